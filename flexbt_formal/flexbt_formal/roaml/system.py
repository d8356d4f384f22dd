# SPDX-License-Identifier: BSD-3-Clause
"""A whole model: automata, tree and timers that run concurrently, and the steps that they can make.

Only one instance of each event is in transit at a time: the sender of the next one waits until all receivers have
taken it in a single step. A receiver discards an event for which it has no transition; events of ticks, services
and actions wait. Time advances when no other step is possible. Timers that are due at the same time fire one after
the other, in the order of the files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from math import gcd, prod
from typing import Any, Final, NamedTuple, TypeVar

from .ascxml import Timer
from .automaton import (
    Around,
    Automaton,
    Branches,
    Draws,
    EnumeratedDraws,
    LocalState,
    ManyValuesError,
    SampledDraws,
    Send,
    Write,
)
from .dialect import FIELD, Events, bt_event, is_waited_for
from .source_text import ModelFault
from .tree import PluginAnswer, Seen, TreePlayer

_STATUSES: Final = ('SUCCESS', 'FAILURE', 'RUNNING')
NANOSECONDS: Final = 1_000_000_000
MOST_SETS: Final = 20_000
"""Maximum number of sets of random values that are followed in one step."""

_T = TypeVar('_T')


class GlobalState(NamedTuple):
    """The state of a model. ``slots``: events in transit, oldest first. ``tree``: the number of the tree's situation,
    and whether its pending event was sent. ``seen``: the last values of each watched event, None before the first.
    ``time``: ns. ``due``: the next of the timers at this time. ``last``: the number of the automaton that made the last
    step, plus 1."""

    time: int
    due: int
    locals: tuple[LocalState, ...]
    slots: tuple[tuple[int, tuple[Any, ...]], ...]
    tree: tuple[int, bool]
    seen: tuple[tuple[Any, ...] | None, ...]
    last: int


class ModelStep(NamedTuple):
    """A step of a model; ``kind`` is send, deliver, write, ask, timer, or time."""

    kind: str
    subject: int
    event: int | None = None
    values: tuple[Any, ...] = ()


Followers = list[tuple[float, GlobalState]]


class ModelSystem:
    """The automata, tree and timers of a model as one transition system.

    ``watched``: the events that properties use. ``clock``: the event that publishes the time.
    Attribute: ``draws``. If true, a step draws one of the random values with ``draw``; otherwise it follows all of
    them.
    """

    def __init__(
        self,
        automata: Sequence[Automaton],
        tree: TreePlayer | None,
        timers: Sequence[Timer],
        events: Events,
        *,
        end: int,
        keeps_ticking: bool,
        clock: int,
        watched: Sequence[int],
        draw: Callable[[], float],
    ) -> None:
        self.automata = tuple(automata)
        self.tree = tree
        self.events = events
        self._timers = tuple(timers)
        self._tick = gcd(*(timer.period for timer in timers)) if timers else 0
        self._end = end
        self._keeps_ticking = keeps_ticking
        self._clock = clock
        self.draws = False
        self._drawn = SampledDraws(draw)
        self._random: Draws = self._drawn
        self._empty = Around({}, self._random)
        self._draw_any = {number for number, automaton in enumerate(automata) if automaton.draws}
        self._places = {event: place for place, event in enumerate(watched)}
        self._of_tree: set[int] = set()
        if tree is not None:
            for instance in tree.instances:
                for kind in ('response', 'halt_response'):
                    self._of_tree.add(events.number(bt_event(instance.uid, kind)))
                for child in instance.children:
                    self._of_tree |= {events.number(bt_event(child, kind)) for kind in ('tick_asked', 'halt_asked')}
        self._first = tree.begin(events, watched) if tree is not None else 0
        self._receivers: list[list[int]] = [[] for _ in events.names]
        for number, automaton in enumerate(automata):
            for event in automaton.received:
                self._receivers[event].append(number)
        self._waits = [is_waited_for(name) for name in events.names]
        self._is_clock_used = bool(self._receivers[clock]) or clock in self._places

    # -- first -------------------------------------------------------------------------------------------------------

    def initial(self) -> Followers:
        """Return the initial states, with probabilities. Raises ModelFault."""
        blank = GlobalState(0, -1, (), (), (self._first, False), (None,) * len(self._places), 0)
        each = [
            self._all(number, lambda one=one: one.begin(self._around(one, blank)))  # type: ignore[misc]
            for number, one in enumerate(self.automata)
        ]
        _check_sets(prod(map(len, each)), 'the automata together')
        return [
            (prod(part for part, _ in combined), blank._replace(locals=tuple(local for _, local in combined)))
            for combined in product(*each)
        ]

    def _around(self, automaton: Automaton, state: GlobalState) -> Around:
        inputs: Mapping[str, Any] | None = None
        if automaton.uid and self.tree is not None:
            inputs = self.tree[state.tree[0]].inputs.get(automaton.uid)
        if inputs is None:
            return self._empty if self._random is self._drawn else Around({}, self._random)
        return Around(inputs, self._random)

    def _all(self, number: int, run: Callable[[], list[tuple[float, _T]]]) -> list[tuple[float, _T]]:
        """Return the results of ``run`` for all random values of an automaton; with ``draws``, one result."""
        if self.draws:
            return [(1.0, one_of(run(), self._drawn.real))]
        if number not in self._draw_any:
            return run()
        found: list[tuple[float, _T]] = []
        ahead: list[tuple[int, ...]] = [()]
        while ahead:
            _check_sets(len(found) + len(ahead), self.automata[number].name)
            random = self._random = EnumeratedDraws(ahead.pop())
            try:
                found += [(random.probability * part, one) for part, one in run()]
            finally:
                self._random = self._drawn
            ahead += random.others
        return found

    # -- steps -------------------------------------------------------------------------------------------------------

    def steps(self, state: GlobalState, *, first_only: bool) -> list[ModelStep]:
        """Return the possible steps; an empty list at the end. ``first_only``: only the next step in turn. Events in
        transit are delivered first, the oldest first; then the automaton that has waited longest continues."""
        found: list[ModelStep] = []
        for place, (event, values) in enumerate(state.slots):
            if self._is_deliverable(event, state):
                found.append(ModelStep('deliver', place, event, values))
                if first_only:
                    return found
        busy = {event for event, _ in state.slots}
        ready = [number for number, local in enumerate(state.locals) if local.at >= 0]
        if self.tree is not None and not state.tree[1]:
            ready.append(len(state.locals))
        if state.last and len(ready) > 1:
            ready = [one for one in ready if one >= state.last] + [one for one in ready if one < state.last]
        for number in ready:
            step = self._due(number, state, busy)
            if step is not None:
                found.append(step)
                if first_only:
                    return found
        if not found:
            later = self._by_time(state)
            return [] if later is None else [later]
        return found

    def _is_deliverable(self, event: int, state: GlobalState) -> bool:
        waits = self._waits[event]
        for number in self._receivers[event]:
            local = state.locals[number]
            if local.at >= 0 or (waits and not self.automata[number].handles(local, event)):
                return False
        if event in self._of_tree:
            assert self.tree is not None
            return state.tree[1] and event in self.tree[state.tree[0]].accepts
        return True

    def _due(self, number: int, state: GlobalState, busy: set[int]) -> ModelStep | None:
        if number == len(self.automata):
            assert self.tree is not None
            pending = self.tree[state.tree[0]].pending
            if pending is None or pending[0] in busy:
                return None
            return ModelStep('ask', number, pending[0], pending[2])
        due = self.automata[number].due(state.locals[number])
        if isinstance(due, Send):
            return None if due.event in busy else ModelStep('send', number, due.event)
        return ModelStep('write', number)

    def _by_time(self, state: GlobalState) -> ModelStep | None:
        if state.slots or not self._timers or any(local.at >= 0 for local in state.locals):
            return None
        due = self.due_at(state.time)
        if 0 <= state.due < len(due):
            timer = self._timers[due[state.due]]
            if timer.event is None:
                assert self.tree is not None
                now = self.tree[state.tree[0]]
                if now.pending is not None or (now.status in (1, 2) and not self._keeps_ticking):
                    return None
            return ModelStep('timer', due[state.due], timer.event)
        after = state.time + self._tick if self._is_clock_used else self._next_time(state.time)
        return ModelStep('time', after) if after < self._end + self._tick else None

    def times(self) -> Iterator[int]:
        """Yield the times at which timers are due until the end, ns."""
        now = 0
        while self._timers and (now := self._next_time(now)) < self._end + self._tick:
            yield now

    def _next_time(self, time: int) -> int:
        return min((time // timer.period + 1) * timer.period for timer in self._timers)

    @property
    def has_timers(self) -> bool:
        return bool(self._timers)

    @property
    def is_timeless(self) -> bool:
        """True if the effects of due timers do not depend on the time."""
        return not self._is_clock_used and (self.tree is None or not self.tree.asks_time)

    def due_at(self, time: int) -> tuple[int, ...]:
        """Return the timers that are due at a time."""
        return tuple(number for number, timer in enumerate(self._timers) if time % timer.period == 0)

    def is_blocked(self, state: GlobalState) -> bool:
        """Return whether time cannot advance because something waits, or the tree has ended."""
        if state.slots or 0 <= state.due < len(self.due_at(state.time)):
            return True
        return any(local.at >= 0 for local in state.locals)

    def follow(self, state: GlobalState, step: ModelStep) -> Followers:
        """Return the states after a step, with probabilities. Raises ModelFault."""
        kind = step.kind
        if kind == 'deliver':
            return self._deliver(state, step)
        if kind in ('send', 'write'):
            return self._go_on(state, step)
        if kind == 'ask':
            assert step.event is not None
            return [(1.0, self._put(state._replace(tree=(state.tree[0], True), last=0), step.event, step.values))]
        if kind == 'timer':
            after = state._replace(due=state.due + 1, last=0)
            if step.event is not None:
                return self._taken(after, step.event, ())
            assert self.tree is not None
            number, seen = self.tree.tick(state.tree[0], state.time / NANOSECONDS)
            return [(1.0, self._note(after._replace(tree=(number, False)), seen))]
        after = state._replace(time=step.subject, due=0, last=0)
        if self._is_clock_used:
            now = divmod(step.subject, NANOSECONDS)
            carried = dict(zip(('ros_fields__sec', 'ros_fields__nanosec'), now, strict=True))
            after = self._put(
                after, self._clock, tuple(carried.get(name, 0) for name in self.events.parameters[self._clock])
            )
        return [(1.0, after)]

    def _is_received(self, event: int) -> bool:
        return bool(self._receivers[event]) or event in self._of_tree

    def _put(self, state: GlobalState, event: int, values: tuple[Any, ...]) -> GlobalState:
        """Put an event in transit, unless it has no receiver."""
        state = self._note(state, ((event, values),))
        if self._is_received(event):
            state = state._replace(slots=(*state.slots, (event, values)))
        return state

    def _note(self, state: GlobalState, seen: Seen) -> GlobalState:
        for event, values in seen:
            place = self._places.get(event)
            if place is not None:
                state = state._replace(seen=_with(state.seen, place, values))
        return state

    def _go_on(self, state: GlobalState, step: ModelStep) -> Followers:
        number = step.subject
        automaton = self.automata[number]
        local = state.locals[number]
        due = automaton.due(local)
        assert due is not None

        def run() -> Followers:
            values = automaton.values(local, due, self._around(automaton, state))
            if isinstance(due, Send):
                then = self._put(state, due.event, values)
            else:
                then = self._written(state, due, values[0])
            return [
                (part, then._replace(locals=_with(then.locals, number, after), last=number + 1))
                for part, after in automaton.go_on(local, self._around(automaton, then))
            ]

        return self._all(number, run)

    def _written(self, state: GlobalState, due: Write, value: Any) -> GlobalState:
        assert self.tree is not None
        try:
            tree, seen = self.tree.write(state.tree[0], due.uid, due.port, value)
        except ModelFault as error:
            raise ModelFault(f'{due.place}: {error}') from error
        return self._note(state._replace(tree=(tree, state.tree[1])), seen)

    def _deliver(self, state: GlobalState, step: ModelStep) -> Followers:
        event = step.event
        assert event is not None
        state = state._replace(slots=(*state.slots[: step.subject], *state.slots[step.subject + 1 :]), last=0)
        if event in self._of_tree and self.tree is not None:
            number = state.tree[0]
            answer = self.tree[number].accepts[event]
            if answer.kind == 'response':
                answer = PluginAnswer(answer.kind, answer.uid, step.values[0] if step.values else 0)
            after, seen = self.tree.answer(number, answer)
            state = self._note(state._replace(tree=(after, False)), seen)
        return self._taken(state, event, step.values)

    def _taken(self, state: GlobalState, event: int, values: tuple[Any, ...]) -> Followers:
        """Return the states after all receivers have taken an event."""
        found = [(1.0, state)]
        for number in self._receivers[event]:
            automaton = self.automata[number]
            local = state.locals[number]
            if local.at >= 0:
                continue
            branches: Branches = self._all(
                number,
                lambda automaton=automaton, local=local: automaton.take(  # type: ignore[misc]
                    local, event, values, self._around(automaton, state)
                ),
            )
            if len(branches) == 1 and branches[0][1] is local:
                continue
            _check_sets(len(found) * len(branches), f'who takes {self.events.names[event]}')
            found = [
                (whole * part, one._replace(locals=_with(one.locals, number, after)))
                for whole, one in found
                for part, after in branches
            ]
        return found

    # -- in words ----------------------------------------------------------------------------------------------------

    def narrate(self, state: GlobalState, step: ModelStep, after: GlobalState) -> Iterator[str]:
        """Describe a step in words, without unimportant details."""
        if step.kind == 'ask':
            assert self.tree is not None and step.event is not None
            what = self.events.names[step.event].rpartition('_')[2]
            pending = self.tree[state.tree[0]].pending
            if pending is not None and what in ('tick', 'halt'):
                yield f'the tree {what}s {self.tree.path(pending[1])}'
        elif step.kind == 'send' and not self._is_between(step.subject):
            yield from self._told(state, step.subject, after)
        elif step.kind == 'time':
            yield f'at {step.subject / NANOSECONDS:g} s'
        elif step.kind == 'timer' and step.event is None:
            yield 'the tree is ticked'
        for number, (before, now) in enumerate(zip(state.locals, after.locals, strict=True)):
            automaton = self.automata[number]
            if now.at < 0 and before.at != now.at and not automaton.uid and not self._is_between(number):
                yield f'{automaton.name} is in {automaton.state_of(now)}'
        if self.tree is not None and state.tree != after.tree:
            status = self.tree[after.tree[0]].status
            if status and self.tree[after.tree[0]].pending is None:
                yield f'the tree gives {_STATUSES[status - 1]}'

    def _is_between(self, number: int) -> bool:
        """Return whether an automaton only relays between clients and servers."""
        return self.automata[number].name.startswith(('srv_handler_', 'action_handler_'))

    def _told(self, state: GlobalState, number: int, after: GlobalState) -> Iterator[str]:
        automaton = self.automata[number]
        local = state.locals[number]
        due = automaton.due(local)
        if not isinstance(due, Send):
            return
        event = self.events.names[due.event]
        if self._is_received(due.event):
            values = after.slots[-1][1]
        else:
            place = self._places.get(due.event)
            sent = None if place is None else after.seen[place]
            values = automaton.values(local, due, self._around(automaton, state)) if sent is None else sent
        who = automaton.name
        if automaton.uid and self.tree is not None:
            who = self.tree.path(automaton.uid)
            if event.endswith('_halt_response'):
                return
            if event == bt_event(automaton.uid, 'response') and values and values[0] in (1, 2, 3):
                yield f'{who} gives {_STATUSES[values[0] - 1]}'
                return
        carried = zip(self.events.parameters[due.event], values, strict=True)
        shown = ', '.join(f'{name.removeprefix(FIELD)} {value!r}' for name, value in carried)
        yield f'{who} sends {event}{f" ({shown})" if shown else ""}'

    def waiting(self, state: GlobalState) -> str:
        """Return why no step is possible; '' at the end of the time or of the tree."""
        found = []
        for event, _ in state.slots:
            who = [
                f'{self.automata[number].name} in {self.automata[number].state_of(state.locals[number]) or "a sending"}'
                for number in self._receivers[event]
                if state.locals[number].at >= 0 or not self.automata[number].handles(state.locals[number], event)
            ]
            found.append(f'{self.events.names[event]} waits for {", ".join(who) or "the tree"}')
        if found:
            return f'stuck: {"; ".join(found)}'
        if self.tree is not None:
            pending = self.tree[state.tree[0]].pending
            if pending is not None:
                return f'stuck: the tree waits for the answer of {self.tree.path(pending[1])}'
        return ''


def one_of(choices: Sequence[tuple[float, _T]], draw: Callable[[], float]) -> _T:
    """Draw one of the choices by their probabilities."""
    if len(choices) == 1:
        return choices[0][1]
    drawn = draw()
    for probability, one in choices:
        drawn -= probability
        if drawn < 0.0:
            return one
    return choices[-1][1]


def _with(items: tuple[Any, ...], place: int, new: Any) -> tuple[Any, ...]:
    return (*items[:place], new, *items[place + 1 :])


def _check_sets(count: int, who: str) -> None:
    if count > MOST_SETS:
        raise ManyValuesError(f'{who}: too many values are drawn at once to follow each')
