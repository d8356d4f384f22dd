# SPDX-License-Identifier: BSD-3-Clause
"""Automata: states with transitions, whose bodies are compiled to code with addresses, and the run of one by itself.

An automaton is in a stable state, or about to send. The others cannot see its steps in between. So after an event it
runs to its next send, or to the next state in which no eventless transition is enabled. An eventless transition takes
precedence over events, as in SCXML.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from .data_types import DataType, DataTypeError
from .expressions import Evaluated
from .source_text import ModelFault

# Values of ``Math.random()``: real numbers from a generator; or, where an expression turns it into an integer at once,
# # all the possible integers with their probabilities.

MOST_VALUES: Final = 20_000
"""Maximum number of values of one draw that are followed."""


class ManyValuesError(ModelFault):
    """A random draw with too many values to follow each of them."""


class SampledDraws:
    """Random draws of expressions from a generator: ``u`` is uniformly distributed in [0, 1)."""

    def __init__(self, real: Callable[[], float]) -> None:
        self.real = real

    def whole(self, width: float, least: float) -> int:
        """Return ``floor(least + u * width)``."""
        return math.floor(least + self.real() * width)

    def below(self, bound: float) -> bool:
        """Return whether ``u < bound``."""
        return self.real() < bound


class EnumeratedDraws:
    """The same draws, enumerated: one set of values, which begins with the ``given`` ones and continues with first
    values.

    ``probability``: the probability of this set. ``others``: the alternative sets.
    """

    def __init__(self, given: tuple[int, ...] = ()) -> None:
        self._given = given
        self._made: list[int] = []
        self.probability = 1.0
        self.others: list[tuple[int, ...]] = []

    def real(self) -> float:
        raise ManyValuesError('the model uses Math.random for real numbers, whose values are too many to follow')

    def whole(self, width: float, least: float) -> int:
        if not 0.0 <= width <= MOST_VALUES:
            raise ManyValuesError(f'Math.random() * {width:g} has too many values to follow each, or is negative')
        first, most = math.floor(least), least + width
        last = math.ceil(most) - first - 1
        if last < 1:
            return first
        taken = self._take(last + 1)
        begin = first + taken if taken else least
        end = first + taken + 1 if taken < last else most
        # Not from the width itself: adding a small width to ``least`` rounds part of it away.
        self.probability *= (end - begin) / (most - least)
        return first + taken

    def below(self, bound: float) -> bool:
        if not bound > 0.0:  # also true of NaN
            return False
        if bound >= 1.0:
            return True
        is_below = self._take(2) == 0
        self.probability *= bound if is_below else 1.0 - bound
        return is_below

    def _take(self, count: int) -> int:
        """Return the index, below ``count``, of the value in this set."""
        place = len(self._made)
        if place >= len(self._given):
            self.others += [(*self._made, other) for other in range(1, count)]
            self._made.append(0)
        else:
            self._made.append(self._given[place])
        return self._made[-1]


Draws = SampledDraws | EnumeratedDraws


_LARGEST: Final = 2**64
_LONGEST: Final = 10_000
MAX_STEPS: Final = 20_000
"""Number of consecutive actions of an automaton that counts as a livelock; also the limit of open branches of a run."""


# -- parsed form ---------------------------------------------------------------------------------------------------


@dataclass
class Assign:
    """An assignment. ``path`` consists of members (strings) and indexes (functions)."""

    variable: int
    kind: DataType
    path: tuple[str | Evaluated, ...]
    value: Evaluated
    place: str


@dataclass
class Send:
    """A send action. ``values`` are in the order of the event's parameters; None for a parameter that is not sent."""

    event: int
    values: tuple[Evaluated | None, ...]
    place: str


@dataclass
class Write:
    """A write to the blackboard, through an output port of a plugin."""

    uid: int
    port: str
    value: Evaluated
    place: str


@dataclass
class If:
    branches: list[tuple[Evaluated, list[Action]]]
    otherwise: list[Action]
    place: str


Action = Assign | Send | Write | If


@dataclass
class Target:
    probability: float
    state: str
    body: list[Action]


