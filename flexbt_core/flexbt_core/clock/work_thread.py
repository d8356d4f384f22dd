# SPDX-License-Identifier: BSD-3-Clause
"""A thread for work that a disk may hold up: nobody waits for it, not even the end of the process."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

from .clock import Clock
from .told_when_late import told_when_late

Work = Callable[[], object]


class WorkThread:
    """Does what it is given, one after the other, until :meth:`close`; from any thread.

    ``on_late`` is told on the thread of ``clock`` what has taken longer than ``seconds``, and on this one, with '',
    that it is done. ``on_fault`` is told, on this thread, what a piece of work has raised.
    """

    def __init__(
        self,
        name: str,
        clock: Clock,
        seconds: float,
        on_late: Callable[[str], object],
        on_fault: Callable[[BaseException], object],
    ) -> None:
        self._clock = clock
        self._seconds = seconds
        self._on_late = on_late
        self._on_fault = on_fault
        self._changed = threading.Condition()
        self._waiting: OrderedDict[object, tuple[Work, str]] = OrderedDict()
        self._is_open = True
        # A daemon: the end of the interpreter would wait for any other, however long its disk hangs.
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def submit(self, work: Work, what: str) -> Callable[[], None]:
        """Have ``work`` done, which ``what`` names for ``on_late``; after :meth:`close`, it is not.

        Gives how to take it back: nothing is kept of it then. Harmless when it was begun.
        """
        ticket = object()
        with self._changed:
            if self._is_open:
                self._waiting[ticket] = work, what
                self._changed.notify()
        return lambda: self._take_back(ticket)

    def is_done_within(self, seconds: float) -> bool:
        """Wait for the end of what was submitted before, s of wall time; gives whether it has come."""
        is_done = threading.Event()
        self.submit(is_done.set, 'the end of what was submitted')
        return is_done.wait(seconds)

    @property
    def waiting(self) -> int:
        """How much was submitted and not begun."""
        return len(self._waiting)

    def close(self) -> None:
        """Begin nothing any more."""
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
            del work  # what it holds is free while this thread waits

    def _do(self, work: Work, what: str) -> None:
        is_late = False

        def late() -> None:
            nonlocal is_late
            is_late = True
            self._on_late(what)

        try:
            with told_when_late(self._clock, self._seconds, late):
                work()
        except BaseException as error:  # SystemExit too: nobody else does the work
            self._on_fault(error)
        finally:
            if is_late:
                self._on_late('')
