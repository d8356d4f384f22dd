# SPDX-License-Identifier: BSD-3-Clause
"""The log on the screen: what states say, transitions, commands of all operators, and what the console itself tells."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Final

from rich.text import Text

from flexbt_console.mirror import Mirror
from flexbt_console.pictures import cut, fold
from flexbt_console.present import Line, Tone, event_line, log_lines, stamp_text, tone_of

from .pane import styled

TOLD_LINES: Final = 200
"""Lines that the console itself has told, and are remembered."""

_INDENT: Final = ' ' * 12


class LogPane:
    """Shows the latest, or what was there when it was scrolled back: that stands still. ``operator`` is the one at this
    screen, who is told of own commands in another way."""

    def __init__(self, operator: str | None) -> None:
        self._operator = operator
        self._told: deque[tuple[float, str]] = deque(maxlen=TOLD_LINES)
        self._held: list[str] = []
        self._back = 0
        self._page = 1

    @property
    def told(self) -> list[str]:
        """What the console itself has told, the latest last."""
        return [line for _, line in self._told]

    def tell(self, stamp: float, text: Iterable[str]) -> None:
        """Add lines of the console's own, which were told at this time of the robot's clock, s."""
        self._told.extend((stamp, line) for line in text)

    def scroll(self, mirror: Mirror, pages: int) -> None:
        """Go back by so many pages, or on again, to its end at most."""
        held = self._held or self._lines(mirror, sys.maxsize)
        self._back = min(max(0, self._back + pages * self._page), max(0, len(held) - self._page))
        self._held = held if self._back else []

    def moved(self) -> None:
        """It is another robot's from now on."""
        self._told.clear()
        self.follow()

    def follow(self) -> None:
        """Show the latest."""
        self._held, self._back = [], 0

    def draw(self, mirror: Mirror, columns: int, rows: int) -> Text:
        """The lines by their times in so many rows. One that is too long takes more of them, at most half of all."""
        shown, last = self._lines(mirror, rows), list[str]()
        if self._held:
            new = '; there is something new' * (shown[-1:] != self._held[-1:])
            shown = self._held[: -self._back]
            last = [Line(cut(f'  ({self._back} below{new}; Esc: the latest)', columns), Tone.DIM)]
        rows = max(1, rows - len(last))
        self._page = max(1, rows - 1)
        folded = [
            Line(row, tone_of(line)) for line in shown[-rows:] for row in fold(line, columns, -(-rows // 2), _INDENT)
        ]
        return styled([*folded[-rows:], *last])

    def _lines(self, mirror: Mirror, count: int) -> list[str]:
        """The latest lines, of each kind so many at most; what became of one's own commands is told already."""
        known = mirror.events(max(1, count))
        events = [event for event in known if event.operator != self._operator and not event.is_in_log]
        merged: list[tuple[float, int, Sequence[str]]] = [
            *((line.stamp, 0, log_lines(line, with_time=True)) for line in mirror.log(max(1, count))),
            *((event.stamp, 0, [event_line(event, with_time=True)]) for event in events),
            *((stamp, 1, [_with_time(stamp, line)]) for stamp, line in self._told),
        ]
        merged.sort(key=lambda one: one[:2])
        return [line for _, _, text in merged[-max(1, count) :] for line in text]


def _with_time(stamp: float, line: str) -> str:
    time = stamp_text(stamp) if stamp and not line.startswith(' ') else ''
    return Line(f'{time:>8}  {line}', tone_of(line))
