# SPDX-License-Identifier: BSD-3-Clause
"""How far the robot is from the end of its path: for the feedback of running trees."""

from __future__ import annotations

import itertools
import math
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

UNKNOWN_DISTANCE = -1.0

Point = tuple[float, float]


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
