# SPDX-License-Identifier: BSD-3-Clause
"""Textual's driver for a terminal: it sleeps while nothing is typed, and goes on where the process was stopped."""

from __future__ import annotations

import codecs
import math
import os
import selectors
import termios
import threading
import time
from collections.abc import Iterable
from typing import Any, Final

from textual import constants, events
from textual._xterm_parser import XTermParser
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from .ordered_app import OrderedApp

LOOK_SECONDS: Final = 0.1
"""From one look to the next at whether a sequence of a key, which has begun, is none."""

READ_BYTES: Final = 4096


class TerminalDriver(LinuxDriver):
    """Is woken by what is typed, where Textual looks ten times a second; and sets the terminal up again on SIGCONT.

    Textual takes each SIGCONT for the end of a suspension that it has begun itself, at SIGTSTP. It comes without one
    after SIGSTOP, and when the terminal goes away (POSIX.1-2017, 11.1.10 and 2.4.3). Then Textual starts the threads
    that read and write a second time, and never ends the first ones, for which the process waits at its end. That
    happens in the handler, too, where locks of the same thread may be taken.
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.exit_event = self._ending = _WakingEvent()

    def run_input_thread(self) -> None:
        """See :class:`textual.drivers.linux_driver.LinuxDriver`."""
        parser, decoder = XTermParser(self._debug), codecs.getincrementaldecoder('utf-8')('replace')
        looks_until = -math.inf
        with selectors.DefaultSelector() as selector:
            selector.register(self.fileno, selectors.EVENT_READ)
            selector.register(self._ending.file, selectors.EVENT_READ)
            while not self._ending.is_set():
                is_looking = time.monotonic() < looks_until
                ready = selector.select(LOOK_SECONDS if is_looking else None)
                if any(key.fd == self.fileno for key, _ in ready):
                    data = os.read(self.fileno, READ_BYTES)
                    if not data:  # the terminal is gone
                        return
                    looks_until = time.monotonic() + constants.ESCAPE_DELAY + LOOK_SECONDS
                    if text := decoder.decode(data):  # an empty one is the end, for the parser
                        self._pass_on(parser.feed(text))
                self._pass_on(parser.tick())

    def _pass_on(self, messages: Iterable[Message]) -> None:
        for message in messages:
            if isinstance(message, events.Key) and isinstance(self._app, OrderedApp):
                self._app.key_read(message.key)
            self.process_message(message)

    def _sigcont_application(self, *args: object) -> None:
        if self._must_signal_resume:
            super()._sigcont_application(*args)
        else:
            self._loop.call_soon_threadsafe(self._set_up_again)

    def _set_up_again(self) -> None:
        try:
            termios.tcgetattr(self.fileno)
        except termios.error:  # it is gone
            return
        if self._app.is_running:
            self.suspend_application_mode()
            self.resume_application_mode()
            self._app.refresh(layout=True)


class _WakingEvent(threading.Event):
    """While it is set, its ``file`` can be read from; each :meth:`set` is followed by :meth:`clear`."""

    def __init__(self) -> None:
        super().__init__()
        self.file, self._other_end = os.pipe()

    def set(self) -> None:
        super().set()
        os.write(self._other_end, b'\0')

    def clear(self) -> None:
        super().clear()
        os.read(self.file, 1)
