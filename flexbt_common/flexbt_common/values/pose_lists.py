# SPDX-License-Identifier: BSD-3-Clause
"""Fields with poses: lists of them in the interfaces of Nav2's branch jazzy, nav_msgs/Goals in those of main."""

from __future__ import annotations

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
