# SPDX-License-Identifier: BSD-3-Clause
"""Poses in a goal of Nav2's branch jazzy, and in one of main; paths by fewer poses, and by their points."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from hypothesis import strategies as st
from nav2_msgs.action import NavigateThroughPoses
from nav_msgs.msg import Goals, Path
from rclpy.serialization import serialize_message

from flexbt_common.values.message_fields import fewer_poses, path_points, poses_of, set_poses


@pytest.mark.parametrize('message', [NavigateThroughPoses.Goal(), SimpleNamespace(poses=Goals())])
def test_poses_are_read_as_they_were_given(message: Any) -> None:
    assert poses_of(message.poses) == []
    poses = [PoseStamped(), PoseStamped()]
    poses[1].pose.position.x = 1.0
    set_poses(message, 'poses', tuple(poses))
    assert poses_of(message.poses) == poses


def path_of(frames: Sequence[str], frame: str = 'map') -> Path:
    """Return a path with a pose in each of the frames."""
    path = Path()
    path.header.frame_id = frame
    for number, name in enumerate(frames):
        pose = PoseStamped()
        pose.header.frame_id = name
        pose.header.stamp.sec, pose.pose.position.x, pose.pose.position.y = number, number * 0.1, -float(number)
        path.poses.append(pose)
    return path


@given(st.lists(st.text(max_size=9)), st.text(max_size=9), st.integers(2, 20))
def test_the_points_of_a_path_are_read_from_its_bytes(frames: list[str], frame: str, most: int) -> None:
    path = path_of([name.replace('\0', '') for name in frames], frame.replace('\0', ''))
    known = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
    data = serialize_message(path)
    assert path_points(data, len(known) + 2) == (path.header.frame_id, known)
    _, fewer = path_points(data, most)
    kept = [(pose.pose.position.x, pose.pose.position.y) for pose in fewer_poses(path, most).poses]
    assert fewer == kept and len(kept) <= most
    assert not known or (kept[0], kept[-1]) == (known[0], known[-1])
    assert fewer_poses(path.poses, most) == fewer_poses(path, most).poses


@given(st.data())
def test_bytes_that_are_no_path_are_refused(data: st.DataObject) -> None:
    whole = bytearray(serialize_message(path_of(['map'] * 4)))
    end = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(ValueError, match=r'CDR|ends inside'):
        path_points(bytes(whole[:end]), 10)
    for place, value in data.draw(st.dictionaries(st.integers(0, len(whole) - 1), st.integers(0, 255))).items():
        whole[place] = value
    with suppress(ValueError):
        path_points(bytes(whole), 10)
