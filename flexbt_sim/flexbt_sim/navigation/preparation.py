# SPDX-License-Identifier: BSD-3-Clause
"""What numba compiles for navigation, before the first goal needs it."""

from __future__ import annotations

import numpy

from flexbt_sim.world import OccupancyMap, Pose

from .costmap import Costmap, Inflation
from .layers import LayeredCostmap, Observation
from .planner import GridPlanner


def prepare_navigation() -> None:
    """Load what is compiled, or compile it on a computer's first start: some seconds that no goal has to wait for."""
    cells = numpy.zeros((20, 20), numpy.int8)
    cells[0] = 100
    robot = Pose(1.0, 1.0, 0.0)
    layers = LayeredCostmap(Costmap(OccupancyMap(cells, 0.1, Pose(0.0, 0.0, 0.0)), Inflation()))
    layers.observe(Observation(robot, numpy.array([0.0]), numpy.array([0.5])), robot)
    layers.costmap.clearance(robot.x, robot.y, 1.0)
    GridPlanner(layers.costmap).plan(robot, Pose(0.6, 1.0, 0.0))
