# SPDX-License-Identifier: BSD-3-Clause
"""The probability of a property of a model: exact, from a graph of all states, or from random runs with a bound."""

from __future__ import annotations

import random
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final

from flexbt_formal.exploration.explorer import OnProgress, unreported

from .automaton import ManyValuesError
from .model import RoamlModel
from .probabilities import BAD, GOOD, GraphChoices, bounds_of, looks, reach
from .properties import ModelProperty
from .rounds import SATISFIED, EndlessError, Flow, Made, ModelPath, Order, Outcomes, OverError, Rounds, Watch
from .system import NANOSECONDS, GlobalState, one_of

_CHAIN: Final = 2_000
"""Maximum number of steps without a choice that are merged into one."""
_REUSE: Final = 4
"""Number of repetitions of a round from which it pays to cache all its outcomes."""
_RUN: Final = 1_000_000
"""Number of steps after which a random run counts as undecided."""
_ORDERS: Final = {Order.TURNS: 'taking turns', Order.RANDOM: 'in random order', Order.ANY: 'in any order'}


class Method(Enum):
    AUTO = 'auto'
    EXACT = 'exact'
    STATISTICAL = 'statistical'


@dataclass(frozen=True)
class CheckLimits:
    """Limits of a check: ``seconds`` of processor time for one property, ``states`` of a graph.

    A statistical result is within ``error`` with the probability ``confidence``. ``seed`` is for its random numbers.
    """

    seconds: float = 60.0
    states: int = 500_000
    error: float = 0.015
    confidence: float = 0.95
    seed: int = 0


@dataclass(frozen=True)
class Result:
    """The result for a property: its value is between ``low`` and ``high``.

    ``how``: the method and its accuracy, in words. ``is_complete``: no limit cut the check short. ``way``: the shortest
    way found to what the demand does not want, in words: to a failure, or if it limits the probability from above, to
    where the property is satisfied. ``has_failed``: such a way was found that counts, with some probability.
    """

    asked: ModelProperty
    value: float
    low: float
    high: float
    how: str
    is_complete: bool
    is_exact: bool
    size: int
    seconds: float
    way: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    has_failed: bool = False

    @property
    def holds(self) -> bool | None:
        """True if the value meets the demand, False if not, None if undecided."""
        if self.is_exact:
            is_missed = self.has_failed and self.asked.is_of_all  # however rarely
            return self.asked.holds(self.value) and not is_missed
        if self.asked.is_of_all:
            # One failure is proof. The absence of failures is known only within the requested error.
            return False if self.has_failed else True if self.asked.holds(self.value) and self.is_complete else None
        low, high = self.asked.holds(self.low), self.asked.holds(self.high)
        return low if low == high else None


def check(
    model: RoamlModel,
    asked: ModelProperty,
    *,
    order: Order = Order.TURNS,
    method: Method = Method.AUTO,
    limits: CheckLimits | None = None,
    on_progress: OnProgress = unreported,
) -> Result:
    """Return the probability of a property. Raises ModelFault for a model that cannot continue, and ValueError for a
    method that does not fit the model or the order."""
    limits = limits or CheckLimits()
    if method is Method.EXACT and model.is_random:
        raise ValueError(
            'the model uses Math.random for real numbers, whose values are too many to follow: '
            'take the method statistical'
        )
    if method is Method.STATISTICAL and order is Order.ANY:
        raise ValueError('all orders can only be followed by the method exact; or take the order random')
    begin = time.process_time()
    generator = random.Random(limits.seed)
    path = model.along(asked, order, generator.random)
    notes: list[str] = []
    watch = Watch(on_progress, begin + limits.seconds)
    followed = 0
    has_rounds = order is not Order.ANY and not path.is_bounded and path.system.has_timers
    rounds = Rounds(path, limits.states) if has_rounds else None
    if method is not Method.STATISTICAL and not model.is_random:
        has_to_be_exact = method is Method.EXACT or order is Order.ANY
        first = Watch(on_progress, begin + limits.seconds * (1.0 if has_to_be_exact else 0.5))
        try:
            if rounds is not None:
                flow = Flow(rounds, path, limits.states, first)
                try:
                    with suppress(OverError):
                        flow.run()
                except EndlessError:
                    rounds = None
                else:
                    if flow.is_complete or has_to_be_exact:
                        return _flowed(path, flow, len(rounds), begin)
                    followed = flow.size
            if rounds is None:
                explorer = _Explorer(path, limits.states, first)
                if explorer.run() or has_to_be_exact:
                    return explorer.result(begin)
            notes.append('there are too many states to follow all of them')
        except ManyValuesError as error:
            if has_to_be_exact:
                raise
            notes.append(str(error))
            rounds = None
    if rounds is not None and not rounds.is_cut and not model.is_random and followed > _REUSE * len(rounds):
        try:
            return _sampled(path, limits, begin, watch, notes, _RoundRuns(path, rounds, generator))
        except (EndlessError, ManyValuesError):
            generator.seed(limits.seed)
    path.system.draws = True
    return _sampled(path, limits, begin, watch, notes, _StepRuns(path, generator))


