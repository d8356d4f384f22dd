# SPDX-License-Identifier: BSD-3-Clause
"""A path as a line that is driven along: its points by their distance from the beginning."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Final

from flexbt_sim.world.plane.geometry import Pose, compose, wrap

Point = tuple[float, float]
"""x and y, m."""


SAME_PLACE: Final = 1e-3
SAME_HEADING: Final = 0.02
"""Differences, m and rad, that poses of a path may have from how it is driven: others may have rounded them."""


class Track:
    """The straight lines between the positions of poses, however far apart these are. ``length`` in m."""

    def __init__(self, poses: Sequence[Pose]) -> None:
        """``poses`` has at least one."""
        self._corners: list[Point] = [(float(pose.x), float(pose.y)) for pose in poses]
        self._at = list(accumulate((math.dist(a, b) for a, b in pairwise(self._corners)), initial=0.0))
        self.length = self._at[-1]

    def moved(self, by: Pose) -> Track:
        """Return the same one where it comes to when its frame, which was that of the map, moves to ``by``."""
        moved = copy(self)
        moved._corners = [compose(by, Pose(*corner, 0.0))[:2] for corner in self._corners]
        return moved

    def point(self, at: float) -> Point:
        """Position at a distance from the beginning, m."""
        after = bisect_left(self._at, at)
        if after == 0:
            return self._corners[0]
        if after == len(self._at):
            return self._corners[-1]
        (x, y), (to_x, to_y) = self._corners[after - 1], self._corners[after]
        share = (at - self._at[after - 1]) / (self._at[after] - self._at[after - 1])
        return x + share * (to_x - x), y + share * (to_y - y)

    def index(self, at: float) -> int:
        """Index of the last pose that is not beyond a distance from the beginning, m."""
        return max(0, bisect_right(self._at, at) - 1)

    def heading(self, at: float) -> float:
        """Return where it leads at a distance from the beginning, rad; 0 for a track without length."""
        index = min(max(bisect_right(self._at, at), 1), len(self._at) - 1)
        while index > 1 and self._at[index] == self._at[index - 1]:
            index -= 1
        (x, y), (to_x, to_y) = self._corners[index - 1], self._corners[index]
        return math.atan2(to_y - y, to_x - x)

    def nearest(self, pose: Pose, begin: float, end: float) -> float:
        """Where, between two distances from the beginning, the track comes nearest to a position."""
        best, least = begin, math.dist(self.point(begin), pose[:2])
        for (at, (x, y)), (next_at, (to_x, to_y)) in pairwise(self._part(begin, end)):
            dx, dy = to_x - x, to_y - y
            square = dx * dx + dy * dy
            if square > 0.0:
                share = min(1.0, max(0.0, ((pose.x - x) * dx + (pose.y - y) * dy) / square))
                gap = math.hypot(x + share * dx - pose.x, y + share * dy - pose.y)
                if gap < least:
                    best, least = at + share * (next_at - at), gap
        return best

    def ahead(self, pose: Pose, begin: float, reach: float) -> Point:
        """Return the first point after a distance from the beginning that is ``reach`` away from a position, or the
        end."""
        x, y = self.point(begin)
        gap = math.hypot(x - pose.x, y - pose.y)
        for _, (to_x, to_y) in self._part(begin, self.length):
            next_gap = math.hypot(to_x - pose.x, to_y - pose.y)
            if next_gap >= reach:
                dx, dy = to_x - x, to_y - y
                square = dx * dx + dy * dy
                if square == 0.0:
                    return to_x, to_y
                # Where a circle round the position cuts the line that leaves it.
                half = (dx * (x - pose.x) + dy * (y - pose.y)) / square
                share = -half + math.sqrt(max(0.0, half * half + (reach * reach - gap * gap) / square))
                return x + share * dx, y + share * dy
            x, y, gap = to_x, to_y, next_gap
        return self._corners[-1]

    def _part(self, begin: float, end: float) -> Iterator[tuple[float, Point]]:
        """Yield the track between two distances from its beginning: distances and positions of its ends and corners."""
        yield begin, self.point(begin)
        last = min(end, self.length)
        for index in range(bisect_right(self._at, begin), len(self._at)):
            if self._at[index] >= last:
                break
            yield self._at[index], self._corners[index]
        yield last, self.point(last)


@dataclass(frozen=True)
class Leg:
    """A part of a path that is driven in one direction."""

    track: Track
    backward: bool = False


def drivable_legs(path: Sequence[Pose], turning_radius: float) -> list[Leg]:
    """Return the parts of a path between changes of direction; none where a robot cannot drive it as its poses say:
    where it would have to turn on the spot, or bend more than the radius, m, allows.
    """
    corners: list[list[Pose]] = []
    backward: list[bool] = []
    for a, b in pairwise(path):
        length, turned = a.distance(b), abs(wrap(b.yaw - a.yaw))
        if length < SAME_PLACE and turned < SAME_HEADING:
            continue
        ahead = a.bearing(b.x, b.y) - wrap(b.yaw - a.yaw) / 2.0
        aside = min(abs(wrap(ahead)), abs(wrap(ahead + math.pi)))
        if turned > length / turning_radius + SAME_HEADING or aside > SAME_HEADING + SAME_PLACE / max(length, 1e-9):
            return []
        is_back = abs(wrap(ahead)) > math.pi / 2.0
        if not backward or is_back != backward[-1]:
            backward.append(is_back)
            corners.append([a])
        corners[-1].append(b)
    return [Leg(Track(part), back) for part, back in zip(corners, backward, strict=True)]
