# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of the strategy of a game to the machine with the fewest states, with its transitions and userdata.

A node without an active capability is skipped. A node where the machine has ended becomes an outcome of the machine. A
state remains active while no outcome arrives. The outcome alone must determine the next state, since a machine sees
nothing else of the world.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from typing import Any, Final

from .capabilities import changed_by
from .errors import SynthesisError
from .formulas import names_in, valuation, value_of
from .request_files import FAILURE_OUTCOMES
from .specification import Section
from .strategy import Strategy, StrategyNode
from .translation import SynthesisProblem

# A synthesized machine: its states, the targets of their outcomes, and the reasons for the states.


@dataclass(frozen=True, slots=True)
class MachinePart:
    """A capability in a state: the state class with its parameters, and the userdata of both."""

    capability: str
    state_class: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    outcomes: tuple[str, ...] = ()
    reads: Mapping[str, str] = field(default_factory=dict)
    writes: Mapping[str, str] = field(default_factory=dict)
    retry_on: tuple[str, ...] = ()

    @property
    def remapping(self) -> dict[str, str]:
        """Keys of the class that have another name in the machine."""
        return {key: name for key, name in {**self.reads, **self.writes}.items() if key != name}


@dataclass(frozen=True, slots=True)
class MachineState:
    """A state. If it has several ``parts``, these are active at once, and ``combinations`` join one outcome of each.

    ``nodes`` are the nodes of the strategy that the state represents, ``holds`` the facts known in all of them.
    """

    name: str
    parts: tuple[MachinePart, ...]
    transitions: Mapping[str, str]
    autonomy: Mapping[str, int]
    nodes: tuple[int, ...] = ()
    holds: tuple[str, ...] = ()
    combinations: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SynthesizedMachine:
    """States by name, in the order in which they are reached; the first one is the initial state.

    ``attempts`` is the maximum number of entries of a state with ``retry_on``. ``keys`` are the userdata keys that must
    exist at the start.
    """

    name: str
    outcomes: tuple[str, ...]
    states: Mapping[str, MachineState]
    attempts: int = 1
    keys: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def initial(self) -> str:
        """The state that begins."""
        return next(iter(self.states))


_LABEL: Final = '%s:%s'
_ASKING: Final = 'start'
"""The state that asks the operator how the world begins."""


@dataclass(frozen=True, slots=True)
class _Place:
    """The activity of a machine in a node: active capabilities, or an outcome that is reached."""

    parts: tuple[MachinePart, ...] = ()
    end: str | None = None

    def __str__(self) -> str:
        return self.end or ' and '.join(part.capability for part in self.parts)


def machine_of(problem: SynthesisProblem, strategy: Strategy) -> SynthesizedMachine:
    """Return the machine with the fewest states that carries out a strategy.

    Raises:
        SynthesisError: an outcome does not tell what comes next, or has no transition; userdata is read that is not
            written on every way there.
    """
    return _Building(problem, strategy).machine()