def _flowed(path: ModelPath, flow: Flow, rounds: int, begin: float) -> Result:
    low, high = flow.good, max(flow.good, 1.0 - flow.bad)
    if flow.is_complete:
        low = high = flow.good / (flow.good + flow.bad)  # the sum differs from 1 by rounding errors
    how = f'exact: {flow.size} states, {rounds} without their time, automata {_ORDERS[path.order]}'
    return _exact(path, flow, (low, high), how, begin)


def _exact(path: ModelPath, found: Flow | _Explorer, values: tuple[float, float], how: str, begin: float) -> Result:
    """Return the result of an exact method, from its least and greatest probability."""
    asked = path.asked
    low, high = (1.0 - values[1], 1.0 - values[0]) if asked.is_negated else values
    if not found.is_complete:
        how = f'bounds only: {found.size} states were followed before the limit'
    way = found.way() if found.has_failed or (low > 0.0 if asked.is_at_most else high < 1.0) else ()
    value = low if low == high or asked.is_least else high
    notes = (found.stuck,) if found.stuck else ()
    seconds = time.process_time() - begin
    whole = found.is_complete
    has_failed = found.has_failed and (path.order is not Order.ANY or asked.is_for_all is not asked.is_at_most)
    return Result(asked, value, low, high, how, whole, whole, found.size, seconds, way, notes, has_failed)


