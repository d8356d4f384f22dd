# SPDX-License-Identifier: BSD-3-Clause
"""spin, backup, drive_on_heading: what Nav2's own tests ask of them, and one motion at a time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from nav2_msgs.action import BackUp, DriveOnHeading, FollowPath, Spin
from nav2_msgs.msg import CollisionMonitorState
from nav2_msgs.srv import Toggle

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.runtime.ros_clock import RosClock
from flexbt_common.values.message_fields import seconds_of
from flexbt_testing.nodes.clients import LifecycleClient, SentGoal
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, Sighting, aborted, line, open_sim_world

FREE = (4.0, 4.45, 0.0)
"""Free on all sides for a metre."""
LATE = 1.0
"""How late a robot may be on a busy machine, s: 0.2 s of wall time, at five times the speed. It turns by 1 rad/s, and
drives by 0.2 m/s. The exact angles and distances are tested where time is simulated, in test_sim_motions.py."""


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    # Not faster: where the robot stops depends on how soon a command arrives.
    with open_sim_world({'speed_factor': 0.0}) as probe:
        yield probe


def spin(world: RobotProbe, angle: float, allowance: int = 0) -> SentGoal:
    """Turn, rad, within s (0: without a limit; a robot that gets its commands late stands still in between)."""
    return world.send(names.SPIN, target_yaw=angle, time_allowance=Duration(sec=allowance))


def drive(
    world: RobotProbe, action: str, distance: float, speed: float = 0.2, allowance: int = 0, y: float = 0.0
) -> SentGoal:
    """Drive, m, at m/s, within s."""
    return world.send(action, target=Point(x=distance), speed=speed, time_allowance=Duration(sec=allowance))


def turned(sightings: list[Sighting]) -> float:
    """Return how far the robot has turned, rad."""
    return math.fsum(math.remainder(later.yaw - earlier.yaw, math.tau) for earlier, later in pairwise(sightings))


def test_a_motion_takes_its_time_by_the_poses_whatever_the_clock_shows(
    world: RobotProbe, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time of the node comes by another topic, and may stand still while the robot turns."""
    monkeypatch.setattr(RosClock, 'now', lambda clock: 0.0)
    world.place(FREE)
    start = world.now.time
    goal = spin(world, 1.0)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert 0.5 < seconds_of(goal.result.total_elapsed_time) <= world.later(1.0).time - start


@pytest.mark.parametrize('angle', [0.35, -3.49, 7.5, 0.0])
def test_spin_turns_by_the_angle_and_stays_where_it_is(world: RobotProbe, angle: float) -> None:
    start = world.place(FREE)
    goal = spin(world, angle)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert goal.result.error_code == Spin.Result.NONE
    rest = world.wait_at_rest()
    assert rest.distance(FREE) < 0.02
    done = turned([seen for seen in world.sightings if seen.time >= start.time]) * math.copysign(1.0, angle)
    unseen = math.tau * round((abs(angle) - done) / math.tau)  # whole turns between poses that came late
    assert abs(angle) - 0.1 <= done + unseen <= abs(angle) + LATE
    told = [message.angular_distance_traveled for message in goal.feedback]
    assert told == sorted(told, key=abs)
    assert not unseen or abs(told[-1]) > abs(angle) - math.pi
    assert all(0.0 <= value * math.copysign(1.0, angle) <= abs(angle) + LATE for value in told)
    assert 0.0 <= seconds_of(goal.result.total_elapsed_time) <= rest.time - start.time + 1.0


@pytest.mark.parametrize(
    ('action', 'distance', 'speed', 'driven'),
    [
        (names.BACKUP, 0.3, 0.15, -0.3),
        (names.BACKUP, -0.3, -0.15, -0.3),
        (names.DRIVE_ON_HEADING, 0.5, 0.2, 0.5),
        (names.DRIVE_ON_HEADING, -0.4, -0.1, -0.4),
        (names.DRIVE_ON_HEADING, 0.0, 0.1, 0.0),
    ],
)
def test_straight_motions_drive_their_distance(
    world: RobotProbe, action: str, distance: float, speed: float, driven: float
) -> None:
    world.place(FREE)
    goal = drive(world, action, distance, speed)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert goal.result.error_code == BackUp.Result.NONE
    rest = world.wait_at_rest()
    assert abs(driven) - 0.05 <= (rest.x - FREE[0]) * math.copysign(1.0, driven) <= abs(driven) + 0.2 * LATE
    assert rest.y == pytest.approx(FREE[1], abs=1e-3)
    told = [message.distance_traveled for message in goal.feedback]
    assert told == sorted(told)
    assert not told or told[-1] <= abs(driven) + 0.05


