# SPDX-License-Identifier: BSD-3-Clause
"""Text from the network or from a file, made harmless for a terminal.

What others have written may contain escape sequences that move the cursor, recolour the screen, set the window title
or answer for the user; direction marks that show a text in another order; invisible characters. All of them are
shown as what they are.
"""

from __future__ import annotations

import unicodedata
from typing import Final

_NAMED: Final = {'\n': '\\n', '\r': '\\r', '\t': '\\t', '\x1b': '\\e'}
_HIDDEN: Final = frozenset({'Cc', 'Cf', 'Cs', 'Co', 'Cn', 'Zl', 'Zp'})
_MARKS: Final = frozenset({'Mn', 'Me'})
_STACKED_MARKS: Final = 3
"""Marks in a row that a written language may need; more of them are stacked over the lines around."""

SHOWN: Final = 20_000
"""Characters of a text that are shown at most: who shows a text of 10 MB again and again does nothing else."""


def one_line(text: str, width: int | None = None) -> str:
    """``text`` on one line without anything that a terminal interprets, cut to ``width`` characters.

    Without a width, what is behind the first :data:`SHOWN` characters is counted.
    """
    begin = text[: SHOWN if width is None else max(0, width) + 1]  # escaping makes nothing shorter
    shown = begin if begin.isascii() and begin.isprintable() else _escaped(begin)
    if width is None:
        return shown if len(text) <= SHOWN else f'{shown}… ({len(text) - SHOWN} more characters)'
    if len(shown) > width:
        return shown[: max(0, width - 1)] + '…' if width > 0 else ''
    return shown


def lines(text: str, limit: int = 50) -> list[str]:
    """``text`` as harmless lines, at most ``limit`` of them; what is left out is said in the last."""
    parts = text.split('\n')
    shown = [one_line(part) for part in parts[:limit]]
    if len(parts) > limit:
        shown.append(f'… {len(parts) - limit} more lines')
    return shown


def _escaped(text: str) -> str:
    shown = []
    marks = 0
    for character in text:
        category = unicodedata.category(character)
        marks = marks + 1 if category in _MARKS else 0
        if character in _NAMED:
            shown.append(_NAMED[character])
        elif category in _HIDDEN or marks > _STACKED_MARKS or (category == 'Zs' and character != ' '):
            code = ord(character)
            shown.append(f'\\x{code:02x}' if code < 0x100 else f'\\u{{{code:x}}}')
        else:
            shown.append(character)
    return ''.join(shown)
