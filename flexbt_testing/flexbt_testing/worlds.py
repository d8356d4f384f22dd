# SPDX-License-Identifier: BSD-3-Clause
"""Maps for tests, from text or random, and distances on them, computed by slow, obvious code."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy
from hypothesis import strategies as st
from numpy.typing import NDArray

from flexbt_sim.world import FREE, OCCUPIED, UNKNOWN, Lidar, LidarModel, OccupancyMap, Pose, Robot, RobotModel
from flexbt_sim.world.plane.ray_casting import RayCaster, outlines

RESOLUTION = 0.05


def drawn(*rows: str, resolution: float = RESOLUTION, origin: Pose = Pose(0.0, 0.0, 0.0)) -> OccupancyMap:  # noqa: B008 - immutable
    """Return a map from rows of text, the top row first: ``#`` occupied, ``?`` unknown, anything else free."""
    values = {'#': OCCUPIED, '?': UNKNOWN}
    cells = numpy.array([[values.get(mark, FREE) for mark in row] for row in reversed(rows)], numpy.int8)
    return OccupancyMap(cells, resolution, origin)


@st.composite
def worlds(
    draw: st.DrawFn,
    *,
    least: int = 4,
    size: int = 40,
    blocks: int = 10,
    border: bool | None = None,
    resolutions: Sequence[float] = (0.02, 0.05, 0.1, 0.3),
) -> OccupancyMap:
    """Return a rotated and shifted map of rectangular blocks, some of them unknown; a border may close it."""
    height, width = draw(st.integers(least, size)), draw(st.integers(least, size))
    cells = numpy.zeros((height, width), numpy.int8)
    corner = st.tuples(st.integers(0, height - 1), st.integers(0, width - 1))
    block = st.tuples(
        corner, st.integers(1, 9), st.integers(1, 9), st.sampled_from([OCCUPIED, OCCUPIED, 51, 50, UNKNOWN])
    )
    for (row, column), tall, wide, value in draw(st.lists(block, max_size=blocks)):
        cells[row : row + tall, column : column + wide] = value
    if draw(st.booleans()) if border is None else border:
        cells[0, :] = cells[-1, :] = cells[:, 0] = cells[:, -1] = OCCUPIED
    origin = Pose(draw(st.floats(-9, 9)), draw(st.floats(-9, 9)), draw(st.floats(-math.pi, math.pi)))
    return OccupancyMap(cells, draw(st.sampled_from(resolutions)), origin)


def places(world: OccupancyMap, beside: float = 0.0) -> st.SearchStrategy[Pose]:
    """Return poses anywhere on a map, or up to ``beside`` cells outside its border."""
    return st.builds(
        lambda row, column, yaw: Pose(*world.point(row, column), yaw),
        st.floats(-0.5 - beside, world.height - 0.5 + beside),
        st.floats(-0.5 - beside, world.width - 0.5 + beside),
        st.floats(-math.pi, math.pi),
    )


def free_places(world: OccupancyMap, clearance: float) -> st.SearchStrategy[Pose]:
    """Return poses at the centres of cells with at least ``clearance`` m to obstacles; none without such a cell."""
    cells = numpy.argwhere(world.distances >= clearance).tolist()
    return st.builds(
        lambda cell, yaw: Pose(*world.point(*cell), yaw),
        st.sampled_from(cells) if cells else st.nothing(),
        st.floats(-math.pi, math.pi),
    )


def rooms(world: OccupancyMap, points: NDArray[numpy.float64]) -> NDArray[numpy.float64]:
    """Return the distances from points, shape (n, 2), to the nearest obstacle cell, m. Check all cells."""
    turn = complex(math.cos(world.origin.yaw), -math.sin(world.origin.yaw))
    place = ((points[:, 0] - world.origin.x) + 1j * (points[:, 1] - world.origin.y)) * turn / world.resolution
    x, y = place.real[:, None], place.imag[:, None]
    rows, columns = numpy.nonzero(world.cells > OCCUPIED // 2)
    gaps = numpy.hypot(numpy.clip(x, columns, columns + 1) - x, numpy.clip(y, rows, rows + 1) - y)
    return gaps.min(axis=1, initial=math.inf) * world.resolution


def room(world: OccupancyMap, x: float, y: float) -> float:
    """Return the distance of one point, m."""
    return float(rooms(world, numpy.array([[x, y]]))[0])


class Scanner:
    """A lidar without a robot, at any pose."""

    def __init__(self, world: OccupancyMap, model: LidarModel, seed: int = 0) -> None:
        self._rays = RayCaster(world)
        self._robot = Robot('lidar', RobotModel(lidar=model), Pose(0.0, 0.0, 0.0), seed)
        self._lidar = Lidar(self._robot, model)
        self._lidar.reset()

    def scan(self, pose: Pose) -> NDArray[numpy.float32]:
        """Return the scan at a pose."""
        self._robot.pose = pose
        self._lidar.take(0.0, self._rays.cast([self._lidar.beams(-1)], outlines([]))[0])
        return self._lidar.array_values()
