# SPDX-License-Identifier: BSD-3-Clause
"""A path as a line that is driven along: its points by their distance from the beginning."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy
from numpy.typing import NDArray

from flexbt_sim.world import Pose

Points = NDArray[numpy.float64]
"""Shape (n, 2): x and y, m."""


class Track:
    """The straight lines between the positions of poses, however far apart these are. ``length`` in m."""

    def __init__(self, poses: Sequence[Pose]) -> None:
        """``poses`` has at least one."""
        self._corners: Points = numpy.array([pose[:2] for pose in poses], float)
        steps = numpy.hypot(*numpy.diff(self._corners, axis=0).T)
        self._at = numpy.concatenate([[0.0], numpy.cumsum(steps)])
        self.length = float(self._at[-1])

    def point(self, at: float) -> tuple[float, float]:
        """Position at a distance from the beginning, m."""
        return float(numpy.interp(at, self._at, self._corners[:, 0])), float(
            numpy.interp(at, self._at, self._corners[:, 1])
        )

    def nearest(self, pose: Pose, begin: float, end: float) -> float:
        """Where, between two distances from the beginning, the track comes nearest to a position."""
        at, corners = self._part(begin, end)
        steps = numpy.diff(corners, axis=0)
        squares = (steps**2).sum(axis=1)
        parts = ((pose[:2] - corners[:-1]) * steps).sum(axis=1) / numpy.where(squares > 0.0, squares, 1.0)
        parts = numpy.clip(parts, 0.0, 1.0)
        gaps = numpy.hypot(*(corners[:-1] + parts[:, None] * steps - pose[:2]).T)
        best = int(numpy.argmin(gaps))
        return float(at[best] + parts[best] * (at[best + 1] - at[best]))

    def ahead(self, pose: Pose, begin: float, reach: float) -> tuple[float, float]:
        """The first point after a distance from the beginning that is ``reach`` away from a position, or the end."""
        _, corners = self._part(begin, self.length)
        gaps = numpy.hypot(*(corners - pose[:2]).T)
        outside = numpy.flatnonzero(gaps >= reach)
        if not outside.size:
            return self.point(self.length)
        last = int(outside[0])
        if last == 0:
            return self.point(begin)
        (x, y), (dx, dy) = corners[last - 1], corners[last] - corners[last - 1]
        # Where a circle round the position cuts the line that leaves it.
        square = dx * dx + dy * dy
        half = (dx * (x - pose.x) + dy * (y - pose.y)) / square
        part = -half + math.sqrt(max(0.0, half * half + (reach * reach - gaps[last - 1] ** 2) / square))
        return float(x + part * dx), float(y + part * dy)

    def _part(self, begin: float, end: float) -> tuple[NDArray[numpy.float64], Points]:
        """The track between two distances from its beginning: distances and positions of its ends and corners."""
        within = (self._at > begin) & (self._at < end)
        at = numpy.concatenate([[begin], self._at[within], [min(end, self.length)]])
        return at, numpy.stack([numpy.interp(at, self._at, self._corners[:, axis]) for axis in (0, 1)], axis=1)
