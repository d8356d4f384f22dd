# SPDX-License-Identifier: BSD-3-Clause
"""Position of the robot on a path: the nearest place, the distance from it, and the remaining length. Pure
arithmetic, in m and rad.

A path is any object with the fields of a nav_msgs/Path. All functions work in the plane.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, Final

from geometry_msgs.msg import PoseStamped

from flexbt_common.values.message_fields import yaw_of_quaternion
from flexbt_server.trees.ros_ports import TrackingFeedback

SEARCH_AHEAD: Final = 3.0
"""Distance along the path, from the robot's last position, within which it is searched, m: a path may pass a place
twice."""

LOST: Final = 0.5
"""Distance from the path above which the robot is searched on the whole remaining path, m: it moved while nothing
observed it."""


class PathTracker:
    """A tracker of the robot along one path, from its beginning."""

    def __init__(self, path: Any) -> None:
        self.path = path
        self._points = points_of(path)
        self._index = 0

    def feedback(self, pose: PoseStamped, speed: float) -> Any:
        """Return the tracking feedback for the robot at ``pose``, in the frame of the path. Needs two poses or more."""
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
    """A search for the pose of a path nearest to the robot; a window starts at the last result on the same path."""

    def __init__(self) -> None:
        self._path: Any = None
        self._begin = 0
        self.points: list[tuple[float, float]] = []

    def index(self, path: Any, pose: PoseStamped, window: float, angular_weight: float = 0.0) -> int:
        """Return the index of the nearest pose, the last of several equally near ones.

        ``window``: length of the path to search, m; infinite or negative for all of it. ``angular_weight``: metres that
        count for 1 rad of difference in direction.
        """
        has_window = 0.0 <= window < math.inf
        # Compare paths only if a window needs it: comparing many poses is slow.
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
    """Return the index of the first point more than ``distance`` m along the path from the point at ``begin``, or the
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
    """Return x and y of a stamped pose, m."""
    return pose.pose.position.x, pose.pose.position.y


def yaw_of(pose: Any) -> float:
    """Return the direction of a stamped pose in the plane, rad. The quaternion need not be normalized."""
    return yaw_of_quaternion(pose.pose.orientation)


def path_length(points: Sequence[tuple[float, float]]) -> float:
    """Return the length of the line through these points, m."""
    return sum(itertools.starmap(math.dist, itertools.pairwise(points)))


def to_segment(here: tuple[float, float], start: tuple[float, float], end: tuple[float, float]) -> tuple[float, float]:
    """Return the distance of a point from a segment, and the distance of the nearest place along the segment, m."""
    length = math.dist(start, end)
    if length == 0.0:
        return math.dist(here, start), 0.0
    unit = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    along = (here[0] - start[0]) * unit[0] + (here[1] - start[1]) * unit[1]
    along = min(max(along, 0.0), length)
    return math.dist(here, (start[0] + along * unit[0], start[1] + along * unit[1])), along
