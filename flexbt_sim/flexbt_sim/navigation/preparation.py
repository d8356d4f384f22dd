# SPDX-License-Identifier: BSD-3-Clause
"""What numba compiles for navigation, before the first goal needs it."""

from __future__ import annotations

import math

import numpy

from flexbt_sim.costmaps import Costmap, Inflation, LayeredCostmap, Observation
from flexbt_sim.world import OccupancyMap, Pose, box

from .hybrid_planner import planner_for
from .motions import Steering


def prepare_navigation(
    steering: Steering = Steering(),  # noqa: B008 - immutable
    inflation: Inflation = Inflation(),  # noqa: B008 - immutable
) -> None:
    """Load what is compiled, or compile it on a computer's first start: some seconds that no goal has to wait for.

    What plans for a robot that steers as a car does, or whose footprint is a polygon, is loaded for such a one only.
    """
    cells = numpy.zeros((20, 20), numpy.int8)
    cells[0] = 100
    robot = Pose(1.0, 1.0, 0.0)
    layers = LayeredCostmap(Costmap(OccupancyMap(cells, 0.1, Pose(0.0, 0.0, 0.0)), Inflation()))
    layers.observe(Observation(robot, numpy.array([0.0]), numpy.array([0.5])), robot)
    layers.costmap.clearance(robot.x, robot.y, 1.0)
    planner_for(layers.costmap, steering).plan(robot, Pose(0.6, 1.0, 0.0))
    if inflation.corners and not steering.turning_radius:
        # A corridor in which a long robot cannot turn, and a room in which it can.
        cells = numpy.zeros((20, 30), numpy.int8)
        cells[:7, :15] = cells[13:, :15] = 100
        corridor = Costmap(OccupancyMap(cells, 0.1, Pose(0.0, 0.0, 0.0)), Inflation.of(box(0.9, 0.4)))
        planner_for(corridor, steering).plan(Pose(0.8, 1.0, 0.0), Pose(0.8, 1.0, math.pi))
