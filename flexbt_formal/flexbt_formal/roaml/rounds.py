# SPDX-License-Identifier: BSD-3-Clause
"""Paths through a model, and the rounds of which they consist."""

from __future__ import annotations

from array import array
from enum import Enum
from time import process_time
from typing import Final, NamedTuple

from flexbt_formal.exploration.explorer import OnProgress

from .automaton import ManyValuesError
from .properties import Judge, ModelProperty
from .system import GlobalState, ModelStep, ModelSystem


class Order(Enum):
    """The order of automata that can continue at the same time."""

    TURNS = 'turns'
    """The event that was sent first is delivered first; the automaton that has waited longest continues."""
    RANDOM = 'random'
    """Each with the same probability, as statistical model checkers do."""
    ANY = 'any'
    """All orders: the result is the least or greatest probability. Some orders may starve automata."""


class ModelPath:
    """A path property: ``left`` until ``right``, along the steps of a model."""

    def __init__(self, system: ModelSystem, left: Judge, right: Judge, asked: ModelProperty, order: Order) -> None:
        self.system = system
        self.asked = asked
        self.order = order
        self._left = left
        self._right = right
        self.is_bounded = asked.lower > 0 or asked.upper is not None

    def steps(self, state: GlobalState) -> list[ModelStep]:
        """Return the possible steps in this order."""
        return self.system.steps(state, first_only=self.order is Order.TURNS)

    def decided(self, state: GlobalState, count: int) -> bool | None:
        """Return True if the path is satisfied, False if it has failed, None if undecided. ``count``: steps so far."""
        asked = self.asked
        if asked.upper is not None and count > asked.upper:
            return False
        if count >= asked.lower and self._right(state.seen):
            return True
        return None if self._left(state.seen) else False

    def at_end(self, state: GlobalState) -> bool:
        """Return whether a path that has ended is satisfied: its last state lasts forever."""
        asked = self.asked
        lasts = asked.upper is None or asked.lower <= asked.upper
        return lasts and self._right(state.seen) and self._left(state.seen)


# A round: all steps after timers are due, until time has to advance.
# The steps do not depend on the time itself, so a round is computed once for each state and set of timers. A model is
# then a chain of rounds, and their probabilities are added up time by time.

SATISFIED: Final = -1
FAILED: Final = -2
_STEPS: Final = 4_000
"""Maximum steps in one round; beyond it, another method follows the model."""
_BETWEEN_QUESTIONS: Final = 1_000
"""Steps in rounds between two checks of the time limit."""

Outcomes = list[tuple[float, int]]
"""Probabilities, and numbers of states, SATISFIED or FAILED."""
Made = tuple[GlobalState, ModelStep, GlobalState]


class EndlessError(Exception):
    """A round that does not end, or depends on the time."""


class OverError(Exception):
    """A limit was exceeded."""


class Watch:
    """The time limit of a check. It also reports the work ``done`` and ``left``."""

    def __init__(self, on_progress: OnProgress, until: float) -> None:
        self._on_progress = on_progress
        self._until = until
        self.done, self.left = 0, 1

    def has_time(self) -> bool:
        """Report the progress, and return whether time is left."""
        self._on_progress(self.done, self.left)
        return process_time() < self._until

    def check(self) -> None:
        """Report the progress. Raises OverError when the time is over."""
        if not self.has_time():
            raise OverError


class RoundLayer(NamedTuple):
    """The states at one time, each with the index of a predecessor in the previous layer."""

    states: array[int]
    parents: array[int]


