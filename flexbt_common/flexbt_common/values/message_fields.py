# SPDX-License-Identifier: BSD-3-Clause
"""Times, poses and options in messages: conversions, and the fields that differ between Nav2's branches."""

from __future__ import annotations

import copy
import math
import struct
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, Final

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import PoseStamped, Quaternion

from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.msg import QueueOptions as QueueOptionsMessage

from .queue_options import OnFailure, QueueOptions

_SECOND = 1_000_000_000
_MOST_SECONDS: Final = 2.0**31 - 0.5  # half a second for rounding


def seconds_of(message: Any) -> float:
    """Return a Time or Duration, s."""
    return float(message.sec) + float(message.nanosec) * 1e-9


def time_message(seconds: float) -> Time:
    """Return a point of time, s."""
    return time_of_nanoseconds(round(seconds * 1e9))


def time_of_nanoseconds(nanoseconds: int) -> Time:
    """Return a point of time, ns."""
    whole, rest = divmod(nanoseconds, _SECOND)
    return Time(sec=whole, nanosec=rest)


def duration_message(seconds: float) -> Duration:
    """Return a length of time, s.

    Raises:
        ValueError: it is no number, or more seconds than a Duration counts.
    """
    if not abs(seconds) < _MOST_SECONDS:
        raise ValueError(f'{seconds:g} s are no length of time for a message, which has less than {_MOST_SECONDS:g} s')
    whole, rest = divmod(round(seconds * 1e9), _SECOND)
    return Duration(sec=whole, nanosec=rest)


def options_message(options: QueueOptions) -> QueueOptionsMessage:
    """Return the message of the options of an entry of the mission queue."""
    values = {one.name: getattr(options, one.name) for one in fields(options)}
    texts = {name: sanitize_for_message(value) for name, value in values.items() if isinstance(value, str)}
    wanted = list(map(sanitize_for_message, options.wanted))
    more = {'not_before': time_message(options.not_before), 'on_failure': int(options.on_failure), 'wanted': wanted}
    return QueueOptionsMessage(**{**values, **texts, **more})


def options_of(message: QueueOptionsMessage) -> QueueOptions:
    """Return the options of a message. A constant of ``on_failure`` that is not known here is UNKNOWN."""
    values = {one.name: getattr(message, one.name) for one in fields(QueueOptions)}
    more = {'not_before': seconds_of(message.not_before), 'wanted': tuple(message.wanted)}
    known = message.on_failure if message.on_failure in set(OnFailure) else 0
    battery = -1.0 if message.battery < 0.0 else message.battery
    return QueueOptions(**{**values, **more, 'on_failure': OnFailure(known), 'battery': battery})


# Poses: the fields that have them (lists in the interfaces of Nav2's branch jazzy, nav_msgs/Goals in those of main),
# and long paths for a person to see, by fewer poses.

_LENGTH: Final = struct.Struct('<I')
_POINT: Final = struct.Struct('<2d')


def yaw_of_quaternion(q: Quaternion) -> float:
    """Return the direction of an orientation in the plane, rad; 0 for all zeros. It need not be normalized."""
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)


def poses_of(field: Any) -> list[PoseStamped]:
    """Return the poses in a field with poses."""
    return list(getattr(field, 'goals', field))


def set_poses(message: Any, field: str, poses: Sequence[PoseStamped]) -> None:
    """Set a field with poses."""
    there = getattr(message, field)
    if hasattr(there, 'goals'):
        there.goals = list(poses)
    else:
        setattr(message, field, list(poses))


def fewer_poses(value: Any, most: int) -> Any:
    """Return a path, or a list of poses, with every n-th of its poses and the last one, ``most`` of them at most.

    One that has no more is returned itself; the value is never changed.
    """
    poses = getattr(value, 'poses', value)
    if len(poses) <= most:
        return value
    step = -(-(len(poses) - 1) // (most - 1))
    kept = [*poses[:-1:step], poses[-1]]
    if poses is value:
        return kept
    path = copy.copy(value)
    path.poses = kept
    return path


def path_points(data: bytes, most: int) -> tuple[str, list[tuple[float, float]]]:
    """Return the frame of a serialized nav_msgs/Path, and the points of every n-th of its poses and the last one, m.

    Unpacking a path creates an object for each pose, which takes a second for 10,000 poses; this takes 10 ms.

    Raises:
        ValueError: these bytes are not a Path in little-endian CDR.
    """
    try:
        if data[:2] != b'\0\1':
            raise ValueError(f'no CDR in little-endian order: it begins with {data[:4].hex()}')
        body = memoryview(data)[4:]
        (length,) = _LENGTH.unpack_from(body, 8)
        frame = bytes(body[12 : 12 + length]).rstrip(b'\0').decode(errors='replace')
        at = (12 + length + 3) & -4
        (count,) = _LENGTH.unpack_from(body, at)
        at += 4
        places = []
        for _ in range(count):  # stamp, frame, and seven numbers; each at a multiple of its size
            at = (at + 3) & -4
            at = (at + 12 + _LENGTH.unpack_from(body, at + 8)[0] + 7) & -8
            places.append(at)
            at += 56
        if places and at > len(body):
            raise ValueError('the data ends inside a pose')
        step = 1 if count <= most else -(-(count - 1) // (most - 1))
        kept = [*places[:-1:step], *places[-1:]]
        return frame, [_POINT.unpack_from(body, place) for place in kept]
    except struct.error:
        raise ValueError('the data ends inside a path') from None
