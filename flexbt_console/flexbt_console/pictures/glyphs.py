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


def glyphs() -> Glyphs:
    """Those of this terminal: ASCII when FLEXBT_ASCII is set, and where the locale has no others."""
    if os.environ.get('FLEXBT_ASCII') or 'utf' not in locale.getpreferredencoding(do_setlocale=False).lower():
        return ASCII
    return UNICODE
