# SPDX-License-Identifier: BSD-3-Clause
"""Edits of texts: spans that are replaced, their inverse, and positions as editors count them.

Offsets count characters (code points) from 0. An edit touches only its span: the rest of a text stays as it is, to the
byte.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable
from typing import Final, NamedTuple

LINE_BREAK: Final = re.compile(r'\r\n?|\n')


class Span(NamedTuple):
    """Characters ``start`` up to, but not with, ``end``."""

    start: int
    end: int


class TextEdit(NamedTuple):
    """Replace the characters from ``start`` up to ``end`` by ``text``. An insertion has ``start == end``."""

    start: int
    end: int
    text: str


def applied(text: str, edits: Iterable[TextEdit]) -> str:
    """Return the text after the edits.

    All offsets count in ``text``, as it was before the first edit. Insertions at one place keep their order.

    Raises:
        ValueError: two edits overlap, or one lies outside of the text.
    """
    parts: list[str] = []
    position = 0
    for edit in sorted(edits, key=lambda one: (one.start, one.end)):
        if not position <= edit.start <= edit.end <= len(text):
            raise ValueError(f'{edit} overlaps another edit, or is not within the {len(text)} characters of the text')
        parts += text[position : edit.start], edit.text
        position = edit.end
    parts.append(text[position:])
    return ''.join(parts)


def inverse(text: str, edits: Iterable[TextEdit]) -> list[TextEdit]:
    """Return the edits that give back ``text`` when they are applied to ``applied(text, edits)``."""
    undo: list[TextEdit] = []
    shift = 0
    for edit in sorted(edits, key=lambda one: (one.start, one.end)):
        start = edit.start + shift
        undo.append(TextEdit(start, start + len(edit.text), text[edit.start : edit.end]))
        shift += len(edit.text) - (edit.end - edit.start)
    return undo


def difference(before: str, after: str) -> list[TextEdit]:
    """Return one edit that turns ``before`` into ``after``, as short as their common beginning and end allow."""
    if before == after:
        return []
    least = min(len(before), len(after))
    start = next((index for index in range(least) if before[index] != after[index]), least)
    end = next((count for count in range(least - start) if before[-1 - count] != after[-1 - count]), least - start)
    return [TextEdit(start, len(before) - end, after[start : len(after) - end])]


class Lines:
    """The lines of a text, to convert offsets to positions and back.

    Lines and columns count from 0. Columns are in UTF-16 code units, as in the language server protocol and in
    JavaScript.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        breaks = [match.span() for match in LINE_BREAK.finditer(text)]
        self.starts = [0, *(end for _, end in breaks)]
        self._ends = [*(start for start, _ in breaks), len(text)]

    def line(self, offset: int) -> int:
        """Return the line of an offset."""
        return bisect_right(self.starts, offset) - 1

    def start(self, offset: int) -> int:
        """Return where the line of an offset begins."""
        return self.starts[self.line(offset)]

    def end(self, offset: int) -> int:
        """Return the end of the line of an offset, with its line break."""
        line = self.line(offset) + 1
        return self.starts[line] if line < len(self.starts) else len(self._text)

    def position(self, offset: int) -> tuple[int, int]:
        """Return line and column of an offset; an offset outside of the text counts as its nearest end."""
        offset = max(0, min(offset, len(self._text)))
        line = self.line(offset)
        return line, utf16_length(self._text[self.starts[line] : min(offset, self._ends[line])])

    def offset(self, line: int, column: int) -> int:
        """Return the offset of a position; a position outside of the text counts as its nearest end."""
        if line < 0:
            return 0
        if line >= len(self.starts):
            return len(self._text)
        start = self.starts[line]
        within = self._text[start : self._ends[line]]
        if within.isascii():
            return start + max(0, min(column, len(within)))
        units = within.encode('utf-16-le')[: 2 * max(0, column)]
        return start + len(units.decode('utf-16-le', 'ignore'))

    def line_break(self) -> str:
        """Return the line break of the text; that of its first line if it has several."""
        found = LINE_BREAK.search(self._text)
        return found.group() if found else '\n'


def utf16_length(text: str) -> int:
    """Return the number of UTF-16 code units of a text."""
    return len(text) if text.isascii() else len(text.encode('utf-16-le')) // 2
