# SPDX-License-Identifier: BSD-3-Clause
"""The lanes of the time line as rows of a terminal, and the way from one entry to another."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, Literal

from flexbt_console.mirror.lanes import Lane, LaneEntry

from .cells import cut, in_cells, write_cells
from .style import Glyphs, Line, Tone

HEAD: Final = 10
"""Cells for the name of a lane."""

_POINTS: Final = frozenset({Lane.COMMANDS, Lane.FAULTS, Lane.DECISIONS})
"""Lanes whose entries are short: their words stand behind them."""

Kind = Literal['failure', 'decision', 'change']


def lane_lines(
    entries: Sequence[LaneEntry], begin: float, end: float, at: float, columns: int, signs: Glyphs
) -> list[str]:
    """Return a row of this many cells for each lane that has entries, from ``begin`` to ``end`` (s), with a cursor.

    Of entries at the same cell the one that began last is seen, so a state hides the containers around it.
    """
    room = max(1, columns - HEAD - 1)
    scale = room / max(1e-9, end - begin)
    cursor = min(room - 1, max(0, int((at - begin) * scale)))
    lines: list[str] = []
    for lane in Lane:
        known = sorted((one for one in entries if one.lane is lane), key=lambda one: (one.begin, len(one.key)))
        if not known:
            continue
        cells, words = [' '] * room, 0
        tone = Tone.PLAIN
        for one in known:
            until = end if one.end is None else min(end, one.end)
            first, last = int((one.begin - begin) * scale), int((until - begin) * scale)
            if last < 0 or first >= room or one.begin > end:
                continue
            tone = Tone.ERROR if one.tone == 'error' and lane in (Lane.FAULTS, Lane.NODES) else tone
            first, last = max(0, first), min(room - 1, max(first, last))
            told = in_cells(f'{_sign(one, signs)}{one.label} {one.word}'.rstrip())
            width = room - first if lane in _POINTS else last - first + 1
            shown = in_cells(cut(''.join(told), width)) if width > 1 else told[:1]
            bar = [*shown, *['-'] * (last - first + 1)][: max(last - first + 1, len(shown))]
            if lane in _POINTS:  # the words before end here
                write_cells(cells, first, [' '] * (words - first))
                words = first + len(bar)
            write_cells(cells, first, bar)
        write_cells(cells, cursor, '|')
        head = cut(lane.value.capitalize(), HEAD - 1).ljust(HEAD)
        lines.append(Line(f'{head}{"".join(cells)}', tone))
    return lines


def _sign(entry: LaneEntry, signs: Glyphs) -> str:
    if entry.tone == 'error':
        return signs.status[3] if entry.lane in _POINTS else f'[{signs.status[3]}'
    if entry.lane is Lane.DECISIONS:
        return signs.waits
    if entry.lane is Lane.COMMANDS:
        return signs.breakpoint
    sign = signs.goal if entry.lane is Lane.GOALS else signs.active if entry.end is None else ''
    return f'[{sign or signs.status[2] * (entry.word == "success")}'


def stops(entries: Iterable[LaneEntry], kind: Kind) -> list[float]:
    """Return the times, s, at which something fails, is asked, or changes."""
    found: set[float] = set()
    for one in entries:
        if kind == 'decision' and one.lane is Lane.DECISIONS:
            found.add(one.begin)
        elif kind == 'failure' and one.tone == 'error':
            found.add(one.begin if one.lane is Lane.FAULTS or one.end is None else one.end)
        elif kind == 'change' and one.lane is not Lane.NODES:
            found |= {one.begin, one.begin if one.end is None else one.end}
    return sorted(found)
