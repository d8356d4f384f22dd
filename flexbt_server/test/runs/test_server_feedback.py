# SPDX-License-Identifier: BSD-3-Clause
"""Feedback of a run: whatever trees have written on the blackboard, there is a message, and so there is a next one."""

from __future__ import annotations

import math
from typing import Any

from geometry_msgs.msg import PoseStamped
from hypothesis import example, given
from hypothesis import strategies as st
from nav_msgs.msg import Path
from rclpy.serialization import serialize_message

from flexbt_common.values.message_fields import duration_message
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_server.actions.progress import distance_left, recoveries, seconds_left

NUMBERS = st.one_of(st.integers(-(2**63), 2**63 - 1), st.floats(), st.booleans(), st.text())


def pose(x: float, y: float) -> PoseStamped:
    stamped = PoseStamped()
    stamped.header.frame_id = 'map'
    stamped.pose.position.x, stamped.pose.position.y = x, y
    return stamped


@given(NUMBERS)
@example(math.inf)
@example(1e9)
def test_recoveries_are_a_count_whatever_is_there(value: Any) -> None:
    board = Blackboard()
    assert recoveries(board) == 0
    board.set('number_recoveries', value)
    assert 0 <= recoveries(board) < 2**15
    if type(value) is int and 0 <= value < 2**15:
        assert recoveries(board) == value


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=4), st.floats())
@example([(0.0, 0.0), (1e300, 0.0)], 0.02)
@example([(0.0, 0.0), (math.inf, 0.0)], 0.02)
def test_the_time_that_is_left_can_be_told(places: list[tuple[float, float]], speed: float) -> None:
    distance = distance_left(Path(poses=[pose(*place) for place in places]), pose(0.0, 0.0))
    serialize_message(duration_message(seconds_left(distance, speed)))
