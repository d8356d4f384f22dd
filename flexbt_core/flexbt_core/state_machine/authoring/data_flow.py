# SPDX-License-Identifier: BSD-3-Clause
"""Data-flow analysis of userdata on the graph of states: which states write a key before another state reads it.

The analysis assumes that a state writes all keys that it declares, with every outcome. A machine writes the output
keys that its states write on a path to the outcome. It has its declared inputs from the beginning; the check of the
parent machine finds out whether they were written.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition, StateKind
from flexbt_core.state_machine.model.userdata import MachineProblem

StateOrMachine = StateDefinition | MachineDefinition
Keys = frozenset[str]

_NOTHING: Keys = frozenset()


@dataclass(frozen=True, slots=True)
class WrittenKeys:
    """The keys written on at least one path to a point, and the keys written on every path."""

    may: Keys = _NOTHING
    must: Keys = _NOTHING

    def then(self, other: WrittenKeys) -> WrittenKeys:
        """Return the keys written on this path followed by ``other``."""
        return WrittenKeys(self.may | other.may, self.must | other.must)

    def beside(self, other: WrittenKeys) -> WrittenKeys:
        """Return the keys written where this path and ``other`` meet."""
        return WrittenKeys(self.may | other.may, self.must & other.must)


@dataclass(frozen=True, slots=True)
class KeyRead:
    """A key that ``path`` reads as ``key``; its machine calls it ``name``, and ``writers`` write it there."""

    path: str
    key: str
    name: str
    writers: tuple[str, ...]

    @property
    def text(self) -> str:
        """The read, as in a message about the state."""
        shown = f"'{self.key}'" if self.name == self.key else f"'{self.key}' (remapped to '{self.name}')"
        return f'reads userdata key {shown}'


@dataclass(frozen=True, slots=True)
class WriteRace:
    """A key of the concurrency container ``path`` that several children (``writers``) write; ``states`` are the states
    in them that do."""

    path: str
    name: str
    writers: tuple[str, ...]
    states: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LostWrite:
    """A key ``name`` that ``path`` writes in ``machine``, while its ``reader`` outside does not get it as an output."""

    path: str
    name: str
    machine: str
    reader: str


def problems_of_reads(machine: MachineDefinition) -> Iterator[MachineProblem]:
    """Yield the reads of keys that no path to the state writes."""
    for read in _reads(machine, is_sure=False):
        text = f'{read.text}; only {" and ".join(read.writers)} writes it, and no way leads from there to here'
        yield MachineProblem(read.path, text, ('remapping', read.key), is_value=True)


def unsure_reads(machine: MachineDefinition) -> list[KeyRead]:
    """Return the reads of keys that some paths to the state do not write. They may still be correct."""
    never = set(_reads(machine, is_sure=False))
    return [read for read in _reads(machine, is_sure=True) if read not in never]


def races(machine: MachineDefinition) -> Iterator[WriteRace]:
    """Yield the keys whose last writer depends on timing, if they may be read afterwards."""
    for node in machine.nodes():
        if isinstance(node, MachineDefinition) and node.kind is StateKind.CONCURRENCY:
            yield from _races_in(node)


def lost_writes(machine: MachineDefinition) -> Iterator[LostWrite]:
    """Yield the keys written in a machine that are neither read there nor output, while a state outside reads a key
    of the same name."""
    for child in machine.children.values():
        if not isinstance(child, MachineDefinition):
            continue
        yield from lost_writes(child)
        inside = {one.remap.get(key, key) for one in child.children.values() for key in _declared_inputs(one)}
        kept = {name for one in child.children.values() for name in _names(one)} - {*child.output_keys, *inside}
        readers = {
            one.remap.get(key, key): one.path
            for one in reversed(list(machine.children.values()))
            if one is not child
            for key in _declared_inputs(one)
        }
        for name in sorted(kept):
            reader = readers.get(name) or (machine.path if name in machine.output_keys else '')
            if reader:
                writer = next(one.path for one in child.children.values() if name in _names(one))
                yield LostWrite(writer, name, child.path, reader)


def _races_in(container: MachineDefinition) -> Iterator[WriteRace]:
    read = {child.remap.get(key, key) for child in container.children.values() for key in _declared_inputs(child)}
    writers: dict[str, dict[str, list[str]]] = {}
    for child in container.children.values():
        for name, state in sorted(_state_writes(child)):
            writers.setdefault(name, {}).setdefault(child.path, []).append(state)
    for name, states in writers.items():
        if len(states) > 1 and (name in read or name in container.output_keys):
            yield WriteRace(container.path, name, tuple(states), tuple(chain.from_iterable(states.values())))


def _state_writes(node: StateOrMachine) -> Iterator[tuple[str, str]]:
    """Yield each key that a child writes, by its name in the parent, with the state that writes it. Defaults do not
    race: they are written first."""
    if isinstance(node, StateDefinition):
        yield from ((name, node.path) for name in _names(node))
        return
    for child in node.children.values():
        for name, state in _state_writes(child):
            if name in node.output_keys:
                yield node.remap.get(name, name), state


def _declared_inputs(node: StateOrMachine) -> Iterable[str]:
    return node.state.input_keys if isinstance(node, StateDefinition) else node.input_keys


def _reads(machine: MachineDefinition, *, is_sure: bool) -> Iterator[KeyRead]:
    given = {*machine.input_keys, *machine.defaults}
    for label, written in _on_entry(machine, _effects_of_children(machine)).items():
        child = machine.children[label]
        known = given | (written.must if is_sure else written.may)
        for key in _input_keys(child):
            name = child.remap.get(key, key)
            if name not in known:
                writers = tuple(other.path for other in machine.children.values() if name in _names(other))
                yield KeyRead(child.path, key, name, writers)
        if isinstance(child, MachineDefinition):
            yield from _reads(child, is_sure=is_sure)


def _input_keys(node: StateOrMachine) -> Iterator[str]:
    """Return the keys that need a value. A machine needs no key that has a default or that nothing in it reads."""
    if isinstance(node, StateDefinition):
        yield from node.state.input_keys
    else:
        yield from (key for key in node.read_inputs if key not in node.defaults)


def _names(node: StateOrMachine, among: Container[str] | None = None) -> set[str]:
    """Return the keys that a child may write, by their names in the parent; ``among`` restricts its own names."""
    keys = node.state.output_keys if isinstance(node, StateDefinition) else node.output_keys
    return {node.remap.get(key, key) for key in keys if among is None or key in among}


_Effects = Mapping[str, Mapping[str, WrittenKeys]]
"""The keys that each child of a machine writes, by its label and its outcome."""


def _effects_of_children(machine: MachineDefinition) -> _Effects:
    return {label: _effects(child) for label, child in machine.children.items()}


def _on_entry(machine: MachineDefinition, effects: _Effects) -> dict[str, WrittenKeys]:
    """Return, for each child, the keys that are written when the child is entered, since the machine was entered."""
    if machine.kind is StateKind.CONCURRENCY:
        return dict.fromkeys(machine.children, WrittenKeys(_ever_written(machine)))
    found = {machine.initial: WrittenKeys()}
    ahead = OrderedDict.fromkeys([machine.initial])  # first in, first out: where ways meet, all have come by then
    while ahead:
        label, _ = ahead.popitem(last=False)
        for outcome, effect in effects[label].items():
            target = machine.children[label].transitions[outcome].state
            if target is not None:
                after = found[label].then(effect)
                before = found.get(target)
                now = after if before is None else before.beside(after)
                if now != before:
                    found[target] = now
                    ahead[target] = None
    return found


def _effects(node: StateOrMachine) -> dict[str, WrittenKeys]:
    """Return, for each outcome of a child, the keys that it writes, by their names in the parent."""
    if isinstance(node, StateDefinition):
        names = frozenset(_names(node))
        return dict.fromkeys(node.outcomes, WrittenKeys(names, names))
    outwards = {key: node.remap.get(key, key) for key in node.output_keys}
    defaults = frozenset(node.defaults)  # they are written when the machine is entered
    begun = WrittenKeys(defaults, defaults)
    return {outcome: _renamed(begun.then(written), outwards) for outcome, written in _at_end(node).items()}


def _at_end(machine: MachineDefinition) -> dict[str, WrittenKeys]:
    """Return, for each outcome by which a machine can end, the keys that are written in it."""
    effects = _effects_of_children(machine)
    ends: dict[str, WrittenKeys] = {}
    if machine.kind is StateKind.CONCURRENCY:
        may = _ever_written(machine)
        for condition in machine.conditions:
            ended = [effects[label].get(outcome, WrittenKeys()) for label, outcome in condition.children]
            here = WrittenKeys(may, frozenset(key for written in ended for key in written.must))
            before = ends.get(condition.outcome)
            ends[condition.outcome] = here if before is None else before.beside(here)
        return ends
    for label, written in _on_entry(machine, effects).items():
        for outcome, effect in effects[label].items():
            end = machine.children[label].transitions[outcome].outcome
            if end is not None:
                at_end = written.then(effect)
                ends[end] = ends[end].beside(at_end) if end in ends else at_end
    return ends


def _ever_written(machine: MachineDefinition) -> Keys:
    """Return the keys that the children of a machine may write, also those that never end."""
    inside = {
        label: {*child.defaults, *_ever_written(child)}
        for label, child in machine.children.items()
        if isinstance(child, MachineDefinition)
    }
    return frozenset(name for label, child in machine.children.items() for name in _names(child, inside.get(label)))


def _renamed(written: WrittenKeys, names: Mapping[str, str]) -> WrittenKeys:
    may = frozenset(names[key] for key in written.may if key in names)
    return WrittenKeys(may, frozenset(names[key] for key in written.must if key in names))
