# SPDX-License-Identifier: BSD-3-Clause
"""A stop stops, whatever does not answer: a server that confirms no cancel, or a state that does not return."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav2_msgs.action import FollowPath
from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_states import BtExecuteState
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.waiting import DEADLINE, wait_until

STOP = ExecutiveCommand.STOP
WAYS = {'done': 'ended', 'failed': 'ended', 'canceled': 'ended'}


class Blocking(EventState):
    """Does not return from a callback before ``go`` is set."""

    def __init__(self, callback: str, entered: threading.Event, go: threading.Event) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._callback = callback
        self._entered = entered
        self._go = go

    def on_enter(self, userdata: Any) -> None:
        self._block('on_enter')

    def execute(self, userdata: Any) -> None:
        self._block('execute')

    def _block(self, callback: str) -> None:
        if callback == self._callback:
            self._entered.set()
            assert self._go.wait(6 * DEADLINE)


class Robot:
    """The servers that drive a robot, and what they are told."""

    def __init__(self, runtime: NodeRuntime, stamped: bool = False) -> None:
        self.runtime = runtime
        self.trees = ScriptedActionServer(runtime, BtExecute, names.BT_EXECUTOR)
        self.motion = ScriptedActionServer(runtime, FollowPath, names.FOLLOW_PATH)
        self.speeds: list[float] = []
        message_type: Any = TwistStamped if stamped else Twist

        def hear(message: Any) -> None:
            self.speeds.append((message.twist if stamped else message).linear.x)

        runtime.call(lambda: runtime.node.create_subscription(message_type, names.CMD_VEL, hear, 10))
        self._poses = runtime.call(lambda: runtime.node.create_publisher(PoseStamped, names.POSE, 10))
        self._links = ActionLinks(runtime)

    def drive(self) -> None:
        """Send a goal to the motion server, as a tree would."""
        ActionCall(self._links.link(FollowPath, names.FOLLOW_PATH), FollowPath.Goal(), on_done=lambda _: None)
        wait_until(lambda: self.motion.goals, 'a goal of the motion server')

    def refuse_cancels(self, refuses: bool) -> None:
        """Whether the server of the trees does not confirm a cancel."""

        def reject(_handle: ServerGoalHandle) -> CancelResponse:
            return CancelResponse.REJECT

        self.trees.on_cancel = reject if refuses else None


@pytest.fixture
def robot() -> Iterator[Robot]:
    with NodeRuntime.open('robot') as runtime:
        yield Robot(runtime)


def beside(blocking: Callable[[], EventState]) -> Callable[[], OperatableStateMachine]:
    """Return a tree, and beside it a state that blocks once the tree runs."""

    def make() -> OperatableStateMachine:
        both = ConcurrencyContainer(outcomes=['ended'], conditions=[('ended', [('Drive', way)]) for way in WAYS])
        with both:
            OperatableStateMachine.add('Drive', BtExecuteState(), dict.fromkeys(WAYS, 'ended'))
            OperatableStateMachine.add('Other', blocking(), {'done': 'ended'})
        machine = OperatableStateMachine(outcomes=['ended'])
        with machine:
            OperatableStateMachine.add('Both', both, {'ended': 'ended'})
        return machine

    return make


def drive_alone() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['ended'])
    with machine:
        OperatableStateMachine.add('Drive', BtExecuteState(), WAYS)
    return machine


@pytest.mark.parametrize('stamped', [False, True])
def test_a_stop_whose_cancel_is_not_confirmed_stops_the_motion_and_waits(stamped: bool) -> None:
    with NodeRuntime.open('robot') as runtime:
        robot = Robot(runtime, stamped)
        parameters = ExecutiveParameters(peers=(), stamped_cmd_vel=stamped)
        bench = ExecutiveBench(behavior_of(drive_alone), parameters=parameters)
        try:
            bench.start('Test')
            wait_until(lambda: robot.trees.goals, 'the goal of the tree')
            robot.drive()
            robot.refuse_cancels(True)
            bench.send(STOP)
            wait_until(lambda: robot.motion.cancels and robot.speeds, 'the motion is stopped')
            assert not any(robot.speeds)
            text = '/Drive: goal of bt_executor not confirmed canceled for '
            bench.wait_for(lambda status: status.message.startswith(text), 'what has not stopped')
            bench.logged('not confirmed to have halted')
            assert bench.status.state == ExecutiveStatus.STOPPING
            robot.refuse_cancels(False)
            assert bench.wait_idle() == 'preempted'
            assert bench.status.message == 'stopped by operator tester'
        finally:
            robot.refuse_cancels(False)
            bench.close()


def test_a_stop_that_is_never_confirmed_ends_as_an_error_and_the_robot_is_kept_at_rest(robot: Robot) -> None:
    bench = ExecutiveBench(behavior_of(drive_alone), parameters=ExecutiveParameters(peers=(), stop_timeout=3.0))
    try:
        bench.start('Test')
        wait_until(lambda: robot.trees.goals, 'the goal of the tree')
        robot.refuse_cancels(True)
        bench.send(STOP)
        assert bench.wait_idle() == 'error'
        assert 'aborted 3 s after the stop, while /Drive: goal of bt_executor not confirmed canceled' in (
            bench.status.message
        )
        robot.drive()
        wait_until(lambda: robot.motion.cancels, 'the motion of a goal that came afterwards is stopped')
    finally:
        robot.refuse_cancels(False)
        bench.close()


@pytest.mark.parametrize('callback', ['on_enter', 'execute'])
def test_a_stop_cancels_goals_while_a_state_does_not_return(callback: str, robot: Robot) -> None:
    """And a second stop leaves the state behind; what it does later has no effect."""
    entered, go = threading.Event(), threading.Event()
    bench = ExecutiveBench(
        behavior_of(beside(lambda: Blocking(callback, entered, go))), behavior_of(drive_alone, 'Next')
    )
    try:
        bench.start('Test')
        assert entered.wait(DEADLINE)
        wait_until(lambda: robot.trees.goals, 'the goal of the tree')
        run_id = bench.run_id
        bench.send(STOP)
        wait_until(lambda: robot.trees.cancels, 'the cancel')
        wait_until(lambda: not robot.trees.running, 'the end of the goal')
        text = f'state /Both/Other has not returned from {callback}() for '
        bench.wait_for(lambda status: status.message.startswith(text), 'what has not stopped')
        assert bench.status.state == ExecutiveStatus.STOPPING

        def stop_again() -> bool:
            if bench.status.state == ExecutiveStatus.STOPPING:
                bench.result(bench.send(STOP))
            return bench.status.state == ExecutiveStatus.IDLE

        wait_until(stop_again, 'the end')
        assert bench.status.outcome == 'error'
        assert 'aborted by operator tester, while state /Both/Other has not returned from' in bench.status.message
        assert bench.logged('its thread is left behind').severity == ExecutiveLog.ERROR
        bench.start('Next')
        wait_until(lambda: len(robot.trees.goals) == 2, 'the goal of the next run')
        go.set()
        bench.logged(f'has returned from {callback}()')
        bench.wait_for_next_status()
        assert bench.status.state == ExecutiveStatus.RUNNING
        assert bench.run_id != run_id
        assert robot.trees.running == [1]
    finally:
        go.set()
        bench.close()
