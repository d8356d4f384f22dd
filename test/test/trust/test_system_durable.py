# SPDX-License-Identifier: BSD-3-Clause
"""kill -9 of the executive while the robot drives: it comes to rest, and drives on when an operator wants it to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack

PLACE = (4.0, 4.45)

SPEED = 2.0
"""Seconds of the robot's clock in a second of wall time."""

REST_AFTER_DEATH = 1.0
"""Seconds from the death of the executive to the robot's last movement."""

NEAR = 0.5


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Stack]:
    with Stack(tmp_path) as stack:
        stack.start('simulator', {'speed_factor': str(SPEED)})
        for name in ('navigation', 'bt_server', 'stop_guard'):
            stack.start(name)
        stack.start('onboard_executive', {'journal_directory': str(tmp_path)})
        yield stack


def test_a_robot_stops_when_its_executive_dies_and_drives_on_when_the_run_goes_on(stack: Stack) -> None:
    with NodeRuntime.open('probe') as runtime:
        probe = Probe(runtime)
        probe.wait_ready()
        probe.drive_to(*PLACE)
        before = probe.status
        killed = stack.kill('onboard_executive')
        probe.wait_at_rest(1.5 * SPEED)
        rested = probe.moved_stamp
        assert probe.moved_at - killed < REST_AFTER_DEATH
        stack.start('onboard_executive', {'journal_directory': str(stack.directory)})
        probe.wait_state(ExecutiveStatus.INTERRUPTED)
        assert (probe.status.run_id, probe.status.behavior) == (before.run_id, 'Navigate')
        assert [one.path for one in probe.status.active_states] == [one.path for one in before.active_states]
        assert probe.moved_stamp == rested  # nothing moves before an operator says so
        probe.wait_ready()
        probe.applied(ExecutiveCommand.RESUME_RUN)
        probe.wait_state(ExecutiveStatus.RUNNING)
        probe.wait(lambda: near(probe, *PLACE), 'robot at its goal')  # which is in the userdata


def near(probe: Probe, x: float, y: float) -> bool:
    """Return whether the robot is at a place."""
    if probe.pose is None:
        return False
    position = probe.pose.pose.position
    return abs(position.x - x) < NEAR and abs(position.y - y) < NEAR
