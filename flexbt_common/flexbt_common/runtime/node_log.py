# SPDX-License-Identifier: BSD-3-Clause
"""The log of a node: safe to read in a terminal, bounded on disk, and never a reason to wait.

rclpy writes each line to standard error, to a file, and to ``/rosout``, on the thread that logs. That has three risks
for a node that gets texts from others:

- a text may contain commands for the terminal, or a line break before a forged line: :class:`NodeLogger` escapes
  them;
- a program that makes a node log repeatedly fills the disk: :class:`NodeLogger` has an allowance, and counts dropped
  messages;
- a reader of standard error that stalls (a full pipe, Ctrl-S in a terminal) stops the thread that logs, and with it
  the node: with :class:`StandardStreams` it loses lines instead, and counts them. Programs that the node starts
  wait for the reader as usual.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import io
import os
import select
import stat
import sys
import threading
import time
from functools import cache
from typing import Any, Final

from rclpy.logging import LoggingSeverity

from flexbt_common.middleware.rclpy_private import ExtendedLogger, log_for_callers_of
from flexbt_core.clock.rates import TokenBucket
from flexbt_core.values.text import escape_lines, pluralize

LINES: Final = 200
"""Maximum number of lines of one message: a trace may be long."""

LOG_BURST: Final = 4_000_000
LOG_RATE: Final = 2_000
"""Maximum number of characters that a node logs, at once and per second; errors and the rest are counted separately."""

log_for_callers_of(__file__)


class _Allowance:
    """The characters that may be logged now.

    When they are used up, nothing is logged until a tenth of the burst is available again.
    """

    def __init__(self, burst: float, rate: float) -> None:
        self.rate = rate
        self._bucket = TokenBucket(rate, burst, time.monotonic)
        self._enough = burst / 10
        self._is_used_up = False
        self._lock = threading.RLock()  # garbage that is collected while it is held may log, too
        self._dropped = 0

    def admit(self) -> bool:
        """Return whether a message may be logged; count it as dropped if not."""
        with self._lock:
            self._is_used_up = self._bucket.left < (self._enough if self._is_used_up else 0.0)
            self._dropped += self._is_used_up
            return not self._is_used_up

    def charge(self, characters: int) -> None:
        """Subtract logged characters from the allowance."""
        with self._lock:
            self._bucket.take(characters)

    def take_dropped(self) -> int:
        """Return how many messages were dropped since the last call."""
        with self._lock:
            dropped, self._dropped = self._dropped, 0
            return dropped


class NodeLogger(ExtendedLogger):
    """A logger of a node like rclpy's, which escapes and bounds its messages.

    The further lines of a message are indented, so that none of them looks like a separate message.
    Debug messages are not bounded: they are off by default.
    """

    def __init__(self, name: str, burst: float = LOG_BURST, rate: float = LOG_RATE) -> None:
        super().__init__(name)
        self._allowances = {False: _Allowance(burst, rate), True: _Allowance(burst, rate)}
        self._notices = ExtendedLogger(name)  # rclpy's refuses two severities from one place of the code

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
        text = '\n    '.join(part.removeprefix('    ') for part in escape_lines(str(message), LINES))
        if severity < LoggingSeverity.INFO:
            return bool(super().log(text, severity, **options))
        allowance = self._allowances[severity >= LoggingSeverity.ERROR]
        if not allowance.admit():
            return False
        stream = _log_stream()
        has_room = stream is None or stream.has_room()
        if has_room and stream is not None and stream.unread:
            stream.end_line()
            self._notices.warning(f'{pluralize(stream.unread, "message")} cut or missing here: {_NO_ROOM}')
            stream.unread = 0
            stream.count_unread()
        is_logged = bool(super().log(text, severity, **options))
        if is_logged:
            allowance.charge(len(text))
            if has_room:
                self._report_dropped(allowance)
            if stream is not None:
                stream.count_unread()
        return is_logged

    def _report_dropped(self, allowance: _Allowance) -> None:
        dropped = allowance.take_dropped()
        if dropped:
            why = f'this node logged more than {allowance.rate:g} characters a second'
            self._notices.warning(f'{pluralize(dropped, "message")} dropped: {why}')


# ------------------------------------------------------------------------------------------------ standard streams

_NO_ROOM: Final = 'nobody read this output'

_PIPE_BYTES: Final = 1 << 20
"""Buffer size of a pipe for the output, bytes, if the system allows it: a long message is not cut while it is read."""

_LAST_SECONDS: Final = 0.2
"""Time that the end of a process waits for a slow reader of its last lines, s."""

_FILENO: Final = 14 * ctypes.sizeof(ctypes.c_void_p)
"""Offset of the descriptor in a ``FILE`` of glibc (``_fileno`` of ``struct_FILE.h``, part of its binary interface);
:meth:`_CStream.move` checks it with ``fileno``."""


class _CStream:
    """``stdout`` or ``stderr`` of the C library, through which rclpy's log and the middleware write."""

    def __init__(self, name: str) -> None:
        libc = ctypes.CDLL(None)
        self._file = ctypes.c_void_p.in_dll(libc, name)
        self._number = ctypes.c_int.from_address((self._file.value or 0) + _FILENO)
        self._fileno, self._flush = libc.fileno, libc.fflush
        self._failed, self._forgive = libc.ferror_unlocked, libc.clearerr_unlocked
        self.unread = 0
        """Number of messages that were not written completely and are not reported yet."""

    def move(self, number: int) -> None:
        """Write to the descriptor ``number`` from now on; do nothing where ``FILE`` is not that of glibc."""
        before = self._number.value
        if self._fileno(self._file) == before:
            self._flush(self._file)
            self._forgive(self._file)
            self._number.value = number
            if self._fileno(self._file) != number:
                self._number.value = before

    @property
    def descriptor(self) -> int:
        """Descriptor that it writes to."""
        return self._number.value

    def has_room(self) -> bool:
        """Return whether something can be written now, or the reader has ended."""
        return bool(_state(self.descriptor))

    def count_unread(self) -> None:
        """Check whether the message that was just written was cut or lost; without a reader that does not matter."""
        if self._failed(self._file):
            self._forgive(self._file)
            self.unread += _state(self.descriptor) in (0, select.POLLOUT)

    def end_line(self) -> None:
        """End a line that may have been cut."""
        with contextlib.suppress(OSError):
            os.write(self.descriptor, b'\n')


