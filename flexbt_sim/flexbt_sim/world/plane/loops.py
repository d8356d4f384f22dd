# SPDX-License-Identifier: BSD-3-Clause
"""The inner loops over beams and cells. numba compiles them if it is installed; without it, the results are the same.

The first call of a loop imports numba, which takes some tenths of a second. Compiling takes some seconds on the first
use on a computer; numba caches the result.
"""

from __future__ import annotations

import functools
import importlib
import logging
import math
import os
from collections.abc import Callable
from contextlib import suppress
from types import FunctionType
from typing import Any

import numpy


class Loop:
    """A decorator that compiles a function over arrays on its first call.

    Without numba, the function runs ``interpreted``. If that is too slow, ``otherwise`` computes the same with
    operations on whole arrays.
    """

    def __init__(self, interpreted: Callable[..., Any], otherwise: Callable[..., Any] | None = None) -> None:
        functools.update_wrapper(self, interpreted)
        self.interpreted = interpreted
        self._otherwise = otherwise or interpreted

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        return (self.compiled or self._otherwise)(*arguments)

    @functools.cached_property
    def compiled(self) -> Callable[..., Any] | None:
        """The compiled function, which releases the GIL; None without numba.

        This also compiles the loops that it calls. ``FLEXBT_ACCELERATION=0`` disables numba.
        """
        numba: Any = None
        if os.environ.get('FLEXBT_ACCELERATION', '1') != '0':
            with suppress(ImportError):
                numba = importlib.import_module('numba')
        if numba is None:
            return None
        function = self._with_compiled()
        made: Any
        try:
            made = numba.njit(nogil=True, cache=True)(function)
            made._cache = _Cache(made._cache, function.__name__)  # noqa: SLF001 - there is no other way to it
        except RuntimeError as error:  # no cache directory is writable
            _tell_not_kept(function.__name__, error)
            made = numba.njit(nogil=True)(function)
        return made

    def _with_compiled(self) -> FunctionType:
        """Return the function with the loops that it calls replaced by compiled ones."""
        function = self.interpreted
        assert isinstance(function, FunctionType)
        there = function.__globals__
        called = {name: one for name in function.__code__.co_names if isinstance(one := there.get(name), Loop)}
        if not called:
            return function
        compiled = {name: one.compiled for name, one in called.items()}
        made = FunctionType(function.__code__, there | compiled, function.__name__)
        made.__qualname__ = function.__qualname__
        return made


class _Cache:
    """The files in which numba keeps a compiled function. Without them, it compiles the function anew."""

    def __init__(self, cache: Any, function: str) -> None:
        self._cache = cache
        self._function = function

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, *arguments: Any) -> Any:
        """Return what is kept, or None. Remove damaged files, such as those of a power failure."""
        try:
            return self._cache.load_overload(*arguments)
        except Exception:  # a damaged pickle raises anything
            with suppress(OSError):
                self._cache.flush()
            return None

    def save_overload(self, *arguments: Any) -> None:
        """Keep a compiled function, unless the disk is full."""
        try:
            self._cache.save_overload(*arguments)
        except OSError as error:
            _tell_not_kept(self._function, error)


def _tell_not_kept(function: str, error: Exception) -> None:
    logging.getLogger(__name__).warning(
        'numba compiles %s anew in each process, as it cannot keep it: %s; NUMBA_CACHE_DIR names a directory '
        'where it can', function, error,
    )  # fmt: skip


