# SPDX-License-Identifier: BSD-3-Clause
"""Text in the cells of a terminal, of which wide characters take two: cut and folded to a width."""

from __future__ import annotations

import unicodedata


def cut(text: str, cells: int) -> str:
    """``text`` cut at its end to so many cells."""
    return text if _fits(text, cells) else _begin(text, cells - 1) + '…' * (cells > 0)


def cut_middle(text: str, cells: int) -> str:
    """``text`` without its middle, in so many cells: both what it belongs to and what it is about stay."""
    if _fits(text, cells):
        return text
    begin = _begin(text, (cells - 1) // 3)
    return begin + '…' * (cells > 0) + _begin(text[::-1], cells - 1 - width(begin))[::-1]


def fold(text: str, cells: int, rows: int, indent: str = '    ') -> list[str]:
    """``text`` in at most so many rows of so many cells, broken between words where there are any; the rest is cut."""
    folded: list[str] = []
    rest = text
    while rest and len(folded) < rows - 1 and not _fits(rest, cells):
        row = _begin(rest, cells)
        head, space, _ = row.rpartition(' ')
        if space and head.strip() and rest[len(row) : len(row) + 1] != ' ':
            row = head
        if len(row) <= len(indent):  # too narrow for anything but the indent
            break
        folded.append(row)
        rest = indent + rest[len(row) :].lstrip(' ')
    return [*folded, cut(rest, cells)]


def width(text: str) -> int:
    """The cells that a text takes."""
    return sum(map(_cells, text))


def _fits(text: str, cells: int) -> bool:
    return len(_begin(text, cells)) == len(text)


def _begin(text: str, cells: int) -> str:
    if text.isascii():
        return text[: max(0, cells)]
    used, begin = 0, ''
    for character in text:
        used += _cells(character)
        if used > cells:
            break
        begin += character
    return begin


def _cells(character: str) -> int:
    if unicodedata.category(character) in ('Mn', 'Me'):
        return 0
    return 2 if unicodedata.east_asian_width(character) in ('W', 'F') else 1
