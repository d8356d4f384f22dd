# SPDX-License-Identifier: BSD-3-Clause
"""Path planning for a robot that steers as a car does: Hybrid A*, as Nav2's SmacPlannerHybrid."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, Final

import numpy
from numpy.typing import NDArray

from flexbt_navigation.controller.motions import Steering
from flexbt_navigation.costmaps.costmap import INSCRIBED, Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Pose, wrap

from .grid_planner import SPACING, Cell, GridPlanner, StopFlag
from .hybrid_kernels import NEAR, PIECE, SLACK, GridPose, Ways, hybrid_search, moved, room, ways_to
from .outline_planner import OutlinePlanner, turned_round

STEERING_RESERVE: Final = 1.1
"""Factor by which bends are planned wider than the robot can drive them: it has to get back to the path, too."""

MARGIN: Final = 0.05
"""Distance to obstacles, in turning radii, within which the way costs more: the robot may be so far beside the path."""

TIGHT: Final = -0.02
"""Slack, in cells, where the robot has no room to spare."""

MOST_STATES: Final = (1_000, 4_000, 16_000, 64_000)
"""Maximum number of states that are looked at from either end, by turns, until the search is given up: a second."""

MOST_INTERPRETED: Final = MOST_STATES[:2]
"""The same where nothing is compiled: six seconds."""

SHORTEST: Final = 1.5
"""Length of the pieces of a way, in cells, at least."""

MOST_BLOCKS: Final = 60_000
"""Over which the ways to the goal are known beforehand."""


def planner_for(costmap: Costmap, steering: Steering, tolerance: float = 0.0) -> GridPlanner:
    """Return the planner for a robot; ``tolerance`` as :class:`GridPlanner` has it."""
    if steering.turning_radius:
        return HybridPlanner(costmap, steering, tolerance)
    if costmap.inflation.corners:
        return OutlinePlanner(costmap, tolerance)
    return GridPlanner(costmap, tolerance)


class HybridPlanner(OutlinePlanner):
    """A planner on one costmap. Its poses have the heading of the robot: it drives backward to one that is behind it.

    :meth:`plan` gives a path that the robot can drive, with the poses of start and goal at its ends. It is searched for
    from either end by turns, since one may be hard to get away from, and from there little is left to look at. A robot
    that stands the other way round drives from the goal to the start where this one drives from the start to the goal.
    Where that leads nowhere the way is made of shorter pieces, before it is said that there is none. Where it takes
    long either end may be hard to get to: then ways from both to a place with room between them are tried.

    The rest of a path ``before``, of this planner and to the same goal, is the plan as long as it is free and the robot
    nearly on it; it begins beside the start, at its pose that is nearest. Of two ways that cost nearly the same, one
    begins forward and the other backward. A robot that gets them in turn makes no progress. NavigationError TIMEOUT is
    raised, too, when the search is given up.
    """

    def __init__(self, costmap: Costmap, steering: Steering, tolerance: float = 0.0) -> None:
        """``tolerance`` as for :class:`GridPlanner`; the turning radius of ``steering`` is above 0."""
        super().__init__(costmap, tolerance)
        self._steering = steering

    def _way(
        self,
        start: Pose,
        source: Cell,
        goal: Pose,
        target: Cell,
        stop: StopFlag,
        before: Sequence[Sequence[Pose]],
    ) -> list[Pose]:
        costmap, world = self._costmap, self._costmap.world
        cell = world.resolution
        if costmap.in_collision(start):
            raise NavigationError(
                'START_OCCUPIED' if costmap.touches_map(start) else 'NO_VALID_PATH',
                f'at the start ({start.x:.2f}, {start.y:.2f}) the robot overlaps an obstacle',
            )
        if rest := self._rest(before, start, goal):
            return rest
        radius = self._steering.turning_radius * STEERING_RESERVE / cell
        begin, end = ends = self.on_grid(start), self.on_grid(goal)
        # Where there is less room at an end the robot may come as near to obstacles all along.
        slack = SLACK if all(room(self.shape, SLACK, *one) >= 0.0 for one in ends) else TIGHT
        rules = slack, max(1.0, MARGIN * radius)

        @cache
        def problem(turned: bool) -> tuple[Any, ...]:
            if not turned:
                return self.shape, *rules, self._ahead(target, radius), begin, end
            return self.shape_turned, *rules, self._ahead(source, radius), turned_round(end), turned_round(begin)

        def halves() -> Iterator[tuple[Any, ...]]:
            """Yield the ways to a place in the midst, from the start and from the goal."""
            *_, ways, _, _ = problem(False)
            if gate := self._gate(ways, source, radius):
                ahead = self._ahead((int(gate[1]), int(gate[0])), radius)
                yield self.shape, *rules, ahead, begin, gate
                yield self.shape_turned, *rules, ahead, turned_round(end), turned_round(gate)

        lengths = sorted({max(SHORTEST, PIECE * radius / share) for share in (1.0, 2.0)})
        untried, looked = {turned: lengths.copy() for turned in (False, True)}, 0
        for number, most in enumerate(MOST_STATES if hybrid_search.compiled else MOST_INTERPRETED):
            parts: list[NDArray[numpy.float64]] = []
            for half in halves() if number == 1 else ():
                pieces, states = self._searched(half, radius, lengths.copy(), most, stop)
                looked += states
                if not len(pieces):
                    break
                parts.append(_driven_back(pieces) if parts else pieces)
            if len(parts) == 2:
                return _sampled(start, numpy.concatenate(parts) * (1.0, cell), radius * cell, goal)
            for turned, left in untried.items():
                pieces, states = self._searched(problem(turned), radius, left, most, stop)
                looked += states
                if len(pieces):
                    pieces = _driven_back(pieces) if turned else pieces
                    return _sampled(start, pieces * (1.0, cell), radius * cell, goal)
                if not left:
                    raise self._no_way('NO_VALID_PATH', goal, looked)
        raise self._no_way('TIMEOUT', goal, looked)

    def _searched(
        self, problem: tuple[Any, ...], radius: float, lengths: list[float], most: int, stop: StopFlag
    ) -> tuple[NDArray[numpy.float64], int]:
        """Return the pieces of a way, empty when none was found, and how many states were looked at, at most ``most``
        with pieces of each length. Lengths without a way are removed; the last one is tried first.
        """
        looked, pieces = 0, numpy.empty((0, 2))
        while lengths:
            pieces, states = hybrid_search(*problem, radius, lengths[-1], self._steering.reverses, most, stop.cell)
            stop.check()
            looked += states
            if len(pieces) or states == most:
                break
            lengths.pop()
        return pieces, looked

    def _gate(self, ways: Ways, source: Cell, radius: float) -> GridPose | None:
        """Return where there is most room on a way over blocks, but for its ends, with the heading that the way has
        there."""
        height, width = self._costmap.costs.shape
        block, following = ways.block, ways.following
        across = (width + block - 1) // block
        way = [source[0] // block * across + source[1] // block]
        while following[way[-1]] != way[-1]:
            way.append(int(following[way[-1]]))
        near = math.ceil(radius / block / 2.0)
        rows, columns = ((numpy.divmod(way, across)[axis] + 0.5) * block for axis in (0, 1))
        cells = numpy.minimum(rows, height - 1).astype(int), numpy.minimum(columns, width - 1).astype(int)
        between = self._costmap.squares[cells][near:-near]
        if not between.size:
            return None
        middle = near + int(between.argmax())
        before, after = middle - near, middle + near
        course = math.atan2(rows[after] - rows[before], columns[after] - columns[before])
        gate = float(cells[1][middle]) + 0.5, float(cells[0][middle]) + 0.5, course
        return gate if room(self.shape, SLACK, *gate) >= 0.0 else None

    def _no_way(self, code: str, goal: Pose, looked: int) -> NavigationError:
        return NavigationError(
            code,
            f'no way with bends of {self._steering.turning_radius:g} m leads to the goal ({goal.x:.2f}, '
            f'{goal.y:.2f}){"" if self._steering.reverses else " without driving backward"}, '
            f'of {looked} places and headings that were looked at',
        )

    @property
    def _on_path(self) -> float:
        return 2.0 * MARGIN * self._steering.turning_radius

    def _beside(self, start: Pose, pose: Pose) -> float:
        return start.distance(pose) + self._steering.turning_radius * abs(wrap(pose.yaw - start.yaw))

    def _is_free(self, path: Sequence[Pose], yaw: float) -> bool:
        """Its poses have the heading of the robot."""
        return all(room(self.shape, TIGHT, *self.on_grid(pose)) >= 0.0 for pose in path)

    def _ahead(self, target: Cell, radius: float) -> Ways:
        """Return the ways to a cell."""
        free = self._costmap.costs < INSCRIBED
        block = math.ceil(math.sqrt(free.size / MOST_BLOCKS))
        free = numpy.pad(free, [(0, -size % block) for size in free.shape])
        blocks = numpy.asarray(free.reshape(free.shape[0] // block, block, -1, block).any(axis=(1, 3)))
        ways: Ways = ways_to(blocks, target[0] // block, target[1] // block, NEAR * radius / block, block)
        return ways


def _driven_back(pieces: NDArray[numpy.float64]) -> NDArray[numpy.float64]:
    """Return the pieces of a way of a robot that stands the other way round, from its end to its beginning."""
    return pieces[::-1] * (-1.0, 1.0)


def _sampled(start: Pose, pieces: NDArray[numpy.float64], radius: float, goal: Pose) -> list[Pose]:
    """Poses along pieces, turn and length in m; the last is the goal."""
    path = [start]
    for turn, length in pieces.tolist():
        begin, count = path[-1], math.ceil(abs(length) / SPACING - 1e-6)
        path += [Pose(*moved(*begin, turn, length * i / count, radius)) for i in range(1, count + 1)]
    return [*path[:-1], goal]