@pytest.mark.parametrize(
    ('action', 'fields', 'code', 'said'),
    [
        (names.SPIN, {'target_yaw': math.nan}, Spin.Result.UNKNOWN, 'target_yaw is nan'),
        (names.SPIN, {'target_yaw': math.inf}, Spin.Result.UNKNOWN, 'target_yaw is inf'),
        (names.BACKUP, {'target': Point(x=0.3, y=0.1), 'speed': 0.1}, BackUp.Result.INVALID_INPUT, 'target.y'),
        (names.BACKUP, {'target': Point(x=math.nan), 'speed': 0.1}, BackUp.Result.INVALID_INPUT, 'target.x is nan'),
        (names.BACKUP, {'target': Point(x=0.3), 'speed': math.inf}, BackUp.Result.INVALID_INPUT, 'speed is'),
        (names.BACKUP, {'target': Point(x=0.3), 'speed': 0.0}, BackUp.Result.INVALID_INPUT, 'speed is 0'),
        (
            names.DRIVE_ON_HEADING,
            {'target': Point(x=0.3), 'speed': -0.1},
            DriveOnHeading.Result.INVALID_INPUT,
            'opposite signs',
        ),
        (
            names.DRIVE_ON_HEADING,
            {'target': Point(x=0.3, z=math.nan), 'speed': 0.1},
            DriveOnHeading.Result.INVALID_INPUT,
            'target.z',
        ),
        (
            names.DRIVE_ON_HEADING,
            {'target': Point(x=math.inf), 'speed': 0.1},
            DriveOnHeading.Result.INVALID_INPUT,
            'target.x is inf',
        ),
    ],
)
def test_what_cannot_be_driven_is_refused_with_nav2s_code(
    world: RobotProbe, action: str, fields: dict[str, Any], code: int, said: str
) -> None:
    there = world.place(FREE)
    result = aborted(world.send(action, **fields), code)
    assert said in result.error_msg
    assert world.later(0.3)[1:] == there[1:]


@pytest.mark.parametrize(
    ('action', 'fields', 'code'),
    [
        (names.SPIN, {'target_yaw': 6.0}, Spin.Result.TIMEOUT),
        (names.BACKUP, {'target': Point(x=1.0), 'speed': 0.1}, BackUp.Result.TIMEOUT),
        (names.DRIVE_ON_HEADING, {'target': Point(x=1.0), 'speed': 0.1}, DriveOnHeading.Result.TIMEOUT),
    ],
)
def test_what_takes_longer_than_allowed_times_out_and_stops(
    world: RobotProbe, action: str, fields: dict[str, Any], code: int
) -> None:
    began = world.place(FREE).time
    result = aborted(world.send(action, time_allowance=Duration(sec=1), **fields), code)
    assert 1.0 <= seconds_of(result.total_elapsed_time) < world.now.time - began + 1.0
    world.wait_at_rest()


def test_no_motion_is_driven_into_a_wall(world: RobotProbe) -> None:
    cases = (
        (names.BACKUP, (0.6, 4.45, 0.0), 1.0, 0.2, BackUp.Result.COLLISION_AHEAD),
        (names.DRIVE_ON_HEADING, (0.6, 4.45, math.pi), 1.0, 0.2, DriveOnHeading.Result.COLLISION_AHEAD),
        (names.DRIVE_ON_HEADING, (0.6, 4.45, 0.0), -1.0, -0.2, DriveOnHeading.Result.COLLISION_AHEAD),
    )
    for action, place, distance, speed, code in cases:
        world.place(place)
        aborted(drive(world, action, distance, speed), code)
        assert world.wait_at_rest().x > 0.15 + 0.22


def test_the_collision_monitor_slows_a_motion_down_before_a_wall_while_it_is_on(world: RobotProbe) -> None:
    states: list[int] = []
    node = world.runtime.node
    subscription = world.runtime.call(
        lambda: node.create_subscription(
            CollisionMonitorState, names.COLLISION_MONITOR_STATE, lambda state: states.append(state.action_type), 9
        )
    )

    def toggle(*, enable: bool) -> None:
        assert world.ask(Toggle, names.TOGGLE_COLLISION_MONITOR, Toggle.Request(enable=enable)).success

    def slowest() -> float:
        """Of the commands while the robot drives to where it is 3 cm from a wall."""
        world.place((0.9, 4.45, math.pi))
        world.wait(lambda: world.commands[-1:] in ([], [(0.0, 0.0)]), 'the end of the commands before')
        begun = len(world.commands)
        assert drive(world, names.DRIVE_ON_HEADING, 0.45).wait().status is not GoalStatus.CANCELED
        return min(linear for linear, _ in world.commands[begun:] if linear)

    toggle(enable=True)
    assert 0.0 < slowest() < 0.19
    world.wait(lambda: states and states[0] == CollisionMonitorState.APPROACH, 'what the monitor does')
    world.wait(lambda: states[-1] == CollisionMonitorState.DO_NOTHING, 'the end of it')
    toggle(enable=False)
    told = len(states)
    assert slowest() == pytest.approx(0.2)
    assert len(states) == told
    world.runtime.call(lambda: node.destroy_subscription(subscription))


