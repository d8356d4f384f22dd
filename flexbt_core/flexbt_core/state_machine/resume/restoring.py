# SPDX-License-Identifier: BSD-3-Clause
"""Taking the position of a run, and going on there in another one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from flexbt_core.state_machine.engine import ContainerRun, LeafRun, MachineRun, Node, Region
from flexbt_core.state_machine.model import (
    AUTONOMY_NAMES,
    MachineDefinition,
    Scope,
    StateDefinition,
    StateKind,
    StateMachineError,
)

from .position import Position

_NONE_STAYS: Final[Mapping[str, LeafRun]] = {}


def position_of(run: MachineRun) -> Position:
    """Where a run is, for another one to :func:`start_at`. On its thread, in a call of the observer too."""
    root, controls = run.root, run.controls
    active: list[str] = []
    coming: list[str] = []
    approved: list[str] = []
    wanted: dict[str, str] = {}
    leaving: dict[str, str] = {}
    ended: dict[str, str] = {}
    userdata: dict[str, dict[str, Any]] = {}

    def take(machine: ContainerRun) -> None:
        userdata[machine.path] = machine.scope.values()
        outcome = machine.outcome or machine.ending
        if outcome is not None:
            wanted[machine.path] = outcome
        if machine.ending is not None:
            return  # what is in it was left
        if machine.definition.kind is StateKind.CONCURRENCY:
            ended.update((machine.children[label].path, outcome) for label, outcome in machine.ended.items())
        for region in machine.regions:
            if region.child is not None:
                take_child(region, region.child)
            elif region.coming is not None:
                (active if region.is_resumed else coming).append(region.coming.path)

    def take_child(region: Region, child: Node) -> None:
        active.append(child.path)
        if region.is_leaving:
            leaving[child.path] = child.outcome or ''
            return
        if region.is_approved:
            approved.append(child.path)
        if isinstance(child, ContainerRun):
            take(child)
        elif child.outcome is not None:
            wanted[child.path] = child.outcome

    take(root)
    return Position(
        active=tuple(active),
        coming=tuple(coming),
        wanted=wanted,
        approved=tuple(approved),
        leaving=leaving,
        ended=ended,
        userdata=userdata,
        levels=controls.levels(),
        locked=tuple(sorted(controls.locked)),
        breakpoints=tuple(sorted(controls.breakpoints)),
        is_paused=run.is_paused,
        decisions=tuple(
            {'id': one.id, 'kind': one.kind.name, 'path': one.path, 'outcome': one.outcome, 'prompt': one.prompt}
            for one in run.decisions
        ),
        decision_count=run.decision_count,
    )


def reasons_against(definition: MachineDefinition, position: Position) -> list[str]:
    """Why a machine cannot be at a position; empty when it can."""
    nodes = {node.path: node for node in definition.nodes()}
    return [*_unknown(nodes, position), *_impossible(definition, position)]


def _unknown(nodes: Mapping[str, StateDefinition | MachineDefinition], position: Position) -> Iterator[str]:
    for path in (*position.active, *position.coming, *position.ended, *position.locked, *position.breakpoints):
        if path not in nodes:
            yield f'the machine has no state {path!r}'
    for path, outcome in (*position.wanted.items(), *position.leaving.items(), *position.ended.items()):
        if path in nodes and outcome and outcome not in nodes[path].outcomes:
            yield f'{path} has no outcome {outcome!r}'
    for path, level in position.levels.items():
        if path not in nodes or level not in AUTONOMY_NAMES:
            yield f'there is no level {level} of {path!r}'


def _impossible(machine: MachineDefinition, position: Position) -> Iterator[str]:
    """What does not fit in a machine that is active."""
    here = {*position.active, *position.coming}
    children = [child for child in machine.children.values() if child.path in here]
    is_done = machine.path in position.wanted and not children
    if machine.kind is not StateKind.CONCURRENCY and len(children) != 1 and not is_done:
        found = ', '.join(child.path for child in children) or 'none'
        yield f'one state of {machine.path} has to be active, not {found}'
    for child in children:
        if isinstance(child, MachineDefinition) and child.path in position.active:
            if child.path not in position.leaving:
                yield from _impossible(child, position)
        elif any(path.startswith(f'{child.path}/') for path in here):
            yield f'{child.path} cannot have anything active in it'


def start_at(run: MachineRun, position: Position) -> None:
    """Start a run where another one was.

    Its states are entered again, with ``is_resumed`` set, each in a step of its own; what had been set by the operator
    holds again.

    Raises:
        StateMachineError: it was started before, or the machine cannot be at that position; with the reasons.
        StateError: a state is part of another run, which has not ended.
    """
    if reasons := reasons_against(run.definition, position):
        raise StateMachineError(f'the run cannot go on there: {"; ".join(reasons)}')

    def enter() -> None:
        run.pausing.is_paused = position.is_paused
        run.decision_count = position.decision_count
        run.controls.restore(position.levels, position.locked, position.breakpoints)
        restore(run, position)

    run.start(enter)


def restore(run: MachineRun, position: Position, staying: Mapping[str, LeafRun] = _NONE_STAYS) -> None:
    """Put the machine of a run, of which nothing was entered yet, at a position.

    States come to be entered in steps that follow, but for those that are ``staying``, by their paths.
    """
    _Restoring(position, staying).machine(run.root, run.scope)


class _Restoring:
    def __init__(self, position: Position, staying: Mapping[str, LeafRun]) -> None:
        self._position = position
        self._staying = staying

    def machine(self, machine: ContainerRun, scope: Scope) -> None:
        position = self._position
        scope.restore(position.userdata.get(machine.path, {}))
        machine.activate(scope)
        machine.outcome = position.wanted.get(machine.path)
        is_concurrent = machine.definition.kind is StateKind.CONCURRENCY
        for number, (label, child) in enumerate(machine.children.items()):
            region = machine.regions[number if is_concurrent else 0]
            if child.path in position.active:
                self._child(machine, region, child)
            elif child.path in position.ended and is_concurrent:
                machine.ended[label] = position.ended[child.path]
            elif child.path in position.coming or (is_concurrent and machine.outcome is None):
                region.await_entry(child)

    def _child(self, machine: ContainerRun, region: Region, child: LeafRun | ContainerRun) -> None:
        position = self._position
        outcome = position.wanted.get(child.path)
        left_by = position.leaving.get(child.path)
        if left_by is not None:
            region.child, child.outcome = child, left_by or None
            region.is_leaving = True
            if isinstance(child, ContainerRun):
                child.take_priority()
        elif isinstance(child, ContainerRun):
            region.child = child
            self.machine(child, child.new_scope(machine.scope))
        elif child.path in self._staying:
            region.child = self._stay(machine, child)
        elif outcome is not None:
            region.child = child
            child.restore(machine.scope, outcome)
        else:
            region.await_entry(child, is_resumed=True)
        region.is_approved = child.path in position.approved

    def _stay(self, machine: ContainerRun, replaced: LeafRun) -> LeafRun:
        leaf = self._staying[replaced.path]
        leaf.stay(replaced.definition)
        leaf.move(machine.scope)
        machine.children[leaf.definition.label] = leaf
        return leaf
