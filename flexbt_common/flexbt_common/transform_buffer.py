# SPDX-License-Identifier: BSD-3-Clause
"""Rigid transforms, and a buffer of the frames over the last seconds with the rules of tf2. Pure."""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from .errors import TransformError

Vector = tuple[float, float, float]
"""x, y, z, m."""

Quaternion = tuple[float, float, float, float]
"""x, y, z, w, of length 1."""


class Rigid(NamedTuple):
    """The pose of a frame in another: it maps the coordinates of a point in the former to those in the latter."""

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def planar(cls, x: float, y: float, yaw: float) -> Rigid:
        """Return a transform in the plane; m, m, rad."""
        return cls((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)))

    @classmethod
    def of(cls, translation: Vector, rotation: Quaternion) -> Rigid:
        """Return a transform from a quaternion of any length. All zeros, as in default messages, means no rotation."""
        return cls(translation, _unit(rotation)) if any(rotation) else cls(translation)

    def __matmul__(self, other: Rigid) -> Rigid:
        """Return the transform that applies ``other`` first, then this one."""
        return Rigid(self.apply(other.translation), _product(self.rotation, other.rotation))

    def inverse(self) -> Rigid:
        """Return the inverse transform."""
        x, y, z, w = self.rotation
        back = (-x, -y, -z, w)
        tx, ty, tz = _rotated(back, self.translation)
        return Rigid((-tx, -ty, -tz), back)

    def apply(self, point: Vector) -> Vector:
        """Return the point in the other frame."""
        rotated = _rotated(self.rotation, point)
        return (
            rotated[0] + self.translation[0],
            rotated[1] + self.translation[1],
            rotated[2] + self.translation[2],
        )

    def towards(self, other: Rigid, share: float) -> Rigid:
        """Return the interpolation to ``other`` at ``share``, 0 to 1: straight, with even rotation (slerp)."""
        here, there = self.translation, other.translation
        translation = (
            here[0] + share * (there[0] - here[0]),
            here[1] + share * (there[1] - here[1]),
            here[2] + share * (there[2] - here[2]),
        )
        return Rigid(translation, _slerp(self.rotation, other.rotation, share))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return _unit(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )
    )


def _unit(q: Quaternion) -> Quaternion:
    size = math.hypot(*q)  # not 0 even if the squares underflow
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size)


def _rotated(q: Quaternion, v: Vector) -> Vector:
    x, y, z, w = q
    # Two cross products with the axis need fewer multiplications than a matrix.
    tx, ty, tz = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


def _slerp(a: Quaternion, b: Quaternion, share: float) -> Quaternion:
    cosine = sum(p * q for p, q in zip(a, b, strict=True))
    sign = math.copysign(1.0, cosine)  # of the two quaternions of a rotation, the nearer one
    angle = math.acos(min(1.0, abs(cosine)))
    if angle < 1e-6:
        of_a, of_b = 1.0 - share, sign * share
    else:
        of_a = math.sin((1.0 - share) * angle) / math.sin(angle)
        of_b = sign * math.sin(share * angle) / math.sin(angle)
    return _unit(
        (
            of_a * a[0] + of_b * b[0],
            of_a * a[1] + of_b * b[1],
            of_a * a[2] + of_b * b[2],
            of_a * a[3] + of_b * b[3],
        )
    )


# The tree of frames over the last seconds, with the rules of tf2 (https://docs.ros.org/en/jazzy/p/tf2/). Pure.
#
# Each frame has one parent. The transforms of a frame are kept for :data:`HISTORY`. Between two of them the buffer
# interpolates; outside of them the transform is unknown.

HISTORY: Final = 10.0
"""Time for which transforms are kept, s, as in tf2."""

MOST_FRAMES: Final = 2_000
"""Maximum number of frames; a broadcaster that makes up names must not fill the memory."""

MOST_SAMPLES: Final = 4_000
"""Maximum number of kept transforms of a frame."""

UNIT_TOLERANCE: Final = 0.01
"""Maximum deviation of the squared length of a quaternion from 1, as in tf2."""


class _Track:
    """The transforms of a frame to its parent, by time."""

    def __init__(self, parent: str, is_static: bool) -> None:
        self.parent = parent
        self.is_static = is_static
        self.times: list[float] = []
        self.transforms: list[Rigid] = []

    def add(self, time: float, transform: Rigid) -> None:
        if self.is_static:
            self.times, self.transforms = [-math.inf], [transform]
            return
        if self.times and time < self.times[-1] - HISTORY:
            return
        place = bisect.bisect_left(self.times, time)
        if place < len(self.times) and self.times[place] == time:
            self.transforms[place] = transform
            return
        self.times.insert(place, time)
        self.transforms.insert(place, transform)
        old = bisect.bisect_left(self.times, self.times[-1] - HISTORY)
        old = max(old, len(self.times) - MOST_SAMPLES)
        if old > 0:
            del self.times[:old], self.transforms[:old]

    def at(self, time: float, frame: str) -> Rigid:
        if self.is_static:
            return self.transforms[0]
        first, last = self.times[0], self.times[-1]
        if not first <= time <= last:
            where = 'past' if time < first else 'future'
            raise TransformError(
                f'the transform of {frame!r} to {self.parent!r} at {time:.3f} s is in the {where} of what is known, '
                f'{first:.3f} to {last:.3f} s',
                is_early=time > last,
            )
        place = bisect.bisect_left(self.times, time)
        if self.times[place] == time:
            return self.transforms[place]
        before, after = self.times[place - 1], self.times[place]
        share = (time - before) / (after - before)
        return self.transforms[place - 1].towards(self.transforms[place], share)


