# SPDX-License-Identifier: BSD-3-Clause
"""Rules for suspicious parts of a state machine that the engine accepts.

A machine is treated as a graph: its states and outcomes are the nodes, the transitions are the edges.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Final

from flexbt_core.skills.skill import OutcomeClass, usual_outcome_class
from flexbt_core.state_machine.authoring.data_flow import KeyRead, lost_writes, races, unsure_reads
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition, StateKind, Transition
from flexbt_core.state_machine.model.event_state import state_skill

from .findings import (
    ALWAYS_ASKS,
    CROSSED_WAYS,
    DEAD_OUTCOME,
    ENDLESS_LOOP,
    LOST_WRITE,
    NO_END,
    UNHEARD,
    UNSURE_READ,
    WRITE_RACE,
    Finding,
)

MachineNode = StateDefinition | MachineDefinition

MachineGraph = Mapping[str, Iterable[str]]
"""Targets of the edges of each node."""


def machine_findings(machine: MachineDefinition) -> Iterator[Finding]:
    """Yield the findings for a machine and everything in it."""
    for node in machine.nodes():
        yield from _always_asks(node)
        if isinstance(node, MachineDefinition) and node.kind is StateKind.CONCURRENCY:
            yield from _never(node, {condition.outcome for condition in node.conditions})
            yield from _unheard(node)
        elif isinstance(node, MachineDefinition):
            yield from _ends(node)
            yield from _endless_loops(node)
            yield from _crossed_ways(node)
    for read in unsure_reads(machine):
        yield Finding(UNSURE_READ, read.path, f'{_shown(read)} is not written on every way that leads here')
    for race in races(machine):
        message = f'userdata key {race.name!r} is written by {" and ".join(race.writers)}: it is chance who is the last'
        yield Finding(WRITE_RACE, race.path, message)
    for lost in lost_writes(machine):
        message = (
            f'writes userdata key {lost.name!r}, which {lost.reader} reads outside, and it is not an output key of '
            f'{lost.machine}: what is written here does not get there'
        )
        yield Finding(LOST_WRITE, lost.path, message)


def _shown(read: KeyRead) -> str:
    writers = f' ({" or ".join(read.writers)} writes it)' if read.writers else ''
    remapped = f' (remapped to {read.name!r})' if read.name != read.key else ''
    return f'userdata key {read.key!r}{remapped}{writers}'


def _always_asks(node: MachineNode) -> Iterator[Finding]:
    """Yield success outcomes that need the operator at every level.

    Failures and decisions are exempt: for them this is the purpose of Full.
    """
    for outcome in _outcomes_of(node, _SUCCESSES):
        transition = node.transitions.get(outcome)
        if transition is not None and transition.autonomy >= Autonomy.Full:
            message = (
                f"outcome '{outcome}' requires autonomy Full, and passes only at a level above it: there is none, so "
                'the operator is always asked'
            )
            yield Finding(ALWAYS_ASKS, node.path, message)


def _ends(machine: MachineDefinition) -> Iterator[Finding]:
    """Yield states from which the machine cannot end, and outcomes that it never reaches."""
    ways = {label: {_target(transition) for transition in child.transitions.values()}
            for label, child in machine.children.items()}  # fmt: skip
    reached = _reachable({machine.initial}, ways)
    back: dict[str, set[str]] = {}
    for label, targets in ways.items():
        for target in targets:
            back.setdefault(target, set()).add(label)
    ending = _reachable({f'={outcome}' for outcome in machine.outcomes}, back)
    stuck = [label for label in machine.children if label not in ending]
    if len(stuck) == len(machine.children):
        yield Finding(NO_END, machine.path, 'it cannot end: no transition leads to one of its outcomes')
    else:
        for label in stuck:
            message = f'once here, {machine.path} cannot end any more: no way leads to one of its outcomes'
            yield Finding(NO_END, machine.children[label].path, message)
        yield from _never(machine, {target.removeprefix('=') for target in reached if target.startswith('=')})


def _never(machine: MachineDefinition, outcomes: Collection[str]) -> Iterator[Finding]:
    for outcome in machine.outcomes:
        if outcome not in outcomes:
            yield Finding(DEAD_OUTCOME, machine.path, f"it never ends by its outcome '{outcome}'")


_SUCCESSES: Final = (OutcomeClass.COMPLETED,)
_FAILURES: Final = (OutcomeClass.FAILED, OutcomeClass.TIMED_OUT)
_OF_FAILURE: Final = re.compile(r'recover|abort|error|fail', re.IGNORECASE)
"""Pattern of the names of states that handle failures."""


def _outcomes_of(node: MachineNode, classes: Collection[OutcomeClass]) -> list[str]:
    """Return the outcomes of a state or machine that belong to one of these classes."""
    if isinstance(node, MachineDefinition):
        return [outcome for outcome in node.outcomes if usual_outcome_class(outcome) in classes]
    skill = state_skill(node.state)
    return [name for name, outcome in skill.outcomes.items() if name in node.outcomes and outcome.kind in classes]


def _unheard(container: MachineDefinition) -> Iterator[Finding]:
    """Yield failures of children that no condition covers."""
    heard = {pair for condition in container.conditions for pair in condition.children}
    for label, child in container.children.items():
        for outcome in _outcomes_of(child, _FAILURES):
            if (label, outcome) not in heard:
                message = f'when it ends by {outcome!r}, {container.path} continues: no condition is about that'
                yield Finding(UNHEARD, child.path, message)


def _crossed_ways(machine: MachineDefinition) -> Iterator[Finding]:
    """Yield states whose success leads to a failure while their failure does not."""
    for child in machine.children.values():
        good = [child.transitions[one] for one in _outcomes_of(child, _SUCCESSES)]
        bad = [child.transitions[one] for one in _outcomes_of(child, _FAILURES)]
        if not good or not bad:
            continue
        ends_well = any(usual_outcome_class(one.outcome or '') in _SUCCESSES for one in bad)
        ends_badly = any(usual_outcome_class(one.outcome or '') in _FAILURES for one in good)
        to_failure = [_OF_FAILURE.search(one.state or '') for one in good]
        from_failure = [one.state and not _OF_FAILURE.search(one.state) for one in bad]
        if (ends_badly and ends_well) or (all(to_failure) and (ends_well or all(from_failure))):
            shown = ', '.join(f'{outcome} -> {_target(way)}' for outcome, way in child.transitions.items())
            yield Finding(CROSSED_WAYS, child.path, f'success leads where failure should: {shown}')


def _endless_loops(machine: MachineDefinition) -> Iterator[Finding]:
    """Yield loops of states that finish immediately, through transitions that pass at the level Low."""
    ways = {
        label: {
            transition.state
            for transition in child.transitions.values()
            if transition.state is not None and transition.autonomy <= Autonomy.Off
        }
        for label, child in machine.children.items()
        if isinstance(child, StateDefinition) and child.state.is_instant
    }
    for loop in _loops(ways):
        path = machine.children[loop[0]].path
        shown = ' -> '.join([*loop, loop[0]])
        message = f'{shown} waits neither for the operator nor for a time nor for the world'
        yield Finding(ENDLESS_LOOP, path, message)


def _target(transition: Transition) -> str:
    return transition.state if transition.state is not None else f'={transition.outcome}'


def _reachable(starts: Iterable[str], ways: MachineGraph) -> set[str]:
    reached: set[str] = set()
    ahead = list(starts)
    while ahead:
        node = ahead.pop()
        if node not in reached:
            reached.add(node)
            ahead.extend(ways.get(node, ()))
    return reached


def _loops(ways: MachineGraph) -> Iterator[list[str]]:
    """Yield one loop for each set of nodes that can all reach each other, in the order of the nodes."""
    done: set[str] = set()
    for start in ways:
        if start in done:
            continue
        loop = _way_back(start, ways)
        if loop:
            around = _reachable(ways[start], ways)
            done |= {node for node in around if start in _reachable(ways.get(node, ()), ways)}
            yield loop


def _way_back(start: str, ways: MachineGraph) -> list[str]:
    """Return a shortest path from a node back to itself; empty if none exists."""
    before: dict[str, str] = {}
    ahead = [start]
    for node in ahead:
        for target in sorted(ways.get(node, ())):
            if target == start:
                way = [node]
                while way[-1] != start:
                    way.append(before[way[-1]])
                return way[::-1]
            if target in ways and target not in before:
                before[target] = node
                ahead.append(target)
    return []
