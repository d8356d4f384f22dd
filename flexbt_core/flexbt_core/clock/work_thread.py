# SPDX-License-Identifier: BSD-3-Clause
"""A thread for work that a disk may delay, and a watchdog that reports slow work."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from .clock import Clock

Work = Callable[[], object]

_WORKING: Final = 0.02
"""Processor share above which a thread counts as computing rather than waiting; low, because a busy computer gives it
little time."""


@dataclass(frozen=True)
class LateWork:
    """A report of work that takes longer than allowed, and whether the thread computes or waits for a disk."""

    what: str
    seconds: float
    uses_processor: bool


class WorkThread:
    """A thread that runs submitted jobs one after the other, until :meth:`close`. Callable from any thread.

    ``on_late`` is called on the thread of ``clock`` when a job takes longer than ``seconds``, and again after each such
    period; then on this thread with None when the job is done. ``on_fault`` gets exceptions of jobs, on this thread.
    """

    def __init__(
        self,
        name: str,
        clock: Clock,
        seconds: float,
        on_late: Callable[[LateWork | None], object],
        on_fault: Callable[[BaseException], object],
    ) -> None:
        self._clock = clock
        self._seconds = seconds
        self._on_late = on_late
        self._on_fault = on_fault
        self._changed = threading.Condition()
        self._waiting: OrderedDict[object, tuple[Work, str]] = OrderedDict()
        self._is_open = True
        # A daemon thread: the interpreter does not wait for it on exit, even if the disk hangs.
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def submit(self, work: Work, what: str) -> Callable[[], None]:
        """Submit ``work``; ``what`` is its name for ``on_late``. After :meth:`close` it is dropped.

        Return a function that withdraws the work and drops its references. It has no effect once the work has begun.
        """
        ticket = object()
        with self._changed:
            if self._is_open:
                self._waiting[ticket] = work, what
                self._changed.notify()
        return lambda: self._take_back(ticket)

    def is_done_within(self, seconds: float) -> bool:
        """Wait up to ``seconds`` of wall time until all work submitted before is done. Return whether it is."""
        is_done = threading.Event()
        self.submit(is_done.set, 'the end of what was submitted')
        return is_done.wait(seconds)

    @property
    def waiting(self) -> int:
        """Number of submitted jobs that have not begun."""
        return len(self._waiting)

    def close(self) -> None:
        """Drop pending work and end the thread after the current job."""
        with self._changed:
            self._is_open = False
            self._waiting.clear()
            self._changed.notify()

    def _take_back(self, ticket: object) -> None:
        with self._changed:
            self._waiting.pop(ticket, None)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or not self._is_open)
                if not self._waiting:
                    return
                _, (work, what) = self._waiting.popitem(last=False)
            self._do(work, what)
            del work  # free its references while this thread waits

    def _do(self, work: Work, what: str) -> None:
        with contextlib.ExitStack() as watching:
            try:
                watching.callback(_Watch(self._clock, self._seconds, what, self._on_late).close)
            except RuntimeError as error:  # the clock has no thread for its timers: work without a watchdog
                self._on_fault(error)
            try:
                work()
            except BaseException as error:  # SystemExit too: no other thread would do the work
                self._on_fault(error)


class _Watch:
    """A watchdog that checks the thread that made it periodically, until it is closed."""

    def __init__(self, clock: Clock, seconds: float, what: str, on_late: Callable[[LateWork | None], object]) -> None:
        self._clock = clock
        self._seconds = seconds
        self._what = what
        self._on_late = on_late
        self._processor = time.pthread_getcpuclockid(threading.get_ident())
        self._used = time.clock_gettime(self._processor)
        self._looks = 0
        self._lock = threading.Lock()
        self._is_open = True
        self._timer = clock.call_at(clock.now() + seconds, self._look)

    def _look(self) -> None:
        with self._lock:
            if not self._is_open:
                return
            before, self._used = self._used, time.clock_gettime(self._processor)
            self._looks += 1
            uses_processor = self._used - before >= _WORKING * self._seconds
            self._on_late(LateWork(self._what, self._looks * self._seconds, uses_processor))
            self._timer = self._clock.call_at(self._clock.now() + self._seconds, self._look)

    def close(self) -> None:
        with self._lock:
            self._is_open = False
            self._timer.cancel()
        if self._looks:
            self._on_late(None)


# A watchdog reports work while it takes longer than allowed.


@contextlib.contextmanager
def watchdog(clock: Clock, seconds: float, on_expired: Callable[[], object]) -> Iterator[None]:
    """Call ``on_expired()`` on the thread of ``clock`` if the block takes longer than ``seconds``; never after it."""
    lock = threading.Lock()
    has_ended = False

    def expire() -> None:
        with lock:
            if not has_ended:
                on_expired()

    timer = clock.call_at(clock.now() + seconds, expire)
    try:
        yield
    finally:
        timer.cancel()
        with lock:
            has_ended = True
