# SPDX-License-Identifier: BSD-3-Clause
"""The terminal of a console: end when it is gone or accepts no more output, and show standard error as lines."""

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
"""Time after which an operator who sees no updates is not present, s."""

END_SECONDS: Final = 10.0
"""Time within which a user interface that was asked to end has to end, s; otherwise the process ends anyway."""

_SIGNALS: Final = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
_SUSPENDING: Final = (signal.SIGTSTP, signal.SIGCONT)
"""Signals for which Textual's driver leaves its own handlers, which need the event loop."""

_CHECK_SECONDS: Final = 5.0
_FULL_SECONDS: Final = 0.5
_SIGN_OFF_SECONDS: Final = 1.0


class TerminalWatch:
    """A watch that ends the process by SIGTERM when the terminal on its standard streams, or the server of the browser,
    is gone, or has accepted no output for :data:`UNSEEN_SECONDS`.

    A writer to a full terminal waits without end: Textual and prompt_toolkit, on the main thread, also when they are to
    end. So a handler of a signal that ends the process reports it by :meth:`signaled`. Where the terminal takes nothing
    then, ``sign_off`` is called, and the process ends with 128 + the signal, less than 2 s after it; so it does where
    :meth:`close` is not called within :data:`END_SECONDS`, whatever the reason.

    Whether the terminal is gone is found from the terminal itself: a signal alone does not show it, since the process
    that started this one may receive it, and wait for our end.
    """

    def __init__(self, sign_off: Callable[[], object]) -> None:
        self.has_given_up = threading.Event()
        """True when nobody is left to show anything to."""
        self._sign_off = sign_off
        self._is_over = threading.Event()
        self._signals, self._signaled = os.pipe()
        self._attributes = None
        with contextlib.suppress(termios.error):  # the server of the browser
            self._attributes = termios.tcgetattr(0)
        threading.Thread(target=self._watch, name='terminal_watch', daemon=True).start()

    def signaled(self, number: int) -> None:
        """End the process because of this signal. Its handler may call this, also more than once."""
        os.write(self._signaled, bytes((number,)))

    @contextlib.contextmanager
    def on_signal(self, end: Callable[[], object]) -> Iterator[None]:
        """In the context, which is one of the event loop on the main thread, SIGINT, SIGTERM and SIGHUP have the loop
        call ``end``. Behind it these, and those that a user interface has set to be suspended, are handled as before.

        An exception raised by their handler instead would leave locks taken and threads running: it comes anywhere.
        """
        loop = asyncio.get_running_loop()

        def handle(number: int, frame: FrameType | None) -> None:
            # Not a handler of the event loop, which is not called while it writes to a full terminal.
            self.signaled(number)
            loop.call_soon_threadsafe(end)

        with restored_signals(*_SIGNALS, *_SUSPENDING):
            for known in _SIGNALS:
                signal.signal(known, handle)
            yield

    def close(self) -> None:
        """Stop watching: the terminal is no longer used."""
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
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})  # of a terminal that is another's now
        if self._attributes is not None:
            with contextlib.suppress(termios.error):
                termios.tcsetattr(0, termios.TCSANOW, self._attributes)
        os._exit(128 + number)

    def _ending(self) -> int:
        """Wait for the signal that ends the process, or for the end of the terminal."""
        changes = select.poll()
        changes.register(0, 0)  # the end is reported anyway
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


# Output of others to the terminal, such as the log of the middleware, as lines of our own.

LINE_BYTES = 4_000
"""Maximum bytes of a line; the rest begins another one."""


class _Terminal(io.FileIO):
    def write(self, data: Any) -> int:
        """Write, or drop the output if nothing can be written any more: an error would end Textual's thread that
        writes, and a caller with 30 further writes would wait for that thread without end."""
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


@contextlib.contextmanager
def standard_error_as_lines(tell: Callable[[str], object]) -> Iterator[None]:
    """In the context, output to the standard error of the process is reported line by line, from any thread.

    Textual draws there, by ``sys.__stderr__``, which leads to the terminal anyway.
    """
    before = sys.__stderr__
    reading, writing = os.pipe()
    # The middleware logs while it holds the interpreter's lock, so nobody reads then: a burst that is too long is lost.
    os.set_blocking(writing, False)
    with io.TextIOWrapper(io.BufferedWriter(_Terminal(os.dup(2), 'w')), encoding='utf-8', errors='replace') as terminal:
        sys.__stderr__ = terminal  # type: ignore[misc]  # which Textual does not let one set
        os.dup2(writing, 2)
        os.close(writing)
        reader = threading.Thread(target=_read, args=(reading, tell), name='standard_error', daemon=True)
        reader.start()
        try:
            yield
        finally:
            os.dup2(terminal.fileno(), 2)  # the end of the pipe
            sys.__stderr__ = before  # type: ignore[misc]
    reader.join()


def _read(pipe: int, tell: Callable[[str], object]) -> None:
    with os.fdopen(pipe, 'rb') as lines:
        while line := lines.readline(LINE_BYTES):
            if text := line.decode(errors='replace').rstrip('\n'):
                tell(one_line(text))


# The common parts of prompt, screen and page: what a key or a line means, which decision it answers, how they end, and
# what others write to the terminal.

OnSignal = Callable[[Callable[[], object]], AbstractContextManager[None]]
"""See :meth:`TerminalWatch.on_signal`."""