@cache
def _c_stream(name: str) -> _CStream | None:
    try:
        return _CStream(name)
    except (AttributeError, ValueError):  # not glibc
        return None


def _log_stream() -> _CStream | None:
    return _c_stream('stdout' if os.environ.get('RCUTILS_LOGGING_USE_STDOUT') == '1' else 'stderr')


def watchdog_descriptor() -> int:
    """Return a descriptor of standard error for what must not wait for the reader: code without the interpreter."""
    stream = _c_stream('stderr')
    return 2 if stream is None else stream.descriptor


def _state(number: int, seconds: float = 0.0) -> int:
    """Return what poll reports of a descriptor in time: POLLOUT if it has room, 0 if not, others without a reader."""
    ready = select.poll()
    ready.register(number, select.POLLOUT)
    return next((flags for _, flags in ready.poll(1000.0 * seconds)), 0)


class StandardStreams:
    """Standard output and standard error of a process in which no thread waits for their readers; a context.

    Inside the context, the streams of Python and of the C library drop and count text that they cannot write at once,
    and report the count when the output is read again. They write without a buffer, so nothing is lost when the process
    is killed. Files stay unchanged, since they have no reader. The streams of the C library stay changed while the
    process ends.

    The descriptors 1 and 2 also stay unchanged: child processes inherit them, and the shell continues to use them.
    Blocking is a property of the open file, not of the descriptor, so the streams open the pipe or terminal again.
    """

    def __init__(self) -> None:
        self._taken: list[tuple[io.TextIOWrapper, _Output]] = []
        self._streams = (sys.stdout, sys.stderr)

    def __enter__(self) -> StandardStreams:
        """Replace the streams."""
        for name in ('stdout', 'stderr'):
            stream = getattr(sys, name)
            if stream is None or stream is not getattr(sys, f'__{name}__'):
                continue  # closed, or replaced by others, such as a test
            with contextlib.suppress(OSError):  # out of descriptors: it stays as it is
                if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                    self._take_over(name, stream)
        return self

    def __exit__(self, *_: object) -> None:
        """Restore the streams."""
        for text, output in self._taken:
            text.flush()
            output.give_back()
        sys.stdout, sys.stderr = self._streams

    def _take_over(self, name: str, stream: Any) -> None:
        stream.flush()
        output = _Output(stream.fileno(), _c_stream(name))
        text = io.TextIOWrapper(
            io.BufferedWriter(output), stream.encoding, stream.errors, line_buffering=True, write_through=True
        )
        self._taken.append((text, output))
        setattr(sys, name, text)


