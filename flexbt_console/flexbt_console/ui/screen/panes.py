# SPDX-License-Identifier: BSD-3-Clause
"""Lines of text as widgets, drawn only when they have changed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Final

from rich.text import Text
from textual.widgets import Static

from flexbt_console.present import Tone, tone_of

from .map_canvas import Cell, Layer

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


class Pane(Static):
    """A rectangle of lines."""

    _drawn: Text | None = None

    def show(self, text: Text) -> None:
        """Draw this, unless it is drawn already."""
        if self._drawn is None or text != self._drawn or text.spans != self._drawn.spans:
            self._drawn = text
            self.update(text)
