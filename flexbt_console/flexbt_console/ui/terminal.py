# SPDX-License-Identifier: BSD-3-Clause
"""The terminal of a console: end when it is gone or accepts no output, and show standard error as lines."""

from __future__ import annotations

import asyncio
import contextlib
import io
import os
import select
import signal
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from types import FrameType
from typing import Any, Final

from flexbt_common.command_line import restored_signals
from flexbt_core.values.text import one_line

UNSEEN_SECONDS: Final = 30.0
"""Time after which an operator who sees no updates counts as absent, s."""

END_SECONDS: Final = 10.0
"""Time that a user interface has to end after a request, s. Then the process ends anyway."""

_SIGNALS: Final = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
_SUSPENDING: Final = (signal.SIGTSTP, signal.SIGCONT)
"""Signals for which Textual's driver leaves its handlers installed; they need the event loop."""

_CHECK_SECONDS: Final = 5.0
_FULL_SECONDS: Final = 0.5
_SIGN_OFF_SECONDS: Final = 1.0


class TerminalWatch:
    """A watch that ends the process by SIGTERM when the terminal on its standard streams, or the server of the browser,
    is gone, or has accepted no output for :data:`UNSEEN_SECONDS`.

    A write to a full terminal blocks without limit. Textual and prompt_toolkit write on the main thread, even when they
    end. So the handler of a signal that ends the process reports the signal to :meth:`signaled`. If the terminal then
    accepts no output, the watch calls ``sign_off`` and ends the process with exit code 128 + the signal, less than 2 s
    after it. It does the same if :meth:`close` is not called within :data:`END_SECONDS`, whatever the reason.

    The watch polls the terminal itself. A signal alone does not show that the terminal is gone: the process that
    started this one may receive the signal instead, and wait for our end.
    """

    def __init__(self, sign_off: Callable[[], object]) -> None:
        self.has_given_up = threading.Event()
        """Set when the terminal is gone or accepts no output."""
        self._sign_off = sign_off
        self._is_over = threading.Event()
        self._signals, self._signaled = os.pipe()
        self._attributes = None
        with contextlib.suppress(termios.error):  # no terminal: the server of the browser
            self._attributes = termios.tcgetattr(0)
        threading.Thread(target=self._watch, name='terminal_watch', daemon=True).start()

    def signaled(self, number: int) -> None:
        """End the process because of this signal. The signal's handler may call this, even more than once."""
        os.write(self._signaled, bytes((number,)))

    @contextlib.contextmanager
    def on_signal(self, end: Callable[[], object]) -> Iterator[None]:
        """Have the running event loop call ``end`` on SIGINT, SIGTERM and SIGHUP during a ``with`` block.

        Call this on the main thread. Afterwards the previous handlers of these signals are restored, and those of
        SIGTSTP and SIGCONT, which a user interface may have replaced. The handlers raise no exception: raised at an
        arbitrary point, it would leave locks held and threads running.
        """
        loop = asyncio.get_running_loop()

        def handle(number: int, frame: FrameType | None) -> None:
            # Not loop.add_signal_handler: the loop calls no handler while it is blocked by a full terminal.
            self.signaled(number)
            loop.call_soon_threadsafe(end)

        with restored_signals(*_SIGNALS, *_SUSPENDING):
            for known in _SIGNALS:
                signal.signal(known, handle)
            yield

    def close(self) -> None:
        """Stop watching, because the terminal is no longer used."""
        self._is_over.set()
        self.signaled(0)

    def _watch(self) -> None:
        number = self._ending()
        room = select.poll()
        room.register(1, select.POLLOUT)
        latest = time.monotonic() + END_SECONDS
        while time.monotonic() < latest and room.poll(_FULL_SECONDS * 1000):
            if self._is_over.wait(0.1):
                return
        if self._is_over.is_set():
            return
        signing_off = threading.Thread(target=self._sign_off, name='sign_off', daemon=True)
        signing_off.start()
        signing_off.join(_SIGN_OFF_SECONDS)
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})  # if we are in the background
        if self._attributes is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(0, termios.TCSANOW, self._attributes)
        os._exit(128 + number)

    def _ending(self) -> int:
        """Wait until a signal ends the process or the terminal ends; return the number of the signal."""
        changes = select.poll()
        changes.register(0, 0)  # poll reports a hang-up without being asked to
        changes.register(1, 0)
        changes.register(self._signals, select.POLLIN)
        while not (events := dict(changes.poll(_CHECK_SECONDS * 1000))):
            changes.modify(1, select.POLLOUT)
            events = dict(changes.poll(UNSEEN_SECONDS * 1000))
            changes.modify(1, 0)
            if events != {1: select.POLLOUT}:
                break
        if self._signals in events:
            return os.read(self._signals, 1)[0]
        self.has_given_up.set()
        os.kill(os.getpid(), signal.SIGTERM)
        return signal.SIGTERM


# Output of libraries to the terminal, such as the log of the middleware, shown as lines of the user interface.

LINE_BYTES = 4_000
"""Maximum bytes of a line; the rest becomes the next line."""


class _Terminal(io.FileIO):
    def write(self, data: Any) -> int:
        """Write the data; drop it if that fails. An error would end Textual's writing thread, and a caller would block
        for that thread after 30 more writes."""
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


@contextlib.contextmanager
def standard_error_as_lines(tell: Callable[[str], object]) -> Iterator[None]:
    """Pass the standard error of the process to ``tell`` line by line, from any thread, during a ``with`` block.

    Textual draws through ``sys.__stderr__``, which still leads to the terminal.
    """
    before = sys.__stderr__
    reading, writing = os.pipe()
    # The middleware logs while it holds the interpreter's lock, so nothing reads the pipe then. Lose the end of a
    # long burst instead of blocking.
    os.set_blocking(writing, False)
    with io.TextIOWrapper(io.BufferedWriter(_Terminal(os.dup(2), 'w')), encoding='utf-8', errors='replace') as terminal:
        sys.__stderr__ = terminal  # type: ignore[misc]  # Textual has no setting for it
        os.dup2(writing, 2)
        os.close(writing)
        reader = threading.Thread(target=_read, args=(reading, tell), name='standard_error', daemon=True)
        reader.start()
        try:
            yield
        finally:
            os.dup2(terminal.fileno(), 2)  # closes the last writing end of the pipe
            sys.__stderr__ = before  # type: ignore[misc]
    reader.join()


def _read(pipe: int, tell: Callable[[str], object]) -> None:
    with os.fdopen(pipe, 'rb') as lines:
        while line := lines.readline(LINE_BYTES):
            if text := line.decode(errors='replace').rstrip('\n'):
                tell(one_line(text))


# Shared by prompt, screen and page.

OnSignal = Callable[[Callable[[], object]], AbstractContextManager[None]]
"""See :meth:`TerminalWatch.on_signal`."""
