# SPDX-License-Identifier: BSD-3-Clause
"""The executive's own way to stop the robot: which servers it asks, and for how long it commands zero velocity."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from action_msgs.msg import GoalStatus as GoalStatusMessage
from action_msgs.msg import GoalStatusArray
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import PoseStamped, Quaternion, Twist, TwistStamped
from nav2_msgs.action import DockRobot, NavigateToPose, Spin
from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalOutcome, GoalStatus
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.middleware.received_messages import guid_prefix_of
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_onboard.runs import motion_stop, stop_enforcer
from flexbt_onboard.runs.motion_stop import MotionParameters, MotionStop
from flexbt_onboard.runs.stop_enforcer import StopEnforcer
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.nodes.scripted_action_server import ScriptedActionServer
from flexbt_testing.waiting import DEADLINE, wait_until

FRONT = 'navigate_to_pose'


class Robot:
    """Two servers that only take cancels, and a robot that hears its commands."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.asked: list[str] = []
        self.front_answers = Future()
        self.front_answers.set_result(None)
        self.commands: list[Twist] = []
        runtime.call(self._open)

    def _open(self) -> None:
        node = self.runtime.node
        node.create_subscription(Twist, names.CMD_VEL, self.commands.append, 10)
        for action in ('follow_path', FRONT, 'drill'):
            service, group = f'{action}/_action/cancel_goal', ReentrantCallbackGroup()
            node.create_service(CancelGoal, service, self._answer(action), callback_group=group)

    def _answer(self, action: str) -> Callable[[Any, Any], Any]:
        async def answer(request: Any, response: Any) -> Any:
            assert not any(request.goal_info.goal_id.uuid)
            assert request.goal_info.stamp.sec == request.goal_info.stamp.nanosec == 0
            self.asked.append(action)
            if action == FRONT:
                await self.front_answers
            return response

        return answer


@pytest.fixture
def robot() -> Iterator[Robot]:
    with NodeRuntime.open('robot') as runtime:
        yield Robot(runtime)


def publisher_of(runtime: NodeRuntime, topic: str, name: str) -> bytes:
    """Return the one of the node ``name``."""
    (found,) = (end for end in runtime.node.get_publishers_info_by_topic(topic) if end.node_name == name)
    return bytes(found.endpoint_gid)


def pose_of(pose: PoseStamped, problem: str = '') -> Any:
    """Return the source of a pose: a new message each time."""
    return SimpleNamespace(latest=lambda: copy.deepcopy(pose), problem=lambda: problem)


AT_REST: Any = pose_of(PoseStamped())


def reporter(tell: Callable[[str], object]) -> Any:
    """Return a reporter that gives the text of each line to ``tell``."""
    return SimpleNamespace(log=lambda severity, text: tell(text))


def silence(robot: Robot, steady_seconds: float = 0.4) -> None:
    """Wait until nothing has been commanded for a while."""
    clock = robot.runtime.steady
    seen, since = len(robot.commands), clock.now()

    def is_silent() -> bool:
        nonlocal seen, since
        if len(robot.commands) != seen:
            seen, since = len(robot.commands), clock.now()
        return clock.now() - since > steady_seconds

    wait_until(is_silent, 'nothing is commanded')


def test_the_robot_is_stopped_until_it_stands_still_and_whenever_it_moves(robot: Robot) -> None:
    pose = PoseStamped()
    with NodeRuntime.open('executive') as runtime:
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), pose_of(pose), MotionParameters()))
        runtime.call(stop.prepare)
        wait_until(lambda: runtime.call(lambda: runtime.node.count_subscribers(names.CMD_VEL)), 'the robot')
        runtime.call(stop.hold)
        wait_until(lambda: robot.asked, 'the cancel')
        silence(robot)
        assert robot.commands and all(command == Twist() for command in robot.commands)
        count = len(robot.commands)
        pose.pose.position.x += 0.1
        wait_until(lambda: len(robot.commands) > count, 'zero velocity, since it moves')
        silence(robot)
        count = len(robot.commands)
        pose.pose.position.x += 0.001  # noise
        silence(robot)
        assert len(robot.commands) == count

        def turn(yaw: float) -> int:
            count = len(robot.commands)
            pose.pose.orientation = Quaternion(z=math.sin(yaw / 2), w=math.cos(yaw / 2))
            wait_until(lambda: len(robot.commands) > count, 'zero velocity, since it turns')
            silence(robot)
            return len(robot.commands)

        turn(0.95)
        count = turn(1.15)
        wait_until(lambda: robot.asked.count('follow_path') > 2, 'cancels again and again')
        assert set(robot.asked) == {'follow_path', 'navigate_to_pose'}, 'no other server is asked'
        robot.asked.clear()
        runtime.call(stop.cancel_others)
        wait_until(lambda: 'navigate_to_pose' in robot.asked, 'the cancel of the goals of others')
        runtime.call(stop.release)
        runtime.call(lambda: None)
        pose.pose.position.x += 1.0
        silence(robot)
        assert len(robot.commands) == count