@dataclass
class Transition:
    """A transition. ``event`` is None for an eventless one. The probabilities of the targets sum to 1."""

    event: int | None
    condition: Evaluated | None
    targets: list[Target]
    place: str


@dataclass
class AutomatonState:
    name: str
    entry: list[Action] = field(default_factory=list)
    exit: list[Action] = field(default_factory=list)
    transitions: list[Transition] = field(default_factory=list)


# -- compiled form
# ------------------------------------------------------------------------------------------------------


class LocalState(NamedTuple):
    """The position of an automaton. ``at`` is a state if negative (``-1 - number``), otherwise the address of the
    pending send or write. ``event`` has the parameters of the current event, until its body ends."""

    at: int
    data: tuple[Any, ...]
    event: tuple[Any, ...]


class _Jump(NamedTuple):
    address: int


class _Unless(NamedTuple):
    condition: Evaluated
    address: int
    place: str


class _Enter(NamedTuple):
    state: int


class Around(NamedTuple):
    """Values that expressions can use in addition to data and event: ports that point to the blackboard, random
    numbers."""

    inputs: Mapping[str, Any]
    draws: Draws


_Code = Assign | Send | Write | _Jump | _Unless | _Enter
_Row = tuple[Evaluated | None, list[tuple[float, int]], str]
"""A transition: its condition, its targets by probability and address, and its place."""

Branches = list[tuple[float, LocalState]]


