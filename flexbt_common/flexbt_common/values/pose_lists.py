# SPDX-License-Identifier: BSD-3-Clause
"""Fields with poses: lists of them in the interfaces of Nav2's branch jazzy, nav_msgs/Goals in those of main."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import PoseStamped


def poses_of(field: Any) -> list[PoseStamped]:
    """What is in such a field."""
    return list(getattr(field, 'goals', field))


def set_poses(message: Any, field: str, poses: Sequence[PoseStamped]) -> None:
    """Give such a field the poses."""
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
