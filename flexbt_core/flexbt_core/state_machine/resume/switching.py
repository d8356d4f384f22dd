# SPDX-License-Identifier: BSD-3-Clause
"""Going on with another machine while states are active, which stay as they are.

FlexBE locks the one active state, stops the run, and begins another one with that state in it.
Here the switch is one step of the run, in which nothing else can happen: no lock is needed, any number of states stays,
and no callback of those is called. When it cannot be, the run goes on as before.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from flexbt_core.state_machine.engine.container import ContainerRun
from flexbt_core.state_machine.engine.leaf import LeafRun
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition
from flexbt_core.state_machine.model.userdata import Scope

from .position import Position
from .restoring import reasons_against, restore


def prepare(root: ContainerRun, old: ContainerRun, position: Position) -> str | None:
    """Call on_start of the states of another machine; gives why a run cannot go on with it, if so."""
    known = {node.path for node in root.definition.nodes()}
    reasons = [
        *_in_between(old),
        *reasons_against(root.definition, _without_what_is_gone(position, known)),
        *_changes(root.definition, old.definition, position),
        *_missing_inputs(root.definition, position),
        *(f'{leaf.path}: its state is part of a run already' for leaf in root.leaves() if leaf.state._leaf is not None),
    ]
    if reasons:
        return f'the run cannot go on with that machine: {"; ".join(reasons)}'
    leaves = list(root.leaves())
    for leaf in leaves:
        leaf.bind()
    raised = [leaf.path for leaf in leaves if leaf.start()]
    if raised:
        for leaf in leaves:
            leaf.stop()
        return f'the run cannot go on with that machine: {", ".join(raised)} raised in on_start'
    return None


def move(
    old: ContainerRun, root: ContainerRun, scope: Scope, position: Position, staying: Mapping[str, LeafRun]
) -> None:
    """Put the other machine in the place of the old one, of which ``staying`` are the states that stay."""
    for leaf in old.leaves():
        if leaf.path not in staying:
            leaf.stop()
    known = {node.path for node in root.definition.nodes()}
    restore(root, scope, replace(_without_what_is_gone(position, known), approved=()), staying)


def _in_between(old: ContainerRun) -> Iterator[str]:
    """What is neither active nor left."""
    for region in old.active_regions():
        if region.child is not None and (region.is_leaving or region.container.ending is not None):
            yield f'{region.child.path} is being left; try again when it is at rest'


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
    for key in new.input_keys:
        if key not in new.defaults and key not in position.userdata[new.path]:
            yield f"nobody has given the input '{key}'"


def _kind(node: StateDefinition | MachineDefinition) -> str:
    return 'a state' if isinstance(node, StateDefinition) else f'a container of kind {node.kind.name}'