@pytest.mark.parametrize(
    ('x', 'problem'), [(math.nan, ''), (0.0, 'nobody publishes pose any more')], ids=['not a number', 'nobody']
)
def test_a_robot_that_is_nobody_knows_where_is_not_at_rest(robot: Robot, x: float, problem: str) -> None:
    pose = PoseStamped()
    pose.pose.position.x = x
    with NodeRuntime.open('executive') as runtime:
        source = pose_of(pose, problem)
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), source, MotionParameters()))
        wait_until(lambda: runtime.call(lambda: runtime.node.count_subscribers(names.CMD_VEL)), 'the robot')
        runtime.call(stop.hold)
        until = runtime.steady.now() + 2.0 * motion_stop._LEAST_SECONDS
        wait_until(lambda: runtime.steady.now() > until, 'the time for which each robot is stopped, twice')
        count = len(robot.commands)
        wait_until(lambda: len(robot.commands) > count, 'zero velocity, since it may move')


def test_a_robot_that_drives_by_stamped_velocities_is_stopped_by_them() -> None:
    with NodeRuntime.open('robot') as robot, NodeRuntime.open('executive') as runtime:
        commands: list[TwistStamped] = []
        robot.call(lambda: robot.node.create_subscription(TwistStamped, names.CMD_VEL, commands.append, 10))
        parameters = MotionParameters(stamped_cmd_vel=True)
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), AT_REST, parameters))
        runtime.call(stop.hold)
        wait_until(lambda: commands, 'zero velocity')
        assert all(command.twist == Twist() and command.header.stamp.sec for command in commands)


def test_who_sends_the_robot_somewhere_is_asked_first_and_waited_for_in_vain_for_a_moment_only(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.front_answers = Future()
    with NodeRuntime.open('executive') as runtime:
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), AT_REST, MotionParameters()))
        wait_until(lambda: len(runtime.call(stop.servers)) == 2, 'both servers')
        with monkeypatch.context() as patched:
            patched.setattr(motion_stop, '_HELD_FRONT_SECONDS', 1e6)
            runtime.call(stop.hold)
            wait_until(lambda: len(robot.commands) > 5, 'zero velocity meanwhile')
            wait_until(lambda: robot.asked, 'the cancel')
            assert set(robot.asked) == {FRONT}
            robot.runtime.call(lambda: robot.front_answers.set_result(None))
            wait_until(lambda: 'follow_path' in robot.asked, 'the other one, as soon as it is answered')
        runtime.call(stop.release)
        robot.front_answers = Future()
        robot.asked.clear()
        runtime.call(stop.hold)
        wait_until(lambda: set(robot.asked) == {FRONT, 'follow_path'}, 'the other one, although it is not answered')
        runtime.call(stop.release)
        robot.runtime.call(lambda: robot.front_answers.set_result(None))


def test_a_cancel_that_waits_for_its_server_does_not_end_what_begins_then(robot: Robot) -> None:
    with NodeRuntime.open('executive') as runtime:
        links = ServiceLinks(runtime)
        stop = runtime.call(lambda: MotionStop(runtime, links, AT_REST, MotionParameters()))
        watch = StopEnforcer(runtime, stop, 1.0, reporter(pytest.fail))
        wait_until(lambda: len(runtime.call(stop.servers)) == 2, 'both servers')

        def stop_and_start() -> None:
            stop.hold()
            assert FRONT in stop._asked
            watch.begins()

        runtime.call(stop_and_start)
        wait_until(lambda: not runtime.call(lambda: len(stop._asked)), 'the end of all requests')
        another = runtime.call(lambda: links.link(CancelGoal, 'follow_path/_action/cancel_goal'))
        wait_until(lambda: service_outcome(another, CancelGoal.Request(), 2.0).ok, 'an answer to what is asked later')
        assert FRONT not in robot.asked


def test_a_stop_while_the_time_of_the_one_before_runs_out_lasts_as_long(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    with NodeRuntime.open('executive') as runtime:
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), AT_REST, MotionParameters()))
        watch = StopEnforcer(runtime, stop, 1.0, reporter(pytest.fail))

        def stop_twice() -> None:
            with monkeypatch.context() as brief:
                brief.setattr(stop_enforcer, 'HALT_SECONDS', 0.05)
                watch.halt_robot(is_running=False)
            time.sleep(0.2)  # its time is over, and what follows from that comes after this
            watch.halt_robot(is_running=False)

        runtime.call(stop_twice)
        runtime.call(lambda: None)
        assert runtime.call(lambda: stop.is_holding)