class Rounds:
    """The numbered states at which time advances, and the rounds between them.

    ``most`` is the maximum number of parallel states in one round. Attributes: ``stuck``, the reason why time cannot
    advance; ``is_cut``, whether the time limit ended a round that had used most of the time.
    """

    def __init__(self, path: ModelPath, most: int) -> None:
        self._path = path
        self._most = most
        self._made = 0
        self._question = _BETWEEN_QUESTIONS
        self._states: list[GlobalState] = []
        self._numbers: dict[GlobalState, int] = {}
        self._known: dict[tuple[int, tuple[int, ...]], Outcomes] = {}
        self.stuck = ''
        self.is_cut = False

    def __len__(self) -> int:
        return len(self._states)

    def first(self, watch: Watch) -> Outcomes:
        """Return the outcomes of the initial round. Raises EndlessError, ManyValuesError and OverError."""
        begin: dict[GlobalState, float] = {}
        for probability, state in self._path.system.initial():
            begin[state] = begin.get(state, 0.0) + probability
        return self._played(begin, watch)

    def after(self, number: int, time: int, watch: Watch) -> Outcomes:
        """Return the outcomes of the round from a state when time advances to ``time``, in ns.

        Raises EndlessError, ManyValuesError and OverError."""
        key = (number, self._path.system.due_at(time))
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = self._played({self._begun(number, time): 1.0}, watch)
            if not self._path.system.is_timeless:
                raise EndlessError
        return found

    def at_end(self, number: int) -> int:
        """Return SATISFIED or FAILED for a state at the end of the time."""
        return SATISFIED if self._path.at_end(self._states[number]) else FAILED

    def _begun(self, number: int, time: int) -> GlobalState:
        return self._states[number]._replace(time=time, due=0)

    def _played(self, ahead: dict[GlobalState, float], watch: Watch) -> Outcomes:
        found: dict[int, float] = {}
        before = self._made
        for _ in range(_STEPS):
            then: dict[GlobalState, float] = {}
            for state, whole in ahead.items():
                outcome, steps = self._decided(state)
                if outcome is not None:
                    found[outcome] = found.get(outcome, 0.0) + whole
                    continue
                for step in steps:
                    followers = self._path.system.follow(state, step)
                    for part, after in followers:
                        probability = whole * part / len(steps)
                        then[after] = then.get(after, 0.0) + probability
                    if len(then) > self._most:
                        raise ManyValuesError(
                            f'more than {self._most} states side by side at one time are too many to follow each'
                        )
                    self._made += len(followers)
                    if self._made >= self._question:
                        self._question = self._made + _BETWEEN_QUESTIONS
                        if not watch.has_time():
                            self.is_cut = self._made - before > before
                            raise OverError
            if not then:
                return [(probability, number) for number, probability in found.items()]
            ahead = then
        raise EndlessError

    def _decided(self, state: GlobalState) -> tuple[int | None, list[ModelStep]]:
        """Return the outcome of a state if it is decided, otherwise None and the possible steps."""
        path = self._path
        decided = path.decided(state, 0)
        if decided is not None:
            return (SATISFIED if decided else FAILED), []
        steps = path.steps(state)
        if steps and steps[0].kind != 'time':
            return None, steps
        if not steps and path.system.is_blocked(state):
            self.stuck = self.stuck or path.system.waiting(state)
            return (SATISFIED if path.at_end(state) else FAILED), []
        rest = GlobalState(0, -1, state.locals, (), state.tree, state.seen, 0)
        number = self._numbers.get(rest)
        if number is None:
            number = self._numbers[rest] = len(self._states)
            self._states.append(rest)
        return number, []

    def steps_to(self, number: int | None, time: int, goal: int) -> list[Made]:
        """Return the steps of the shortest way through one round to ``goal``; ``number`` None: through the initial
        round."""
        path = self._path
        begins = [state for _, state in path.system.initial()] if number is None else [self._begun(number, time)]
        come: dict[GlobalState, Made | None] = dict.fromkeys(begins)
        ahead = list(begins)
        for state in ahead:
            outcome, steps = self._decided(state)
            if outcome == goal:
                made: list[Made] = []
                one = come[state]
                while one is not None:
                    made.append(one)
                    one = come[one[0]]
                return made[::-1]
            for step in steps:
                for _, after in path.system.follow(state, step):
                    if after not in come:
                        come[after] = (state, step, after)
                        ahead.append(after)
        return []


class Flow:
    """Probability that flows through time, round by round, up to ``most`` states.

    Attributes: ``good`` and ``bad``, the probability that has arrived there; ``size``, the number of states.
    """

    def __init__(self, rounds: Rounds, path: ModelPath, most: int, watch: Watch) -> None:
        self._rounds = rounds
        self._path = path
        self._most = most
        self._watch = watch
        self._layers: list[RoundLayer] = []
        self._times: list[int] = []
        self._fails: tuple[int, int] | None = None
        self.good = self.bad = 0.0
        self.size = 0
        self.is_complete = False

    @property
    def stuck(self) -> str:
        """The reason why time cannot advance; '' if it can."""
        return self._rounds.stuck

    def run(self) -> None:
        """Follow all probability up to the limits. Raises EndlessError, ManyValuesError and OverError."""
        now: dict[int, float] = {}
        for probability, number in self._rounds.first(self._watch):
            self._add(now, number, probability, 0)
        self._layers.append(RoundLayer(array('l', now), array('l', [0] * len(now))))
        self._times.append(0)
        for time in self._path.system.times():
            if not now:
                break
            then: dict[int, float] = {}
            parents = array('l')
            for place, (number, whole) in enumerate(now.items()):
                self._watch.done, self._watch.left = self.size, len(now) - place
                if place % 256 == 0:
                    self._watch.check()
                if self.size > 20 * self._most or len(self._rounds) > self._most:
                    raise OverError
                for part, after in self._rounds.after(number, time, self._watch):
                    if self._add(then, after, whole * part, place):
                        parents.append(place)
            self._layers.append(RoundLayer(array('l', then), parents))
            self._times.append(time)
            now = then
        for place, (number, whole) in enumerate(now.items()):
            self._add({}, self._rounds.at_end(number), whole, place)
        self.is_complete = True

    def _add(self, now: dict[int, float], number: int, probability: float, place: int) -> bool:
        """Add probability to a state, and return whether the state is new at this time."""
        if number < 0:
            if number == SATISFIED:
                self.good += probability
            else:
                self.bad += probability
            if (number == SATISFIED) is self._path.asked.is_missed_where and self._fails is None:
                self._fails = (len(self._layers), place)
            return False
        known = now.get(number)
        now[number] = probability if known is None else known + probability
        self.size += known is None
        return known is None

    @property
    def has_failed(self) -> bool:
        """True if there is a path that the demand does not want."""
        return self._fails is not None

    def way(self) -> tuple[str, ...]:
        """Return the way to the first end that the demand does not want, in words."""
        if self._fails is None:
            return ()
        layer, place = self._fails
        goal = SATISFIED if self._path.asked.is_missed_where else FAILED
        made: list[list[Made]] = []
        while layer > 0:
            before = self._layers[layer - 1]
            number = before.states[place]
            if layer < len(self._layers):
                made.append(self._rounds.steps_to(number, self._times[layer], goal))
            goal = number
            place = before.parents[place]
            layer -= 1
        made.append(self._rounds.steps_to(None, 0, goal))
        lines: list[str] = []
        for time, steps in zip(self._times, reversed(made), strict=False):
            inner = [line for one in steps for line in self._path.system.narrate(*one)]
            if time and inner:
                lines.append(f'at {time / 1e9:g} s')
            lines += inner
        return tuple(lines)
