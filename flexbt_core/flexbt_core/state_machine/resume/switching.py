# SPDX-License-Identifier: BSD-3-Clause
"""Going on with another machine while states are active, which stay as they are.

FlexBE locks the one active state, stops the run, and begins another one with that state in it.
Here the switch is one step of the run, in which nothing else can happen: no lock is needed, any number of states stays,
and no callback of those is called. When it cannot be, the run goes on as before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from flexbt_core.state_machine.engine import Answer, ContainerRun, LeafRun, MachineRun
from flexbt_core.state_machine.model import MachineDefinition, StateDefinition

from .position import Position
from .restoring import position_of, reasons_against, restore


def switch_machine(run: MachineRun, definition: MachineDefinition, answer: Answer) -> None:
    """Go on with another machine, which has the active states at the same paths. A command, from any thread.

    These are not left and entered for it: the state objects that are active stay, with their userdata, until their
    visit is over. The refusal names each state that cannot stay. on_start and on_stop of all other states are called;
    what waited for the operator is asked again, since it may lead elsewhere now.
    """
    run.command(lambda: _switch(run, definition), answer)


def _switch(run: MachineRun, definition: MachineDefinition) -> str | None:
    old, root, position = run.root, ContainerRun(run, definition), position_of(run)
    known = {node.path for node in definition.nodes()}
    there = _without_what_is_gone(position, known)
    staying = {leaf.path: leaf for leaf in run.active_states()}
    leaves = list(root.leaves())
    reasons = [
        *_in_between(old),
        *reasons_against(definition, there),
        *_changes(definition, old.definition, position),
        *_missing_inputs(definition, position),
        *(f'{leaf.path}: its state is part of a run already' for leaf in leaves if leaf.state.bound_to is not None),
    ]
    if not reasons:
        for leaf in leaves:
            leaf.bind()
        reasons = _raising(leaves)
    if reasons:
        return f'the run cannot go on with that machine: {"; ".join(reasons)}'
    run.go_on_with(root)
    for leaf in old.leaves():
        if leaf.path not in staying:
            leaf.stop()
    restore(run, replace(there, approved=()), staying)
    run.changed()
    return None


def _raising(leaves: Sequence[LeafRun]) -> list[str]:
    """Call on_start of the states of the other machine; when one raises, all of them are stopped again."""
    raised = [leaf.path for leaf in leaves if leaf.start()]
    if raised:
        for leaf in leaves:
            leaf.stop()
    return [f'{", ".join(raised)} raised in on_start'] if raised else []


def _in_between(old: ContainerRun) -> Iterator[str]:
    """What is neither active nor left."""
    for region in old.active_regions():
        if region.child is not None and (region.is_leaving or region.container.is_ending):
            yield f'{region.child.path} is being left; try again when it has halted'


def _without_what_is_gone(position: Position, known: set[str]) -> Position:
    """Without locks, levels and children that have ended of what the other machine does not have."""
    return replace(
        position,
        locked=tuple(path for path in position.locked if path in known),
        breakpoints=tuple(path for path in position.breakpoints if path in known),
        levels={path: level for path, level in position.levels.items() if path in known},
        ended={path: outcome for path, outcome in position.ended.items() if path in known},
    )


def _changes(new: MachineDefinition, old: MachineDefinition, position: Position) -> Iterator[str]:
    """What is active, but another thing in the other machine."""
    others = {node.path: node for node in new.nodes()}
    for node in old.nodes():
        other = others.get(node.path)
        if other is None or (node.path not in position.active and node is not old):
            continue
        if isinstance(node, StateDefinition) and isinstance(other, StateDefinition):
            yield from _changes_of_state(node, other)
        elif isinstance(node, StateDefinition) or isinstance(other, StateDefinition) or node.kind is not other.kind:
            yield f'{node.path} is active, and would be {_kind(other)} instead of {_kind(node)}'


def _changes_of_state(old: StateDefinition, new: StateDefinition) -> Iterator[str]:
    one, other = (f'{type(node.state).__module__}.{type(node.state).__qualname__}' for node in (old, new))
    if one != other:
        yield f'{old.path} is active, and would be of class {other} instead of {one}'
        return
    for what in ('outcomes', 'input_keys', 'output_keys'):
        before, after = set(getattr(old.state, what)), set(getattr(new.state, what))
        if before != after:
            changed = ', '.join(sorted(before ^ after))
            yield f'{old.path} is active, and would have other {what.replace("_", " ")} ({changed})'


def _missing_inputs(new: MachineDefinition, position: Position) -> Iterator[str]:
    for key in new.read_inputs:
        if key not in new.defaults and key not in position.userdata[new.path]:
            yield f"nobody has given the input '{key}'"


def _kind(node: StateDefinition | MachineDefinition) -> str:
    return 'a state' if isinstance(node, StateDefinition) else f'a container of kind {node.kind.name}'
