# SPDX-License-Identifier: BSD-3-Clause
"""Compilation of navigation with numba, before the first goal needs it. ``python3 -m flexbt_navigation.preparation``
makes numba compile all loops, including those of the world, and cache them for later processes. The set-up of the
workspace runs it. Without it, each of the first processes compiles them itself."""

from __future__ import annotations

import math

import numpy

from flexbt_navigation.controller.motions import Steering
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.costmaps.layers import LayeredCostmap, Observation
from flexbt_navigation.planner.planners import planner_for
from flexbt_sim.world.plane.geometry import Pose, box
from flexbt_sim.world.plane.occupancy_map import OccupancyMap
from flexbt_sim.world.world import prepare_world


def prepare_navigation(
    steering: Steering = Steering(),  # noqa: B008 - immutable
    inflation: Inflation = Inflation(),  # noqa: B008 - immutable
) -> None:
    """Load the compiled loops, or compile them on the first start of a computer, so that no goal waits for these
    seconds.

    Planners for car-like robots and for polygonal footprints are loaded for such robots only.
    """
    cells = numpy.zeros((20, 20), numpy.int8)
    cells[0] = 100
    robot = Pose(1.0, 1.0, 0.0)
    layers = LayeredCostmap(Costmap(OccupancyMap(cells, 0.1, Pose(0.0, 0.0, 0.0)), Inflation()))
    layers.observe(Observation(robot, numpy.array([math.pi]), numpy.array([0.5])), robot)  # behind it
    layers.costmap.clearance(robot.x, robot.y, 1.0)
    planner_for(layers.costmap, steering).plan(robot, Pose(1.4, 1.0, 0.0))  # straight ahead, as any robot can drive
    if inflation.corners and not steering.turning_radius:
        # A corridor in which a long robot cannot turn, and a room in which it can.
        cells = numpy.zeros((20, 30), numpy.int8)
        cells[:7, :15] = cells[13:, :15] = 100
        corridor = Costmap(OccupancyMap(cells, 0.1, Pose(0.0, 0.0, 0.0)), Inflation.of(box(0.9, 0.4)))
        planner_for(corridor, steering).plan(Pose(0.8, 1.0, 0.0), Pose(0.8, 1.0, math.pi))


if __name__ == '__main__':
    prepare_world()
    prepare_navigation()
    prepare_navigation(inflation=Inflation.of(box(1.0, 0.5)))
    prepare_navigation(Steering(turning_radius=0.1))
