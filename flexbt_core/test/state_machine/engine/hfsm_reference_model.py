# SPDX-License-Identifier: BSD-3-Clause
"""A small model of a run, written from the rules and not from the engine: what has to come of each operation.

It is a tree of seats, of plain data. What has priority, what stands still, what a lock holds back and what is to be
done is found out anew each time, by looking at the whole tree; the engine keeps that, and is notified of changes.

The order of things: whatever can happen first in the order of the children does, in a machine before around it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from flexbt_core.state_machine.model.definition import StateKind
from flexbt_testing.state_machines.random_machines import RandomNode, Visit

LIVELOCK: Final = 60
REST_TIME: Final = 3.0
STOP_TIME: Final = 10.0

Wish = tuple[str, str, str]
"""Kind, path and outcome of what waits for the operator."""


@dataclass(eq=False)
class Seat:
    """A place for an active state or machine. ``phase``: 'empty', 'coming', 'in', or 'left' and halting."""

    outer: Seat | None
    node: RandomNode | None = None
    phase: str = 'empty'
    wish: str | None = None
    why: str = 'OUTCOME'
    is_approved: bool = False
    is_repeated: bool = False
    decision: Wish | None = None
    number: int = 0
    until: float | None = None  # when the wait for rest is over
    # of a state
    visit: Visit | None = None
    is_entered: bool = False
    is_resumed: bool = False
    is_paused: bool = False
    is_at_rest: bool = True
    asks: bool = False
    is_woken: bool = False
    told: str | None = None
    # of a machine
    inner: list[Seat] = field(default_factory=list)
    ended: dict[str, str] = field(default_factory=dict)
    ending: str | None = None

    def all(self) -> Iterator[Seat]:
        """Yield this seat and everything in it."""
        yield self
        for seat in self.inner:
            yield from seat.all()

    @property
    def occupant(self) -> RandomNode:
        assert self.node is not None
        return self.node

    @property
    def is_state(self) -> bool:
        return self.node is not None and not self.node.children


def inside(path: str, top: str) -> bool:
    return top == '/' or f'{path}/'.startswith(f'{top}/')


class Model:
    """Each operation gives whether it is accepted, and leaves the model in its next stable state."""

    def __init__(self, root: RandomNode, level: int) -> None:
        self.events: list[str] = []
        self.transitions: list[tuple[str, str, str]] = []
        self.outcome: str | None = None
        self.decisions = 0
        self.locked: set[str] = set()
        self.breakpoints: set[str] = set()
        self.is_paused = False
        self._levels = {node.path: level for node in root.all()}
        self._visits = dict.fromkeys((node.path for node in root.all()), 0)
        self._now = 0.0
        self._count = 0
        self._end: str | None = None
        self._end_until: float | None = None
        self._root = Seat(None, root, 'in')
        self._open(self._root)
        self._go_on()

    # -- what there is -----------------------------------------------------------------------------------------------

    def seats(self) -> list[Seat]:
        """Of everything that is active, outermost first, the root not included."""
        return [seat for seat in self._root.all() if seat.outer is not None and seat.phase in ('in', 'left')]

    @property
    def active(self) -> list[RandomNode]:
        """The active states."""
        return [seat.occupant for seat in self.seats() if seat.is_state]

    @property
    def paused(self) -> list[str]:
        """Paths of the states that stand still."""
        return [seat.occupant.path for seat in self.seats() if seat.is_paused]

    @property
    def pending(self) -> list[tuple[int, Wish]]:
        """Number and content of what waits for the operator, oldest first."""
        found = [(seat.number, seat.decision) for seat in self.seats() if seat.decision is not None]
        return sorted(found, key=lambda one: one[0])

    @property
    def stands(self) -> bool:
        """True if the run ends or has ended, so that nothing is accepted any more."""
        return self.outcome is not None or self._end is not None

    # -- operations --------------------------------------------------------------------------------------------------

    def event(self, node: RandomNode, outcome: str | None) -> None:
        """Give a state an event by which it wants to be left, or no longer."""
        for seat in self.seats():
            if seat.node is node:
                seat.told, seat.is_woken = outcome, True
        self._go_on()

    def rest(self, node: RandomNode) -> None:
        """Note that a state has halted."""
        for seat in self.seats():
            if seat.node is node:
                seat.is_at_rest = True
        self._go_on()

    def pass_time(self, seconds: float) -> None:
        end = self._now + seconds
        while self.outcome is None:
            times = [self._end_until, *(seat.until for seat in self._root.all())]
            due = [time for time in times if time is not None and self._now < time <= end]
            if not due:
                break
            self._now = min(due)
            self._go_on()
        self._now = end

    def set_autonomy(self, level: int, path: str) -> bool:
        if self.stands:
            return False
        for other in self._levels:
            if inside(other, path):
                self._levels[other] = level
        self._go_on()
        return True

    def mark(self, marked: set[str], path: str) -> bool:
        if self.stands or path in marked:
            return False
        marked.add(path)
        self._go_on()
        return True

    def unmark(self, marked: set[str], path: str) -> bool:
        if self.stands or path not in marked:
            return False
        marked.remove(path)
        self._go_on()
        return True

    def pause(self, is_paused: bool) -> bool:
        if self.stands or self.is_paused is is_paused:
            return False
        self.is_paused = is_paused
        self._go_on()
        return True

    def confirm(self, number: int) -> bool:
        seat = next((seat for seat in self.seats() if seat.decision is not None and seat.number == number), None)
        if seat is None or seat.decision is None or not seat.decision[2] or self._free(seat.occupant.path) is None:
            return False
        self._settle(seat, seat.decision[2])
        return True

    def force(self, path: str, outcome: str, number: int | None) -> bool:
        seat = self._free(path)
        if seat is None or outcome not in seat.occupant.outcomes:
            return False
        if number is not None and (seat.decision is None or seat.number != number):
            return False
        seat.why = 'FORCED'
        self._settle(seat, outcome)
        return True

    def repeat(self, path: str) -> bool:
        seat = self._free(path)
        if seat is None or any(one != path and inside(one, path) for one in self._locked()):
            return False
        self._count = 0
        seat.is_repeated, seat.why, seat.wish = True, 'REPEATED', None
        self._take(seat, None)
        self._go_on(self._count)
        return True

    def switch(self) -> bool:
        """Continue with the same machine, made again."""
        is_between = any(seat.phase == 'left' or seat.ending is not None for seat in self._root.all())
        if self.stands or is_between:
            return False
        for seat in self._root.all():
            seat.decision, seat.is_approved = None, False
            if not seat.is_state:
                seat.why = 'OUTCOME'
        self._visits = dict.fromkeys(self._visits, 0)
        self._go_on()
        return True

    def resume(self) -> None:
        """Go on in another run, after this one ended without notice."""
        self._visits = dict.fromkeys(self._visits, 0)
        self.events, self.transitions = [], []
        for seat in list(self._root.all()):
            if seat.phase == 'left' or seat.ending is not None:
                seat.wish = seat.ending or seat.wish
                seat.inner, seat.ending = [], None
            seat.decision, seat.until, seat.is_paused = None, None, False
            seat.is_at_rest, seat.why = True, 'OUTCOME'
            if seat.is_state and seat.phase == 'in' and seat.wish is None:
                seat.phase, seat.is_resumed = 'coming', True
            seat.is_entered = False
        self._go_on()

    def stop(self) -> None:
        if not self.stands:
            self._finish('preempted', 'PREEMPTED')
            self._go_on()

    def abort(self) -> None:
        """Stop again: what has had its time to halt is not waited for any longer."""
        if self._end_until is not None and self._now >= self._end_until - STOP_TIME + REST_TIME:
            self._end_until = self._now
        self._go_on()

    # -- what follows ------------------------------------------------------------------------------------------------

    def _free(self, path: str) -> Seat | None:
        """Return the seat of something active with which the operator can do what they want."""
        seat = next((seat for seat in self.seats() if seat.occupant.path == path), None)
        if self.stands or seat is None or self._is_held(seat):
            return None
        around = seat.outer
        is_left = seat.phase == 'left'
        while around is not None:
            is_left = is_left or around.phase == 'left' or around.ending is not None or around.wish is not None
            around = around.outer
        return None if is_left else seat

    def _settle(self, seat: Seat, outcome: str) -> None:
        seat.wish, seat.is_approved, seat.decision = outcome, True, None
        self._go_on()

    def _focus(self) -> str | None:
        """Return what has priority: the innermost of the priority containers that are active."""
        found = [seat.occupant.path for seat in self.seats() if seat.occupant.kind is StateKind.PRIORITY]
        return max(found, key=lambda path: path.count('/'), default=None)

    def _is_held(self, seat: Seat) -> bool:
        focus, path = self._focus(), seat.occupant.path
        return self.is_paused or (focus is not None and not inside(path, focus) and not inside(focus, path))

    def _locked(self) -> set[str]:
        """Return what is locked and active, also before another run has entered it again."""
        again = [seat for seat in self._root.all() if seat.is_resumed and seat.phase == 'coming']
        return self.locked & {'/', *(seat.occupant.path for seat in (*self.seats(), *again))}

    def _go_on(self, count: int = 0) -> None:
        """All that follows at once, after ``count`` transitions already."""
        self._count = count
        while self.outcome is None:
            if self._end is not None:
                is_busy = self._is_busy(self._root)
                if is_busy and not self._is_time('_end_until', None, STOP_TIME):
                    return
                self.outcome, self._root.inner = 'error' if is_busy else self._end, []
            elif self._root.wish is not None:
                self._finish(self._root.wish, 'PARENT_LEFT')
            elif not self._pause_one() and (self.is_paused or not self._step_inside(self._root)) and not self.stands:
                return

    def _pause_one(self) -> bool:
        for seat in self.seats():
            if seat.is_state and seat.is_entered and seat.is_paused != self._is_held(seat):
                seat.is_paused = not seat.is_paused
                seat.is_woken = seat.is_woken or not seat.is_paused
                self.events.append(f'{"on_pause" if seat.is_paused else "on_resume"} {seat.occupant.path}')
                return True
        return False

    def _step_inside(self, seat: Seat) -> bool:
        if seat.wish is not None:
            return False
        if seat.ending is not None:
            return self._try_to_end(seat)
        entries_first = sorted(seat.inner, key=lambda inner: inner.phase != 'coming')
        return any(inner.phase != 'empty' and not self._is_held(inner) and self._step(inner) for inner in entries_first)

    def _step(self, seat: Seat) -> bool:
        if seat.phase == 'coming':
            self._enter(seat, seat.occupant)
            return True
        if seat.phase == 'left':
            return self._pass_on(seat)
        if seat.wish is None and (self._execute(seat) if seat.is_state else self._step_inside(seat)):
            return True
        if seat.wish is not None and seat.occupant.runs_on and not seat.is_approved:
            if self._consider(seat):
                return True
            self._execute(seat)
        return self._consider(seat)

    def _execute(self, seat: Seat) -> bool:
        """Return a state is executed, if there is a reason to."""
        goes_on = seat.occupant.runs_on and seat.why == 'OUTCOME' and seat.is_entered
        if not seat.is_woken or seat.asks or (seat.wish is not None and not goes_on):
            return False
        seat.is_woken = False
        assert seat.visit is not None
        if seat.visit.kind == 'execute':
            self._fail(seat)
        elif seat.visit.kind == 'ask':
            seat.asks, seat.wish = True, None
        else:
            seat.wish = seat.told
        return seat.wish is not None

    def _consider(self, seat: Seat) -> bool:
        kind, wanted = 'transition', seat.wish
        if wanted is None:
            if not seat.asks or seat.visit is None:
                seat.decision = None
                return False
            kind, wanted = 'choice', seat.visit.outcome
        path = seat.occupant.path
        if wanted is not None:
            top = self._top_left_by(seat, wanted)
            if any(inside(one, top) for one in self._locked()):
                seat.decision = None
                return False
            required = seat.occupant.required[wanted]
            if seat.is_approved or (path not in self.breakpoints and required < self._levels[path]):
                self._take(seat, wanted)
                return True
        decision = (kind, path, wanted or '')
        if seat.decision != decision:
            self.decisions += 1
            seat.number = self.decisions
        seat.decision = decision
        return False

    def _top_left_by(self, seat: Seat, outcome: str) -> str:
        """Return what is left when the seat is: perhaps what is around it as well."""
        path, around, after = seat.occupant.path, seat.outer, self._after(seat, outcome, with_left=True)
        while around is not None and isinstance(after, str):
            path = around.occupant.path
            after = self._after(around, after, with_left=True) if around.outer is not None else None
            around = around.outer
        return path

    def _after(self, seat: Seat, outcome: str, *, with_left: bool = False) -> RandomNode | str | None:
        """Return the result of leaving by an outcome: a sibling, the outcome of what is around it, or nothing.
        ``with_left``: what was left beside it, and has not halted, has ended, too."""
        around = seat.outer
        assert around is not None
        if around.occupant.kind is not StateKind.CONCURRENCY:
            return seat.occupant.ways[outcome]
        left = [one for one in around.inner if with_left and one.phase == 'left' and one.wish is not None]
        ended = around.ended | {one.occupant.path: one.wish for one in left} | {seat.occupant.path: outcome}
        for result, children in around.occupant.conditions:
            if all(ended.get(child.path) == wanted for child, wanted in children):
                return result
        return None

    def _take(self, seat: Seat, wanted: str | None) -> None:
        """Leave the seat by what it wants, or take it again."""
        self._count += 1
        seat.wish, seat.asks = wanted, False
        if self._count > LIVELOCK:
            self._leave(seat, seat.why)
            self._finish('error', 'FAULT')
            return
        self._leave(seat, seat.why)
        if seat.wish == wanted and not self.stands:
            seat.phase = 'left'

    def _leave(self, seat: Seat, why: str) -> None:
        """Call on_exit of everything in a seat that was entered."""
        seat.decision, seat.is_approved, seat.until = None, False, None
        if seat.phase == 'coming':
            seat.phase = 'empty'
        if seat.is_state:
            if seat.is_entered:
                seat.is_entered = seat.is_paused = False
                self.events.append(f'on_exit {seat.occupant.path} {why}')
                assert seat.visit is not None
                if seat.visit.leaving == 'raise' and why == 'OUTCOME':
                    self._fail(seat)
            return
        seat.ending = None
        for inner in seat.inner:
            self._leave(inner, why if why in ('PREEMPTED', 'FAULT') else 'PARENT_LEFT')

    def _is_busy(self, seat: Seat) -> bool:
        """Return whether something in it has not halted."""
        return any(one.is_state and one.phase in ('in', 'left') and not one.is_at_rest for one in seat.all())

    def _is_time(self, name: str, seat: Seat | None, seconds: float = REST_TIME) -> bool:
        """Return whether the wait for rest, which begins with the first time that this is asked, is over."""
        owner = seat or self
        until: float | None = getattr(owner, name)
        if until is None:
            until = self._now + seconds
            setattr(owner, name, until)
        return self._now >= until

    def _pass_on(self, seat: Seat) -> bool:
        if not seat.is_repeated and isinstance(self._after(seat, seat.wish or ''), str):
            top, path = self._top_left_by(seat, seat.wish or ''), seat.occupant.path
            if any(inside(one, top) and not inside(one, path) for one in self._locked()):
                return False
        if self._is_busy(seat) and not self._is_time('until', seat):
            return False
        node, wish, around = seat.occupant, seat.wish, seat.outer
        assert around is not None
        self.transitions.append((node.path, wish or '', seat.why))
        following = node if seat.is_repeated else self._after(seat, wish or '')
        if isinstance(following, RandomNode):
            self._enter(seat, following)
            return True
        seat.phase, seat.node, seat.inner, seat.until = 'empty', None, [], None
        if around.occupant.kind is not StateKind.CONCURRENCY:
            around.wish = following
        else:
            around.ended[node.path] = wish or ''
            if following is not None:
                around.ending = following
                for inner in around.inner:
                    self._leave(inner, 'PARENT_LEFT')
        return True

    def _try_to_end(self, seat: Seat) -> bool:
        if any(map(self._is_busy, seat.inner)) and not self._is_time('until', seat):
            return False
        seat.wish, seat.ending, seat.inner, seat.until = seat.ending, None, [], None
        return True

    def _enter(self, seat: Seat, node: RandomNode) -> None:
        is_resumed = seat.is_resumed and seat.phase == 'coming'
        fresh = Seat(seat.outer, node, 'in')
        seat.__dict__.update(fresh.__dict__)
        if node.children:
            self._open(seat)
            return
        visit = node.visits[self._visits[node.path] % len(node.visits)]
        self._visits[node.path] += 1
        seat.visit, seat.is_entered, seat.is_woken = visit, True, True
        seat.told = visit.outcome if visit.kind == 'go' else None
        seat.is_at_rest = visit.leaving != 'slow'
        self.events.append(f'on_enter {node.path}{" resumed" if is_resumed else ""}')
        if visit.kind == 'on_enter':
            self._fail(seat)

    def _open(self, seat: Seat) -> None:
        node = seat.occupant
        if node.kind is StateKind.CONCURRENCY:
            seat.inner = [Seat(seat, child, 'coming') for child in node.children]
        else:
            seat.inner = [Seat(seat, node.children[0], 'coming')]
        if node.kind is StateKind.MACHINE:
            self._enter(seat.inner[0], node.children[0])

    def _fail(self, seat: Seat) -> None:
        seat.why, seat.asks = 'FAULT', False
        seat.wish = 'failed' if 'failed' in seat.occupant.outcomes else None
        if seat.wish is None:
            self._finish('error', 'FAULT')

    def _finish(self, outcome: str, why: str) -> None:
        if self._end is not None:
            return
        self._end = outcome
        for inner in self._root.inner:
            self._leave(inner, why)