class _Explorer:
    """The state graph, built breadth-first. In states 0 and 1 the property has failed or is satisfied."""

    def __init__(self, path: ModelPath, most: int, watch: Watch) -> None:
        self._path = path
        self._most = most
        self._watch = watch
        self.graph: list[GraphChoices] = [[], []]
        self._numbers: dict[tuple[GlobalState, int], int] = {}
        self._states: list[tuple[GlobalState, int] | None] = [None, None]
        self._from: list[int] = [-1, -1]
        self._fails: tuple[int, GlobalState] | None = None
        self._is_round = False  # it fails by going round without an end
        self.stuck = ''
        self._made = 0
        self._is_late = False
        self.is_complete = False

    def run(self) -> bool:
        """Build the graph, and return whether it is complete."""
        start: list[tuple[float, int]] = []
        self._start = [start]
        ahead: deque[int] = deque()
        for probability, state in self._path.system.initial():
            start.append((probability, self._reached(-1, state, 0, ahead)))
        while ahead:
            if self._is_over(len(ahead)) or len(self.graph) > self._most:
                return False
            number = ahead.popleft()
            held = self._states[number]
            assert held is not None
            state, count = held
            steps = self._path.steps(state)
            rows = [
                [
                    (probability, self._reached(number, after, count + 1, ahead))
                    for probability, after in self._path.system.follow(state, step)
                ]
                for step in steps
            ]
            if self._path.order is Order.RANDOM and rows:
                rows = [[(probability / len(rows), after) for row in rows for probability, after in row]]
            self.graph[number] = rows
        self.is_complete = True
        return True

    def _is_over(self, left: int) -> bool:
        """Return whether the time is over; the clock is read every 64 steps."""
        self._made += 1
        if self._made % 64 == 0:
            self._watch.done, self._watch.left = len(self.graph), left
            self._is_late = not self._watch.has_time()
        return self._is_late

    def _reached(self, source: int, state: GlobalState, count: int, ahead: deque[int]) -> int:
        """Return the number of the next state with a choice."""
        path = self._path
        seen = None
        for made in range(_CHAIN):
            if state.seen is not seen or path.is_bounded:
                seen = state.seen
                decided = path.decided(state, count)
                if decided is not None:
                    return self._ended(source, state, decided)
            steps = path.steps(state)
            if not steps:
                self.stuck = self.stuck or path.system.waiting(state)
                return self._ended(source, state, path.at_end(state))
            if len(steps) > 1:
                break
            if made and (state, count if path.is_bounded else 0) in self._numbers:
                break
            follow = path.system.follow(state, steps[0])
            if len(follow) > 1:
                break
            state = follow[0][1]
            count += 1
            if self._is_over(len(ahead)):
                break
        bound = max(path.asked.lower, (path.asked.upper or 0) + 1)
        count = min(count, bound) if path.is_bounded else 0
        key = (state, count)
        number = self._numbers.get(key)
        if number is None:
            number = self._numbers[key] = len(self.graph)
            self.graph.append([])
            self._states.append(key)
            self._from.append(source)
            ahead.append(number)
        return number

    def _ended(self, source: int, state: GlobalState, is_good: bool) -> int:
        if is_good is self._path.asked.is_missed_where and self._fails is None:
            self._fails = (source, state)
        return GOOD if is_good else BAD

    @property
    def size(self) -> int:
        """Number of states with a choice."""
        return len(self.graph)

    @property
    def has_failed(self) -> bool:
        """True if there is a path that the demand does not want."""
        return self._fails is not None

    def result(self, begin: float) -> Result:
        values = self._values([*self.graph, self._start], self._path.asked.is_least)
        return _exact(
            self._path, self, values, f'exact: {self.size} states, automata {_ORDERS[self._path.order]}', begin
        )

    def _values(self, graph: list[GraphChoices], is_least: bool) -> tuple[float, float]:
        """Return the least and greatest possible value of the start; they are equal if the graph is complete and not
        too large to be solved."""
        values, is_solved = reach(graph, is_least)
        if self.is_complete and is_solved:
            if self._fails is None and not self._path.asked.is_missed_where:
                self._find_round(values)
            return values[-1], values[-1]
        self.is_complete = False
        opened = [*graph]
        for number in range(2, len(graph)):
            if not graph[number]:
                opened[number] = [[(1.0, GOOD)]]
        others, is_solved = reach(opened, is_least)
        return values[-1], others[-1] if is_solved else 1.0

    def _find_round(self, values: Sequence[float]) -> None:
        """Note the first state from which the goal is never reached: a failure, however rarely the state is."""
        for number in range(2, len(self.graph)):
            held = self._states[number]
            if values[number] == 0.0 and held is not None:
                self._fails, self._is_round = (self._from[number], held[0]), True
                return

    def way(self) -> tuple[str, ...]:
        """Return the way to the failure in words: the choices, and the steps in between."""
        wanted = 'fails' if self._path.asked.is_at_most else 'is satisfied'
        goes_round = f'it goes round without ever coming to where the property {wanted}'
        if self._fails is None:
            return (goes_round,)
        source, goal = self._fails
        goals = [goal]
        while source >= 0:
            held = self._states[source]
            assert held is not None
            goals.append(held[0])
            source = self._from[source]
        starts = [state for _, state in self._path.system.initial()]
        at = next((one for one in starts if self._leads(one, goals[-1]) is not None), starts[0])
        found: list[str] = []
        for then in reversed(goals):
            for step in self._leads(at, then) or ():
                found += self._path.system.narrate(*step)
            at = then
        return (*found, goes_round) if self._is_round else tuple(found)

    def _leads(self, state: GlobalState, goal: GlobalState) -> list[Made] | None:
        """Return the steps from a choice to the next one; None if they do not lead to ``goal``."""
        if state == goal:
            return []
        path = self._path
        for step in path.steps(state):
            for _, after in path.system.follow(state, step):
                made = [(state, step, after)]
                at = after
                for _ in range(_CHAIN + 1):
                    if at == goal:
                        return made
                    steps = path.steps(at)
                    if len(steps) != 1:
                        break
                    follow = path.system.follow(at, steps[0])
                    if len(follow) != 1:
                        break
                    made.append((at, steps[0], follow[0][1]))
                    at = follow[0][1]
        return None


