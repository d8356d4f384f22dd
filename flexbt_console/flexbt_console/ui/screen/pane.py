# SPDX-License-Identifier: BSD-3-Clause
"""Lines of text as widgets, drawn only when they have changed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, zip_longest
from typing import Final

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual.geometry import Region, Size
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget
from textual.widgets import Input

from flexbt_console.present.cells import in_cells
from flexbt_console.present.maps import Cell, Layer
from flexbt_console.present.style import Tone, tone_of
from flexbt_core.values.text import printable

TONES: Final = {
    Tone.PLAIN: '',
    Tone.GOOD: 'green',
    Tone.WARNING: 'bold yellow',
    Tone.ERROR: 'bold red',
    Tone.DECISION: 'bold cyan',
    Tone.DIM: 'dim',
}

LAYERS: Final = {
    Layer.NOTHING: '',
    Layer.WALL: '',
    Layer.DRIVEN: 'dim',
    Layer.PLAN: 'cyan',
    Layer.PLACE: 'yellow',
    Layer.SCAN: 'bold yellow',
    Layer.GOAL: 'bold magenta',
    Layer.CURSOR: 'reverse bold',
    Layer.ROBOT: 'bold green',
}


def styled(lines: Sequence[str]) -> Text:
    """Lines by their tones."""
    text = Text(no_wrap=True, end='')
    for number, line in enumerate(lines):
        text.append('\n' * (number > 0) + str(line), TONES[tone_of(line)])
    return text


def drawn(rows: Sequence[Sequence[Cell]]) -> Text:
    """Characters of a map by their layers."""
    text = Text(no_wrap=True, end='')
    for number, row in enumerate(rows):
        if number:
            text.append('\n')
        for layer, cells in groupby(row, key=lambda cell: cell[1]):
            text.append(''.join(sign for sign, _ in cells), LAYERS[layer])
    return text


class Pane(Widget):
    """A rectangle of lines. Of a row, what has changed and what is left of it goes to the terminal."""

    DEFAULT_CSS = 'Pane { height: auto; }'

    class Resized(Message):
        """A pane has got another size, for which it has to be drawn."""

    def __init__(self, *, id: str | None = None) -> None:
        super().__init__(id=id)
        self._text = Text()
        self._rows: list[list[Segment]] = []

    def show(self, text: Text) -> None:
        """Draw these lines, unless they are drawn already."""
        if text == self._text:
            return
        before, self._text, no_row = self._rows, text, list[Segment]()
        rows = (row.render(self.app.console) for row in text.split('\n')) if text.plain else ()
        # Textual makes greys of colours then, and of red one that is hardly seen.
        self._rows = [list(Segment.remove_color(row) if self.app.no_color else row) for row in rows]
        if self.styles.auto_dimensions and len(before) != len(self._rows):
            self.refresh(layout=True)
            return
        width = self.content_size.width
        for number, (old, new) in enumerate(zip_longest(before, self._rows, fillvalue=no_row)):
            if old != new and (span := _changed(_cells(old, width), _cells(new, width))) is not None:
                self.refresh(Region(span[0], number, span[1] - span[0], 1))
        self._dirty_regions.clear()  # each that there ever was stays, where a widget renders its own lines

    def on_resize(self) -> None:
        """See :class:`Resized`."""
        self.post_message(self.Resized())

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        """See :class:`textual.widget.Widget`."""
        return len(self._rows)

    def render_line(self, y: int) -> Strip:
        """See :class:`textual.widget.Widget`."""
        style = self.rich_style
        strip = Strip(self._rows[y] if y < len(self._rows) else []).apply_style(style)
        return strip.adjust_cell_length(self.content_size.width, style)


class Field(Input):
    """A field that shows a space in place of what a terminal interprets or hides: its text may come from a robot."""

    def render_line(self, y: int) -> Strip:
        """See :class:`textual.widgets.Input`."""
        strip = super().render_line(y)
        shown = Strip([Segment(printable(text), style, control) for text, style, control in strip])
        return shown.adjust_cell_length(strip.cell_length)


Cells = list[tuple[str, Style | None]]


def _cells(row: Sequence[Segment], width: int) -> Cells:
    """Return the text of each cell of a row; the second cell of a wide character is ''."""
    cells: Cells = []
    for text, style, _ in row:
        cells += [(sign, style) for sign in in_cells(text)]
    return [*cells[:width], *[(' ', None)] * (width - len(cells))]


def _changed(before: Cells, after: Cells) -> tuple[int, int] | None:
    """Return the columns from the first to behind the last that differ; None while all are the same."""
    differing = [place for place, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
    if not differing:
        return None
    end = differing[-1] + 1
    return differing[0], end + (end < len(after) and not after[end][0])  # a character is drawn as a whole
