# SPDX-License-Identifier: BSD-3-Clause
"""Which panes there are, and which has the focus, is enlarged or hidden: as its operator has left it the last time."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from flexbt_console.errors import RefusedError
from flexbt_core.values import TextFileError, read_text, write_text

PANES: Final = ('machine', 'map', 'log')


class Layout:
    """The pane with the focus is the one that keys scroll, enlarge and hide. It is kept in ``file``, if there is one,
    as words; others than those that are known, as of another version, are passed over.

    What changes it raises RefusedError when it cannot be kept.
    """

    def __init__(self, file: Path | None = None) -> None:
        self._file = file
        words: list[str] = []
        if file is not None:
            with contextlib.suppress(TextFileError):  # it is not there yet
                words = read_text(file).split()
        self.focused = next((pane for pane in PANES if f'focused={pane}' in words), '')
        self.is_enlarged = bool(self.focused) and 'enlarged' in words
        self.hidden = {pane for pane in PANES if f'hidden={pane}' in words}

    def visible(self, empty: str = '') -> tuple[str, ...]:
        """The panes that have room. One that is ``empty`` has some only when it is enlarged."""
        if self.is_enlarged:
            return (self.focused,)
        return tuple(pane for pane in PANES if pane not in self.hidden and pane != empty)

    def focus_next(self, by: int = 1) -> None:
        """The next pane that has room (1), or the last one (-1), has the focus; behind the last, none."""
        self._focus([pane for pane in PANES if pane not in self.hidden], by)

    def enlarge(self) -> None:
        """The pane with the focus has all the room, or else the next one; behind the last, all have room again."""
        if self.is_enlarged or not self.focused:
            self._focus(PANES, 1, is_enlarged=True)
        else:
            self._set(self.focused, is_enlarged=True)

    def hide(self) -> None:
        """The pane with the focus has no room; without a focus, all have room again."""
        self.hidden = self.hidden | {self.focused} if self.focused else set()
        self._set('', is_enlarged=False)

    def _focus(self, panes: Sequence[str], by: int, *, is_enlarged: bool | None = None) -> None:
        stops = ['', *panes]
        place = stops.index(self.focused) if self.focused in stops else 0
        self._set(
            stops[(place + by) % len(stops)], is_enlarged=self.is_enlarged if is_enlarged is None else is_enlarged
        )

    def _set(self, focused: str, *, is_enlarged: bool) -> None:
        self.focused, self.is_enlarged = focused, is_enlarged and bool(focused)
        if self._file is None:
            return
        words = [f'focused={focused}'] if focused else []
        words += ['enlarged'] if self.is_enlarged else []
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text(self._file, ' '.join([*words, *(f'hidden={pane}' for pane in sorted(self.hidden))]) + '\n')
        except OSError as error:
            raise RefusedError(f'this layout is not there the next time: {error}') from None