def test_nothing_passes_a_collision_monitor_that_is_not_active(world: RobotProbe) -> None:
    manager = LifecycleClient(world.runtime, names.COLLISION_MONITOR)
    assert manager.change('deactivate')
    start = world.place(FREE)
    goal = drive(world, names.DRIVE_ON_HEADING, 0.3)
    world.wait(lambda: goal.feedback, 'the motion')
    assert world.later(0.5)[1:] == start[1:]
    assert manager.change('activate')
    assert goal.wait().status is GoalStatus.SUCCEEDED


def test_a_server_that_is_deactivated_aborts_its_goals_and_rejects_others(world: RobotProbe) -> None:
    managers = {name: LifecycleClient(world.runtime, name) for name in names.ACTIONS_OF_SERVERS}
    assert {manager.state() for manager in managers.values()} == {'active'}
    manager = managers['behavior_server']
    world.place(FREE)
    turn = spin(world, 20.0)
    world.wait(lambda: world.moving() and turn.feedback, 'the robot turning')
    assert manager.change('deactivate')
    assert aborted(turn, Spin.Result.UNKNOWN).error_msg == 'behavior_server was deactivated'
    world.wait_at_rest()
    assert spin(world, 1.0).wait().status is drive(world, names.BACKUP, 0.3).wait().status is GoalStatus.REJECTED
    assert world.follow(line(FREE, (4.5, 4.45))).wait().status is GoalStatus.SUCCEEDED  # of another server
    assert manager.change('activate')
    assert spin(world, 0.35).wait().status is GoalStatus.SUCCEEDED


@pytest.mark.parametrize('action', [names.SPIN, names.BACKUP, names.DRIVE_ON_HEADING])
def test_a_cancel_stops_a_motion(world: RobotProbe, action: str) -> None:
    start = world.place(FREE)
    goal = spin(world, 20.0) if action == names.SPIN else drive(world, action, 3.0)
    world.wait(lambda: world.moving() and goal.feedback, 'the robot moving')
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    rest = world.wait_at_rest()
    assert world.commands[-1] == (0.0, 0.0)
    assert 0.0 < rest.distance(start[1:]) + abs(rest.yaw) < 2.0


def test_goals_that_are_canceled_before_they_have_begun_do_not_move_the_robot(world: RobotProbe) -> None:
    world.place(FREE)
    goals = [spin(world, 3.0) for _ in range(5)]
    for goal in goals:
        goal.cancel()
    assert {goal.wait().status for goal in goals} <= {GoalStatus.CANCELED, GoalStatus.ABORTED}
    assert goals[-1].wait().status is GoalStatus.CANCELED
    assert world.wait_at_rest().distance(FREE) < 0.01


def test_a_newer_turn_replaces_an_older_one(world: RobotProbe) -> None:
    world.place(FREE)
    older = spin(world, 3.0)
    world.wait(lambda: world.moving() and older.feedback, 'the robot turning')
    newer = spin(world, -0.5)
    aborted(older, Spin.Result.NONE)
    assert newer.wait().status is GoalStatus.SUCCEEDED


def test_a_turn_takes_the_robot_from_the_path_and_the_path_does_not_take_it_back(world: RobotProbe) -> None:
    world.place(DOCK)
    path = world.follow(line(DOCK, (11.2, 4.45)))
    world.wait_driving()
    turn = spin(world, 1.57)
    aborted(path, FollowPath.Result.NONE)
    began = len(world.commands)
    assert turn.wait().status is GoalStatus.SUCCEEDED
    world.wait_at_rest()
    assert {linear for linear, _ in world.commands[began:]} == {0.0}


def test_a_path_takes_the_robot_from_a_turn(world: RobotProbe) -> None:
    world.place(DOCK)
    turn = spin(world, 20.0)
    world.wait(lambda: world.moving() and turn.feedback, 'the robot turning')
    path = world.follow(line(DOCK, (2.0, 4.45)))
    assert turn.wait().status is GoalStatus.ABORTED
    assert path.wait().status is GoalStatus.SUCCEEDED
    assert world.wait_at_rest().distance((2.0, 4.45)) < 0.15
