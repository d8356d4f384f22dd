# SPDX-License-Identifier: BSD-3-Clause
"""Progress of a robot for the feedback of running trees: the remaining distance and the remaining time."""

from __future__ import annotations

import itertools
import math
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_common.values.message_fields import seconds_of
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.values.json_data import finite_number
from flexbt_server.leaves.path_tracking import path_length, points_of, position_of, to_segment
from flexbt_server.trees.blackboards import RECOVERIES_KEY

MOST_COUNTED: Final = 2**15 - 1
"""Maximum count of recoveries and of poses in feedback: an int16."""

LONGEST: Final = 2.0**31 - 1.0
"""Maximum time that feedback can report, s."""

LEAST_SPEED: Final = 0.01
LEAST_DISTANCE: Final = 0.1
"""Minimum speed and distance for an estimate of the time, m/s and m, as in Nav2."""

SMOOTHING: Final = 0.3
"""Time over which the speed is averaged, s, as Nav2 smooths the speed of the odometry."""


UNKNOWN_DISTANCE: Final = -1.0


def distance_along(path: Any, pose: PoseStamped) -> float:
    """Return the metres from ``pose`` to the nearest place on ``path`` and along it to its end; negative if unknown."""
    if not isinstance(path, Path) or not path.poses or not pose.header.frame_id:
        return UNKNOWN_DISTANCE
    here, points = position_of(pose), points_of(path)
    nearest, ahead_of_nearest = math.dist(here, points[-1]), 0.0
    ahead = 0.0
    for start, end in reversed(list(itertools.pairwise(points))):
        length = math.dist(start, end)
        distance, along = to_segment(here, start, end)
        if distance < nearest:
            nearest, ahead_of_nearest = distance, ahead + length - along
        ahead += length
    return nearest + ahead_of_nearest


def distance_left(path: Any, pose: PoseStamped) -> float:
    """Return the metres along ``path`` from its pose nearest to ``pose``; 0 without a path."""
    if not isinstance(path, Path) or not path.poses or not pose.header.frame_id:
        return 0.0
    here, points = position_of(pose), points_of(path)
    nearest = min(range(len(points)), key=lambda index: math.dist(here, points[index]))
    return path_length(points[nearest:])


def seconds_left(distance: float, speed: float) -> float:
    """Return the time for ``distance``, m, at ``speed``, m/s; 0 if the robot hardly moves or has nearly arrived."""
    return min(distance / speed, LONGEST) if speed > LEAST_SPEED and distance > LEAST_DISTANCE else 0.0


def recoveries(board: Blackboard) -> int:
    """Return the number of recoveries that trees have counted on a blackboard, where any client may write any value."""
    return int(min(max(finite_number(board.get_or(RECOVERIES_KEY, 0)) or 0.0, 0.0), MOST_COUNTED))


class Speed:
    """The speed of a robot, computed from its poses, m/s."""

    def __init__(self) -> None:
        self._poses: list[tuple[float, float, float]] = []

    def at(self, pose: PoseStamped) -> float:
        """Return the speed over the last :data:`SMOOTHING` seconds up to this pose, m/s."""
        seen = (seconds_of(pose.header.stamp), *position_of(pose))
        if self._poses and seen[0] < self._poses[-1][0]:
            self._poses.clear()  # time has jumped back
        if not self._poses or seen[0] > self._poses[-1][0]:
            self._poses.append(seen)
        while len(self._poses) > 2 and self._poses[1][0] <= seen[0] - SMOOTHING:
            del self._poses[0]
        (since, *there), (until, *here) = self._poses[0], self._poses[-1]
        return math.dist(there, here) / (until - since) if until > since else 0.0