@Loop
def cast(
    free: Any, row: float, column: float, turned: float, resolution: float, x: float, y: float, heading: float,
    increment: float, range_max: float, owner: int, circles: Any, segments: Any, ranges: Any,
) -> None:  # fmt: skip
    """Write the range of each beam, m, into ``ranges``; infinite beyond ``range_max``.

    ``free`` has, for each cell of the map, the distance in cells that a beam can travel from anywhere in it, and less
    than -0.5 for an obstacle. ``row`` and ``column`` are the position of the sensor on the map, and ``turned`` is the
    heading of the map. ``heading`` is that of the first beam. See :class:`.ray_casting.Outlines` for the others. The
    sensor must not be in a body: see :func:`covers`.
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
            room = float(free[i, j])  # NumPy would add the steps of a beam as float32 and lose them
            if room < -0.5:
                ranges[beam] = travelled * resolution
                break
            if room < 1.0:  # the next cell may be farther away
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
        half = math.asin(radius / distance)
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
                if chord >= 0.0 and along > 0.0:
                    ranges[beam] = min(ranges[beam], along - math.sqrt(chord))
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
                    if length >= 0.0 and -1e-9 <= part <= 1.0 + 1e-9:  # no beam slips between two sides
                        ranges[beam] = min(ranges[beam], length)
    for beam in range(beams):
        if ranges[beam] > range_max:
            ranges[beam] = math.inf


@Loop
def covers(x: float, y: float, owner: int, circles: Any, segments: Any) -> bool:
    """Return whether a point is in a body or within 1e-6 m of its outline. The body ``owner`` is ignored.

    The function uses only products and sums, which are equal to the last bit whether compiled or not. Nearer to a
    corner, the direction of a side would be dominated by rounding.
    """
    for k in range(circles.shape[0]):
        dx, dy, reach = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2] + 1e-6
        if circles[k, 3] != owner and dx * dx + dy * dy <= reach * reach:
            return True
    count = segments.shape[0]
    inside = False
    for k in range(count):
        body = segments[k, 4]
        if body == owner:
            continue
        x0, y0, x1, y1 = segments[k, 0] - x, segments[k, 1] - y, segments[k, 2] - x, segments[k, 3] - y
        ux, uy = x1 - x0, y1 - y0
        nearest = min(1.0, max(0.0, -(x0 * ux + y0 * uy) / (ux * ux + uy * uy)))
        off_x, off_y = x0 + nearest * ux, y0 + nearest * uy
        if off_x * off_x + off_y * off_y <= 1e-12:
            return True
        if (y0 > 0.0) != (y1 > 0.0) and x0 - y0 / uy * ux > 0.0:
            inside = not inside
        if k + 1 == count or segments[k + 1, 4] != body:  # the last side of the body
            if inside:
                return True
            inside = False
    return False


@Loop
def nearest(obstacles: Any, known: Any, only_new: bool, row: float, column: float, reach: float) -> Any:
    """Return the distance, in cells, from a position to the nearest obstacle in a square, ``reach`` to each side;
    infinite without one. With ``only_new``, obstacles in ``known`` do not count."""
    height, width = obstacles.shape
    least = math.inf
    for a in range(max(0, math.floor(row - reach)), min(height, math.ceil(row + reach))):
        up = max(a - row, row - a - 1.0, 0.0)
        if up * up < least:
            for b in range(max(0, math.floor(column - reach)), min(width, math.ceil(column + reach))):
                if obstacles[a, b] and not (only_new and known[a, b]):
                    right = max(b - column, column - b - 1.0, 0.0)
                    least = min(least, up * up + right * right)
    return math.sqrt(least)


def polygon_gap_at_once(obstacles: Any, corners: Any) -> float:
    """Return the same as :func:`polygon_gap`, with operations on whole arrays."""
    left, bottom = numpy.maximum(numpy.floor(corners.min(axis=0)).astype(int) - 1, 0)
    right, top = numpy.maximum(numpy.ceil(corners.max(axis=0)).astype(int) + 1, 0)
    rows, columns = numpy.nonzero(obstacles[bottom:top, left:right])
    if not rows.size:
        return math.inf
    squares = numpy.stack([columns + left, rows + bottom], axis=1)[:, None, :].astype(float)
    starts, sides = corners[None], (numpy.roll(corners, -1, axis=0) - corners)[None]
    # The interval in which each side is between the edges of a square, by axis: they cross if both axes overlap.
    with numpy.errstate(divide='ignore', invalid='ignore'):
        into, out = (squares - starts) / sides, (squares + 1.0 - starts) / sides
    parallel = sides == 0.0
    beside = parallel & ((starts <= squares) | (starts >= squares + 1.0))
    first = numpy.where(parallel, 0.0, numpy.minimum(into, out)).max(axis=2)
    last = numpy.where(parallel, 1.0, numpy.maximum(into, out)).min(axis=2)
    crosses = (numpy.maximum(first, 0.0) < numpy.minimum(last, 1.0)) & ~beside.any(axis=2)
    crossed = int(crosses.any(axis=1).sum())
    if crossed:
        return -float(crossed)
    # Otherwise, the closest point is a corner of the side or of the square.
    nearest = ((starts - numpy.clip(starts, squares, squares + 1.0)) ** 2).sum(axis=2).min()
    for corner in ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)):
        points = squares + corner - starts
        part = numpy.clip((points * sides).sum(axis=2) / (sides * sides).sum(axis=2), 0.0, 1.0)
        nearest = min(nearest, ((points - part[:, :, None] * sides) ** 2).sum(axis=2).min())
    return math.sqrt(nearest)


@functools.partial(Loop, otherwise=polygon_gap_at_once)
def polygon_gap(obstacles: Any, corners: Any) -> float:
    """Return the distance, in cells, from the sides of a polygon to the nearest obstacle cell within a cell of its
    bounds.

    ``corners`` has rows of column and row. If sides cross obstacle cells, the result is the negative number of these;
    it is infinite if no obstacle is near.
    """
    height, width = obstacles.shape
    count = corners.shape[0]
    left, bottom, right, top = corners[0, 0], corners[0, 1], corners[0, 0], corners[0, 1]
    for k in range(count):
        left, right = min(left, corners[k, 0]), max(right, corners[k, 0])
        bottom, top = min(bottom, corners[k, 1]), max(top, corners[k, 1])
    nearest, crossed = math.inf, 0
    for i in range(max(0, int(math.floor(bottom)) - 1), min(height, int(math.ceil(top)) + 1)):  # noqa: RUF046
        for j in range(max(0, int(math.floor(left)) - 1), min(width, int(math.ceil(right)) + 1)):  # noqa: RUF046
            if not obstacles[i, j]:
                continue
            crosses = False
            for k in range(count):
                x, y = corners[k, 0], corners[k, 1]
                dx, dy = corners[(k + 1) % count, 0] - x, corners[(k + 1) % count, 1] - y
                # The interval in which the side is between the edges of the cell, on both axes.
                first, last = 0.0, 1.0
                if dx != 0.0:
                    first, last = (
                        max(first, min((j - x) / dx, (j + 1 - x) / dx)),
                        min(last, max((j - x) / dx, (j + 1 - x) / dx)),
                    )
                elif x <= j or x >= j + 1:
                    last = -1.0
                if dy != 0.0:
                    first, last = (
                        max(first, min((i - y) / dy, (i + 1 - y) / dy)),
                        min(last, max((i - y) / dy, (i + 1 - y) / dy)),
                    )
                elif y <= i or y >= i + 1:
                    last = -1.0
                crosses = crosses or first < last
                aside, up = max(j - x, x - 1.0 - j, 0.0), max(i - y, y - 1.0 - i, 0.0)
                nearest = min(nearest, aside * aside + up * up)
                for corner in range(4):
                    px, py = j + corner % 2 - x, i + corner // 2 - y
                    part = min(1.0, max(0.0, (px * dx + py * dy) / (dx * dx + dy * dy)))
                    nearest = min(nearest, (px - part * dx) ** 2 + (py - part * dy) ** 2)
            crossed += crosses
    return -float(crossed) if crossed else math.sqrt(nearest)