class _Building:
    def __init__(self, problem: SynthesisProblem, strategy: Strategy) -> None:
        self._problem = problem
        self._words = problem.vocabulary
        self._strategy = strategy
        self._nodes = strategy.nodes
        changed = set().union(*map(changed_by, problem.file.capabilities.values()))
        # What is known: outputs, and what capabilities change of the world.
        self._memory = [
            name
            for name, one in problem.specification.variables.items()
            if not self._words.is_own(name) and (not one.is_input or name.removesuffix('_m') in changed)
        ]
        self._places = [self._place(node) for node in strategy.nodes]
        self._outputs = [self._output(place) for place in self._places]
        self._notes = list(problem.notes)

    def machine(self) -> SynthesizedMachine:
        starts = list(dict.fromkeys(to for number in self._strategy.start for to in self._settled(number)))
        reached, steps = self._reached(starts)
        position = {number: index for index, number in enumerate(reached)}
        edges = [{label: [position[to] for to in targets] for label, targets in step.items()} for step in steps]
        outputs = [
            (self._outputs[number], *(part.retry_on for part in self._places[number].parts)) for number in reached
        ]
        blocks = blocks_of(outputs, edges)
        first = [blocks.index(block) for block in range(max(blocks) + 1)]
        single = [self._told(reached[index], edges[index], blocks, reached) for index in first]
        root = merged([outputs[index] for index in first], single)
        of_block: dict[int, list[int]] = {}
        for index, number in enumerate(reached):
            of_block.setdefault(root[blocks[index]], []).append(number)
        joined = {
            block: {
                label: root[to] for one in range(len(first)) if root[one] == block for label, to in single[one].items()
            }
            for block in of_block
        }
        begins = list(dict.fromkeys(root[blocks[position[number]]] for number in starts))
        return self._built(of_block, joined, begins)

    # -- nodes -------------------------------------------------------------------------------------------------------

    def _place(self, node: StrategyNode) -> _Place:
        ends = self._words.ends_in(node.values)
        if len(ends) > 1:
            raise SynthesisError([f'the machine would end by {" and ".join(ends)} at once: exclude that in SYS_TRANS'])
        if ends:
            return _Place(end=ends[0])
        return _Place(tuple(self._part(name, node) for name in self._words.active_in(node.values)))

    def _part(self, name: str, node: StrategyNode) -> MachinePart:
        capability, interface = self._problem.file.capabilities[name], self._problem.interfaces[name]
        reads, writes = capability.userdata_in, capability.userdata_out
        return MachinePart(
            name,
            capability.interface,
            {key: self._chosen(value, node.values) for key, value in capability.parameters.items()},
            interface.outcomes,
            {key: reads.get(key, key) for key in dict.fromkeys((*(interface.input_keys or ()), *reads))},
            {key: writes.get(key, key) for key in dict.fromkeys((*(interface.output_keys or ()), *writes))},
            tuple(
                one
                for one in interface.outcomes
                if self._is_failing(one) and self._changes_nothing(node, name, self._problem.normalized(one))
            )
            if self._problem.options.retries
            else (),
        )

    def _is_failing(self, outcome: str) -> bool:
        return self._problem.normalized(outcome) != self._problem.hoped

    def _changes_nothing(self, node: StrategyNode, name: str, outcome: str) -> bool:
        """Return whether what is known is the same after an outcome of a capability, so that it may be tried again.
        What others that are active at once change, it does not change itself."""
        others = [one for one in self._words.active_in(node.values) if one != name]
        changed = set().union(*(changed_by(self._problem.file.capabilities[one]) for one in others))
        own = [one for one in self._memory if one.removesuffix('_m') not in changed]
        return all(
            all(self._nodes[to].values[one] == node.values[one] for one in own)
            for inputs, to in node.moves
            if outcome in self._words.arrived_in(inputs, name)
        )

    def _chosen(self, value: Any, values: Mapping[str, int]) -> Any:
        """Return a parameter; ``@variable`` is what the strategy has chosen."""
        if isinstance(value, str) and value.startswith('@') and value[1:] in values:
            number = values[value[1:]]
            return self._problem.file.labels.get(value[1:], {}).get(number, number)
        return value

    def _output(self, place: _Place) -> Hashable:
        return place.end or tuple((part.capability, repr(sorted(part.parameters.items()))) for part in place.parts)

    # -- edges -------------------------------------------------------------------------------------------------------

    def _reached(self, starts: list[int]) -> tuple[list[int], list[dict[str, list[int]]]]:
        """Return the nodes at which the machine may be, and for each where its outcomes lead."""
        reached, steps = list(starts), list[dict[str, list[int]]]()
        for number in reached:
            steps.append(self._steps(number))
            targets = dict.fromkeys(to for targets in steps[-1].values() for to in targets)
            known = set(reached)
            reached += [to for to in targets if to not in known]
        return reached, steps

    def _steps(self, number: int) -> dict[str, list[int]]:
        """Return the next nodes by outcome, or by the combination of outcomes of some of several parts."""
        place = self._places[number]
        targets: dict[str, list[int]] = {}
        waiting = [] if place.end else [number]
        for node in waiting:
            for inputs, to in self._nodes[node].moves:
                label = self._label(place, inputs)
                if label:
                    targets[label] = list(dict.fromkeys([*targets.get(label, ()), *self._settled(to)]))
                    continue
                for then in self._settled(to):
                    if self._outputs[then] != self._outputs[number]:
                        raise SynthesisError(
                            [
                                f'the strategy leaves {place} for {self._places[then]} without an outcome, which no '
                                'machine can: require in SYS_TRANS that an activation stays until its outcome arrives'
                            ]
                        )
                    waiting += [then] if then not in waiting else []
        return targets

    def _label(self, place: _Place, inputs: Mapping[str, int]) -> str:
        return ' & '.join(
            _LABEL % (part.capability, outcome)
            for part in place.parts
            for outcome in self._words.arrived_in(inputs, part.capability)[:1]
        )

    def _settled(self, number: int) -> list[int]:
        """Return the nodes reached at once from a node: itself, or its successors if nothing is active in it."""
        found, seen = list[int](), [number]
        for node in seen:
            place = self._places[node]
            if place.end or place.parts:
                found.append(node)
            else:
                seen += [to for to in dict.fromkeys(to for _, to in self._nodes[node].moves) if to not in seen]
        if not found:
            raise SynthesisError(['the strategy comes to a point from which nothing is ever active again'])
        return found

    def _told(
        self, number: int, step: Mapping[str, list[int]], blocks: list[int], reached: list[int]
    ) -> dict[str, int]:
        """Return the block to which each outcome leads."""
        for label, targets in step.items():
            if len({blocks[to] for to in targets}) > 1:
                one, *others = (self._nodes[reached[to]].values for to in targets)
                inputs = [name.name for name in self._problem.specification.names(inputs=True)]
                told = [name for name in inputs if any(one[name] != other[name] for other in others)]
                raise SynthesisError(
                    [
                        f"after '{label}' in {self._places[number]} what comes next depends on "
                        f'{", ".join(told) or "how long it took"}, which no outcome reports: give the capability '
                        'an outcome for each case'
                    ]
                )
        return {label: blocks[targets[0]] for label, targets in step.items()}

    # -- states ------------------------------------------------------------------------------------------------------

    def _built(
        self, of_block: Mapping[int, list[int]], edges: Mapping[int, Mapping[str, int]], begins: list[int]
    ) -> SynthesizedMachine:
        order = list(begins)
        for block in order:
            order += [to for to in dict.fromkeys(edges[block].values()) if to not in order]
        names: dict[int, str] = {}
        asking = {_ASKING} if len(begins) > 1 else set()
        for block in order:
            place = self._places[of_block[block][0]]
            name = place.end or '_'.join(part.capability for part in place.parts)
            taken = {*asking, *self._words.ends, *names.values()} if not place.end else set()
            names[block] = next(
                one for n in range(1, len(order) + 2) if (one := f'{name}_{n}' if n > 1 else name) not in taken
            )
        states = {}
        if len(begins) > 1:
            first = self._asking(begins, of_block, names)
            states[first.name] = first
        for block in order:
            if self._places[of_block[block][0]].end is None:
                states[names[block]] = self._state(names, of_block[block], edges[block], names[block])
        if not states:
            at_once = f"the machine would end by '{names[begins[0]]}' at once: there is nothing to do"
            raise SynthesisError(['; '.join((at_once, *self._left_open()))])
        self._notes += self._left_open()
        used = {target for state in states.values() for target in state.transitions.values()}
        for end in self._words.ends:
            if end not in used:
                self._notes.append(f"nothing leads to the outcome '{end}', so the machine does not have it")
        name = self._problem.request.name or self._problem.request.system or 'Synthesized'
        retries = self._problem.options.retries
        for part in (part for one in names.values() if retries and one in states for part in states[one].parts):
            once = [one for one in part.outcomes if one not in part.retry_on and self._is_failing(one)]
            if once:
                told = ', '.join(once)
                self._notes.append(f'{part.capability} is not repeated after {told}, which changes what is known')
        machine = SynthesizedMachine(
            name,
            tuple(end for end in self._words.ends if end in used),
            states,
            1 if retries is None else retries + 1,
            notes=tuple(dict.fromkeys(self._notes)),
        )
        return replace(machine, keys=keys_from_the_start(machine))

    def _state(self, names: Mapping[int, str], nodes: list[int], edges: Mapping[str, int], name: str) -> MachineState:
        parts = self._places[nodes[0]].parts
        held = [self._problem.holding(self._nodes[node].values) for node in nodes]
        holds = tuple(one for one in held[0] if all(one in other for other in held))
        transitions: dict[str, str] = {}
        combinations: dict[str, tuple[tuple[str, str], ...]] = {}
        autonomy: dict[str, int] = {}
        for label, to in sorted(edges.items(), key=lambda edge: -edge[0].count('&')):
            arrived = dict(one.split(':') for one in label.split(' & '))
            active = [part for part in parts if part.capability in arrived]
            of_class = [
                [one for one in part.outcomes if self._problem.normalized(one) == arrived[part.capability]]
                for part in active
            ]
            for chosen in product(*of_class):
                pairs = tuple(zip((part.capability for part in active), chosen, strict=True))
                outcome = chosen[0] if len(parts) == 1 else '__'.join(f'{part}_{one}' for part, one in pairs)
                transitions[outcome] = names[to]
                combinations[outcome] = pairs
                autonomy[outcome] = max(self._autonomy(part, one) for part, one in pairs)
        if len(parts) == 1:
            self._impossible(parts[0], transitions, autonomy)
            transitions = {one: transitions[one] for one in parts[0].outcomes}
            combinations = {}
        levels = {outcome: autonomy[outcome] for outcome in transitions}
        return MachineState(name, parts, transitions, levels, tuple(nodes), holds, combinations)

    def _impossible(self, part: MachinePart, transitions: dict[str, str], autonomy: dict[str, int]) -> None:
        """Add transitions to the failure of the machine for outcomes that the specification excludes."""
        failures = [end for end in self._words.ends if end in FAILURE_OUTCOMES]
        for outcome in part.outcomes:
            if outcome in transitions:
                continue
            if not failures:
                raise SynthesisError(
                    [
                        f"{part.capability}: by the specification the outcome '{outcome}' of {part.state_class} cannot "
                        "come, so it leads nowhere; add 'failed' to the outcomes of the machine, or allow the outcome"
                    ]
                )
            transitions[outcome] = failures[0]
            autonomy[outcome] = self._autonomy(part.capability, outcome)
            self._notes.append(
                f"{part.capability}: '{outcome}' cannot come by the specification; it leads to '{failures[0]}'"
            )

    def _left_open(self) -> list[str]:
        """Return what the strategy was free to take as the beginning: values of integers that no initial condition
        says."""
        asked = [  # but what is begun with, which follows from what is taken
            formula
            for formula in self._problem.specification.of(Section.SYS_INIT)
            if not any(self._words.is_own(name.name) for name in names_in(formula))
        ]
        values = self._nodes[self._strategy.start[0]].values
        outputs = {name.name for name in self._problem.specification.names(inputs=False)}
        notes = []
        for name, labels in self._problem.file.labels.items():
            if name not in outputs or self._words.is_own(name):
                continue
            others = [valuation(values | {name: number}) for number in labels if number != values[name]]
            if any(all(value_of(formula, other) is not False for formula in asked) for other in others):
                taken = f'{name}={labels.get(values[name], values[name])}'
                notes.append(f"the initial conditions leave '{name}' open, so {taken} is taken; say which it is")
        return notes

    def _autonomy(self, capability: str, outcome: str) -> int:
        one = self._problem.file.capabilities[capability]
        return one.autonomy.get(outcome, one.default_autonomy)

    def _asking(self, begins: list[int], of_block: Mapping[int, list[int]], names: Mapping[int, str]) -> MachineState:
        """Return a state before all others in which the operator enters the initial facts."""
        inputs = [name.name for name in self._problem.specification.names(inputs=True)]
        begun = [self._nodes[number].values for number in self._strategy.start]
        told = [name for name in inputs if len({values[name] for values in begun}) > 1]
        transitions: dict[str, str] = {}
        settled = {to: names[block] for block in begins for to in of_block[block]}
        for number in self._strategy.start:
            values = self._nodes[number].values
            case = '_and_'.join(self._told_as(name, values[name]) for name in told)
            transitions[case] = settled[self._settled(number)[0]]
        question = 'How is it?'
        part = MachinePart(
            _ASKING, 'OperatorDecisionState', {'outcomes': list(transitions), 'hint': question}, tuple(transitions)
        )
        self._notes.append(
            f"the world may begin in several ways ({', '.join(told)}): the state '{_ASKING}' asks the operator"
        )
        return MachineState(_ASKING, (part,), transitions, dict.fromkeys(transitions, 0))

    def _told_as(self, name: str, value: int) -> str:
        """Return a value of an input as the operator chooses it."""
        if self._problem.specification.variables[name].bounds is None:
            return name if value else f'not_{name}'
        return f'{name}={self._problem.file.labels.get(name, {}).get(value, value)}'


