# SPDX-License-Identifier: BSD-3-Clause
"""Extensions of Textual: keys in order, errors that do not end the app, a driver that sleeps, and images."""

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
"""Maximum time that a key waits until a field has processed the text typed before, s. Then Enter sends nothing."""


class OrderedApp(App[None]):
    """An app that handles keys in the order in which they were typed. It shows an error in a handler, and continues."""

    _opening: AwaitMount | None = None

    def tell_error(self, error: Exception) -> None:
        """Show a refusal or a fault."""
        raise NotImplementedError

    def key_read(self, key: str) -> None:
        """Note a key that was read and waits for its turn. Called on the thread that reads the terminal."""

    def touched(self) -> None:
        """Note a pressed key, whatever its effect."""

    def guarded(self, call: Callable[P, object]) -> Callable[P, None]:
        """Return a function that does the same, but shows errors instead of raising them."""

        @functools.wraps(call)
        def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
            try:
                call(*args, **kwargs)
            except Exception as error:
                self.tell_error(error)

        return guarded

    def open(self, dialog: ModalScreen[T | None], then: Callable[[T], object] = lambda given: None) -> None:
        """Open a dialog, and pass its result to ``then`` unless that is None. Later keys go to the dialog."""

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
        """See :class:`textual.app.App`. Show an error in the handling of a key, also in a dialog, and continue."""
        try:
            return await super().run_action(action, default_namespace, namespaces)
        except Exception as error:
            self.tell_error(error)
            return True

    async def on_event(self, event: events.Event) -> None:
        """See :class:`textual.app.App`.

        Textual puts typed text and other keys into queues of different widgets. This keeps their order: a key that
        changes or leaves a field is handled after the text that was typed into it, and before the next key. A widget
        that a key has opened gets the focus before the next key.
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


# A driver for the terminal that sleeps while nothing is typed, and restores the terminal after SIGCONT.

LOOK_SECONDS: Final = 0.1
"""Period of checking for the time-out of a key sequence that has begun, s."""

READ_BYTES: Final = 4096


class TerminalDriver(LinuxDriver):
    """A driver that sleeps until a key is typed, and restores the terminal on SIGCONT.

    Textual's own driver polls ten times a second. It takes each SIGCONT as the end of a suspension that it began itself
    on SIGTSTP. SIGCONT also arrives without SIGTSTP: after SIGSTOP, and when the terminal goes away (POSIX.1-2017,
    11.1.10 and 2.4.3). Textual then starts its reading and writing threads a second time and never ends the first ones,
    for which the process waits at its end. It also does so within the signal handler, where the same thread may already
    hold the locks.
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
                    if text := decoder.decode(data):  # the parser takes an empty text as the end
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
        except termios.error:  # the terminal is gone
            return
        if self._app.is_running:
            self.suspend_application_mode()
            self.resume_application_mode()
            self._app.refresh(layout=True)


class _WakingEvent(threading.Event):
    """An event whose ``file`` is readable while it is set. Follow each :meth:`set` by exactly one :meth:`clear`."""

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
"""Environment variable: 1 queries any terminal for a protocol for images, 0 none; by default only known ones."""

_TERMS: Final = ('xterm-kitty', 'xterm-ghostty', 'foot', 'wezterm', 'mlterm', 'contour')
_VARIABLES: Final = ('KITTY_WINDOW_ID', 'WEZTERM_PANE', 'KONSOLE_VERSION', 'ITERM_SESSION_ID', 'WT_SESSION')


def image_widget() -> ImageWidget | None:
    """Return the widget that shows an image in this terminal; None if the terminal has no protocol for images.

    By default, query only terminals that are known to have one, because a terminal that does not answer delays the
    start. Call this before Textual uses the terminal.
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
    except (ModuleNotFoundError, ZeroDivisionError):  # no rosdep key installs it; a new terminal may have no columns
        return None
    return Widget