def test_a_docking_server_does_not_send_the_robot_off_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """opennav_docking sends a goal that was canceled by somebody else once more, but while it is canceled itself."""
    for front in ('_FRONT_SECONDS', '_HELD_FRONT_SECONDS'):
        monkeypatch.setattr(motion_stop, front, 1e6)
    with NodeRuntime.open('robot') as robot, NodeRuntime.open('executive') as runtime:
        navigate = ActionLinks(robot).link(NavigateToPose, names.NAVIGATE_TO_POSE)

        async def dock(handle: ServerGoalHandle) -> Any:
            for _ in range(2):
                ended = Future(executor=robot.node.executor)

                def done(outcome: GoalOutcome, ended: Future = ended) -> None:
                    ended.set_result(outcome)

                ActionCall(navigate, NavigateToPose.Goal(), on_done=done)
                assert (await ended).status is GoalStatus.CANCELED
                if handle.is_cancel_requested:
                    break
            handle.canceled()
            return DockRobot.Result()

        driver = ScriptedActionServer(robot, NavigateToPose, names.NAVIGATE_TO_POSE)
        ScriptedActionServer(robot, DockRobot, names.DOCK_ROBOT, dock)
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), AT_REST, MotionParameters()))
        wait_until(lambda: len(runtime.call(stop.servers)) == 2, 'both servers')
        docking = ActionLinks(runtime).link(DockRobot, names.DOCK_ROBOT)
        for count, ask in enumerate((stop.cancel_others, stop.hold), 1):
            goal = SentGoal(docking, DockRobot.Goal())
            wait_until(lambda: driver.running, 'the goal of the docking server')
            runtime.call(ask)
            assert goal.wait().status is GoalStatus.CANCELED
            assert len(driver.goals) == count, 'the robot was sent off again'
            runtime.call(stop.release)


def test_what_a_server_has_said_of_its_goals_goes_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[bytes] = []  # processes that the middleware still takes for alive
    peers: Any = SimpleNamespace(has_ended=lambda writer: guid_prefix_of(writer) in ended)
    with NodeRuntime.open('executive') as runtime, NodeRuntime.open('next') as later:
        stop = runtime.call(lambda: MotionStop(runtime, ServiceLinks(runtime), AT_REST, MotionParameters(), peers))

        def goes_on() -> list[str]:
            runtime.call(stop.prepare)
            return sorted(runtime.call(lambda: stop.going_on).values())

        told: list[str] = []
        watch = StopEnforcer(runtime, stop, 1.0, reporter(told.append))

        with NodeRuntime.open('robot') as robot:
            spin = ScriptedActionServer(robot, Spin, names.SPIN)
            SentGoal(ActionLinks(later).link(Spin, names.SPIN), Spin.Goal())
            wait_until(lambda: spin.running and goes_on() == ['spin (of /robot)'], 'the goal')
            with monkeypatch.context() as early:  # the name of a node comes after its writers
                early.setattr(motion_stop, 'writer_name', lambda *_: 'a node that has just come')
                assert runtime.call(watch.goes_on)
            assert runtime.call(watch.goes_on)
            assert len(told) == 1, 'one hold is told once'
            ScriptedActionServer(later, Spin, names.SPIN)
            status = runtime.node.resolve_topic_name(f'{names.SPIN}/_action/status')
            wait_until(lambda: runtime.call(lambda: runtime.node.count_publishers(status)) == 2, 'the next server')
            assert goes_on() == ['spin (of /robot)']
            reports = later.node.create_publisher(GoalStatusArray, status, qos_profile_action_status_default)
            reports.publish(GoalStatusArray(status_list=[GoalStatusMessage(status=GoalStatusMessage.STATUS_EXECUTING)]))
            wait_until(lambda: len(goes_on()) == 2, 'the goal of another server')
            reports.publish(GoalStatusArray(status_list=[GoalStatusMessage(status=GoalStatusMessage.STATUS_SUCCEEDED)]))
            wait_until(lambda: len(goes_on()) == 1, 'its end')
            assert goes_on() == ['spin (of /robot)']
            ended.append(guid_prefix_of(publisher_of(runtime, status, 'robot')))
            assert not goes_on()
            ended.clear()
            assert goes_on()
        wait_until(lambda: not goes_on(), 'the end of the first server, with its goal')
        assert not runtime.call(watch.goes_on)
        assert told[1:] == ['spin (of /robot) has ended: the robot is not kept at rest any more']