def _sampled(
    path: ModelPath, limits: CheckLimits, begin: float, watch: Watch, notes: list[str], runs: _RoundRuns | _StepRuns
) -> Result:
    """Make random runs until they suffice for the requested error, or the time is over."""
    looks_at = looks(limits.error, limits.confidence)
    wanted = max(looks_at)
    doubt = looks_at[wanted]
    good = undecided = done = 0
    has_failed = is_enough = False
    way: tuple[str, ...] = ()
    shortest = _RUN
    asked = path.asked
    while done < wanted:
        watch.done, watch.left = done, wanted - done
        try:
            outcome = runs.one(watch)
        except OverError:
            break
        done += 1
        good += outcome is True
        undecided += outcome is None
        if outcome is asked.is_missed_where:
            has_failed = True
            if len(runs.made) < shortest:
                shortest = len(runs.made)
                way = runs.way()
        if done in looks_at and bounds_of(good, undecided, done, looks_at[done]).error <= limits.error:
            doubt, is_enough = looks_at[done], True
            break
    seconds = time.process_time() - begin
    if undecided:
        notes.append(f'{undecided} runs were not decided after {_RUN} steps')
    found = Result(
        asked, 0.0, 0.0, 1.0, 'not one run came to its end in time', False, False, done, seconds, way, tuple(notes)
    )
    if done == 0:
        return found
    bounds = bounds_of(good, undecided, done, doubt)
    value, low, high = bounds
    if asked.is_negated:
        value, low, high = 1.0 - value, 1.0 - high, 1.0 - low
    how = (
        f'statistical: {done} random runs (seed {limits.seed}), within {bounds.error:.3f} with probability '
        f'{limits.confidence:g}, automata {_ORDERS[path.order]}'
    )
    whole = not undecided and (is_enough or done >= wanted)
    return replace(found, value=value, low=low, high=high, how=how, is_complete=whole, has_failed=has_failed)


class _RoundRuns:
    """Random runs from round to round; each round is computed once. ``made``: the parts of the last run."""

    def __init__(self, path: ModelPath, rounds: Rounds, generator: random.Random) -> None:
        self._path = path
        self._rounds = rounds
        self._random = generator
        self.made: list[tuple[int | None, int, int]] = []
        self._times = list(path.system.times())

    def one(self, watch: Watch) -> bool | None:
        """Make a run, and return whether the property is satisfied. Raises OverError."""
        self.made = []
        number = self._take(None, 0, self._rounds.first(watch))
        for count, at in enumerate(self._times):
            if number < 0:
                break
            if count % 16 == 0:
                watch.check()
            number = self._take(number, at, self._rounds.after(number, at, watch))
        return (number if number < 0 else self._rounds.at_end(number)) == SATISFIED

    def _take(self, number: int | None, at: int, outcomes: Outcomes) -> int:
        after = one_of(outcomes, self._random.random)
        self.made.append((number, at, after))
        return after

    def way(self) -> tuple[str, ...]:
        """Return the last run in words."""
        found: list[str] = []
        for one in self.made:
            inner = [line for step in self._rounds.steps_to(*one) for line in self._path.system.narrate(*step)]
            if one[1] and inner:
                found.append(f'at {one[1] / NANOSECONDS:g} s')
            found += inner
        return tuple(found)


class _StepRuns:
    """Random runs from step to step. ``made``: the steps of the last run."""

    def __init__(self, path: ModelPath, generator: random.Random) -> None:
        self._path = path
        self._random = generator
        self.made: list[Made] = []

    def one(self, watch: Watch) -> bool | None:
        """Make a run, and return whether the property is satisfied; None if undecided after a million steps. Raises
        OverError."""
        path, generator = self._path, self._random
        state = one_of(path.system.initial(), generator.random)
        self.made = []
        for count in range(_RUN):
            if count % 256 == 0:
                watch.check()
            decided = path.decided(state, count)
            if decided is not None:
                return decided
            steps = path.steps(state)
            if not steps:
                return path.at_end(state)
            step = steps[0] if len(steps) == 1 else steps[int(generator.random() * len(steps))]
            after = one_of(path.system.follow(state, step), generator.random)
            self.made.append((state, step, after))
            state = after
        return None

    def way(self) -> tuple[str, ...]:
        """Return the last run in words."""
        return tuple(line for one in self.made for line in self._path.system.narrate(*one))
