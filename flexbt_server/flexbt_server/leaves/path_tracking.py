# SPDX-License-Identifier: BSD-3-Clause
"""Position of the robot on a path: the nearest place, the distance from it, and the length that remains. Pure
arithmetic, in m and rad.

A path is anything with the fields of a nav_msgs/Path; all of it is about the plane.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_server.trees.ros_ports import TrackingFeedback

SEARCH_AHEAD: Final = 3.0
"""Distance along the path from its last position within which the robot is looked for, m: a path may pass a place
twice."""

LOST: Final = 0.5
"""Distance from the path above which the robot is looked for on all of the remaining path, m: it drove on
unobserved."""


class PathTracker:
    """A tracker of the robot along one path, from its beginning."""

    def __init__(self, path: Any) -> None:
        self.path = path
        self._points = points_of(path)
        self._index = 0

    def feedback(self, pose: PoseStamped, speed: float) -> Any:
        """Return how the robot, at ``pose`` in the frame of the path, is on it; the path has two poses or more."""
        here = position_of(pose)
        last = len(self._points) - 1

        def gap(index: int) -> float:
            return to_segment(here, *self._points[index : index + 2])[0]

        end = first_beyond(self._points, self._index, SEARCH_AHEAD)
        nearest = min(range(self._index, max(self._index + 1, min(end, last))), key=gap)
        if gap(nearest) > LOST:
            nearest = min(range(self._index, last), key=gap)
        self._index = nearest
        start, end_point = self._points[nearest : nearest + 2]
        distance, along = to_segment(here, start, end_point)
        direction = math.atan2(end_point[1] - start[1], end_point[0] - start[0])
        side = (end_point[0] - start[0]) * (here[1] - start[1]) - (end_point[1] - start[1]) * (here[0] - start[0])
        return TrackingFeedback(
            header=self.path.header,
            position_tracking_error=math.copysign(distance, side),
            heading_tracking_error=math.remainder(yaw_of(pose) - direction, math.tau),
            current_path_index=nearest,
            robot_pose=pose,
            distance_to_goal=math.dist(here, self._points[-1]),
            speed=speed,
            remaining_path_length=path_length(self._points[nearest:]) - along,
        )


class NearestPose:
    """The pose of a path that is nearest to the robot; with a window, from where it was last on the same path."""

    def __init__(self) -> None:
        self._path: Any = None
        self._begin = 0
        self.points: list[tuple[float, float]] = []

    def index(self, path: Any, pose: PoseStamped, window: float, angular_weight: float = 0.0) -> int:
        """Its index. ``window``: how far along the path it is looked for, m; infinity or less than 0 for everywhere.

        Of poses that are equally near it is the last. ``angular_weight`` is the number of metres that 1 rad of another
        direction counts as.
        """
        has_window = 0.0 <= window < math.inf
        # Only a window needs to know whether another object is the same path: to compare many poses takes long.
        is_same = path is self._path or (has_window and path == self._path)
        if not is_same:
            self.points = points_of(path)
        if not (is_same and has_window):
            self._begin = 0
        self._path = path
        end = first_beyond(self.points, self._begin, window) if has_window else len(self.points)
        here, yaw = position_of(pose), yaw_of(pose)

        def distance(index: int) -> float:
            straight = math.dist(here, self.points[index])
            if not angular_weight:
                return straight
            return math.hypot(straight, angular_weight * math.remainder(yaw - yaw_of(path.poses[index]), math.tau))

        self._begin = min(reversed(range(self._begin, end)), key=distance)
        return self._begin


def first_beyond(points: Sequence[tuple[float, float]], begin: int, distance: float) -> int:
    """Index of the first point that is more than ``distance`` along the path from the one at ``begin``; else the
    number of points."""
    length = 0.0
    for index in range(begin, len(points) - 1):
        length += math.dist(points[index], points[index + 1])
        if length > distance:
            return index + 1
    return len(points)


def points_of(path: Any) -> list[tuple[float, float]]:
    """Return the positions of a path."""
    return [position_of(pose) for pose in path.poses]


def position_of(pose: Any) -> tuple[float, float]:
    """x and y of a stamped pose."""
    return pose.pose.position.x, pose.pose.position.y


def yaw_of(pose: Any) -> float:
    """Direction of a stamped pose in the plane, rad."""
    turned = pose.pose.orientation
    return math.atan2(
        2.0 * (turned.w * turned.z + turned.x * turned.y), 1.0 - 2.0 * (turned.y * turned.y + turned.z * turned.z)
    )


def path_length(points: Sequence[tuple[float, float]]) -> float:
    """Length of the way through these points."""
    return sum(itertools.starmap(math.dist, itertools.pairwise(points)))


def to_segment(here: tuple[float, float], start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """Return how far a point is from a segment, and how far along it the nearest place is."""
    length = math.dist(start, end)
    if length == 0.0:
        return math.dist(here, start), 0.0
    unit = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    along = (here[0] - start[0]) * unit[0] + (here[1] - start[1]) * unit[1]
    along = min(max(along, 0.0), length)
    return math.dist(here, (start[0] + along * unit[0], start[1] + along * unit[1])), along
