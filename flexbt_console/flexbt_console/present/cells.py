# SPDX-License-Identifier: BSD-3-Clause
"""Text in the cells of a terminal, of which wide characters take two, as the screen counts them: cut and folded."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from rich.cells import cell_len, split_graphemes

from .style import glyphs, toned


def cut(text: str, cells: int) -> str:
    """Cut the end of ``text`` to this many cells; keep its tone."""
    return text if _fits(text, cells) else toned(_begin(text, cells - 1) + glyphs().ellipsis * (cells > 0), text)


def cut_middle(text: str, cells: int) -> str:
    """Cut the middle of ``text`` to this many cells, so that its beginning and its end stay; keep its tone."""
    if _fits(text, cells):
        return text
    begin = _begin(text, (cells - 1) // 3)
    room = cells - 1 - width(begin)
    end = _begin(text[::-1], room)[::-1]
    while end and width(end) > room:  # backwards nothing is widened
        end = end[1:]
    return toned(begin + glyphs().ellipsis * (cells > 0) + end, text)


def fold(text: str, cells: int, rows: int, indent: str = '    ') -> list[str]:
    """``text`` in at most this many rows of this many cells, broken between words where that takes a row farther than
    the indent, and within them otherwise; the rest is cut. Each row has the tone of the text."""
    folded: list[str] = []
    rest = text
    while rest and len(folded) < rows - 1 and not _fits(rest, cells):
        row = _begin(rest, cells)
        head = row.rpartition(' ')[0]
        if head.strip() and width(head) > len(indent) and rest[len(row) : len(row) + 1] != ' ':
            row = head
        if width(row) <= len(indent):  # too narrow for anything but the indent
            break
        folded.append(row)
        rest = indent + rest[len(row) :].lstrip(' ')
    return [toned(row, text) for row in (*folded, cut(rest, cells))]


def width(text: str) -> int:
    """Return the number of cells of a text."""
    return len(text) if text.isascii() else sum(map(_cells, f' {text}', text))


def in_cells(text: str) -> list[str]:
    """Return the character in each cell; '' in the second one of a wide character."""
    cells: list[str] = []
    for begin, end, taken in split_graphemes(text)[0]:
        if taken == 0 and cells:
            cells[-1] += text[begin:end]
        cells += [text[begin:end], ''][:taken]
    return cells


def write_cells(row: list[str], at: int, cells: Sequence[str]) -> None:
    """Replace cells of a row, which are as those of :func:`in_cells`. Of a wide character that loses one of its cells,
    the other one gets empty."""
    for edge in (at, at + len(cells)):
        if cells and edge < len(row) and not row[edge]:
            row[edge - 1 : edge + 1] = '  '
    row[at : at + len(cells)] = cells


def _fits(text: str, cells: int) -> bool:
    return len(_begin(text, cells)) == len(text)


def _begin(text: str, cells: int) -> str:
    if text.isascii():
        return text[: max(0, cells)]
    used = 0
    for place, taken in enumerate(map(_cells, f' {text}', text)):
        used += taken
        if used > cells:
            return text[:place]
    return text


@lru_cache(4096)
def _cells(before: str, character: str) -> int:
    """Return the cells that a character takes behind another one, which a variation selector may make wide."""
    return cell_len(before + character) - cell_len(before)
