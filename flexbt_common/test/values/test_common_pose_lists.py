# SPDX-License-Identifier: BSD-3-Clause
"""Poses in a goal of Nav2's branch jazzy, and in one of main."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses
from nav_msgs.msg import Goals

from flexbt_common.values import poses_of, set_poses


@pytest.mark.parametrize('message', [NavigateThroughPoses.Goal(), SimpleNamespace(poses=Goals())])
def test_poses_are_read_as_they_were_given(message: Any) -> None:
    assert poses_of(message.poses) == []
    poses = [PoseStamped(), PoseStamped()]
    poses[1].pose.position.x = 1.0
    set_poses(message, 'poses', tuple(poses))
    assert poses_of(message.poses) == poses
