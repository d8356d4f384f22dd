# SPDX-License-Identifier: BSD-3-Clause
"""The log of a node: safe to read in a terminal, bounded on disk, and never a reason to wait.

rclpy writes each line to standard error, to a file, and to ``/rosout``, on the thread that logs. Three things follow
for a node that other people send texts to:

- a text may hold commands for the terminal, or a line break that begins a forged line: :class:`NodeLogger` escapes
  them;
- a program that makes a node log again and again fills the disk: :class:`NodeLogger` has an allowance, and counts what
  it drops;
- a reader of standard error that stalls (a full pipe, Ctrl-S in a terminal) stops the thread that logs, and with it
  the node: with :class:`StandardStreams` it loses lines instead, and counts them.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import select
import stat
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Final

from rclpy.logging import LoggingSeverity

from flexbt_core.values import counted, lines

from .rclpy_private import OpenLogger, log_for_callers_of

__all__ = ['NodeLogger', 'StandardStreams']

LINES: Final = 200
"""Lines of one message, at most: a trace may be long."""

LOG_BURST: Final = 4_000_000
LOG_RATE: Final = 2_000
"""Characters that a node logs, at once and a second, at most; counted apart for errors and for the rest."""

_KINDS: Final = 100

log_for_callers_of(__file__)


class _Allowance:
    """The characters that may be logged now.

    When they are used up, nothing is logged until a tenth of the burst is there again.
    """

    def __init__(self, burst: float, rate: float) -> None:
        self._burst = self._left = burst
        self.rate = rate
        self._at = time.monotonic()
        self._is_used_up = False
        self._lock = threading.RLock()  # garbage that is collected while it is held may log, too
        self._dropped = 0

    def admit(self) -> bool:
        """Return whether a message may be logged; count it as dropped if not."""
        with self._lock:
            now = time.monotonic()
            self._left = min(self._burst, self._left + (now - self._at) * self.rate)
            self._at = now
            self._is_used_up = self._left < (self._burst / 10 if self._is_used_up else 0.0)
            self._dropped += self._is_used_up
            return not self._is_used_up

    def charge(self, characters: int) -> None:
        """Take what was logged off what is left."""
        with self._lock:
            self._left -= characters

    def take_dropped(self) -> int:
        """Return how many messages were dropped since the last call."""
        with self._lock:
            dropped, self._dropped = self._dropped, 0
            return dropped


class NodeLogger(OpenLogger):
    """The logger of a node, as rclpy's, whose messages are escaped and bounded.

    A message of several lines has the further ones indented, so that none of them looks like a message of its own.
    Debug messages are not bounded: they are off unless somebody asks for them.
    """

    def __init__(self, name: str, burst: float = LOG_BURST, rate: float = LOG_RATE) -> None:
        super().__init__(name)
        self._allowances = {False: _Allowance(burst, rate), True: _Allowance(burst, rate)}
        self._unread = 0
        self._notices = OpenLogger(name)  # rclpy's refuses two severities from one place of the code

    def get_child(self, name: str) -> NodeLogger:
        """Return a logger below this one, which shares its allowance."""
        child = super().get_child(name)
        bounded = NodeLogger(child.name)
        bounded._allowances = self._allowances
        # The child removes its name from /rosout when it is deleted: hand that on, do not do it twice.
        bounded.logger_sublogger_namepair, child.logger_sublogger_namepair = child.logger_sublogger_namepair, None
        return bounded

    def log(self, message: object, severity: LoggingSeverity | int, **options: Any) -> bool:
        """See :meth:`rclpy.impl.rcutils_logger.RcutilsLogger.log`."""
        if not self.is_enabled_for(severity):
            return False
        text = '\n    '.join(part.removeprefix('    ') for part in lines(str(message), LINES))
        if severity < LoggingSeverity.INFO:
            return bool(super().log(text, severity, **options))
        allowance = self._allowances[severity >= LoggingSeverity.ERROR]
        if not allowance.admit():
            return False
        is_read = _is_read(2)
        is_logged = bool(super().log(text, severity, **options))
        if is_logged:
            allowance.charge(len(text))
            self._unread += not is_read
            if is_read:
                self._report_dropped(allowance)
        return is_logged

    def _report_dropped(self, allowance: _Allowance) -> None:
        dropped = allowance.take_dropped()
        if dropped:
            why = f'this node logged more than {allowance.rate:g} characters a second'
            self._notices.warning(f'{counted(dropped, "message")} dropped: {why}')
        if self._unread:
            unread, self._unread = self._unread, 0
            self._notices.warning(f'{counted(unread, "message")} missing here: nobody read this output')


class RepeatedReports:
    """Lets a report of each kind pass once in ``seconds``, and counts those between. From any thread.

    ``now`` is in seconds. Only the newest hundred kinds are remembered.
    """

    def __init__(self, seconds: float, now: Callable[[], float]) -> None:
        self._seconds = seconds
        self._now = now
        self._lock = threading.Lock()
        self._passed: OrderedDict[Hashable, tuple[float, int]] = OrderedDict()  # when, and how many were held since

    def held_before(self, kind: Hashable) -> int | None:
        """Return how many reports of this kind were held since the last one that passed; None if this one is held."""
        now = self._now()
        with self._lock:
            passed_at, held = self._passed.get(kind, (-math.inf, 0))
            if now < passed_at + self._seconds:
                self._passed[kind] = passed_at, held + 1
                return None
            self._passed[kind] = now, 0
            self._passed.move_to_end(kind)
            if len(self._passed) > _KINDS:
                self._passed.popitem(last=False)
            return held


def _is_read(number: int) -> bool:
    """Return whether what is written to a descriptor now has room: its reader has not stalled."""
    ready = select.poll()
    ready.register(number, select.POLLOUT)
    return bool(ready.poll(0))


class StandardStreams:
    """Standard output and standard error of a process in which no thread waits for their readers; a context.

    Within it, writing to a pipe, socket or terminal that takes no more fails at once, and what was to be written is
    dropped. Python's own streams count the lines, and report them when they are read again; :class:`NodeLogger` does so
    for messages. What is written is with the reader at once: nothing is lost when the process is killed. Files stay as
    they are: they have no reader.
    """

    def __init__(self) -> None:
        self._before: list[tuple[str, int, int]] = []
        self._streams = (sys.stdout, sys.stderr)

    def __enter__(self) -> StandardStreams:
        """Take the streams over."""
        for name in ('stdout', 'stderr'):
            stream = getattr(sys, name)
            if stream is None or stream is not getattr(sys, f'__{name}__'):
                continue  # closed, or somebody's own, such as that of a test
            with contextlib.suppress(OSError):  # it cannot be opened once more: it stays as it is
                number = stream.fileno()
                if not stat.S_ISREG(os.fstat(number).st_mode):
                    self._take_over(name, number)
        return self

    def __exit__(self, *_: object) -> None:
        """Give the streams back."""
        for name, number, before in self._before:
            getattr(sys, name).flush()
            os.dup2(before, number)
            os.close(before)
        sys.stdout, sys.stderr = self._streams

    def _take_over(self, name: str, number: int) -> None:
        if stat.S_ISSOCK(os.fstat(number).st_mode):  # that of journald: nobody else writes to it
            again = os.dup(number)
        else:
            # Opened once more, since whether to wait is a matter of who opens: the shell goes on waiting.
            again = os.open(f'/proc/self/fd/{number}', os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        os.set_blocking(again, False)
        stream = getattr(sys, name)
        stream.flush()
        self._before.append((name, number, os.dup(number)))
        os.dup2(again, number)
        os.close(again)
        file = io.BufferedWriter(_Output(number))
        text = io.TextIOWrapper(file, stream.encoding, stream.errors, line_buffering=True, write_through=True)
        setattr(sys, name, text)


class _Output(io.RawIOBase):
    """Writes to a descriptor what it takes, and drops the rest."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number
        self._unread = 0

    def write(self, data: Any) -> int:
        """Return the length of ``data``: all of it is written or dropped."""
        given = bytes(data)
        left = b'... %d lines dropped: nobody read this output\n%b' % (self._unread, given) if self._unread else given
        try:
            while left:
                left = left[os.write(self._number, left) :]
            self._unread = 0
        except BlockingIOError:
            self._unread += max(1, given.count(b'\n'))
        return len(given)

    def writable(self) -> bool:
        """It is."""
        return True

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._number

    def isatty(self) -> bool:
        """Return whether a person reads it in a terminal."""
        return os.isatty(self._number)
