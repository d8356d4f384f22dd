# SPDX-License-Identifier: BSD-3-Clause
"""assisted_teleop: an operator drives, the obstacles have their say."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Twist
from nav2_msgs.action import AssistedTeleop, Spin
from std_msgs.msg import Empty

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.values.message_fields import seconds_of
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, aborted, open_sim_world

Result = AssistedTeleop.Result
Joystick = Callable[[float, float], None]


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world({'speed_factor': 5.0}) as probe:
        yield probe


@pytest.fixture
def joystick(world: RobotProbe) -> Iterator[Joystick]:
    """Held as it was put last: it repeats its command every 50 ms of wall time."""
    runtime = world.runtime
    commands = runtime.call(lambda: runtime.node.create_publisher(Twist, names.CMD_VEL_TELEOP, 1))
    wanted = Twist()
    timer = runtime.call(lambda: runtime.node.create_timer(0.05, lambda: commands.publish(wanted), clock=None))
    world.wait(commands.get_subscription_count, 'the server')

    def put(linear: float, angular: float) -> None:
        wanted.linear.x, wanted.angular.z = linear, angular

    yield put
    runtime.call(lambda: (runtime.node.destroy_timer(timer), runtime.node.destroy_publisher(commands)))


def teleop(world: RobotProbe, allowance: int = 0) -> SentGoal:
    """Hand the robot over to the operator."""
    goal = world.send(names.ASSISTED_TELEOP, time_allowance=Duration(sec=allowance))
    world.wait(lambda: goal.feedback, 'feedback')
    return goal


def preempt(world: RobotProbe) -> None:
    """End the assistance: the operator is done."""
    node = world.runtime.node
    done = world.runtime.call(lambda: node.create_publisher(Empty, names.PREEMPT_TELEOP, 1))
    world.wait(done.get_subscription_count, 'the server')
    done.publish(Empty())


def test_the_operator_drives_up_to_a_wall_and_not_into_it_and_says_when_it_is_done(
    world: RobotProbe, joystick: Joystick
) -> None:
    world.place((1.2, 4.45, math.pi))
    goal = teleop(world)
    joystick(0.25, 0.0)
    world.wait_driving(0.15)
    rest = world.wait_at_rest()
    # The wall ends at 0.15 m; the robot has a radius of 0.22 m.
    assert 0.37 < rest.x < 0.6
    joystick(-0.2, 0.0)  # away from it
    world.wait_driving(0.15)
    preempt(world)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert goal.result.error_code == Result.NONE
    assert 0.0 < seconds_of(goal.feedback[-1].current_teleop_duration) <= seconds_of(goal.result.total_elapsed_time)
    world.wait_at_rest()


def test_what_is_commanded_while_nobody_has_asked_for_it_does_not_drive(world: RobotProbe, joystick: Joystick) -> None:
    there = world.place(DOCK)
    joystick(0.2, 0.0)
    assert world.later(1.0)[1:] == there[1:]


def test_the_time_is_up_whatever_the_operator_does(world: RobotProbe, joystick: Joystick) -> None:
    world.place(DOCK)
    goal = world.send(names.ASSISTED_TELEOP, time_allowance=Duration(sec=1))
    joystick(0.2, 0.0)
    result = aborted(goal, Result.TIMEOUT)
    assert seconds_of(result.total_elapsed_time) >= 1.0
    world.wait_at_rest()


def test_an_operator_who_falls_silent_or_talks_nonsense_drives_nowhere(world: RobotProbe, joystick: Joystick) -> None:
    world.place(DOCK)
    goal = teleop(world)
    joystick(0.2, 0.0)
    world.wait_driving(0.15)
    joystick(math.nan, 0.0)
    world.wait_at_rest()
    joystick(0.2, 0.0)
    world.wait_driving(0.15)
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    world.wait_at_rest()


def test_a_single_command_counts_for_half_a_second(world: RobotProbe) -> None:
    world.place(DOCK)
    goal = teleop(world)
    node = world.runtime.node
    command = Twist()
    command.linear.x = 0.2
    once = world.runtime.call(lambda: node.create_publisher(Twist, names.CMD_VEL_TELEOP, 1))
    world.wait(once.get_subscription_count, 'the server')
    once.publish(command)
    world.wait_driving(0.15)
    world.wait_at_rest()
    turn = world.send(names.SPIN, target_yaw=0.5)
    aborted(goal, Result.NONE)
    assert turn.wait().status is GoalStatus.SUCCEEDED
    assert turn.result.error_code == Spin.Result.NONE
