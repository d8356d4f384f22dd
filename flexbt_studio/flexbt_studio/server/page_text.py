# SPDX-License-Identifier: BSD-3-Clause
"""Offsets as the page counts them: UTF-16 code units of a text whose line breaks are all one character."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from flexbt_studio.documents.text import LINE_BREAK, Lines, TextEdit, utf16_length


def shown(text: str) -> str:
    """Return a text with ``\\n`` for all line breaks."""
    return LINE_BREAK.sub('\n', text) if '\r' in text else text


class PageText:
    """The text of one version of a file, to convert its offsets to those of the page and back."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._same = '\r' not in text and text.isascii()
        self._lines = Lines(text)
        self._starts: list[int] = []
        """Offset of each line for the page."""
        if not self._same:
            position = 0
            for line in LINE_BREAK.split(text):
                self._starts.append(position)
                position += utf16_length(line) + 1

    def to_page(self, offset: int) -> int:
        """Return the page's offset of a character."""
        if self._same:
            return offset
        line, column = self._lines.position(offset)
        return self._starts[line] + column

    def from_page(self, offset: int) -> int:
        """Return the offset of a character in the text. One outside of the text counts as its nearest end."""
        if self._same:
            return max(0, min(offset, len(self._text)))
        low, high = 0, len(self._starts)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._starts[middle] <= offset else (low, middle)
        return self._lines.offset(low, offset - self._starts[low])

    def edits_to_page(self, edits: Iterable[TextEdit]) -> list[list[Any]]:
        """Return edits as the page's ``[start, end, text]``."""
        return [[self.to_page(one.start), self.to_page(one.end), shown(one.text)] for one in edits]

    def edits_from_page(self, edits: Iterable[list[Any]]) -> list[TextEdit]:
        """Return the page's edits, with the line breaks of the text. Raises ValueError for anything else than edits."""
        found = []
        line_break = self._lines.line_break()
        for edit in edits:
            match edit:
                case [int(start), int(end), str(text)] if 0 <= start <= end:
                    written = text.replace('\n', line_break) if line_break != '\n' else text
                    found.append(self._apart(self._whole(start, end, written)))
                case _:
                    raise ValueError('an edit is [start, end, text] with 0 <= start <= end')
        return found

    def _whole(self, start: int, end: int, text: str) -> TextEdit:
        """Return an edit of the page as one of whole characters: it may replace one of the two units of a character."""
        first, last = self.from_page(start), self.from_page(end)
        units = text.encode('utf-16-le', 'surrogatepass')
        if self._is_within(first, start):
            units = self._text[first].encode('utf-16-le')[:2] + units
        if self._is_within(last, end):
            units += self._text[last].encode('utf-16-le')[2:]
            last += 1
        return TextEdit(first, last, units.decode('utf-16-le', 'replace'))

    def _is_within(self, offset: int, place: int) -> bool:
        """Return whether a place of the page is within the character at an offset."""
        return self._text[offset : offset + 1] > '\uffff' and self.to_page(offset) < place

    def _apart(self, edit: TextEdit) -> TextEdit:
        """Return an edit that makes no one line break of two: a carriage return may come before a line feed by it."""
        start, end, text = edit
        if self._text[max(start - 1, 0) : start] == '\r' and (text or self._text[end : end + 1])[:1] == '\n':
            text = f'\n{text}'
        if text[-1:] == '\r' and self._text[end : end + 1] == '\n':
            text = f'{text}\n'
        return TextEdit(start, end, text)

    def spans_to_page(self, value: Any) -> Any:
        """Return a JSON value with all spans in it converted. A span is a list of two integers under a key that is one
        of ``span``, ``open``, ``whole``, or ends with ``_span``."""
        if self._same:
            return value
        if isinstance(value, dict):
            return {key: self._span(one) if _is_span(key) else self.spans_to_page(one) for key, one in value.items()}
        if isinstance(value, list):
            return [self.spans_to_page(one) for one in value]
        return value

    def _span(self, value: Any) -> Any:
        match value:
            case [int(start), int(end)] | (int(start), int(end)):
                return [self.to_page(start), self.to_page(end)]
        return value


def _is_span(key: str) -> bool:
    return key in ('span', 'open', 'whole') or key.endswith('_span')
