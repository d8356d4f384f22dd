# SPDX-License-Identifier: BSD-3-Clause
"""What a request has to satisfy before anything is done about it: known names, and numbers that are numbers.

The middleware carries NaN and infinity like any other number; in a path, a pose or a speed they would make a robot
turn or drive for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flexbt_core.values import shown
from flexbt_sim.navigation_errors import NavigationError
from flexbt_sim.ros_messages import pose_of
from flexbt_sim.world import FARTHEST, Pose


def bounded(value: float, name: str, most: float) -> float:
    """``value`` as it is.

    Raises:
        NavigationError: INVALID_INPUT when it is NaN, or its size is more than ``most``.
    """
    if not abs(value) <= most:
        raise NavigationError('INVALID_INPUT', f'{name} is {value:g}; give a number within ±{most:g}')
    return float(value)


def finite_pose(message: Any, name: str, code: str) -> Pose:
    """The pose of a geometry_msgs/Pose.

    Raises:
        NavigationError: with ``code`` when it is no place: NaN, infinite, or beyond FARTHEST.
    """
    pose = pose_of(message)
    if not pose.is_place:
        raise NavigationError(
            code,
            f'{name} is no place: x {pose.x}, y {pose.y}, yaw {pose.yaw}; give finite numbers, of at most {FARTHEST:g}',
        )
    return pose


def check_frame(frame: str, map_frame: str, name: str) -> None:
    """Of the map, and of the robot's pose, by which all else goes. An empty frame counts as that of the map.

    Raises:
        NavigationError: TF_ERROR for any other frame.
    """
    if frame not in ('', map_frame):
        raise NavigationError(
            'TF_ERROR', f'{name} is in frame {shown(frame)}, from which no transform is known; give it in {map_frame!r}'
        )


def check_id(asked: str, known: Sequence[str], what: str, code: str) -> None:
    """An empty name means the only one there is. Raises NavigationError ``code`` for a name that is not known."""
    if asked and asked not in known:
        raise NavigationError(code, f'there is no {what} {shown(asked)}; known: {", ".join(known)}')
