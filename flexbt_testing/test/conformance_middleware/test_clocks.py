# SPDX-License-Identifier: BSD-3-Clause
"""ROS time that is set, and jumps: what timers and callbacks do."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.clock import JumpThreshold, ROSClock
from rclpy.duration import Duration
from rclpy.time import Time

SECOND = 10**9


def set_to(clock: Any, seconds: float) -> None:
    clock.set_ros_time_override(Time(nanoseconds=round(seconds * SECOND), clock_type=clock.clock_type))


def clock_at(seconds: float) -> Any:
    clock = ROSClock()
    clock._set_ros_time_is_active(True)
    set_to(clock, seconds)
    return clock


def test_a_timer_follows_jumps(ros: Any) -> None:
    clock = clock_at(10.0)
    timer = ros.node('timers', spins=False).create_timer(1.0, lambda: None, clock=clock)

    def rest_at(seconds: float) -> float:
        set_to(clock, seconds)
        return round(timer.time_until_next_call() / SECOND, 6)

    assert rest_at(10.4) == 0.6
    assert rest_at(9.9) == 1.0, 'before its last call, or its start, it begins anew'
    assert timer.time_since_last_call() == 0
    assert rest_at(10.3) == 0.6
    assert rest_at(10.0) == 0.9, 'a smaller jump back changes nothing'
    assert not timer.is_ready()
    assert rest_at(13.0) == -2.1
    assert timer.is_ready()
    timer.handle.call_timer()
    assert rest_at(13.0) == 0.9, 'calls that were missed are left out'
    timer.cancel()
    set_to(clock, 2.0)
    timer.reset()
    assert rest_at(2.0) == 1.0


def test_a_negative_period_is_refused(ros: Any) -> None:
    with pytest.raises(RuntimeError, match='timer period must be non-negative'):
        ros.node('timers', spins=False).create_timer(-1.0, lambda: None)


def test_a_timer_that_is_called_late_keeps_its_beat(ros: Any) -> None:
    clock = clock_at(10.0)
    timer = ros.node('timers', spins=False).create_timer(1.0, lambda: None, clock=clock)
    for late, rest in ((11.0, 1.0), (13.0, 1.0), (13.0, 2.0), (16.0, 1.0), (17.5, 0.5), (30.0, 1.0)):
        set_to(clock, late)
        timer.handle.call_timer()
        assert timer.time_until_next_call() == rest * SECOND, late


def test_a_timer_waits_on_when_the_source_of_time_changes(ros: Any) -> None:
    clock = clock_at(10.0)
    timer = ros.node('timers', spins=False).create_timer(1000.0, lambda: None, clock=clock)
    set_to(clock, 300.0)
    clock._set_ros_time_is_active(False)
    assert 0 <= 290 * SECOND - timer.time_until_next_call() < 100 * SECOND
    assert timer.time_since_last_call() >= 710 * SECOND


def test_jumps_are_told_with_their_size(ros: Any) -> None:
    clock = clock_at(10.0)
    told: list[Any] = []
    threshold = JumpThreshold(min_forward=Duration(seconds=2), min_backward=Duration(seconds=-3), on_clock_change=True)
    handle = clock.create_jump_callback(
        threshold,
        pre_callback=lambda: told.append('before'),
        post_callback=lambda jump: told.append((jump.clock_change.name, jump.delta.nanoseconds / SECOND)),
    )
    for seconds in (11.0, 13.0, 11.0, 8.0):
        set_to(clock, seconds)
    clock._set_ros_time_is_active(False)
    clock._set_ros_time_is_active(True)
    clock._set_ros_time_is_active(True)
    handle.unregister()
    set_to(clock, 100.0)
    assert [one for one in told if one != 'before'] == [
        ('ROS_TIME_NO_CHANGE', 2.0),
        ('ROS_TIME_NO_CHANGE', -3.0),
        ('ROS_TIME_DEACTIVATED', 0.0),
        ('ROS_TIME_ACTIVATED', 0.0),
    ]
    assert told[::2] == ['before'] * 4
