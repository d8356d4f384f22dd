# SPDX-License-Identifier: BSD-3-Clause
"""What a request has to satisfy before anything is done about it: known frames, and numbers that are numbers.

The middleware carries NaN and infinity like any other number; in a path, a pose or a speed they would make a robot
turn or drive for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flexbt_common.values import shown
from flexbt_sim.errors import NavigationError
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
    """An empty frame counts as that of the map.

    Raises:
        NavigationError: TF_ERROR for any other frame.
    """
    if frame not in ('', map_frame):
        raise NavigationError(
            'TF_ERROR', f'{name} is in frame {shown(frame)}, from which no transform is known; give it in {map_frame!r}'
        )


def pose_in_map(stamped: Any, map_frame: str, name: str, code: str) -> Pose:
    """The pose of a geometry_msgs/PoseStamped. Raises NavigationError TF_ERROR, or ``code`` as :func:`finite_pose`."""
    check_frame(stamped.header.frame_id, map_frame, name)
    return finite_pose(stamped.pose, name, code)


def path_in_map(path: Any, map_frame: str) -> list[Pose]:
    """The poses of a nav_msgs/Path, whose own header counts. Raises NavigationError TF_ERROR or INVALID_PATH."""
    check_frame(path.header.frame_id, map_frame, 'the path')
    return [
        finite_pose(stamped.pose, f'pose {index} of the path', 'INVALID_PATH')
        for index, stamped in enumerate(path.poses)
    ]


def check_id(asked: str, known: Sequence[str], what: str, code: str) -> None:
    """An empty name means the only one there is. Raises NavigationError ``code`` for a name that is not known."""
    if asked and asked not in known:
        raise NavigationError(code, f'there is no {what} {shown(asked)}; known: {", ".join(known)}')
