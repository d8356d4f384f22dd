# SPDX-License-Identifier: BSD-3-Clause
"""Tones, which show the severity of a line, and glyphs in Unicode and ASCII. Colour never carries meaning alone."""

from __future__ import annotations

import locale
import os
from dataclasses import dataclass
from enum import Enum
from typing import Final, TextIO


class Tone(Enum):
    """The severity of a line; the value is its colour in a terminal (ECMA-48, SGR)."""

    PLAIN = ''
    GOOD = '32'
    WARNING = '33'
    ERROR = '31'
    DECISION = '36'
    DIM = '90'


class Line(str):
    """A line of text with its tone; usable wherever a string is."""

    __slots__ = ('tone',)

    def __new__(cls, text: str, tone: Tone) -> Line:
        """Return the text with a tone."""
        line = super().__new__(cls, text)
        line.tone = tone
        return line

    tone: Tone


def tone_of(line: str) -> Tone:
    """Return the tone of a line; PLAIN for an ordinary string."""
    return line.tone if isinstance(line, Line) else Tone.PLAIN


def toned(text: str, line: str) -> str:
    """Return ``text`` with the tone of ``line``."""
    return Line(text, line.tone) if isinstance(line, Line) else text


def coloured(line: str, has_colours: bool) -> str:
    """Return the line with its tone as a colour, if the terminal has colours."""
    tone = tone_of(line)
    return f'\x1b[{tone.value}m{line}\x1b[0m' if has_colours and tone.value else str(line)


def has_colours(stream: TextIO) -> bool:
    """Return whether to write colours: only to a terminal, and not if NO_COLOR (no-color.org) is set."""
    return stream.isatty() and not os.environ.get('NO_COLOR') and os.environ.get('TERM') != 'dumb'


# The glyphs of a terminal, in Unicode and in ASCII. Each has a distinct shape, so that none depends on its colour.


@dataclass(frozen=True)
class Glyphs:
    """The glyphs of a terminal.

    ``status``: one for each status of a node of a tree, by its number. ``active`` and ``waits``: marks of a state.
    ``robot``: one for each of eight headings, from east, counterclockwise. ``ellipsis``: one cell, replaces text that
    was cut. ``has_braille``: maps are drawn in braille; otherwise in ASCII, one character for each cell.
    """

    status: str
    active: str
    waits: str
    locked: str
    breakpoint: str
    arrow: str
    branch: str
    robot: str
    goal: str
    place: str
    cursor: str
    ellipsis: str
    has_braille: bool


UNICODE: Final = Glyphs(
    status='·▶✓✗↷',
    active='▶',
    waits='?',
    locked='■',
    breakpoint='●',
    arrow='→',
    branch='│',
    robot='→↗↑↖←↙↓↘',
    goal='◎',
    place='◦',
    cursor='┼',
    ellipsis='…',
    has_braille=True,
)

ASCII: Final = Glyphs(
    status='.>+x~',
    active='>',
    waits='?',
    locked='#',
    breakpoint='*',
    arrow='->',
    branch='|',
    robot='>/^\\</v\\',
    goal='X',
    place='@',
    cursor='+',
    ellipsis='~',
    has_braille=False,
)


_COERCED: Final = frozenset({'C.UTF-8', 'C.utf8', 'UTF-8'})
"""Values to which Python sets LC_CTYPE in the locale C (PEP 538)."""


def glyphs() -> Glyphs:
    """Return the glyphs for this terminal: ASCII if FLEXBT_ASCII is set, if the locale has no UTF-8, or if the terminal
    is one of DEC's (vt...); otherwise Unicode."""
    given = os.environ.get
    character_type = given('LC_CTYPE', '')
    # Python replaces C by UTF-8, even if C was requested (PEP 538 and 540).
    asked = given('LC_ALL') or (character_type if character_type not in _COERCED else '') or given('LANG')
    encoding = locale.getpreferredencoding(do_setlocale=False).lower()
    is_ascii = asked in ('C', 'POSIX') or 'utf' not in encoding or given('TERM', '').startswith('vt')
    return ASCII if given('FLEXBT_ASCII') or is_ascii else UNICODE
