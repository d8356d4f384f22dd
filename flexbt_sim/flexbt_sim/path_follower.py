# SPDX-License-Identifier: BSD-3-Clause
"""Follows a path by regulated pure pursuit, with a goal checker and a progress checker.

The rules are those of Nav2's regulated pure pursuit controller, with speeds that fit a TurtleBot3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from flexbt_sim.costmap import Costmap
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose, wrap
from flexbt_sim.motions import TurnLimits, Velocity, collides


@dataclass(frozen=True)
class FollowerLimits:
    """Parameters of the controller, in m, s and rad.

    The look-ahead distance is ``lookahead_time`` of driving, within its bounds. Within ``approach_distance`` of the end
    the robot slows down to ``approach_speed``; where the path bends more than ``curvature_radius`` it slows down to no
    less than ``curve_speed``. A turn of more than ``rotate_angle`` is made on the spot. No progress means less than
    ``progress_distance`` within ``progress_time``; ``patience`` is how long an obstacle ahead is waited for.
    """

    speed: float = 0.26
    lookahead_min: float = 0.25
    lookahead_max: float = 0.6
    lookahead_time: float = 1.5
    approach_distance: float = 0.4
    approach_speed: float = 0.05
    curvature_radius: float = 0.6
    curve_speed: float = 0.1
    rotate_angle: float = 0.785
    angular_speed: float = 1.5
    xy_tolerance: float = 0.1
    yaw_tolerance: float = 0.1
    progress_distance: float = 0.5
    progress_time: float = 10.0
    patience: float = 0.3
    collision_time: float = 1.0


class ProgressChecker:
    """Notices when the robot gets nowhere. It outlives a change of the path."""

    def __init__(self, limits: FollowerLimits) -> None:
        self._limits = limits
        self._mark: tuple[Pose, float] | None = None

    def check(self, pose: Pose, now: float, turning: bool) -> None:
        """Raises NavigationError FAILED_TO_MAKE_PROGRESS. A turn at the goal is progress of its own."""
        if self._mark is None or turning or self._mark[0].distance(pose) >= self._limits.progress_distance:
            self._mark = (pose, now)
        elif now - self._mark[1] > self._limits.progress_time:
            raise NavigationError(
                'FAILED_TO_MAKE_PROGRESS',
                f'moved less than {self._limits.progress_distance:g} m in {self._limits.progress_time:g} s',
            )


class PathFollower:
    """Follows one path to its end, and turns to the heading of its last pose."""

    def __init__(
        self,
        path: Sequence[Pose],
        costmap: Costmap,
        limits: FollowerLimits,
        progress: ProgressChecker | None = None,
    ) -> None:
        """``progress`` is that of the path that this one replaces.

        Raises:
            NavigationError: INVALID_PATH for one without poses.
        """
        if not path:
            raise NavigationError('INVALID_PATH', 'the path has no poses')
        self._path = list(path)
        self._costmap = costmap
        self._limits = limits
        self.progress = progress or ProgressChecker(limits)
        self._turn = TurnLimits(maximum=limits.angular_speed)
        self._left = _distances_to_end(self._path)
        self._nearest = 0
        self._at_goal = False
        self._blocked_since: float | None = None
        self.speed = 0.0
        self.distance_to_goal = self._left[0]

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`flexbt_sim.motions.Motion`."""
        goal = self._path[-1]
        self._nearest = self._find_nearest(pose)
        self.distance_to_goal = pose.distance(self._path[self._nearest]) + self._left[self._nearest]
        near_end = self._left[self._nearest] <= 2.0 * self._limits.xy_tolerance
        self._at_goal = self._at_goal or (near_end and pose.distance(goal) <= self._limits.xy_tolerance)
        self.progress.check(pose, now, self._at_goal)
        if self._at_goal:
            velocity = self._turn_to(wrap(goal.yaw - pose.yaw), self._limits.yaw_tolerance)
            self.speed = 0.0
            return velocity
        velocity = self._pursue(pose)
        if collides(self._costmap, pose, velocity, self._look_ahead_time(velocity)):
            velocity = self._wait_for_way(now)
        else:
            self._blocked_since = None
        self.speed = velocity.linear
        return velocity

    def update(self, costmap: Costmap) -> None:
        """See :class:`flexbt_sim.motions.Motion`."""
        self._costmap = costmap

    def _pursue(self, pose: Pose) -> Velocity:
        limits = self._limits
        carrot = self._carrot(pose)
        bearing = pose.bearing(carrot.x, carrot.y)
        turning = abs(self.speed) < 0.01
        if abs(bearing) > (limits.rotate_angle / 3.0 if turning else limits.rotate_angle):
            return self._turn_to(bearing, 0.0) or Velocity(0.0, 0.0)
        reach = max(pose.distance(carrot), 0.05)
        curvature = 2.0 * math.sin(bearing) / reach
        speed = limits.speed
        if abs(curvature) * limits.curvature_radius > 1.0:
            speed = max(limits.curve_speed, speed / (abs(curvature) * limits.curvature_radius))
        if self.distance_to_goal < limits.approach_distance:
            speed = max(limits.approach_speed, speed * self.distance_to_goal / limits.approach_distance)
        angular = max(-limits.angular_speed, min(limits.angular_speed, speed * curvature))
        return Velocity(speed, angular)

    def _turn_to(self, angle: float, tolerance: float) -> Velocity | None:
        if abs(angle) <= tolerance:
            return None
        return Velocity(0.0, math.copysign(self._turn.speed(angle), angle))

    def _look_ahead_time(self, velocity: Velocity) -> float:
        if velocity.linear <= 0.0:
            return self._limits.collision_time
        return min(self._limits.collision_time, max(0.1, self.distance_to_goal / velocity.linear))

    def _wait_for_way(self, now: float) -> Velocity:
        if self._blocked_since is None:
            self._blocked_since = now
        elif now - self._blocked_since > self._limits.patience:
            raise NavigationError('NO_VALID_CONTROL', 'an obstacle is ahead on the path')
        return Velocity(0.0, 0.0)

    def _find_nearest(self, pose: Pose) -> int:
        """Index of the nearest pose from where the robot was, not beyond 1.5 m along the path (it may cross itself)."""
        best, best_distance = self._nearest, math.inf
        for index in range(self._nearest, len(self._path)):
            if self._left[self._nearest] - self._left[index] > 1.5:
                break
            distance = pose.distance(self._path[index])
            if distance < best_distance:
                best, best_distance = index, distance
        return best

    def _carrot(self, pose: Pose) -> Pose:
        limits = self._limits
        reach = min(limits.lookahead_max, max(limits.lookahead_min, self.speed * limits.lookahead_time))
        for index in range(self._nearest, len(self._path)):
            if pose.distance(self._path[index]) >= reach:
                return self._path[index]
        return self._path[-1]


def _distances_to_end(path: Sequence[Pose]) -> list[float]:
    left = [0.0]
    for here, ahead in zip(reversed(path[:-1]), reversed(path), strict=False):
        left.append(left[-1] + here.distance(ahead))
    return left[::-1]