class _Output(io.RawIOBase):
    """An output that writes as much as a descriptor accepts at once, and counts the lines that do not fit.

    It ends a started line before the next one.
    """

    def __init__(self, number: int, c_stream: _CStream | None) -> None:
        super().__init__()
        self._number = number
        self._rest = b''  # of the line that is begun
        self._unread = 0
        self._pump: threading.Thread | None = None
        try:
            self._own = os.open(f'/proc/self/fd/{number}', os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:  # a socket, such as that of journald, or the terminal of another user
            reading, self._own = os.pipe()
            os.set_blocking(self._own, False)
            self._pump = threading.Thread(target=_pump, args=(reading, number), name='standard_stream', daemon=True)
            self._pump.start()
        with contextlib.suppress(OSError):  # not a pipe, or this many large ones are not allowed
            if fcntl.fcntl(self._own, fcntl.F_GETPIPE_SZ) < _PIPE_BYTES:
                fcntl.fcntl(self._own, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        self._c_stream = c_stream
        if c_stream is not None:
            c_stream.move(self._own)

    def write(self, data: Any) -> int:
        """Return the length of ``data``: all of it is written or dropped."""
        given, rest = bytes(data), self._rest
        notice = b''
        if self._unread:
            line_end = b'\n' if rest and not rest.endswith(b'\n') else b''
            notice = b'%b... %d lines dropped: %b\n' % (line_end, self._unread, _NO_ROOM.encode())
        head = rest + notice
        left = head + given
        done = self._write(left)
        if done < len(rest) or done == len(rest) < len(head):  # the notice is not begun
            self._rest = rest[done:]
            self._unread += _lines(given)
        elif done < len(head):
            self._rest = head[done:]
            self._unread = _lines(given)
        else:
            is_begun = done > len(head) and not left.endswith(b'\n', 0, done)
            end = (left.find(b'\n', done) + 1 or len(left)) if is_begun else done
            self._rest = left[done:end] if end - done <= _PIPE_BYTES else f' ... cut: {_NO_ROOM}\n'.encode()
            self._unread = _lines(left[end:])
        return len(given)

    def _write(self, data: bytes) -> int:
        done = 0
        with contextlib.suppress(BlockingIOError):
            while done < len(data):
                done += os.write(self._own, data[done:])
        return done

    def give_back(self) -> None:
        """Write the pending notice, if the descriptor accepts it."""
        stream, unread = self._c_stream, 0
        if stream is not None:
            stream.count_unread()
            unread, stream.unread = stream.unread, 0
        if (unread or self._rest or self._unread) and _state(self._own, _LAST_SECONDS) == select.POLLOUT:
            self.write(b'\n... %d messages cut or missing above: %b\n' % (unread, _NO_ROOM.encode()) if unread else b'')
        if self._pump is not None:
            own, self._own = self._own, self._number
            if stream is not None:
                stream.move(self._number)
            os.close(own)
            self._pump.join(_LAST_SECONDS)

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the descriptor that a program to be started may inherit: one that waits for its reader."""
        return self._number

    def isatty(self) -> bool:
        """Return whether a person reads it in a terminal."""
        return os.isatty(self._number)


def _lines(data: bytes) -> int:
    return data.count(b'\n') or bool(data)


def _pump(reading: int, number: int) -> None:
    """Copy a pipe to a descriptor; this thread waits for its reader."""
    with contextlib.suppress(OSError), os.fdopen(reading, 'rb', buffering=0) as pipe:
        while data := pipe.read(65536):
            while data:
                select.select([], [number], [])
                data = data[os.write(number, data) :]
