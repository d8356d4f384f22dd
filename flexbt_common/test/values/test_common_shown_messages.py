# SPDX-License-Identifier: BSD-3-Clause
"""Messages in messages to people: small ones as rclpy writes them, of large ones no more than is shown."""

from __future__ import annotations

import tracemalloc
from typing import Any

import pytest
from geometry_msgs.msg import Point, Pose
from rcl_interfaces.srv import DescribeParameters
from sensor_msgs.msg import Image
from std_msgs.msg import String

from flexbt_core.values.text import short_repr


@pytest.mark.parametrize('message', [Point(x=1.0), String(data='a'), DescribeParameters.Request(names=['a', 'b'])])
def test_a_small_message_is_shown_as_rclpy_writes_it(message: Any) -> None:
    assert short_repr(message) == repr(message)


@pytest.mark.parametrize('message', [Image(data=bytes(10**7)), String(data='x' * 10**7), [Pose()] * 100_000])
def test_what_is_left_out_of_a_message_is_not_written(message: Any) -> None:
    tracemalloc.start()
    assert 'msg' in short_repr(message)
    assert tracemalloc.get_traced_memory()[1] < 10**5
    tracemalloc.stop()
