# SPDX-License-Identifier: BSD-3-Clause
"""The map of a plan, drawn: what is done where, what is left then, and what leads from there to where."""

from __future__ import annotations

from typing import Final

from flexbt_common.pictures import DrawnMove, DrawnRegion, regions_as_dot, regions_as_mermaid
from flexbt_formal.planning import MoveKind, Plan, Region, RegionKind, TeamPlan, region_map
from flexbt_tools.cli import picture_output

_KINDS: Final = {RegionKind.BRANCH: 'Region', RegionKind.GOAL: 'Goal', RegionKind.NOWHERE: 'Nowhere'}
_LINES: Final = {MoveKind.PLANNED: 'planned', MoveKind.ACTION: 'onward', MoveKind.DISTURBANCE: 'disturbed'}
_MOST_LITERALS: Final = 12


def draw_plan(file: str, found: Plan | TeamPlan) -> None:
    """Write the map of a plan: SVG, or dot or Mermaid when the file is called so. Raises UsageError."""
    found_map = region_map(found)
    several = isinstance(found, TeamPlan)
    regions = [
        DrawnRegion(_KINDS[region.kind], _label(region, 'time' if several else 'cost')) for region in found_map.regions
    ]
    moves = [
        # Where one robot goes on, what it does stands in the region.
        DrawnMove(
            move.start, move.end, _LINES[move.kind], move.name if several or move.kind.value == 'disturbance' else ''
        )
        for move in found_map.moves
    ]
    picture_output.write_file(
        file,
        lambda: regions_as_dot(regions, moves, found_map.start),
        lambda: regions_as_mermaid(regions, moves, found_map.start),
    )


def _label(region: Region, unit: str) -> list[str]:
    if region.kind is RegionKind.NOWHERE:
        return ['no way to the goal']
    literals = list(region.condition[:_MOST_LITERALS])
    if len(region.condition) > _MOST_LITERALS:
        literals.append(f'... {len(region.condition) - _MOST_LITERALS} more')
    if region.kind is RegionKind.GOAL:
        return ['the goal', *literals]
    return [*region.actions, f'{unit} left: {region.left:g}', 'where', *literals]