class TransformBuffer:
    """The known transforms between frames. Times are in s."""

    def __init__(self) -> None:
        self._tracks: dict[str, _Track] = {}

    def clear(self) -> None:
        """Drop all transforms except static ones. Call this when time jumps back, since later transforms are wrong."""
        self._tracks = {frame: track for frame, track in self._tracks.items() if track.is_static}

    def set(self, parent: str, frame: str, transform: Rigid, time: float = 0.0, *, is_static: bool = False) -> None:
        """Add the transform of ``frame`` in ``parent`` at a time; a static transform holds at every time.

        Raises:
            TransformError: the frames or the numbers are invalid, or the number of frames exceeds the limit.
        """
        for name in (parent, frame):
            _check_frame(name)
        if parent == frame:
            raise TransformError(f'frame {frame!r} is said to be its own parent')
        numbers = (*transform.translation, *transform.rotation, time)
        length = sum(part * part for part in transform.rotation)
        if not all(map(math.isfinite, numbers)) or abs(length - 1.0) > UNIT_TOLERANCE:
            raise TransformError(
                f'the transform of {frame!r} to {parent!r} has numbers that are none, or a quaternion that is not of '
                f'length 1: {transform}'
            )
        track = self._tracks.get(frame)
        if track is None and len(self._tracks) >= MOST_FRAMES:
            raise TransformError(f'there are {MOST_FRAMES} frames already: {frame!r} is not taken')
        if track is None or (track.parent, track.is_static) != (parent, is_static):
            track = self._tracks[frame] = _Track(parent, is_static)
        track.add(time, Rigid.of(*transform))

    @property
    def frames(self) -> tuple[str, ...]:
        """Return all known frames, sorted."""
        return tuple(sorted({*self._tracks, *(track.parent for track in self._tracks.values())}))

    def lookup(self, target: str, source: str, time: float | None = None) -> Rigid:
        """Return the transform of frame ``source`` in frame ``target`` at a time; None for the latest known time.

        Raises:
            TransformError: it is unknown; with ``is_early`` it may be known in a moment.
        """
        up, down = self._way(target, source)
        if time is None:
            time = self._latest(up, down)
        return self._climb(down, time).inverse() @ self._climb(up, time)

    def latest(self, target: str, source: str) -> float:
        """Return the latest time at which the transform between two frames is known, s; infinite if it is static.

        Raises:
            TransformError: as :meth:`lookup`.
        """
        return self._latest(*self._way(target, source))

    def carries(self, carrier: str, frame: str) -> bool:
        """Return whether ``frame`` is below ``carrier``, so that it moves with it."""
        return carrier in self._ancestors(frame)

    def _latest(self, up: list[str], down: list[str]) -> float:
        ends = [self._tracks[frame].times[-1] for frame in (*up, *down) if not self._tracks[frame].is_static]
        return min(ends, default=math.inf)

    def _way(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """Return the frames from each of the two up to their common ancestor, which is left out.

        Where ancestors form a ring, one of the two has to be an ancestor of the other: else the way is ambiguous, and
        refused, as by tf2.
        """
        for name in (target, source):
            _check_frame(name)
        ups, downs = list(self._ancestors(source)), list(self._ancestors(target))
        if target in ups:
            return ups[: ups.index(target)], []
        if source in downs:
            return [], downs[: downs.index(source)]
        for frames in (ups, downs):
            if frames[-1] in self._tracks:
                ring = frames[frames.index(self._tracks[frames[-1]].parent) :]
                shown = ', '.join(map(repr, ring))
                raise TransformError(f'the frames {shown} form a ring; end one of their broadcasters', is_early=True)
        meeting = next(filter(set(downs).__contains__, ups), None)
        if meeting is None:
            raise TransformError(self._why_apart(target, source), is_early=True)
        return ups[: ups.index(meeting)], downs[: downs.index(meeting)]

    def _climb(self, frames: list[str], time: float) -> Rigid:
        whole = Rigid()
        for frame in frames:
            whole = self._tracks[frame].at(time, frame) @ whole
        return whole

    def _ancestors(self, frame: str) -> Iterator[str]:
        """Yield the frame, its parent, and so on; stop at a cycle."""
        seen: set[str] = set()
        while frame not in seen:
            seen.add(frame)
            yield frame
            if frame not in self._tracks:
                return
            frame = self._tracks[frame].parent

    def _why_apart(self, target: str, source: str) -> str:
        known = self.frames
        for frame in (source, target):
            if frame not in known:
                return f'frame {frame!r} is not known; known: {", ".join(known) or "none"}'
        return f'frames {target!r} and {source!r} are not connected'


def _check_frame(name: str) -> None:
    if not name or name.startswith('/'):
        raise TransformError(f'{name!r} is not a frame name: give one that is not empty and has no slash in front')