# The fewest states that behave the same: partition refinement, then merging where an outcome cannot come.
#
# Two states are the same if they do the same, and lead to the same by every outcome. (Hopcroft 1971; here by rounds, as
# machines are small.) A state that lacks an outcome which another one has may be merged with it all the same (Paull and
# Unger 1959): any answer to what does not happen is right. That is done one pair after the other, which need not be the
# best; without such outcomes the result is the smallest there is.


def blocks_of(outputs: Sequence[Hashable], edges: Sequence[Mapping[str, Collection[int]]]) -> list[int]:
    """Return the number of the block of each state. The states of a block behave the same.

    ``edges[i]`` are the targets of state ``i`` by outcome. Blocks are numbered from 0 in the order of their first
    states.
    """
    blocks = _numbered(outputs)
    while True:
        finer = _numbered(
            [
                (
                    block,
                    tuple(
                        sorted(
                            (outcome, tuple(sorted({blocks[to] for to in targets}))) for outcome, targets in of.items()
                        )
                    ),
                )
                for block, of in zip(blocks, edges, strict=True)
            ]
        )
        if finer == blocks:
            return blocks
        blocks = finer


def merged(outputs: Sequence[Hashable], edges: Sequence[Mapping[str, int]]) -> list[int]:
    """Return for each state the number of the state that it is merged with, so that no outcome has two targets."""
    root = list(range(len(outputs)))
    for one, other in combinations(range(len(outputs)), 2):
        if root[one] != root[other] and outputs[one] == outputs[other]:
            root = _joined(root, one, other, outputs, edges) or root
    return root


