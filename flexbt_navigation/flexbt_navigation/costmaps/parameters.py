# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the costmaps, with Nav2's names."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from flexbt_common import names
from flexbt_common.errors import UnfitParameterError
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.values.json_data import load_json
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import short_repr
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.plane.geometry import Circle, Polygon

from .costmap import Inflation

MOST_RADIUS: Final = 50.0
"""Maximum radius of a robot, m, as in a world file."""


@dataclass(frozen=True)
class CostmapParameters:
    """Parameters of the costmaps."""

    inflation: Inflation
    filter_info_topic: str = parameter(
        'filter_info_topic',
        names.KEEPOUT_FILTER_INFO,
        'topic that names the mask of areas to keep out of, nav2_msgs/CostmapFilterInfo',
    )
    scan_topic: str = parameter('scan_topic', names.SCAN, 'topic of the lidar, sensor_msgs/LaserScan')


def declare_inflation(declare: ParameterDeclarer, inflation: Inflation) -> Inflation:
    """Declare the parameters of the footprint and the inflation. ``inflation`` has the defaults for the robot.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    return _inflation(
        declare.text(
            'footprint', _written(inflation.corners), 'corners of a robot that is no circle, m: [[x, y], ...]'
        ),
        declare.real('robot_radius', inflation.robot_radius, 0.001, MOST_RADIUS, 'radius of the robot, m'),
        declare.real('inflation_radius', inflation.radius, 0.0, 10.0, 'how far costs reach round obstacles, m'),
        declare.real('cost_scaling_factor', inflation.scaling, 0.1, 100.0, 'how fast costs fall off, 1/m'),
    )


def _written(corners: Collection[tuple[float, float]]) -> str:
    return json.dumps([[x, y] for x, y in corners]) if corners else ''


def _inflation(corners: str, radius: float, *fall: float) -> Inflation:
    """For the footprint of the parameters ``footprint`` and ``robot_radius``. Raises UnfitParameterError."""
    try:
        polygon = tuple((float(x), float(y)) for x, y in load_json(corners)) if corners else ()
        return Inflation.of(Polygon(polygon) if polygon else Circle(radius), *fall)
    except (ValueError, TypeError, OverflowError, RecursionError, SimulationError) as error:
        raise UnfitParameterError('footprint', f'{short_repr(corners)}: {error}; give [[x, y], ...] in m') from None
