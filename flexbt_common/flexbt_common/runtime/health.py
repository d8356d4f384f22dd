# SPDX-License-Identifier: BSD-3-Clause
"""A check that the threads of a process answer, as a condition for reporting it alive.

Each part that must keep answering is registered: the executor, the thread of a run, the loop of a simulation. Every
:data:`PERIOD` the clock's thread pings all of them. One that waits as it should counts as answering, and is not woken.
When the last one has answered, that is a *beat*. The process reports that it is alive only on beats, so not while one
of these threads or the clock's own hangs. After a hang, beats pause for :data:`SETTLE_SECONDS`, so that the thread can
handle its pending work; work that takes longer is not waited for.

The process reports a hang once, with the stack of the thread, and also its end. It reports a pause of the whole process
before a thread that calls :meth:`Health.check_pause` continues.
"""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from types import FrameType
from typing import Final

from flexbt_core.clock.clock import Clock

PERIOD: Final = 0.15
"""Time from one ping to the next, s of wall time."""

LATE_SECONDS: Final = 0.3
"""Time without an answer after which a thread is late, s. With :data:`PERIOD` that is less than the lease of the
liveliness token, so that others get the reason before they miss the process."""

HANG_SECONDS: Final = 1.0
"""Time without an answer after which a thread hangs, s: it is logged with its stack."""

OUT_OF_REACH_SECONDS: Final = 2.0
"""Pause of the whole process after which other nodes, and their middleware (after the lease of a participant), may have
given it up, s. Messages sent to it meanwhile, cancels too, may be lost."""

SETTLE_SECONDS: Final = 0.3
"""Time after a hang, or a stop of the whole process, in which it is not reported alive, s of wall time. A cancel that
was pending passes through the threads of the process, and on to others, before the work that it ends can continue. That
takes a tenth of a second if no other work was pending; the time does not guarantee that everything is handled."""

Ping = Callable[[Callable[[], None]], object]
"""Called on the clock's thread with ``answer``, which the watched thread must call soon. It must not block, and may
drop an earlier ``answer``."""


@dataclass(frozen=True)
class Hang:
    """A present or past hang of a thread: its name, its duration (s of wall time), and its place, as a line and as the
    text of its stack for a log. ``was_out_of_reach``: the whole process was stopped for :data:`OUT_OF_REACH_SECONDS`.
    """

    name: str
    seconds: float
    where: str = ''
    stack: str = ''
    is_over: bool = False
    was_out_of_reach: bool = False

    def __str__(self) -> str:
        if self.is_over:
            return f'{self.name} answers again, after {self.seconds:.1f} s'
        return f'{self.name} has not answered for {self.seconds:.1f} s' + (f': {self.where}' if self.where else '')


class WatchedThread:
    """A thread that must answer until :meth:`close`. From any thread."""

    def __init__(
        self, health: Health, name: str, ping: Ping, thread: threading.Thread | None, where: Callable[[], str] | None
    ) -> None:
        self.name = name
        self.ping = ping
        self.asked_at = 0.0
        self.is_told = False
        self._health = health
        self._thread = thread
        self._where = where

    def close(self) -> None:
        """Stop watching it. May be called twice."""
        self._health.forget(self)

    def hang(self, now: float) -> Hang:
        """Return the report of the hang while the thread does not answer."""
        thread = self._thread
        frame = None if thread is None or thread.ident is None else sys._current_frames().get(thread.ident)
        where = self._where() if self._where else '' if frame is None else _place(frame)
        stack = '' if frame is None else ''.join(traceback.format_stack(frame)).rstrip()
        return Hang(self.name, now - self.asked_at, where, stack)


