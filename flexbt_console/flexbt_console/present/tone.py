# SPDX-License-Identifier: BSD-3-Clause
"""How grave a line is, and how a terminal shows that."""

from __future__ import annotations

import os
from enum import Enum
from typing import TextIO


class Tone(Enum):
    """What a line is to its reader; the value is the colour of a terminal (ECMA-48, SGR)."""

    PLAIN = ''
    GOOD = '32'
    WARNING = '33'
    ERROR = '31'
    DECISION = '36'
    DIM = '90'


class Line(str):
    """A line of text with its tone; where only the text is wanted, it is that text."""

    __slots__ = ('tone',)

    def __new__(cls, text: str, tone: Tone) -> Line:
        """The text, and what it is to its reader."""
        line = super().__new__(cls, text)
        line.tone = tone
        return line

    tone: Tone


def tone_of(line: str) -> Tone:
    """The tone of a line; a text alone is plain."""
    return line.tone if isinstance(line, Line) else Tone.PLAIN


def coloured(line: str, has_colours: bool) -> str:
    """The line with its tone as a colour, if the terminal has colours."""
    tone = tone_of(line)
    return f'\x1b[{tone.value}m{line}\x1b[0m' if has_colours and tone.value else str(line)


def has_colours(stream: TextIO) -> bool:
    """Whether colours may be written: to a terminal, unless NO_COLOR (no-color.org) is set."""
    return stream.isatty() and not os.environ.get('NO_COLOR') and os.environ.get('TERM') != 'dumb'
