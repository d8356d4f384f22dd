# SPDX-License-Identifier: BSD-3-Clause
"""An application of Textual that deals with keys in the order in which they were typed, and that no fault ends."""

from __future__ import annotations

import asyncio
import contextlib
import functools
from collections.abc import Callable, Mapping
from typing import Final, ParamSpec, TypeVar

from textual import events
from textual.actions import ActionParseResult
from textual.app import App
from textual.dom import DOMNode
from textual.screen import ModalScreen
from textual.widget import AwaitMount
from textual.widgets import Input

from flexbt_console.errors import RefusedError

P = ParamSpec('P')
T = TypeVar('T')

FIELD_SECONDS: Final = 0.5
"""A field has taken what was typed into it before that; else the next key does not wait for it, and sends nothing."""


class OrderedApp(App[None]):
    """Its operator has to be able to act whatever happens: an error of what a key does is told."""

    _opening: AwaitMount | None = None

    def tell_error(self, error: Exception) -> None:
        """Tell what was refused, or what is a fault."""
        raise NotImplementedError

    def key_read(self, key: str) -> None:
        """A key was read, and waits for its turn from now on; on the thread that reads the terminal."""

    def touched(self) -> None:
        """A key was pressed, whatever it is for."""

    def guarded(self, call: Callable[P, object]) -> Callable[P, None]:
        """The same, except that its errors are told."""

        @functools.wraps(call)
        def guarded(*args: P.args, **kwargs: P.kwargs) -> None:
            try:
                call(*args, **kwargs)
            except Exception as error:
                self.tell_error(error)

        return guarded

    def open(self, dialog: ModalScreen[T | None], then: Callable[[T], object] = lambda given: None) -> None:
        """Open a dialog, and do something with what it gives. It gets the keys that are typed from now on."""

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
        """See :class:`textual.app.App`. An error of what a key does, also in a dialog, is told, and it goes on."""
        try:
            return await super().run_action(action, default_namespace, namespaces)
        except Exception as error:
            self.tell_error(error)
            return True

    async def on_event(self, event: events.Event) -> None:
        """See :class:`textual.app.App`.

        A key that changes a field, or leaves it, comes after what was typed into it, and before the next key: Textual
        has both in queues of different widgets. What a key has opened has its focus before the next key.
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
