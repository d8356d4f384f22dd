# SPDX-License-Identifier: BSD-3-Clause
"""Path smoothing like Nav2's simple smoother, but without entering obstacles.

Nav2's smoother moves each point towards the middle of its neighbours and back towards its old position, and repeats
this until no point moves. The limit is the solution of a tridiagonal system of equations, which this module solves
directly. A point whose move would lead into an obstacle stays where it was.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy
import scipy
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Pose, wrap

DATA_WEIGHT: Final = 0.2
SMOOTH_WEIGHT: Final = 0.3
"""Weights that pull a point to its old position and to the middle of its neighbours: Nav2's w_data and w_smooth."""

LEAST_POSES: Final = 5
"""Minimum number of poses between two changes of direction for smoothing."""

Points = NDArray[numpy.float64]
Flags = NDArray[numpy.bool_]


@dataclass(frozen=True)
class Smoothing:
    """Settings for smoothing a path.

    ``refinements`` is the number of additional passes. With ``keeps_reversals``, points at which the robot reverses or
    turns on the spot stay (Nav2's enforce_path_inversion).
    """

    refinements: int = 2
    keeps_reversals: bool = True


def smooth_path(
    path: Sequence[Pose], costmap: Costmap, smoothing: Smoothing, check_time: Callable[[], None]
) -> list[Pose]:
    """Return the smoothed path, with the same number of poses. Both ends stay; no step that moves leads into an
    obstacle.

    ``check_time()`` is called regularly, and may raise to stop.

    Raises:
        NavigationError: INVALID_PATH for one without poses; what ``check_time`` raises.
    """
    if not path:
        raise NavigationError('INVALID_PATH', 'the path has no poses')
    smoothed = list(path)
    turns = _reversals(path) if smoothing.keeps_reversals else []
    for first, last in pairwise([0, *turns, len(path) - 1]):
        check_time()
        if last - first + 1 >= LEAST_POSES:
            part = path[first : last + 1]
            points = numpy.array([pose[:2] for pose in part])
            turn = math.pi if _is_backward(part) else 0.0
            points = _smoothed(points, turn, costmap, smoothing.refinements, check_time)
            smoothed[first:last] = _headed(points, turn, part)[:-1]
    return smoothed


def _reversals(path: Sequence[Pose]) -> list[int]:
    """Return the indices of the poses at which the robot reverses, or turns on the spot."""
    turns = []
    for index, (before, here, after) in enumerate(zip(path, path[1:], path[2:], strict=False), 1):
        bends = (here.x - before.x) * (after.x - here.x) + (here.y - before.y) * (after.y - here.y)
        on_the_spot = here[:2] == after[:2] and here.yaw != after.yaw
        if bends < 0.0 or on_the_spot:
            turns.append(index)
    return turns


def _is_backward(path: Sequence[Pose]) -> bool:
    """Return whether the robot is driven backward: most of the path leads away from its headings."""
    return sum((b.x - a.x) * math.cos(a.yaw) + (b.y - a.y) * math.sin(a.yaw) for a, b in pairwise(path)) < 0.0


def _smoothed(
    points: Points, turn: float, costmap: Costmap, refinements: int, check_time: Callable[[], None]
) -> Points:
    """Return the smoothed points. ``turn`` is the angle from the direction of the path to the heading of the robot."""
    fixed = numpy.zeros(len(points), bool)
    fixed[[0, -1]] = True
    margin = 0
    while True:
        smoothed = points
        for _ in range(refinements + 1):
            check_time()
            smoothed = _drawn(smoothed, fixed)
        blocked = _blocked(points, smoothed, turn, costmap, check_time)
        if not blocked.any():
            return smoothed
        # Fix more points each time, so that this ends after a few passes: if all points are fixed, none moves.
        for index in numpy.flatnonzero(blocked).tolist():
            fixed[max(0, index - margin) : index + 2 + margin] = True
        margin = 2 * margin + 1


def _drawn(points: Points, fixed: Flags) -> Points:
    """Return the final positions of the points."""
    free = ~fixed[1:-1]
    bands = numpy.zeros((3, len(points)))
    bands[1] = 1.0
    bands[1, 1:-1][free] = DATA_WEIGHT + 2.0 * SMOOTH_WEIGHT
    bands[0, 2:][free] = -SMOOTH_WEIGHT
    bands[2, :-2][free] = -SMOOTH_WEIGHT
    wanted = points.copy()
    wanted[1:-1][free] *= DATA_WEIGHT
    drawn: Points = scipy.linalg.solve_banded((1, 1), bands, wanted)
    return drawn


def _blocked(points: Points, smoothed: Points, turn: float, costmap: Costmap, check_time: Callable[[], None]) -> Flags:
    """Return, for each step between two points, whether it has moved and the robot would be in collision on it."""
    moved = (smoothed != points).any(axis=1)
    blocked = numpy.zeros(len(points) - 1, bool)
    for index in numpy.flatnonzero(moved[:-1] | moved[1:]).tolist():
        check_time()
        (x, y), (dx, dy) = smoothed[index], smoothed[index + 1] - smoothed[index]
        count = max(1, math.ceil(2.0 * math.hypot(dx, dy) / costmap.world.resolution))
        yaw = math.atan2(dy, dx) + turn
        blocked[index] = any(
            costmap.in_collision(Pose(x + dx * part / count, y + dy * part / count, yaw)) for part in range(count + 1)
        )
    return blocked


def _headed(points: Points, turn: float, path: Sequence[Pose]) -> list[Pose]:
    """Return poses that head to the next point, turned by ``turn``."""
    heads = [
        wrap(math.atan2(dy, dx) + turn) if dx or dy else pose.yaw
        for (dx, dy), pose in zip(numpy.diff(points, axis=0).tolist(), path, strict=False)
    ]
    return [Pose(x, y, yaw) for (x, y), yaw in zip(points.tolist(), [*heads, path[-1].yaw], strict=True)]
