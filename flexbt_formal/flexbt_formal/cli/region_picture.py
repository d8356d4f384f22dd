# SPDX-License-Identifier: BSD-3-Clause
"""The map of a plan as a picture: regions of states, and what leads from one to another; in Graphviz's language or in
Mermaid's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from flexbt_common.pictures.markup import DOT_HEAD, LINE_STYLES, MARK_STYLES, MERMAID_HEAD, dot_text, mermaid_text

_ARROWS: Final = {'planned': '==>', 'onward': '-->', 'disturbed': '-.->'}


@dataclass(frozen=True, slots=True)
class DrawnRegion:
    """``kind`` is Region, Goal or Nowhere; ``lines`` are its label."""

    kind: str
    lines: Sequence[str]


@dataclass(frozen=True, slots=True)
class DrawnMove:
    """An arrow between regions, by their positions; ``kind`` is planned, onward or disturbed; ``text`` its label."""

    start: int
    end: int
    kind: str
    text: str = ''


def regions_as_dot(regions: Sequence[DrawnRegion], moves: Sequence[DrawnMove], begin: int) -> Iterator[str]:
    """Yield the picture in the language of Graphviz; the element of region n is called ``rN``."""
    yield from DOT_HEAD
    yield '  start [shape=circle, class=entry, label="", width=0.15, fillcolor="#333333"]'
    for number, region in enumerate(regions):
        colour = MARK_STYLES[region.kind].light
        label = dot_text(region.lines)
        yield (
            f'  r{number} [shape=box, style="rounded,filled", id=r{number}, class={region.kind}, '
            f'fillcolor="{colour}", label={label}]'
        )
    yield f'  start -> r{begin} [class=begin]'
    for move in moves:
        line = LINE_STYLES[move.kind]
        label = f', label={dot_text([f" {move.text}"])}' if move.text else ''
        free = ', constraint=false' if move.kind == 'disturbed' else ''
        yield (
            f'  r{move.start} -> r{move.end} [class={move.kind}, style={line.style}, penwidth={line.width}, '
            f'color="{line.light}", fontcolor="{line.light}", fontsize=9{label}{free}]'
        )
    yield '}'


def regions_as_mermaid(regions: Sequence[DrawnRegion], moves: Sequence[DrawnMove], begin: int) -> Iterator[str]:
    """Yield the picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    yield '  start((" "))'
    for number, region in enumerate(regions):
        yield f'  r{number}(["{mermaid_text(region.lines)}"]):::{region.kind}'
    yield f'  start --> r{begin}'
    for move in moves:
        label = f'|"{mermaid_text([move.text])}"|' if move.text else ''
        yield f'  r{move.start} {_ARROWS[move.kind]}{label} r{move.end}'
