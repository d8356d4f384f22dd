# SPDX-License-Identifier: BSD-3-Clause
"""The robot's pose, and how far it is from the end of a path: for the feedback of running trees."""

from __future__ import annotations

import itertools
import math
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_server.leaves.topic_cache import TopicCaches

UNKNOWN_DISTANCE = -1.0

Point = tuple[float, float]


class RobotPose:
    """The robot's pose from its topic; its frame is empty until there is one."""

    def __init__(self, topics: TopicCaches, topic: str) -> None:
        # The same subscription as that of the leaves: they find a pose at once.
        self._cache = topics.cache(PoseStamped, topic, 1)
        self._unknown = PoseStamped()

    @property
    def latest(self) -> PoseStamped:
        """The pose that was received last."""
        return self._unknown if self._cache.latest is None else self._cache.latest


def distance_along(path: Any, pose: PoseStamped) -> float:
    """Metres from ``pose`` to the nearest place of ``path``, and along it to its end; negative when unknown."""
    if not isinstance(path, Path) or not path.poses or not pose.header.frame_id:
        return UNKNOWN_DISTANCE
    here = (pose.pose.position.x, pose.pose.position.y)
    points = [(stamped.pose.position.x, stamped.pose.position.y) for stamped in path.poses]
    lengths = [math.dist(a, b) for a, b in itertools.pairwise(points)]
    nearest, ahead_of_nearest = math.dist(here, points[-1]), 0.0
    ahead = 0.0
    for (start, end), length in zip(reversed(list(itertools.pairwise(points))), reversed(lengths), strict=True):
        place, left = _nearest_on_segment(here, start, end, length)
        distance = math.dist(here, place)
        if distance < nearest:
            nearest, ahead_of_nearest = distance, ahead + left
        ahead += length
    return nearest + ahead_of_nearest


def _nearest_on_segment(here: Point, start: Point, end: Point, length: float) -> tuple[Point, float]:
    """The point of a segment that is nearest to ``here``, and how far it is from the segment's end."""
    if length <= 0.0:
        return end, 0.0
    along = ((here[0] - start[0]) * (end[0] - start[0]) + (here[1] - start[1]) * (end[1] - start[1])) / length**2
    along = min(max(along, 0.0), 1.0)
    place = (start[0] + along * (end[0] - start[0]), start[1] + along * (end[1] - start[1]))
    return place, (1.0 - along) * length