class WatchedLoop:
    """A thread that works in a loop and must soon wait again.

    Inside its ``with`` block, the thread that entered the block is watched. Inside :meth:`resting` it may take any
    time, because it waits to be woken; so it may while ``is_held_up()``, for example by a debugger.
    """

    def __init__(
        self, health: Health, name: str, where: Callable[[], str] | None, is_held_up: Callable[[], bool] | None
    ) -> None:
        self._health = health
        self._name = name
        self._where = where
        self._is_held_up = is_held_up
        self._lock = threading.Lock()
        self._is_resting = False
        self._answer: Callable[[], None] | None = None
        self._watched: WatchedThread | None = None

    def __enter__(self) -> WatchedLoop:
        self._watched = self._health.register(self._name, self._ping, threading.current_thread(), self._where)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop watching the thread, wherever it is. From any thread; may be called twice."""
        if self._watched is not None:
            self._watched.close()

    @contextlib.contextmanager
    def resting(self) -> Iterator[None]:
        """Mark the block as waiting. On the thread of the loop."""
        with self._lock:
            self._is_resting = True
            answer, self._answer = self._answer, None
        if answer is not None:
            answer()
        try:
            yield
        finally:
            with self._lock:
                self._is_resting = False
            self._health.check_pause()

    def _ping(self, answer: Callable[[], None]) -> None:
        with self._lock:
            self._answer = answer
            if not self._is_resting and not (self._is_held_up and self._is_held_up()):
                return
        answer()


class Health:
    """The threads that must answer, and the listeners to their state. Thread-safe.

    Listeners must not block: they are called on the clock's thread, on an answering thread, or on one that checks.
    """

    def __init__(self, steady: Clock) -> None:
        self._steady = steady
        self._lock = threading.Lock()
        # Held during reports of lateness, so that the last report is the current one.
        self._telling = threading.Lock()
        self._watched: list[WatchedThread] = []
        self._missing: set[WatchedThread] = set()
        self._on_beat: list[Callable[[], object]] = []
        self._on_late: list[Callable[[str], object]] = []
        self._on_hang: list[Callable[[Hang], object]] = []
        self._asked_at = math.inf  # not yet
        self._looked_at = 0.0
        self._settled_at = -math.inf
        self.returned_at = -math.inf
        """When the process went on after it had been out of reach the last time, on the steady clock, s."""
        # Held until a pause is reported, so that a checking thread continues after that. Acquired before other locks.
        self._pausing = threading.RLock()
        self._is_late = False
        self._failure = ''

    def register(
        self,
        name: str,
        ping: Ping,
        thread: threading.Thread | None = None,
        where: Callable[[], str] | None = None,
    ) -> WatchedThread:
        """Watch something until it is closed.

        ``name`` is the subject of a sentence ('the executor'). ``where`` returns its present activity for people; by
        default, the report has the innermost call of ``thread``.
        """
        watched = WatchedThread(self, name, ping, thread, where)
        with self._lock:
            self._watched.append(watched)
        return watched

    def loop(
        self, name: str, where: Callable[[], str] | None = None, is_held_up: Callable[[], bool] | None = None
    ) -> WatchedLoop:
        """Watch a thread that works in a loop; see :class:`WatchedLoop`. ``where`` as for :meth:`register`."""
        return WatchedLoop(self, name, where, is_held_up)

    def forget(self, watched: WatchedThread) -> None:
        """See :meth:`WatchedThread.close`."""
        with self._lock:
            if watched in self._watched:
                self._watched.remove(watched)
        self._answered(watched)

    def on_beat(self, fn: Callable[[], object]) -> None:
        """Call ``fn`` each time all threads have answered."""
        with self._lock:
            self._on_beat.append(fn)
            begins = self._asked_at == math.inf
            if begins:
                self._asked_at = self._steady.now()
        if begins:
            self._ask()

    def on_late(self, fn: Callable[[str], object]) -> None:
        """Call ``fn`` with the problem, for people, when a thread has not answered for :data:`LATE_SECONDS`.

        Call it with '' when all answer again.
        """
        self._on_late.append(fn)

    def on_hang(self, fn: Callable[[Hang], object]) -> None:
        """Call ``fn`` for each hang, once after :data:`HANG_SECONDS`, and again when it is over."""
        self._on_hang.append(fn)

    def cancel_on_hang(self, fn: Callable[[Hang], object]) -> None:
        """Undo :meth:`on_hang`."""
        self._on_hang.remove(fn)

    def fail(self, problem: str) -> None:
        """Stop the heartbeat permanently: the process cannot do its work. The first problem counts."""
        with self._telling:
            if self._failure:
                return
            self._failure = problem
            for fn in list(self._on_late):
                fn(problem)

    @property
    def failure(self) -> str:
        """Reason why the process cannot do its work; '' while it can."""
        return self._failure

    def check_pause(self) -> None:
        """Report a pause of the whole process of :data:`OUT_OF_REACH_SECONDS` or more, on this thread. Call this after
        a wait, before the thread continues.
        """
        with self._pausing:
            now = self._steady.now()
            pause, self._looked_at = now - max(self._asked_at, self._looked_at), now
            if pause >= OUT_OF_REACH_SECONDS:
                self._asked_at = now
                self._tell_pause(pause, pause)

    def _ask(self) -> None:
        with self._pausing:
            if self._failure:
                return
            now = self._steady.now()
            asked_at, self._asked_at = self._asked_at, now
            pause = now - asked_at
            self._steady.call_at(now + PERIOD, self._ask)
            if pause > HANG_SECONDS:
                self._tell_pause(pause, now - max(asked_at, self._looked_at))
        with self._lock:
            missing = sorted(self._missing, key=lambda watched: watched.asked_at)
            asked = [] if missing else list(self._watched)
            for watched in asked:
                watched.asked_at = now
            self._missing.update(asked)
        if missing and pause <= HANG_SECONDS:
            self._tell_missing(missing, now)
        for watched in asked:
            watched.ping(partial(self._answered, watched))
        if not missing and not asked:
            self._beat()

    def _tell_pause(self, seconds: float, stopped: float) -> None:
        """Report that the clock's thread did not run for some seconds, and no checking thread for ``stopped`` of
        them."""
        self._settled_at = self._steady.now() + SETTLE_SECONDS
        name = 'the whole process (it was stopped, or its computer is busy)'
        was_out_of_reach = stopped >= OUT_OF_REACH_SECONDS
        if was_out_of_reach:
            self.returned_at = self._steady.now()
        self._tell(Hang(name, seconds, is_over=True, was_out_of_reach=was_out_of_reach))

    def _tell_missing(self, missing: list[WatchedThread], now: float) -> None:
        longest = missing[0].hang(now)
        if longest.seconds >= LATE_SECONDS:
            self._tell_late(str(longest))
        for watched in missing:
            if now - watched.asked_at >= HANG_SECONDS and not watched.is_told:
                watched.is_told = True
                self._tell(watched.hang(now))

    def _answered(self, watched: WatchedThread) -> None:
        with self._lock:
            if watched not in self._missing:
                return
            self._missing.remove(watched)
            is_last = not self._missing
        if watched.is_told:
            watched.is_told = False
            now = self._steady.now()
            self._settled_at = now + SETTLE_SECONDS
            self._tell(Hang(watched.name, now - watched.asked_at, is_over=True))
        if is_last:
            self._beat()

    def _beat(self) -> None:
        if self._steady.now() < self._settled_at:
            return
        self._tell_late('')
        if self._failure:
            return
        for beaten in list(self._on_beat):
            beaten()

    def _tell_late(self, problem: str) -> None:
        with self._telling:
            if self._failure or bool(problem) is self._is_late:
                return
            self._is_late = bool(problem)
            for fn in list(self._on_late):
                fn(problem)

    def _tell(self, hang: Hang) -> None:
        for fn in list(self._on_hang):
            fn(hang)


def _place(frame: FrameType) -> str:
    return f'in {frame.f_code.co_qualname} ({frame.f_code.co_filename}:{frame.f_lineno})'
