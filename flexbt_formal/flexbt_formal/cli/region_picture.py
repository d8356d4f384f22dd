# SPDX-License-Identifier: BSD-3-Clause
"""The map of a plan as a picture: regions of states, and what leads from one to another; in Graphviz's language or in
Mermaid's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from flexbt_common.pictures.markup import DOT_HEAD, LINE_STYLES, MARK_STYLES, MERMAID_HEAD, dot_text, mermaid_text
from flexbt_formal.planning.planner import Plan
from flexbt_formal.planning.regions import MoveKind, PlanRegion, RegionKind, RegionMove, region_map
from flexbt_formal.planning.team import TeamPlan
from flexbt_tools.cli.output import write_picture_file

_ARROWS: Final = {MoveKind.PLANNED: '==>', MoveKind.ACTION: '-->', MoveKind.DISTURBANCE: '-.->'}
_MOST_LITERALS: Final = 12


def draw_plan(file: str, plan: Plan) -> None:
    """Write the map of a plan as dot, Mermaid or SVG, by the suffix of the file. Raises UsageError."""
    picture = _Picture(plan)
    write_picture_file(file, picture.as_dot, picture.as_mermaid)


class _Picture:
    def __init__(self, plan: Plan) -> None:
        self._map = region_map(plan)
        self._is_team = isinstance(plan, TeamPlan)

    def as_dot(self) -> Iterator[str]:
        """Yield the lines of the picture in the dot language of Graphviz; region n has the ID ``rN``."""
        yield from DOT_HEAD
        yield '  start [shape=circle, class=entry, label="", width=0.15, fillcolor="#333333"]'
        for number, region in enumerate(self._map.regions):
            kind = region.kind.value
            yield (
                f'  r{number} [shape=box, style="rounded,filled", id=r{number}, class={kind}, '
                f'fillcolor="{MARK_STYLES[kind].light}", label={dot_text(self._label(region))}]'
            )
        yield f'  start -> r{self._map.start} [class=begin]'
        for move in self._map.moves:
            kind = move.kind.value
            line = LINE_STYLES[kind]
            text = self._text(move)
            label = f', label={dot_text([f" {text}"])}' if text else ''
            free = ', constraint=false' if move.kind is MoveKind.DISTURBANCE else ''
            yield (
                f'  r{move.start} -> r{move.end} [class={kind}, style={line.style}, penwidth={line.width}, '
                f'color="{line.light}", fontcolor="{line.light}", fontsize=9{label}{free}]'
            )
        yield '}'

    def as_mermaid(self) -> Iterator[str]:
        """Yield the lines of the picture in Mermaid."""
        yield from MERMAID_HEAD
        yield '  start((" "))'
        for number, region in enumerate(self._map.regions):
            yield f'  r{number}(["{mermaid_text(self._label(region))}"]):::{region.kind.value}'
        yield f'  start --> r{self._map.start}'
        for move in self._map.moves:
            text = self._text(move)
            label = f'|"{mermaid_text([text])}"|' if text else ''
            yield f'  r{move.start} {_ARROWS[move.kind]}{label} r{move.end}'

    def _text(self, move: RegionMove) -> str:
        """Return the label of a move. If one robot continues, the region already shows its action."""
        return move.name if self._is_team or move.kind is MoveKind.DISTURBANCE else ''

    def _label(self, region: PlanRegion) -> list[str]:
        if region.kind is RegionKind.NOWHERE:
            return ['no way to the goal']
        literals = list(region.condition[:_MOST_LITERALS])
        if len(region.condition) > _MOST_LITERALS:
            literals.append(f'... {len(region.condition) - _MOST_LITERALS} more')
        if region.kind is RegionKind.GOAL:
            return ['the goal', *literals]
        unit = 'time' if self._is_team else 'cost'
        return [*region.actions, f'{unit} left: {region.left:g}', 'where', *literals]
