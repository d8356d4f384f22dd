# SPDX-License-Identifier: BSD-3-Clause
"""The log of a node: safe to read in a terminal, bounded on disk, and never a reason to wait.

rclpy writes each line to standard error, to a file, and to ``/rosout``, on the thread that logs. Three things follow
for a node that other people send texts to:

- a text may hold commands for the terminal, or a line break that begins a forged line: :class:`NodeLogger` escapes
  them;
- a program that makes a node log again and again fills the disk: :class:`NodeLogger` has an allowance, and counts what
  it drops;
- a reader of standard error that stalls (a full pipe, Ctrl-S in a terminal) stops the thread that logs, and with it
  the node: :class:`StandardStreams` writes on a thread that nobody waits for.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import os
import select
import stat
import sys
import termios
import threading
import time
from pathlib import Path
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

STREAM_BYTES: Final = 1_000_000
"""Bytes that wait for the reader of a standard stream, at most."""

_FLUSH_SECONDS: Final = 0.3

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
        self._lock = threading.Lock()
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
        is_logged = bool(super().log(text, severity, **options))
        if is_logged:
            allowance.charge(len(text))
            dropped = allowance.take_dropped()
            if dropped:
                why = f'this node logged more than {allowance.rate:g} characters a second'
                self._notices.warning(f'{counted(dropped, "message")} dropped: {why}')
        return is_logged


class StandardStreams:
    """Standard output and standard error of a process in which no thread waits for their readers; a context.

    Within it, a pipe, socket or terminal is replaced by a pipe that a thread empties. Of what nobody reads,
    :data:`STREAM_BYTES` are kept, and the number of lines dropped is written when it is read again. Files stay: they
    have no reader.
    """

    def __init__(self) -> None:
        self._drains: dict[tuple[int, int], _Drain] = {}
        self._before = (sys.stdout, sys.stderr)

    def __enter__(self) -> StandardStreams:
        """Take the streams over."""
        for number in (1, 2):
            with contextlib.suppress(OSError):  # it is closed, or there is no descriptor left: it stays as it is
                status = os.fstat(number)
                if stat.S_ISREG(status.st_mode) or os.path.samestat(status, Path(os.devnull).stat()):
                    continue
                if number == 2 and os.isatty(number):
                    os.environ.setdefault('RCUTILS_COLORIZED_OUTPUT', '1')  # what a pipe would not get
                file = (status.st_dev, status.st_ino)
                if file not in self._drains:  # both streams may be one file, whose order is kept
                    self._drains[file] = _Drain(number)
                self._drains[file].take_over(number)
        return self

    def __exit__(self, *_: object) -> None:
        """Write what waits, and give the streams back if they are read."""
        if self.flush():
            for drain in self._drains.values():
                drain.give_back()
        sys.stdout, sys.stderr = self._before

    def flush(self) -> bool:
        """Wait until everything is written, 0.3 s at most; return whether it is."""
        return all(drain.flush() for drain in self._drains.values())

    def error_file(self) -> int:
        """Return a descriptor of standard error for who cannot wait for a thread of this process: the file itself while
        it is read."""
        drain = next((drain for drain in self._drains.values() if 2 in drain.numbers), None)
        return 2 if drain is None or not drain.flush() else drain.file


class _Drain:
    """Writes to a file what comes through a pipe, on threads of its own."""

    def __init__(self, number: int) -> None:
        self.file = os.dup(number)
        self.numbers: list[int] = []
        self._reading, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        with contextlib.suppress(OSError):  # beyond what this user may have
            fcntl.fcntl(self._writing, fcntl.F_SETPIPE_SZ, STREAM_BYTES)
        self._waiting = bytearray()
        self._dropped = 0
        self._changed = threading.Condition()
        for run in (self._read, self._write):
            threading.Thread(target=run, name='standard_streams', daemon=True).start()

    def take_over(self, number: int) -> None:
        """Have everything that is written to this descriptor come here."""
        os.dup2(self._writing, number)
        self.numbers.append(number)
        name = 'stdout' if number == 1 else 'stderr'
        stream = getattr(sys, name)
        if stream is not None and stream is getattr(sys, f'__{name}__'):
            stream.flush()
            setattr(sys, name, _text_stream(self, number, stream))

    def add(self, data: bytes) -> None:
        """Keep what is to be written, or count its lines if there is no room for it."""
        with self._changed:
            if len(self._waiting) + len(data) > STREAM_BYTES:
                self._dropped += max(1, data.count(b'\n'))
            else:
                self._waiting += data
                self._changed.notify_all()

    def is_terminal(self) -> bool:
        """Return whether what comes here is shown in a terminal."""
        return os.isatty(self.file)

    def flush(self) -> bool:
        """Wait until everything is written, 0.3 s at most; return whether it is."""
        with self._changed:
            return self._changed.wait_for(lambda: self._is_empty() and not self._waiting, _FLUSH_SECONDS)

    def give_back(self) -> None:
        """Have the descriptors be the file again."""
        for number in self.numbers:
            os.dup2(self.file, number)

    def _is_empty(self) -> bool:
        return int.from_bytes(fcntl.ioctl(self._reading, termios.FIONREAD, bytes(4)), sys.byteorder) == 0

    def _read(self) -> None:
        while True:
            select.select([self._reading], [], [])
            with self._changed:  # what is not in the pipe any more is in what waits
                self.add(os.read(self._reading, 65536))

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
                if self._dropped and len(self._waiting) < STREAM_BYTES / 2:
                    self._waiting += b'... %d lines dropped: nobody read this output\n' % self._dropped
                    self._dropped = 0
                data = bytes(self._waiting[:4096])
            try:
                written = os.write(self.file, data)
            except OSError:  # the reader is gone
                written = len(data)
            with self._changed:
                del self._waiting[:written]
                self._changed.notify_all()


class _DrainFile(io.RawIOBase):
    """What Python's text streams write to in place of a descriptor that would say that it is full."""

    def __init__(self, drain: _Drain, number: int) -> None:
        super().__init__()
        self._drain = drain
        self._number = number

    def write(self, data: Any) -> int:
        """Never waits, and takes all."""
        part = bytes(data)
        self._drain.add(part)
        return len(part)

    def writable(self) -> bool:
        """It is."""
        return True

    def fileno(self) -> int:
        """Return the descriptor for which this stands."""
        return self._number

    def isatty(self) -> bool:
        """Return whether a person reads it in a terminal."""
        return self._drain.is_terminal()


def _text_stream(drain: _Drain, number: int, like: Any) -> io.TextIOWrapper:
    return io.TextIOWrapper(
        io.BufferedWriter(_DrainFile(drain, number)),
        like.encoding,
        like.errors,
        write_through=True,
        line_buffering=True,
    )
