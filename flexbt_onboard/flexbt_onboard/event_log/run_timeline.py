# SPDX-License-Identifier: BSD-3-Clause
"""The picture of a run: a row for each state and machine, a bar for each visit, waiting for the operator marked."""

from __future__ import annotations

import math
from typing import Final

from flexbt_core.values import xml_attribute, xml_text

from .run_metrics import ROOT, Intervention, RunMetrics

_ROW: Final = 22
_LEFT: Final = 260
_WIDTH: Final = 900
_TOP: Final = 64
_TICKS: Final = 10
_LEAST: Final = 0.8
"""Pixels of the shortest bar, so that a state without duration is seen."""

_STYLE: Final = (
    'text{font:12px sans-serif;fill:#222}.time{fill:#666;font-size:11px}.back{fill:#fff}.machine{fill:#c9d6e8}'
    '.state{fill:#4c78a8}.forced{fill:#b279a2}.open{fill:#9a9a9a}.wait{fill:#f2a13e}.grid{stroke:#e4e4e4}'
    '.who{stroke:#c0392b}.refused{stroke:#c0392b;stroke-dasharray:2 3}'
    '@media (prefers-color-scheme:dark){text{fill:#e8e8e8}.time{fill:#aaa}.back{fill:#1b1d21}.machine{fill:#3a4a61}'
    '.state{fill:#6fa0d6}.forced{fill:#d09bc0}.open{fill:#777}.grid{stroke:#383c43}.who,.refused{stroke:#ff8a80}}'
)

_LEGEND: Final = {
    'machine': 'machine',
    'state': 'state',
    'forced': 'left by force',
    'open': 'not left by an outcome',
    'wait': 'waits for the operator',
    'who': 'command of an operator',
    'refused': 'refused command',
}
"""What is seen, by its class; only what is in the picture is told."""


def timeline(metrics: RunMetrics) -> str:
    """An SVG document. Bars have tooltips; red lines are commands of operators, dashed when they were refused."""
    rows = [one.path for one in metrics.paths()]
    machines = {path for path in rows for other in rows if other != path and other.startswith(path.rstrip('/') + '/')}
    bottom = _TOP + _ROW * max(1, len(rows)) + 40
    height = bottom + _ROW
    scale = _WIDTH / (metrics.duration or 1.0)

    def x(time: float) -> float:
        return _LEFT + (time - metrics.begin) * scale

    def bar(kind: str, row: int, begin: float, end: float, told: str, inset: int) -> str:
        width = max(_LEAST, (end - begin) * scale)
        top = _TOP + _ROW * row + inset
        return (
            f'<rect class="{kind}" x="{x(begin):.2f}" y="{top}" width="{width:.2f}" height="{_ROW - 2 * inset}">'
            f'<title>{xml_text(_plain(told))}</title></rect>'
        )

    title = f'{metrics.behavior}: {metrics.outcome or "no end"} after {metrics.duration:.1f} s'
    shown = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_LEFT + _WIDTH + 30}" height="{height}">',
        f'<style>{_STYLE}</style><rect class="back" width="100%" height="100%"/>',
        f'<text x="10" y="20">{xml_text(_plain(title))}</text>',
        f'<text class="time" x="10" y="38">run {xml_text(_plain(metrics.run))}, waiting for the operator '
        f'{metrics.waiting:.1f} s</text>',
    ]
    for time in _ticks(metrics.duration):
        at = x(metrics.begin + time)
        shown.append(f'<line class="grid" x1="{at:.2f}" x2="{at:.2f}" y1="{_TOP - 6}" y2="{bottom - 30}"/>')
        shown.append(f'<text class="time" x="{at:.2f}" y="{bottom - 14}" text-anchor="middle">{time:g} s</text>')
    for row, path in enumerate(rows):
        label = path if path == ROOT else '\u2003' * (path.count('/') - 1) + path.rsplit('/', 1)[-1]
        shown.append(
            f'<text x="10" y="{_TOP + _ROW * row + 15}" data-path={xml_attribute(_plain(path))}>'
            f'{xml_text(_plain(label))}<title>{xml_text(_plain(path))}</title></text>'
        )
    for visit in metrics.visits:
        if visit.path in rows:
            forced = 'forced' if visit.reason == 'forced' else 'state'
            kind = 'machine' if visit.path in machines else forced if visit.outcome else 'open'
            told = f'{visit.path}: {visit.outcome or "not left by an outcome"}, {visit.end - visit.begin:.3f} s'
            shown.append(bar(kind, rows.index(visit.path), visit.begin, visit.end, told, 3))
    for wait in metrics.waits:
        if wait.path in rows:
            told = f'{wait.path} waited for the operator, {wait.end - wait.begin:.1f} s: {wait.outcome or wait.kind}'
            shown.append(bar('wait', rows.index(wait.path), wait.begin, wait.end, told, 8))
    shown += [_mark(x(one.time), bottom, one) for one in metrics.interventions]
    shown += [*_legend('\n'.join(shown), bottom), '</svg>']
    return '\n'.join(shown) + '\n'


def _mark(at: float, bottom: int, one: Intervention) -> str:
    kind = 'who' if one.effect == 'applied' else 'refused'
    told = f'{one.operator}: {one.command} {one.text} ({one.effect})'
    return (
        f'<line class="{kind}" x1="{at:.2f}" x2="{at:.2f}" y1="{_TOP - 14}" y2="{bottom - 30}">'
        f'<title>{xml_text(_plain(told))}</title></line>'
    )


def _legend(picture: str, top: int) -> list[str]:
    """A sample and a text of each class that is in a picture."""
    shown, x = [], 10.0
    for kind, text in _LEGEND.items():
        if f'<rect class="{kind}"' in picture:
            shown.append(f'<rect class="{kind}" x="{x}" y="{top}" width="18" height="10"/>')
        elif f'<line class="{kind}"' in picture:
            shown.append(f'<line class="{kind}" x1="{x + 9}" x2="{x + 9}" y1="{top - 2}" y2="{top + 12}"/>')
        else:
            continue
        shown.append(f'<text x="{x + 24}" y="{top + 9}">{text}</text>')
        x += 44 + 7 * len(text)
    return shown


def _ticks(duration: float) -> list[float]:
    """Round times, about ten of them."""
    if duration <= 0.0:
        return [0.0]
    step = 10.0 ** math.floor(math.log10(duration / _TICKS))
    step *= next(factor for factor in (1, 2, 5, 10, 20) if duration / (step * factor) <= _TICKS)
    return [round(number * step, 9) for number in range(int(duration / step) + 1)]


def _plain(text: str) -> str:
    """Without characters that XML does not allow."""
    return ''.join(character if character.isprintable() else ' ' for character in text)
