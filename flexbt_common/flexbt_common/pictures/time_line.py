# SPDX-License-Identifier: BSD-3-Clause
"""A time line as a picture in SVG: a row for each thing, bars for what lasted, lines for what happened."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from flexbt_core.values.text import printable, xml_attribute, xml_text

ROW: Final = 22
LEFT: Final = 260
WIDTH: Final = 900
_TOP: Final = 64
_TICKS: Final = 10
_LEAST: Final = 0.8
"""Minimum width of a bar, px, so that what has no duration is visible."""

_STYLE: Final = (
    'text{font:12px sans-serif;fill:#222}.time{fill:#666;font-size:11px}.back{fill:#fff}.grid{stroke:#e4e4e4}'
)
_DARK: Final = 'text{fill:#e8e8e8}.time{fill:#aaa}.back{fill:#1b1d21}.grid{stroke:#383c43}'


class Look(NamedTuple):
    """The look of a kind of bars: colours in light and in dark, words in the legend, and whether a line is dashed."""

    light: str
    dark: str
    text: str
    is_dashed: bool = False


class Bar(NamedTuple):
    """Something that lasted, in a row, or that happened, as a line through all rows: kind, and what it was."""

    row: int | None
    begin: float
    end: float
    kind: str
    told: str
    inset: int = 3


def time_line(
    title: Sequence[str],
    rows: Sequence[tuple[str, str]],
    bars: Sequence[Bar],
    looks: Mapping[str, Look],
    span: tuple[float, float],
    zero: float,
) -> str:
    """Return the picture of a span of time. ``rows`` are their labels, and what they are of. Times are in seconds; the
    axis counts from ``zero``. The legend has the kinds that occur."""
    begin, end = span
    scale, bottom = WIDTH / ((end - begin) or 1.0), _TOP + ROW * max(1, len(rows)) + 40

    def x(time: float) -> float:
        return LEFT + (min(max(time, begin), end) - begin) * scale

    light = ''.join(f'.{kind}{{fill:{look.light};stroke:{look.light}}}' for kind, look in looks.items())
    light += ''.join(f'.{kind}{{stroke-dasharray:2 3}}' for kind, look in looks.items() if look.is_dashed)
    dark = ''.join(f'.{kind}{{fill:{look.dark};stroke:{look.dark}}}' for kind, look in looks.items())
    shown = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{LEFT + WIDTH + 30}" height="{bottom + ROW}">',
        f'<style>{_STYLE}{light}@media (prefers-color-scheme:dark){{{_DARK}{dark}}}</style>',
        '<rect class="back" width="100%" height="100%"/>',
    ]
    for number, line in enumerate(title):
        kind = ' class="time"' if number else ''
        shown.append(f'<text{kind} x="10" y="{20 + 18 * number}">{xml_text(printable(line))}</text>')
    for time in _ticks(begin - zero, end - zero):
        at = x(zero + time)
        shown.append(f'<line class="grid" x1="{at:.2f}" x2="{at:.2f}" y1="{_TOP - 6}" y2="{bottom - 30}"/>')
        for y in (_TOP - 10, bottom - 14):  # of many rows, one of the two is in sight
            shown.append(f'<text class="time" x="{at:.2f}" y="{y}" text-anchor="middle">{time:.12g} s</text>')
    for number, (label, path) in enumerate(rows):
        shown.append(
            f'<text x="10" y="{_TOP + ROW * number + 15}" data-path={xml_attribute(printable(path))}>'
            f'{xml_text(printable(label))}<title>{xml_text(printable(path))}</title></text>'
        )
    for row, since, until, kind, told, inset in bars:
        left = f'{x(since):.2f}'
        if row is None:
            shape = f'line class="{kind}" x1="{left}" x2="{left}" y1="{_TOP - 14}" y2="{bottom - 30}"'
        else:
            size = f'width="{max(_LEAST, x(until) - x(since)):.2f}" height="{ROW - 2 * inset}"'
            shape = f'rect class="{kind}" x="{left}" y="{_TOP + ROW * row + inset}" {size}'
        shown.append(f'<{shape}><title>{xml_text(printable(told))}</title></{shape[:4]}>')
    is_line = {bar.kind: bar.row is None for bar in bars}
    at = 10.0
    for kind, look in ((kind, look) for kind, look in looks.items() if kind in is_line):
        if is_line[kind]:
            shown.append(f'<line class="{kind}" x1="{at + 9}" x2="{at + 9}" y1="{bottom - 2}" y2="{bottom + 12}"/>')
        else:
            shown.append(f'<rect class="{kind}" x="{at}" y="{bottom}" width="18" height="10"/>')
        shown.append(f'<text x="{at + 24}" y="{bottom + 9}">{look.text}</text>')
        at += 44 + 7 * len(look.text)
    return '\n'.join([*shown, '</svg>']) + '\n'


def _ticks(begin: float, end: float) -> list[float]:
    """Return about ten round times between two, s."""
    if end <= begin:
        return [0.0]
    step = 10.0 ** math.floor(math.log10((end - begin) / _TICKS))
    step *= next(factor for factor in (1, 2, 5, 10, 20) if (end - begin) / (step * factor) <= _TICKS)
    return [round(number * step, 9) for number in range(math.ceil(begin / step), math.floor(end / step) + 1)]
