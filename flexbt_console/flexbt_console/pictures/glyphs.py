# SPDX-License-Identifier: BSD-3-Clause
"""The signs of a terminal, in Unicode and in ASCII. Each has a shape of its own: colours never carry meaning alone."""

from __future__ import annotations

import locale
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from flexbt_console.mirror import NodeStatus


@dataclass(frozen=True)
class Glyphs:
    """``status`` of a node of a tree, ``active`` and ``waits`` of a state; ``robot`` by heading, eight from east on,
    against the clock; ``ellipsis``, of one cell, stands for what is cut. Without ``has_braille``, maps are drawn by one
    character a cell."""

    status: Mapping[NodeStatus, str]
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
    status={
        NodeStatus.IDLE: '·',
        NodeStatus.RUNNING: '▶',
        NodeStatus.SUCCESS: '✓',
        NodeStatus.FAILURE: '✗',
        NodeStatus.SKIPPED: '↷',
    },
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
    status={
        NodeStatus.IDLE: '.',
        NodeStatus.RUNNING: '>',
        NodeStatus.SUCCESS: '+',
        NodeStatus.FAILURE: 'x',
        NodeStatus.SKIPPED: '~',
    },
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
"""What Python makes of LC_CTYPE in the locale C (PEP 538)."""


def glyphs() -> Glyphs:
    """Those of this terminal: ASCII when FLEXBT_ASCII is set, where the locale has no others, and for a terminal of
    DEC's, which has none either."""
    given = os.environ.get
    character_type = given('LC_CTYPE', '')
    # Python takes UTF-8 for C, also where somebody has asked for C (PEP 538 and 540).
    asked = given('LC_ALL') or (character_type if character_type not in _COERCED else '') or given('LANG')
    encoding = locale.getpreferredencoding(do_setlocale=False).lower()
    is_ascii = asked in ('C', 'POSIX') or 'utf' not in encoding or given('TERM', '').startswith('vt')
    return ASCII if given('FLEXBT_ASCII') or is_ascii else UNICODE
