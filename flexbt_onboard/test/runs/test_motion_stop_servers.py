# SPDX-License-Identifier: BSD-3-Clause
"""Servers that come, and goals that begin, while the executive holds the robot."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import Spin
from rclpy.action import CancelResponse

from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_onboard.runs import motion_stop
from flexbt_onboard.runs.motion_stop import MotionParameters, MotionStop
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.waiting import wait_until

AT_REST: Any = SimpleNamespace(latest=PoseStamped, problem=str)


class Bench:
    """A robot with a server that turns it, a client of the server, and the executive's way to stop it."""

    def __init__(self, robot: NodeRuntime, client: NodeRuntime, executive: NodeRuntime) -> None:
        self._robot = robot
        self._client = client
        self._executive = executive
        self.stop = executive.call(lambda: MotionStop(executive, ServiceLinks(executive), AT_REST, MotionParameters()))

    def serve(self) -> ScriptedActionServer:
        """Start the server, and wait until the executive knows it."""
        server = ScriptedActionServer(self._robot, Spin, 'spin')
        wait_until(lambda: self._executive.call(self.stop.servers) == ['spin'], 'the server')
        return server

    def hold(self) -> None:
        """Stop the robot."""
        self._executive.call(self.stop.hold)

    def turn(self) -> SentGoal:
        """Send a goal."""
        return SentGoal(ActionLinks(self._client).link(Spin, 'spin'), Spin.Goal())


@pytest.fixture
def bench() -> Iterator[Bench]:
    with (
        NodeRuntime.open('robot') as robot,
        NodeRuntime.open('client') as client,
        NodeRuntime.open('executive') as executive,
    ):
        yield Bench(robot, client, executive)


def test_a_goal_that_begins_while_the_robot_is_held_is_canceled_at_once(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion_stop, '_CANCEL_PERIODS', 1_000_000)  # after the first, no round cancels anything
    server = bench.serve()
    bench.hold()
    wait_until(lambda: bench._executive.call(lambda: not bench.stop._asked), 'the end of the first round')
    assert bench.turn().wait().status is GoalStatus.CANCELED
    assert server.cancels == 1


def test_a_goal_of_a_server_that_came_after_the_preparation_is_known_to_go_on(bench: Bench) -> None:
    bench._executive.call(bench.stop.prepare)
    server = bench.serve()
    server.on_cancel = lambda _goal: CancelResponse.REJECT
    bench.hold()
    goal = bench.turn()

    def going_on() -> list[str]:
        return [action for action, _ in bench._executive.call(lambda: bench.stop.going_on)]

    wait_until(lambda: going_on() == ['spin'], 'a goal that continues')
    server.end(0)
    goal.wait()
    wait_until(lambda: not going_on(), 'the end of the goal')
