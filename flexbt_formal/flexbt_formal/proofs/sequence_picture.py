# SPDX-License-Identifier: BSD-3-Clause
"""Sequence diagrams of events between participants: in SVG or Mermaid."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from flexbt_common.pictures.markup import mermaid_text
from flexbt_core.values.text import one_line

_COLUMN: Final = 220
_ROW: Final = 15
_GAP: Final = 13
_MARGIN: Final = 20
_HEAD: Final = 42
_CHARACTER: Final = 6.1
"""Sizes in points: distance of lifelines, of text lines and of steps, margin, boxes of participants, and an upper bound
of the average character width."""

_LABEL: Final = 26
_NOTE: Final = 56
"""Maximum number of characters of a line in the box of a participant, and in a note."""

_TEXT: Final = 4000
"""Maximum number of characters shown of a text."""


@dataclass(frozen=True)
class Arrow:
    """A message from one participant to another; a message to itself is a loop."""

    start: str
    end: str
    text: str


@dataclass(frozen=True)
class Note:
    """A note beside a participant's lifeline; a ``wrong`` one is what the diagram is about."""

    at: str
    lines: Sequence[str]
    is_wrong: bool = False


@dataclass(frozen=True)
class SequenceDiagram:
    """A sequence diagram: participants from left to right, events from the top down."""

    title: str
    participants: Sequence[str]
    steps: Sequence[Arrow | Note]


SEQUENCE_STYLE: Final = (
    'svg{background:#fff}text{font:11px Helvetica,Arial,sans-serif;fill:#222}.title{font-size:14px;font-weight:bold}'
    '.who{fill:#dce6f5;stroke:#555}.life{stroke:#999;stroke-dasharray:4 4}.arrow{stroke:#333;fill:none}.tip{fill:#333}'
    '.note{fill:#fff3c4;stroke:#b5a642}.wrong{fill:#f8d0cc;stroke:#c03030;stroke-width:2}.number{fill:#777}'
    '@media (prefers-color-scheme:dark){svg{background:#1b1d21}text{fill:#e8e8e8}.who{fill:#2a3c58;stroke:#aaa}'
    '.life{stroke:#777}.arrow{stroke:#ddd}.tip{fill:#ddd}.note{fill:#57501f;stroke:#8d8238}'
    '.wrong{fill:#5a2422;stroke:#ff8a80}.number{fill:#999}}'
)
"""The style sheet: of text and lines in light and in dark."""


def sequence_as_svg(diagram: SequenceDiagram) -> str:
    """Return the diagram as SVG, with one style sheet for light and dark."""
    return _Drawing(diagram).picture()


class _Drawing:
    def __init__(self, diagram: SequenceDiagram) -> None:
        self._diagram = diagram
        self._places = {
            name: _MARGIN + _COLUMN / 2 + _COLUMN * number for number, name in enumerate(diagram.participants)
        }
        self._right: float = _MARGIN + _COLUMN * len(diagram.participants)
        self._parts: list[str] = []

    def picture(self) -> str:
        title = textwrap.wrap(_short(self._diagram.title), max(20, int(self._right / 8))) or ['']
        top = _MARGIN + 20.0 * len(title)
        for number, line in enumerate(title):
            self._parts.append(f'<text class="title" x="{_MARGIN}" y="{_MARGIN + 20 * number}">{_safe(line)}</text>')
        y = top + _HEAD + _GAP
        number = 0
        for step in self._diagram.steps:
            if isinstance(step, Arrow):
                number += 1
                y = self._arrow(step, number, y)
            else:
                y = self._note(step, y)
        bottom = y + _GAP
        lives = [self._life(name, top, bottom) for name in self._diagram.participants]
        width, height = self._right + _MARGIN, bottom + _MARGIN
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
            f'viewBox="0 0 {width:.0f} {height:.0f}">\n<style>{SEQUENCE_STYLE}</style>\n'
            + '\n'.join([*lives, *self._parts])
        ) + '\n</svg>\n'

    def _life(self, name: str, top: float, bottom: float) -> str:
        x = self._places[name]
        box = _COLUMN - 20
        shown = textwrap.wrap(_short(name), _LABEL, break_long_words=True)[:2] or ['']
        texts = ''.join(
            f'<text x="{x:.0f}" y="{top + _HEAD / 2 + 4 + (number - (len(shown) - 1) / 2) * _ROW:.1f}" '
            f'text-anchor="middle">{_safe(line)}</text>'
            for number, line in enumerate(shown)
        )
        return (
            f'<line class="life" x1="{x:.0f}" y1="{top + _HEAD:.0f}" x2="{x:.0f}" y2="{bottom:.0f}"/>'
            f'<rect class="who" x="{x - box / 2:.0f}" y="{top:.0f}" width="{box}" height="{_HEAD}" rx="4">'
            f'<title>{_safe(name)}</title></rect>{texts}'
        )

    def _arrow(self, arrow: Arrow, number: int, y: float) -> float:
        start, end = self._places[arrow.start], self._places[arrow.end]
        room = abs(end - start) or _COLUMN
        texts = textwrap.wrap(f'{number}. {_short(arrow.text)}', max(12, int((room - 16) / _CHARACTER)))
        middle = (start + end) / 2 if start != end else start + room / 2
        for line in texts:
            y += _ROW
            self._parts.append(f'<text x="{middle:.0f}" y="{y - 4:.0f}" text-anchor="middle">{_safe(line)}</text>')
        y += 4.0
        if start == end:
            self._parts.append(f'<path class="arrow" d="M{start:.0f} {y:.0f}h24v10h-20"/>')
            y += 10
        else:
            self._parts.append(f'<path class="arrow" d="M{start:.0f} {y:.0f}H{end:.0f}"/>')
        tip, back = (start + 4, -7) if start == end else (end, 7 if end > start else -7)
        self._parts.append(f'<path class="tip" d="M{tip:.0f} {y:.0f}l{-back} -4v8z"/>')
        return y + _GAP

    def _note(self, note: Note, y: float) -> float:
        texts = [line for text in note.lines for line in textwrap.wrap(_short(text), _NOTE, subsequent_indent='  ')]
        width = max((len(line) for line in texts), default=1) * _CHARACTER + 16
        left = self._places[note.at] - 10
        self._right = max(self._right, left + width)
        kind = 'wrong' if note.is_wrong else 'note'
        height = _ROW * len(texts) + 8
        self._parts.append(
            f'<rect class="{kind}" x="{left:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height}" rx="3"/>'
        )
        for number, line in enumerate(texts, start=1):
            self._parts.append(
                f'<text x="{left + 8:.0f}" y="{y + _ROW * number:.0f}" xml:space="preserve">{_safe(line)}</text>'
            )
        return y + height + _GAP


def sequence_as_mermaid(diagram: SequenceDiagram) -> Iterator[str]:
    """Yield the lines of the diagram in Mermaid."""
    names = {name: f'p{number}' for number, name in enumerate(diagram.participants)}
    yield 'sequenceDiagram'
    yield '  autonumber'
    for name, short in names.items():
        yield f'  participant {short} as {mermaid_text([name])}'
    for step in diagram.steps:
        if isinstance(step, Arrow):
            yield f'  {names[step.start]}->>{names[step.end]}: {mermaid_text([_short(step.text)])}'
        else:
            yield f'  Note over {names[step.at]}: {mermaid_text([_short(line) for line in step.lines])}'


def _short(text: str) -> str:
    return one_line(text, _TEXT)


def _safe(text: str) -> str:
    return html.escape(text, quote=True)
