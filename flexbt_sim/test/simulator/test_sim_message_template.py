# SPDX-License-Identifier: BSD-3-Clause
"""Messages kept as bytes: what is read from them is what was written, whatever the numbers and the texts."""

from __future__ import annotations

import math
from typing import Any

import numpy
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from flexbt_sim.simulator.message_template import MessageTemplate, stamp_fields

numbers = st.floats(allow_nan=False, width=64)
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1))


@given(stamps, numbers, numbers, st.text(max_size=30).filter(lambda text: '\0' not in text))
def test_a_pose_is_read_as_it_was_written(stamp: tuple[int, int], x: float, w: float, frame: str) -> None:
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.y = 3.5
    template = MessageTemplate(
        message, *stamp_fields('header.stamp'), ('d', 'pose.position.x'), ('d', 'pose.orientation.w')
    )
    for _ in range(2):
        read = deserialize_message(template.filled(*stamp, x, w), PoseStamped)
        assert read.header.stamp == Time(sec=stamp[0], nanosec=stamp[1]) and read.header.frame_id == frame
        assert (read.pose.position.x, read.pose.position.y, read.pose.orientation.w) == (x, 3.5, w)


@pytest.mark.parametrize('beams', [1, 7, 360])
def test_a_scan_has_its_ranges(beams: int) -> None:
    scan = LaserScan(ranges=[0.0] * beams, range_max=3.5)
    scan.header.frame_id = 'base_scan'
    template = MessageTemplate(scan, *stamp_fields('header.stamp'), array='ranges')
    ranges = numpy.linspace(0.1, 9.9, beams).astype(numpy.float32)
    ranges[0] = math.inf
    template.fill_array(ranges)
    read = deserialize_message(template.filled(5, 6), LaserScan)
    assert list(read.ranges) == list(ranges)
    assert (read.header.stamp.sec, read.header.frame_id, read.range_max) == (5, 'base_scan', 3.5)


def test_elements_of_lists_are_told_apart() -> None:
    message = TFMessage(transforms=[TransformStamped(child_frame_id=name) for name in ('odom', 'base_link')])
    paths = [f'transforms.{index}.transform.translation.{axis}' for index in (0, 1) for axis in 'xy']
    read = deserialize_message(MessageTemplate(message, *(('d', path) for path in paths)).filled(1, 2, 3, 4), TFMessage)
    places: list[Any] = [one.transform.translation for one in read.transforms]
    assert [(place.x, place.y) for place in places] == [(1.0, 2.0), (3.0, 4.0)]


def test_a_field_that_is_none_is_an_error() -> None:
    with pytest.raises(AttributeError):
        MessageTemplate(Odometry(), ('d', 'pose.pose.position.q'))