class _RestsLate(EventState):
    """Has not halted before the test says so: as a goal whose server gives up to wait for another one."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self.rests = False

    def halting(self) -> str | None:
        return None if self.rests else 'a goal not confirmed canceled'


def driving(state: EventState) -> OperatableStateMachine:
    """Return a machine of this state only."""
    made = OperatableStateMachine(outcomes=['finished'])
    with made:
        made.add('Drive', state, transitions={'done': 'finished'})
    return made


def test_a_robot_whose_server_ignores_cancels_is_kept_at_rest_after_the_end_of_the_run() -> None:
    state = _RestsLate()
    with NodeRuntime.open('robot') as robot:
        commands: list[Twist] = []
        poses = robot.call(lambda: robot.node.create_publisher(PoseStamped, names.POSE, 1))
        robot.call(lambda: robot.node.create_subscription(Twist, names.CMD_VEL, commands.append, 10))
        spin = ScriptedActionServer(robot, Spin, names.SPIN, on_cancel=lambda _handle: CancelResponse.ACCEPT)
        goal = SentGoal(ActionLinks(robot).link(Spin, names.SPIN), Spin.Goal())
        wait_until(lambda: spin.running, 'the goal')
        pose = PoseStamped()
        pose.header.frame_id = 'map'

        def is_stopped_when_it_moves() -> bool:
            pose.pose.position.x += 0.1
            poses.publish(pose)
            return bool(commands)

        bench = ExecutiveBench(behavior_of(lambda: driving(state)))
        try:
            bench.start()
            bench.wait_active('/Drive')
            bench.applied(ExecutiveCommand.STOP)
            wait_until(lambda: spin.cancels, 'the cancel of all goals')
            state.rests = True
            state.wake()
            assert bench.wait_idle() == 'preempted'
            bench.logged('the robot is kept at rest until the next start: spin (of /robot) continued after the stop')
            commands.clear()
            wait_until(is_stopped_when_it_moves, 'zero velocity after the end of the run')
            spin.end(0, 'canceled')
            goal.wait()
            bench.logged('spin (of /robot) has ended: the robot is not kept at rest any more')

            # Nor does a run that is at rest at once let go what somebody else has begun.
            driver = ScriptedActionServer(robot, NavigateToPose, names.NAVIGATE_TO_POSE, on_cancel=spin.on_cancel)
            goal = SentGoal(ActionLinks(robot).link(NavigateToPose, names.NAVIGATE_TO_POSE), NavigateToPose.Goal())
            wait_until(lambda: driver.running, 'the goal of somebody else')
            bench.start()
            bench.wait_active('/Drive')
            stop = bench.executive.runs._stops._robot

            def is_heard() -> bool:
                bench.runtime.call(stop.prepare)
                return [*bench.runtime.call(lambda: stop.going_on).values()] == ['navigate_to_pose (of /robot)']

            wait_until(is_heard, 'what the server says')
            bench.applied(ExecutiveCommand.STOP)
            bench.logged('kept at rest until the next start: navigate_to_pose (of /robot) continued after the stop')
            driver.end(0, 'canceled')
            goal.wait()
            bench.logged('navigate_to_pose (of /robot) has ended: the robot is not kept at rest any more')
        finally:
            bench.close()


class _Drives(EventState):
    """Is done when the test says so."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self.is_done = False

    def execute(self, userdata: Any) -> str | None:
        return 'done' if self.is_done else None


def test_a_stop_of_a_run_that_has_just_ended_by_itself_stops_what_others_have_begun() -> None:
    state = _Drives()
    with NodeRuntime.open('robot') as robot:
        spin = ScriptedActionServer(robot, Spin, names.SPIN)
        goal = SentGoal(ActionLinks(robot).link(Spin, names.SPIN), Spin.Goal())
        wait_until(lambda: spin.running, 'the goal of somebody else')
        bench = ExecutiveBench(behavior_of(lambda: driving(state)))
        try:
            bench.start()
            bench.wait_active('/Drive')
            runs = bench.executive.runs
            stop, run = runs._stops._robot, runs.run
            assert run is not None

            def is_heard() -> bool:
                bench.runtime.call(stop.prepare)
                return bool(bench.runtime.call(lambda: stop.going_on))

            def stop_at_its_end() -> None:
                state.is_done = True
                state.wake()
                assert run.join(DEADLINE)
                assert runs.run is run, 'the executive has not heard of its end'
                runs.stop('by the test')
                runs.halt_robot()

            wait_until(is_heard, 'what the server says')
            bench.runtime.call(stop_at_its_end)
            assert goal.wait().status is GoalStatus.CANCELED
            assert bench.wait_idle() == 'finished'
        finally:
            bench.close()
