# SPDX-License-Identifier: BSD-3-Clause
"""Rigid transforms in space: a rotation, then a translation."""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]
"""x, y, z, m."""

Quaternion = tuple[float, float, float, float]
"""x, y, z, w, of length 1."""


class Rigid(NamedTuple):
    """Where a frame is in another: takes the coordinates of a point in the former to those in the latter."""

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    @classmethod
    def planar(cls, x: float, y: float, yaw: float) -> Rigid:
        """In the plane: m, m, rad."""
        return cls((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0)))

    @classmethod
    def of(cls, translation: Vector, rotation: Quaternion) -> Rigid:
        """With a quaternion of any length; of all zeros, as in messages not filled in, it is no turn."""
        return cls(translation, _unit(rotation)) if any(rotation) else cls(translation)

    def __matmul__(self, other: Rigid) -> Rigid:
        """First ``other``, then this one."""
        return Rigid(self.apply(other.translation), _product(self.rotation, other.rotation))

    def inverse(self) -> Rigid:
        """The way back."""
        x, y, z, w = self.rotation
        back = (-x, -y, -z, w)
        tx, ty, tz = _rotated(back, self.translation)
        return Rigid((-tx, -ty, -tz), back)

    def apply(self, point: Vector) -> Vector:
        """The point in the other frame."""
        rotated = _rotated(self.rotation, point)
        return (
            rotated[0] + self.translation[0],
            rotated[1] + self.translation[1],
            rotated[2] + self.translation[2],
        )

    def towards(self, other: Rigid, share: float) -> Rigid:
        """A part of the way to ``other``, 0 to 1: straight, and turning evenly about one axis (slerp)."""
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
    size = math.hypot(*q)  # which is not 0 where the squares are
    return (q[0] / size, q[1] / size, q[2] / size, q[3] / size)


def _rotated(q: Quaternion, v: Vector) -> Vector:
    x, y, z, w = q
    # Twice the cross product with the axis, and that once more: fewer products than with a matrix.
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