class Automaton:
    """One automaton of a model, compiled. ``uid``: its number as a node of the tree, 0 for other automata. ``draws``:
    true if it draws random values."""

    def __init__(
        self,
        name: str,
        data: Sequence[tuple[str, Any]],
        states: Sequence[AutomatonState],
        initial: str,
        uid: int = 0,
        *,
        draws: bool = False,
    ) -> None:
        self.name = name
        self.uid = uid
        self.draws = draws
        self.variables = tuple(name for name, _ in data)
        self.states = tuple(state.name for state in states)
        self._numbers = {state.name: number for number, state in enumerate(states)}
        self._code: list[_Code] = []
        self._free: list[list[_Row]] = []
        self._by_event: list[dict[int, list[_Row]]] = []
        by_name = {state.name: state for state in states}
        for state in states:
            free: list[_Row] = []
            handlers: dict[int, list[_Row]] = {}
            for transition in state.transitions:
                targets = [
                    (
                        target.probability,
                        self._block([*state.exit, *target.body, *by_name[target.state].entry], target.state),
                    )
                    for target in transition.targets
                ]
                row = (transition.condition, targets, transition.place)
                if transition.event is None:
                    free.append(row)
                else:
                    handlers.setdefault(transition.event, []).append(row)
            self._free.append(free)
            self._by_event.append(handlers)
        self.start = LocalState(self._block(by_name[initial].entry, initial), tuple(value for _, value in data), ())
        self.received = frozenset(event for handlers in self._by_event for event in handlers)

    def _block(self, body: Sequence[Action], state: str) -> int:
        address = len(self._code)
        self._compile(body)
        self._code.append(_Enter(self._numbers[state]))
        return address

    def _compile(self, body: Sequence[Action]) -> None:
        code = self._code
        for action in body:
            if not isinstance(action, If):
                code.append(action)
                continue
            ends = []
            for condition, inner in action.branches:
                unless = len(code)
                code.append(_Jump(0))
                self._compile(inner)
                ends.append(len(code))
                code.append(_Jump(0))
                code[unless] = _Unless(condition, len(code), action.place)
            self._compile(action.otherwise)
            for end in ends:
                code[end] = _Jump(len(code))

    def due(self, local: LocalState) -> Send | Write | None:
        """Return the pending send or write; None in a stable state."""
        return None if local.at < 0 else self._code[local.at]  # type: ignore[return-value]

    def state_of(self, local: LocalState) -> str:
        """Return the name of the stable state; '' while a send or write is pending."""
        return self.states[-1 - local.at] if local.at < 0 else ''

    def handles(self, local: LocalState, event: int) -> bool:
        """Return whether the stable state has a transition for an event, under any condition."""
        return local.at < 0 and event in self._by_event[-1 - local.at]

    def take(self, local: LocalState, event: int, values: tuple[Any, ...], around: Around) -> Branches:
        """Return the branches after an event in a stable state; without an enabled transition it stays there. Raises
        ModelFault."""
        targets = self._chosen(self._by_event[-1 - local.at].get(event, ()), local.data, values, around)
        if targets is None:
            return [(1.0, local)]
        return self._run([(p, LocalState(address, local.data, values)) for p, address in targets], around)

    def go_on(self, local: LocalState, around: Around) -> Branches:
        """Return the branches after the pending send or write. Raises ModelFault."""
        return self._run([(1.0, local._replace(at=local.at + 1))], around)

    def begin(self, around: Around) -> Branches:
        """Return the initial branches. Raises ModelFault."""
        return self._run([(1.0, self.start)], around)

    def _run(self, ahead: Branches, around: Around) -> Branches:
        found: Branches = []
        rounds = 0
        while ahead:
            probability, local = ahead.pop()
            at, data, event = local
            while True:
                rounds += 1
                if rounds > MAX_STEPS:
                    raise ModelFault(
                        f'{self.name} keeps itself busy: {MAX_STEPS} actions in a row without sending or waiting'
                    )
                action = self._code[at]
                kind = type(action)
                if kind is Assign:
                    data = self._assigned(action, data, event, around)  # type: ignore[arg-type]
                    at += 1
                elif kind is Send or kind is Write:
                    found.append((probability, LocalState(at, data, event)))
                    break
                elif kind is _Unless:
                    condition, address, place = action  # type: ignore[misc]
                    at = at + 1 if self._value(condition, data, event, around, place) else address
                elif kind is _Jump:
                    at = action.address  # type: ignore[union-attr]
                else:
                    state = action.state  # type: ignore[union-attr]
                    event = ()
                    targets = self._chosen(self._free[state], data, (), around)
                    if targets is None:
                        found.append((probability, LocalState(-1 - state, data, ())))
                        break
                    for part, address in targets[1:]:
                        ahead.append((probability * part, LocalState(address, data, ())))
                    probability *= targets[0][0]
                    at = targets[0][1]
        return found

    def _chosen(
        self, rows: Sequence[_Row], data: tuple[Any, ...], event: tuple[Any, ...], around: Around
    ) -> list[tuple[float, int]] | None:
        """Return the targets of the first transition whose condition holds."""
        for condition, targets, place in rows:
            if condition is None or self._value(condition, data, event, around, place):
                return targets
        return None

    def values(self, local: LocalState, due: Send | Write, around: Around) -> tuple[Any, ...]:
        """Return the parameters of the pending send, or the value of the pending write. Raises ModelFault."""
        functions = due.values if isinstance(due, Send) else (due.value,)
        return tuple(
            0 if value is None else self._value(value, local.data, local.event, around, due.place)
            for value in functions
        )

    def _assigned(
        self, action: Assign, data: tuple[Any, ...], event: tuple[Any, ...], around: Around
    ) -> tuple[Any, ...]:
        number = action.variable
        value = self._value(action.value, data, event, around, action.place)
        if (type(value) is int and not -_LARGEST <= value <= _LARGEST) or (
            type(value) is str and len(value) > _LONGEST
        ):
            raise ModelFault(f'{action.place}: {self.name}: the value is too large for {self.variables[number]}')
        if action.path:
            steps = [
                step if isinstance(step, str) else self._value(step, data, event, around, action.place)
                for step in action.path
            ]
            try:
                value = action.kind.replaced(data[number], steps, value)
            except (DataTypeError, TypeError, ValueError) as error:
                raise ModelFault(f'{action.place}: {self.variables[number]}: {error}') from error
        return (*data[:number], value, *data[number + 1 :])

    def _value(
        self, function: Evaluated, data: tuple[Any, ...], event: tuple[Any, ...], around: Around, place: str
    ) -> Any:
        try:
            return function(data, event, around)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            what = str(error.args[0]) if isinstance(error, LookupError) and error.args else str(error)
            raise ModelFault(f'{place}: {self.name}: the expression has no value: {what}') from error
