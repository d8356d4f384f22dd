# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is wrong with a machine, found before it runs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from typing import Final

from flexbt_core.state_machine.model import (
    ERROR,
    PREEMPTED,
    ROOT_PATH,
    UNDECLARED,
    Autonomy,
    Child,
    EventState,
    Machine,
    StateKind,
    child_path,
)
from flexbt_core.values import hint

from .condition_check import problems_of_conditions

RESERVED: Final = (PREEMPTED, ERROR)


def problems_of(root: Machine) -> Iterator[str]:
    """What is wrong with a machine and everything in it, in the order of the states."""
    yield from _reserved(ROOT_PATH, root.outcomes)
    yield from _keys(ROOT_PATH, root)
    yield from _machine(root, ROOT_PATH, {id(root): ROOT_PATH})


def _machine(machine: Machine, path: str, seen: dict[int, str]) -> Iterator[str]:
    if not machine.children:
        yield f'{path}: the machine has no states'
    if not machine.outcomes:
        yield f'{path}: the machine has no outcomes'
    labels: set[str] = set()
    for child in machine.children:
        own = child_path(path, child.label)
        yield from _label(own, child.label, labels, machine)
        labels.add(child.label)
        state = child.state.unwrapped if isinstance(child.state, EventState) else child.state
        if id(state) in seen:
            yield f'{own}: the same state object is also {seen[id(state)]}; make one for each place'
            continue
        seen[id(state)] = own
        yield from _transitions(own, child, machine)
        yield from _keys(own, child.state)
        yield from _remapping(own, child)
    if machine.kind is StateKind.CONCURRENCY:
        yield from problems_of_conditions(path, machine)
    else:
        yield from _reachability(path, machine)
    yield from _data_flow(path, machine)
    for child in machine.children:
        own = child_path(path, child.label)
        if not isinstance(child.state, EventState) and seen.get(id(child.state)) == own:
            yield from _machine(child.state, own, seen)


def _label(own: str, label: str, labels: Collection[str], machine: Machine) -> Iterator[str]:
    if not label or '/' in label or label != label.strip():
        yield f"{own}: '{label}' cannot be a label: it is empty, contains '/', or begins or ends with a blank"
    if label in labels:
        yield f"{own}: the label '{label}' is used twice"
    if label in machine.outcomes:
        yield f"{own}: '{label}' is both a state and an outcome of its machine, so that a transition to it is ambiguous"


def _keys(path: str, owner: EventState | Machine) -> Iterator[str]:
    for key in dict.fromkeys((*owner.input_keys, *owner.output_keys)):
        if not key or key.startswith('_'):
            yield f"{path}: '{key}' cannot be a userdata key: it is empty or begins with an underscore"


def _reserved(path: str, outcomes: Collection[str]) -> Iterator[str]:
    for outcome in outcomes:
        if outcome in RESERVED:
            yield f"{path}: the outcome '{outcome}' is reserved for runs that were stopped or failed; rename it"


def _transitions(own: str, child: Child, machine: Machine) -> Iterator[str]:
    outcomes = child.state.outcomes
    is_concurrent = machine.kind is StateKind.CONCURRENCY
    targets = [*(sibling.label for sibling in machine.children if not is_concurrent), *machine.outcomes]
    for outcome in outcomes:
        if outcome not in child.transitions and not is_concurrent:
            yield f"{own}: the outcome '{outcome}' leads nowhere; add it to transitions"
    for outcome, target in child.transitions.items():
        if outcome not in outcomes:
            yield f"{own}: transition of '{outcome}', which is no outcome of it{hint(outcome, outcomes)}"
        if target not in targets:
            what = 'no outcome of the container' if is_concurrent else 'neither a state nor an outcome of the machine'
            yield f"{own}: the outcome '{outcome}' leads to '{target}', which is {what}{hint(target, targets)}"
    for outcome, level in child.autonomy.items():
        if outcome not in outcomes:
            yield f"{own}: autonomy of '{outcome}', which is no outcome of it{hint(outcome, outcomes)}"
        if not (isinstance(level, int) and UNDECLARED <= level <= Autonomy.Full):
            yield f"{own}: autonomy {level!r} of '{outcome}' is none of the levels Off 0, Low 1, High 2, Full 3"


def _remapping(own: str, child: Child) -> Iterator[str]:
    keys = {*child.state.input_keys, *child.state.output_keys}
    for key in child.remapping:
        if key not in keys:
            yield f"{own}: remaps '{key}', which is none of its keys{hint(key, keys)}"


def _reachability(path: str, machine: Machine) -> Iterator[str]:
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
            yield f'{child_path(path, child.label)}: no transition leads to it from the initial state'


def _read_inputs(node: EventState | Machine, around: tuple[Machine, ...] = ()) -> Iterable[str]:
    """The input keys that have to be given: of a machine, those that something in it reads, or that it hands out."""
    if isinstance(node, EventState) or node in around:  # a machine in itself is told elsewhere
        return node.input_keys
    read, written = set[str](), set[str]()
    for child in node.children:
        read.update(child.remapping.get(key, key) for key in _read_inputs(child.state, (*around, node)))
        written.update(child.remapping.get(key, key) for key in child.state.output_keys)
    read.update(key for key in node.output_keys if key not in written)
    return [key for key in node.input_keys if key in read]


def _data_flow(path: str, machine: Machine) -> Iterator[str]:
    written = {*machine.input_keys, *(machine.userdata.values())}
    for child in machine.children:
        written.update(child.remapping.get(key, key) for key in child.state.output_keys)
    for child in machine.children:
        optional = child.state.userdata.values() if not isinstance(child.state, EventState) else {}
        for key in _read_inputs(child.state):
            name = child.remapping.get(key, key)
            if name not in written and key not in optional:
                shown = f"'{key}'" if name == key else f"'{key}' (remapped to '{name}')"
                yield (
                    f'{child_path(path, child.label)}: reads userdata key {shown}; no state of {path} writes it, and '
                    f'it is neither an input nor a default of the machine{hint(name, written)}'
                )
    for key in machine.output_keys:
        if key not in written:
            yield f"{path}: the output key '{key}' of the machine is written by none of its states{hint(key, written)}"
