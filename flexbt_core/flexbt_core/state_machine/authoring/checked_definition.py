# SPDX-License-Identifier: BSD-3-Clause
"""Turn a machine as written into a checked definition that can run; ``define`` reports all problems at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from types import MappingProxyType
from typing import Final, TypeVar

from flexbt_core.state_machine.model.autonomy import UNDECLARED, Autonomy, no_level
from flexbt_core.state_machine.model.definition import (
    ERROR,
    PREEMPTED,
    ROOT_PATH,
    Child,
    EndCondition,
    Machine,
    MachineDefinition,
    StateDefinition,
    StateKind,
    Transition,
    child_path,
)
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError, MachineProblem
from flexbt_core.values.text import did_you_mean

from .data_flow import problems_of_reads

_Key = TypeVar('_Key')
_Value = TypeVar('_Value')


MAX_PROBLEMS: Final = 200
"""Maximum number of problems of a machine that are reported."""


def define(machine: Machine) -> MachineDefinition:
    """Check a whole machine and return its definition.

    Raises:
        MachineError: the machine has problems; the error lists all of them, up to MAX_PROBLEMS.
    """
    problems = list(islice(problems_of(machine), MAX_PROBLEMS))
    if problems:
        raise MachineError(problems)
    definition = _define(machine, ROOT_PATH, '', {}, {})
    unwritten = list(problems_of_reads(definition))
    if unwritten:
        raise MachineError(unwritten)
    return definition


def _define(
    machine: Machine,
    path: str,
    label: str,
    transitions: Mapping[str, Transition],
    remap: Mapping[str, str],
) -> MachineDefinition:
    children: dict[str, StateDefinition | MachineDefinition] = {}
    labels = {child.label for child in machine.children}
    for child in machine.children:
        own = child_path(path, child.label)
        ways = {outcome: _transition(machine, labels, child, outcome) for outcome in child.state.outcomes}
        if isinstance(child.state, Machine):
            children[child.label] = _define(child.state, own, child.label, ways, child.remapping)
        else:
            children[child.label] = StateDefinition(
                own, child.label, child.state, _fixed(ways), _fixed(child.remapping)
            )
    return MachineDefinition(
        path=path,
        label=label,
        outcomes=machine.outcomes,
        input_keys=machine.input_keys,
        output_keys=machine.output_keys,
        defaults=_fixed(machine.userdata.values()),
        children=_fixed(children),
        initial=machine.children[0].label,
        transitions=_fixed(transitions),
        remap=_fixed(remap),
        type_name=type(machine).__name__,
        kind=machine.kind,
        conditions=machine.conditions,
    )


def _transition(machine: Machine, labels: set[str], child: Child, outcome: str) -> Transition:
    target = child.transitions.get(outcome)
    if machine.kind is StateKind.CONCURRENCY and target is None:  # drawn to the outcome of its condition
        ended = child.label, outcome
        target = next((one.outcome for one in machine.conditions if ended in one.children), None)
    level = child.autonomy.get(outcome, machine.autonomy)
    return Transition(target, None, level) if target in labels else Transition(None, target, level)


def _fixed(mapping: Mapping[_Key, _Value]) -> Mapping[_Key, _Value]:
    return MappingProxyType(dict(mapping))


# Problems of a machine, found before it runs.

RESERVED: Final = (PREEMPTED, ERROR)


def problems_of(root: Machine) -> Iterator[MachineProblem]:
    """Yield the problems of a machine and of all its descendants, in the order of the states."""
    yield from _reserved(ROOT_PATH, root.outcomes)
    yield from _keys(ROOT_PATH, root)
    yield from _machine(root, ROOT_PATH, {id(root): ROOT_PATH})


def _machine(machine: Machine, path: str, seen: dict[int, str]) -> Iterator[MachineProblem]:
    if not machine.children:
        yield MachineProblem(path, 'the machine has no states', ('states',))
    if not machine.outcomes:
        yield MachineProblem(path, 'the machine has no outcomes', ('outcomes',))
    if not _is_level(machine.autonomy):
        yield MachineProblem(path, no_level(machine.autonomy), ('autonomy',), is_value=True)
    labels: set[str] = set()
    is_concurrent = machine.kind is StateKind.CONCURRENCY
    targets = dict.fromkeys([*(child.label for child in machine.children if not is_concurrent), *machine.outcomes])
    for child in machine.children:
        own = child_path(path, child.label)
        yield from _label(own, child.label, labels, machine)
        labels.add(child.label)
        state = child.state.unwrapped if isinstance(child.state, EventState) else child.state
        if id(state) in seen:
            yield MachineProblem(own, f'the same state object is also {seen[id(state)]}; make one for each place')
            continue
        seen[id(state)] = own
        yield from _transitions(own, child, targets, is_concurrent=is_concurrent)
        yield from _keys(own, child.state)
        yield from _remapping(own, child)
    if is_concurrent:
        yield from problems_of_conditions(path, machine)
    else:
        yield from _reachability(path, machine)
    yield from _data_flow(path, machine)
    for child in machine.children:
        own = child_path(path, child.label)
        if not isinstance(child.state, EventState) and seen.get(id(child.state)) == own:
            yield from _machine(child.state, own, seen)


def _label(own: str, label: str, labels: Collection[str], machine: Machine) -> Iterator[MachineProblem]:
    if not label or '/' in label or label != label.strip():
        text = f"'{label}' cannot be a label: it is empty, contains '/', or begins or ends with a blank"
        yield MachineProblem(own, text)
    if label in labels:
        yield MachineProblem(own, f"the label '{label}' is used twice")
    if label in machine.outcomes:
        text = f"'{label}' is both a state and an outcome of its machine, so that a transition to it is ambiguous"
        yield MachineProblem(own, text)


def _keys(path: str, owner: EventState | Machine) -> Iterator[MachineProblem]:
    for key in dict.fromkeys((*owner.input_keys, *owner.output_keys)):
        if not key or key.startswith('_'):
            yield MachineProblem(path, f"'{key}' cannot be a userdata key: it is empty or begins with an underscore")


def _reserved(path: str, outcomes: Collection[str]) -> Iterator[MachineProblem]:
    for outcome in outcomes:
        if outcome in RESERVED:
            text = f"the outcome '{outcome}' is reserved for runs that were stopped or failed; rename it"
            yield MachineProblem(path, text, ('outcomes', outcome))


def _transitions(own: str, child: Child, targets: Collection[str], *, is_concurrent: bool) -> Iterator[MachineProblem]:
    outcomes = child.state.outcomes
    for outcome in outcomes:
        if outcome not in child.transitions and not is_concurrent:
            yield MachineProblem(own, f"the outcome '{outcome}' leads nowhere; add it to transitions", ('transitions',))
    for outcome, target in child.transitions.items():
        place = 'transitions', outcome
        if outcome not in outcomes:
            near = did_you_mean(outcome, outcomes)
            yield MachineProblem(own, f"transition of '{outcome}', which is not an outcome of it{near}", place)
        if target not in targets:
            what = (
                'not an outcome of the container' if is_concurrent else 'neither a state nor an outcome of the machine'
            )
            near = did_you_mean(target, targets)
            text = f"the outcome '{outcome}' leads to '{target}', which is {what}{near}"
            yield MachineProblem(own, text, place, is_value=True)
    for outcome, level in child.autonomy.items():
        place = 'autonomy', outcome
        if outcome not in outcomes:
            near = did_you_mean(outcome, outcomes)
            yield MachineProblem(own, f"autonomy of '{outcome}', which is not an outcome of it{near}", place)
        if not _is_level(level):
            text = f"autonomy {level!r} of '{outcome}' is none of the levels Off 0, Low 1, High 2, Full 3"
            yield MachineProblem(own, text, place, is_value=True)


def _is_level(level: object) -> bool:
    return isinstance(level, int) and UNDECLARED <= level <= Autonomy.Full


def _remapping(own: str, child: Child) -> Iterator[MachineProblem]:
    keys = {*child.state.input_keys, *child.state.output_keys}
    for key in child.remapping:
        if key not in keys:
            text = f"remaps '{key}', which is none of its keys{did_you_mean(key, keys)}"
            yield MachineProblem(own, text, ('remapping', key))


def _reachability(path: str, machine: Machine) -> Iterator[MachineProblem]:
    ways = {child.label: set(child.transitions.values()) for child in machine.children}
    if not machine.children:
        return
    reached: set[str] = set()
    open_ends = [machine.children[0].label]
    while open_ends:
        label = open_ends.pop()
        if label in reached or label not in ways:
            continue
        reached.add(label)
        open_ends.extend(ways[label])
    for child in machine.children:
        if child.label not in reached:
            yield MachineProblem(child_path(path, child.label), 'no transition leads to it from the initial state')


def _read_inputs(node: EventState | Machine, around: tuple[Machine, ...] = ()) -> Iterable[str]:
    """Return the input keys that need a value. For a machine: those that one of its states reads or that it outputs."""
    if isinstance(node, EventState) or node in around:  # a machine inside itself is reported elsewhere
        return node.input_keys
    read, written = set[str](), set[str]()
    for child in node.children:
        read.update(child.remapping.get(key, key) for key in _read_inputs(child.state, (*around, node)))
        written.update(child.remapping.get(key, key) for key in child.state.output_keys)
    read.update(key for key in node.output_keys if key not in written)
    return [key for key in node.input_keys if key in read]


def _data_flow(path: str, machine: Machine) -> Iterator[MachineProblem]:
    written = {*machine.input_keys, *(machine.userdata.values())}
    for child in machine.children:
        written.update(child.remapping.get(key, key) for key in child.state.output_keys)
    for child in machine.children:
        optional = child.state.userdata.values() if not isinstance(child.state, EventState) else {}
        for key in _read_inputs(child.state):
            name = child.remapping.get(key, key)
            if name not in written and key not in optional:
                shown = f"'{key}'" if name == key else f"'{key}' (remapped to '{name}')"
                text = (
                    f'reads userdata key {shown}; no state of {path} writes it, and '
                    f'it is neither an input nor a default of the machine{did_you_mean(name, written)}'
                )
                yield MachineProblem(child_path(path, child.label), text, ('remapping', key), is_value=True)
    for key in machine.output_keys:
        if key not in written:
            near = did_you_mean(key, written)
            text = f"the output key '{key}' of the machine is written by none of its states{near}"
            yield MachineProblem(path, text, ('output_keys', key))


# Problems of the conditions of a concurrency container that would keep it from ending as intended.

_SEARCHED: Final = 20_000
"""Maximum number of checked combinations of outcomes; a run detects problems in the others."""

_SEARCHED_CHILDREN: Final = 200
"""Maximum number of children whose outcomes are combined."""


def problems_of_conditions(path: str, container: Machine) -> Iterator[MachineProblem]:
    """Yield the problems of the conditions."""
    problems = list(_names(path, container))
    yield from problems
    if not container.conditions:
        text = 'the concurrency container has no conditions, so that it could never end'
        yield MachineProblem(path, text, ('conditions',))
    elif not problems:
        possible = {child.label: outcomes_of(child.state) for child in container.children}
        ended = _uncovered(possible, container.conditions)
        if ended is not None:
            shown = ', '.join(f'{label} by {outcome!r}' for label, outcome in ended.items())
            text = f'when its children have ended {shown}, no condition holds; add one for that'
            yield MachineProblem(path, text, ('conditions',))


def _names(path: str, container: Machine) -> Iterator[MachineProblem]:
    children = {child.label: child.state.outcomes for child in container.children}
    for index, condition in enumerate(container.conditions):
        what, place = f'condition {index + 1}, of {condition.outcome!r},', ('conditions', index)
        if condition.outcome not in container.outcomes:
            text = f'{what} is of no outcome of the container{did_you_mean(condition.outcome, container.outcomes)}'
            yield MachineProblem(path, text, (*place, 'outcome'), is_value=True)
        if not condition.children:
            yield MachineProblem(path, f'{what} names no child', place)
        if len(dict(condition.children)) < len(dict.fromkeys(condition.children)):
            yield MachineProblem(path, f'{what} wants two outcomes of one child, so that it never holds', place)
        for label, outcome in condition.children:
            ended = *place, 'when', label
            if label not in children:
                text = f'{what} names {label!r}, which is not a child{did_you_mean(label, children)}'
                yield MachineProblem(path, text, ended)
            elif outcome not in children[label]:
                near = did_you_mean(outcome, children[label])
                text = f'{what} names {outcome!r}, which is not an outcome of {label}{near}'
                yield MachineProblem(path, text, ended, is_value=True)


def outcomes_of(state: EventState | Machine) -> tuple[str, ...]:
    """Return the outcomes by which a state can end, or a machine with its transitions."""
    if isinstance(state, EventState):
        return state.outcomes
    if state.kind is StateKind.CONCURRENCY:
        found = {condition.outcome for condition in state.conditions}
    else:
        children = {child.label: child for child in state.children}
        found, ahead = set(), [child.label for child in state.children[:1]]
        while ahead:
            label = ahead.pop()
            if label not in found:
                found.add(label)
                child = children.get(label)
                if child is not None:
                    ahead += [child.transitions[one] for one in outcomes_of(child.state) if one in child.transitions]
    return tuple(outcome for outcome in state.outcomes if outcome in found)


def _uncovered(possible: Mapping[str, Sequence[str]], conditions: Sequence[EndCondition]) -> dict[str, str] | None:
    """Return outcomes of all children for which no condition holds; None if the search finds none in time."""
    labels = list(possible)
    ended: dict[str, str] = {}
    searched = 0

    def search(left: Sequence[EndCondition]) -> bool:
        """Return whether the choice so far can be completed so that no condition in ``left`` holds."""
        nonlocal searched
        searched += 1
        if searched > _SEARCHED or any(one.holds(ended) for one in left):
            return False
        if len(ended) == len(labels):
            return True
        label = labels[len(ended)]
        for outcome in possible[label]:
            ended[label] = outcome
            if search([one for one in left if dict(one.children).get(label, outcome) == outcome]):
                return True
            del ended[label]
        return False

    return ended if len(labels) <= _SEARCHED_CHILDREN and search(conditions) else None
