# SPDX-License-Identifier: BSD-3-Clause
"""The beams of one sensor, one after the other, written so that numba can compile it.

It is the same as the whole-array operations of :mod:`.ray_casting`, which are for where there is no numba.
"""

from __future__ import annotations

import math
from typing import Any


def cast(
    free: Any, row: float, column: float, turned: float, resolution: float, x: float, y: float, heading: float,
    increment: float, range_max: float, owner: int, circles: Any, segments: Any, ranges: Any,
) -> None:  # fmt: skip
    """How far each beam gets, m, into ``ranges``, of which there is one for each beam; infinite beyond ``range_max``.

    ``free`` has for each cell of the map how far a beam may go from anywhere in it, in cells, and less than -0.5 for an
    obstacle; ``row`` and ``column`` is where the sensor is on it, and ``turned`` the heading of the map. ``heading`` is
    that of the first beam; see :class:`.ray_casting.Outlines` for the others.
    """
    height, width = free.shape
    beams = ranges.shape[0]
    limit = range_max / resolution
    for beam in range(beams):
        ranges[beam] = math.inf
        up, right = math.sin(heading - turned + beam * increment), math.cos(heading - turned + beam * increment)
        if abs(up) < 1e-12:
            up = 1e-12
        if abs(right) < 1e-12:
            right = 1e-12
        per_row, per_column = 1.0 / up, 1.0 / right
        low, high = -row * per_row, (height - row) * per_row
        left, far = -column * per_column, (width - column) * per_column
        travelled = max(min(low, high), min(left, far), 0.0) + 1e-6
        end = min(max(low, high), max(left, far), limit + 1.0) - 1e-6
        while travelled < end:
            r, c = row + travelled * up, column + travelled * right
            i, j = min(max(int(math.floor(r)), 0), height - 1), min(max(int(math.floor(c)), 0), width - 1)  # noqa: RUF046 - a float to numba
            room = free[i, j]
            if room < -0.5:
                ranges[beam] = travelled * resolution
                break
            if room < 1.0:  # it may be farther to the next cell
                to_row = (i + 1.0 - r if up > 0.0 else i - r) * per_row
                to_column = (j + 1.0 - c if right > 0.0 else j - c) * per_column
                room = max(min(to_row, to_column) + 1e-6, room)
            travelled += room
    whole = math.tau / increment if increment > 1e-6 else 0.0
    for k in range(circles.shape[0]):
        dx, dy, radius = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2]
        distance = math.hypot(dx, dy)
        if circles[k, 3] == owner or distance - radius > range_max:
            continue
        half = math.pi if distance <= radius else math.asin(radius / distance)
        middle = math.atan2(dy, dx) - heading
        middle -= math.tau * math.floor(middle / math.tau)
        for turn in range(-1, 2):
            first, last = 0, beams - 1
            if whole > 0.0:
                first = max(first, int(math.floor((middle - half) / increment + turn * whole)))  # noqa: RUF046
                last = min(last, int(math.ceil((middle + half) / increment + turn * whole)))  # noqa: RUF046
            for beam in range(first, last + 1):
                angle = heading + beam * increment
                along = dx * math.cos(angle) + dy * math.sin(angle)
                beside = dx * math.sin(angle) - dy * math.cos(angle)
                chord = radius * radius - beside * beside
                if chord >= 0.0 and along + math.sqrt(chord) >= 0.0:
                    ranges[beam] = min(ranges[beam], max(along - math.sqrt(chord), 0.0))
    for k in range(segments.shape[0]):
        x0, y0, x1, y1 = segments[k, 0] - x, segments[k, 1] - y, segments[k, 2] - x, segments[k, 3] - y
        ux, uy = x1 - x0, y1 - y0
        nearest = min(1.0, max(0.0, -(x0 * ux + y0 * uy) / (ux * ux + uy * uy)))
        if segments[k, 4] == owner or math.hypot(x0 + nearest * ux, y0 + nearest * uy) > range_max:
            continue
        start = math.atan2(y0, x0) - heading
        start -= math.tau * math.floor(start / math.tau)
        sweep = math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
        for turn in range(-1, 2):
            first, last = 0, beams - 1
            if whole > 0.0:
                first = max(first, int(math.floor((start + min(0.0, sweep)) / increment + turn * whole)))  # noqa: RUF046
                last = min(last, int(math.ceil((start + max(0.0, sweep)) / increment + turn * whole)))  # noqa: RUF046
            for beam in range(first, last + 1):
                cos, sin = math.cos(heading + beam * increment), math.sin(heading + beam * increment)
                across = cos * uy - sin * ux
                if across != 0.0:
                    length, part = (x0 * uy - y0 * ux) / across, (x0 * sin - y0 * cos) / across
                    if length >= 0.0 and 0.0 <= part <= 1.0:
                        ranges[beam] = min(ranges[beam], length)
    for beam in range(beams):
        if ranges[beam] > range_max:
            ranges[beam] = math.inf
