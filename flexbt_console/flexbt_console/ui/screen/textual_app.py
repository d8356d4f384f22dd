# SPDX-License-Identifier: BSD-3-Clause
"""Textual as the screen needs it: keys in order, no fault ends it, a driver that sleeps, and images in terminals."""

from __future__ import annotations

import asyncio
import codecs
import contextlib
import functools
import math
import os
import selectors
import termios
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final, ParamSpec, TypeVar

from textual import constants, events
from textual._xterm_parser import XTermParser
from textual.actions import ActionParseResult
from textual.app import App
from textual.dom import DOMNode
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message
from textual.screen import ModalScreen
from textual.widget import AwaitMount
from textual.widgets import Input

from flexbt_console.errors import RefusedError

P = ParamSpec('P')
T = TypeVar('T')

FIELD_SECONDS: Final = 0.5
"""A field has taken what was typed into it before that; else the next key does not wait for it, and sends nothing."""


class OrderedApp(App[None]):
    """An app whose operator can act at any time: it reports an error in the handling of a key, and continues."""

    _opening: AwaitMount | None = None

    def tell_error(self, error: Exception) -> None:
        """Report a refusal or a fault."""
        raise NotImplementedError

    def key_read(self, key: str) -> None:
        """Note a key that was read and waits for its turn. Called on the thread that reads the terminal."""

    def touched(self) -> None:
        """Note a pressed key, whatever it is for."""

    def guarded(self, call: Callable[P, object]) -> Callable[P, None]:
        """Return the same, except that its errors are shown."""

        @functools.wraps(call)
        def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
            try:
                call(*args, **kwargs)
            except Exception as error:
                self.tell_error(error)

        return guarded

    def open(self, dialog: ModalScreen[T | None], then: Callable[[T], object] = lambda given: None) -> None:
        """Open a dialog, and pass its result to ``then``. It gets the keys that are typed from now on."""

        def closed(given: T | None) -> None:
            if given is not None:
                then(given)

        self._opening = self.push_screen(dialog, self.guarded(closed))

    async def run_action(
        self,
        action: str | ActionParseResult,
        default_namespace: DOMNode | None = None,
        namespaces: Mapping[str, DOMNode] | None = None,
    ) -> bool:
        """See :class:`textual.app.App`. An error in the handling of a key, also in a dialog, is shown, and the app goes
        on."""
        try:
            return await super().run_action(action, default_namespace, namespaces)
        except Exception as error:
            self.tell_error(error)
            return True

    async def on_event(self, event: events.Event) -> None:
        """See :class:`textual.app.App`.

        A key that changes a field, or leaves it, comes after what was typed into it, and before the next key: Textual
        has both in queues of different widgets. A widget that a key has opened has the focus before the next key.
        """
        if isinstance(event, events.Key):
            if self._opening is not None:
                opening, self._opening = self._opening, None
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(opening(), FIELD_SECONDS)
            self.touched()
            field = self.focused
            if isinstance(field, Input) and not (event.is_forwarded or event.is_printable):
                typed = asyncio.Event()
                field.call_later(typed.set)
                try:
                    await asyncio.wait_for(typed.wait(), FIELD_SECONDS)
                except TimeoutError:
                    if event.key in ('enter', 'ctrl+s'):
                        late = 'what was typed is not in its field yet; nothing was done: press it again'
                        self.tell_error(RefusedError(late))
                        return
                if not await self._check_bindings(event.key, priority=True):
                    await self._check_bindings(event.key)
                return
        await super().on_event(event)


# Textual's driver for a terminal: it sleeps while nothing is typed, and goes on where the process was stopped.

LOOK_SECONDS: Final = 0.1
"""Time between two checks whether a key sequence that has begun is not one, s."""

READ_BYTES: Final = 4096


class TerminalDriver(LinuxDriver):
    """A driver that typed keys wake, where Textual polls ten times a second, and that restores the terminal on SIGCONT.

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


# Images in terminals that have a protocol for them: Sixel, or kitty's graphics protocol.

if TYPE_CHECKING:
    from textual_image.widget import AutoImage, SixelImage

    ImageWidget = type[AutoImage | SixelImage]

IMAGES: Final = 'FLEXBT_IMAGES'
"""1: the terminal is asked whether it has a protocol, whatever it is; 0: it is not asked."""

_TERMS: Final = ('xterm-kitty', 'xterm-ghostty', 'foot', 'wezterm', 'mlterm', 'contour')
_VARIABLES: Final = ('KITTY_WINDOW_ID', 'WEZTERM_PANE', 'KONSOLE_VERSION', 'ITERM_SESSION_ID', 'WT_SESSION')


def image_widget() -> ImageWidget | None:
    """Return the widget that shows an image in this terminal; None where it has no protocol for that.

    Query only terminals that are known to have one: a terminal that does not answer delays the start. Call this
    before Textual has the terminal.
    """
    wanted = os.environ.get(IMAGES, '')
    known = os.environ.get('TERM', '').startswith(_TERMS) or any(map(os.environ.get, _VARIABLES))
    if wanted == '0' or not (wanted == '1' or known):
        return None
    try:
        from textual_image.renderable import HalfcellImage, Image, UnicodeImage

        if Image in (HalfcellImage, UnicodeImage):
            return None
        from textual_image.widget import Image as Widget
    except (ModuleNotFoundError, ZeroDivisionError):  # rosdep has no key for it; a terminal may have no columns yet
        return None
    return Widget