def _joined(
    root: list[int], one: int, other: int, outputs: Sequence[Hashable], edges: Sequence[Mapping[str, int]]
) -> list[int] | None:
    """Return the classes after merging two blocks and all merges that follow; None if outputs contradict that."""
    waiting = [(one, other)]
    while waiting:
        a, b = sorted(root[block] for block in waiting.pop())
        if a == b:
            continue
        if outputs[a] != outputs[b]:
            return None
        root = [a if block == b else block for block in root]
        targets: dict[str, int] = {}
        for block, of in enumerate(edges):
            if root[block] == a:
                waiting += ((targets.setdefault(outcome, to), to) for outcome, to in of.items())
    return root


def _numbered(keys: Sequence[Hashable]) -> list[int]:
    numbers: dict[Hashable, int] = {}
    return [numbers.setdefault(key, len(numbers)) for key in keys]


# Check that every path to a state writes the keys that it reads.


def keys_from_the_start(machine: SynthesizedMachine) -> tuple[str, ...]:
    """Return the keys that some state reads and no state writes without that: the caller of the machine must provide
    them.

    Raises:
        SynthesisError: a state writes a key, but a path to a reader avoids that state; the text shows the path.
    """
    reads = {
        name: {key for part in state.parts for key in part.reads.values()} for name, state in machine.states.items()
    }
    writes = {
        name: {key for part in state.parts for key in part.writes.values()} for name, state in machine.states.items()
    }
    written = set().union(*(writes[name] - reads[name] for name in machine.states))
    problems = []
    for name in machine.states:
        for key in sorted(reads[name] & written):
            way = _way_without(machine, name, {one for one in machine.states if key in writes[one]})
            if way is not None:
                problems.append(
                    f"{name} reads userdata '{key}', which is not written on the way {' → '.join(way)}: "
                    f'make what writes it a precondition of {name}'
                )
    if problems:
        raise SynthesisError(problems)
    return tuple(sorted(set().union(*reads.values()) - written))


def _way_without(machine: SynthesizedMachine, target: str, writers: set[str]) -> list[str] | None:
    """Return the shortest path from the start to a state on which no writer is left."""
    ways = {machine.initial: [machine.initial]}
    for name in (waiting := [machine.initial]):
        if name == target:
            return ways[name]
        if name in writers:
            continue
        for to in machine.states[name].transitions.values():
            if to in machine.states and to not in ways:
                ways[to] = [*ways[name], to]
                waiting.append(to)
    return None
