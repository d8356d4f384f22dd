# SPDX-License-Identifier: BSD-3-Clause
"""follow_path in the simulator: arriving, replanning, stopping, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import Any

import pytest
from nav2_msgs.action import FollowPath, Spin
from nav2_msgs.msg import SpeedLimit
from nav_msgs.msg import Path
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import RobotModel, load_map
from flexbt_testing.nodes.sim_world import DOCK, OFFICE, RobotProbe, aborted, line, open_sim_world, pose
from flexbt_testing.waiting import wait_until

Result = FollowPath.Result
MODEL = RobotModel()
EAST = (11.2, 4.45)


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world() as probe:
        yield probe


@pytest.fixture(autouse=True)
def fast(world: RobotProbe) -> Iterator[None]:
    """Yield a test that measures wall time changes the speed factor."""
    yield
    world.set_speed_factor(0.0)


def test_the_robot_arrives_round_the_walls_and_tells_how_far_it_is(world: RobotProbe) -> None:
    start = world.place(DOCK)
    path = world.plan(OFFICE).result.path
    goal = world.follow(path, controller_id='FollowPath', goal_checker_id='general_goal_checker')
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert goal.result.error_code == Result.NONE
    rest = world.wait_at_rest()
    assert rest.distance(OFFICE) < 0.15
    assert abs(math.remainder(rest.yaw - OFFICE[2], math.tau)) < 0.15
    walls = load_map(built_in_map())
    driven = [seen for seen in world.sightings if seen.time >= start.time]
    assert min(walls.clearance(seen.x, seen.y) for seen in driven) >= MODEL.footprint.radius - walls.resolution / 2.0
    left = [message.distance_to_goal for message in goal.feedback]
    assert left[0] == pytest.approx(sum(map(_length, pairwise(path.poses))), rel=0.1)
    assert left[-1] < left[0] / 2.0  # of the last messages some may be overtaken by the result
    assert all(later < earlier + 0.1 for earlier, later in pairwise(left))
    assert max(message.speed for message in goal.feedback) == pytest.approx(MODEL.drive.linear_speed)


def _length(ends: tuple[Any, Any]) -> float:
    a, b = (one.pose.position for one in ends)
    return math.dist((a.x, a.y), (b.x, b.y))


def test_new_paths_are_gone_over_to_without_slowing_down(world: RobotProbe) -> None:
    world.place(DOCK)
    world.set_speed_factor(2.0)
    goals = [world.follow(line(DOCK, EAST))]
    world.wait_driving(0.25)
    before = len(world.commands)
    for _ in range(4):
        here = world.later(0.6)
        goals.append(world.follow(line((here.x, here.y), EAST)))
    world.later(0.6)
    assert min(linear for linear, _ in world.commands[before:]) > 0.24
    for replaced in goals[:-1]:
        result = aborted(replaced, Result.NONE)
        assert 'newer' in result.error_msg
    goals[-1].cancel()
    assert goals[-1].wait().status is GoalStatus.CANCELED


def test_a_limit_of_the_speed_holds_until_it_is_taken_back(world: RobotProbe) -> None:
    """In percent or in m/s; 0 for none; for the path that is followed just now, too."""
    world.place(DOCK)
    node = world.runtime.node
    limits = world.runtime.call(lambda: node.create_publisher(SpeedLimit, names.SPEED_LIMIT, 1))
    wait_until(limits.get_subscription_count)
    goal = world.follow(line(DOCK, EAST))
    world.wait_driving(0.25)

    def drives_at(speed: float) -> bool:
        return bool(world.commands[-1][0] == pytest.approx(speed))

    for limit, speed in (
        (SpeedLimit(percentage=True, speed_limit=50.0), 0.13),
        (SpeedLimit(speed_limit=0.2), 0.2),
        (SpeedLimit(speed_limit=math.nan), 0.2),
        (SpeedLimit(), 0.26),
    ):
        limits.publish(limit)
        wait_until(partial(drives_at, speed))
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    world.runtime.call(lambda: node.destroy_publisher(limits))


def test_a_canceled_robot_is_at_rest_in_time(world: RobotProbe) -> None:
    world.place(DOCK)
    world.set_speed_factor(1.0)
    goal = world.follow(line(DOCK, EAST))
    asked = world.wait_driving(0.25)
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    rest = world.wait_at_rest()
    assert rest.time - asked.time < 0.5 + MODEL.drive.linear_speed / MODEL.drive.linear_acceleration
    assert world.commands[-1] == (0.0, 0.0)


def _broken(index: int, **fields: float) -> Path:
    path = line(DOCK, EAST)
    place = path.poses[index].pose
    for name, value in fields.items():
        setattr(place.orientation if name in ('z', 'w') else place.position, name, value)
    return path


REFUSED = {
    'empty': ({'path': Path()}, Result.INVALID_PATH, 'no poses'),
    'frame': ({'path': line(DOCK, EAST, 'moon')}, Result.TF_ERROR, "'moon'"),
    'nan': ({'path': _broken(7, x=math.nan)}, Result.INVALID_PATH, 'pose 7'),
    'infinite': ({'path': _broken(-1, y=math.inf)}, Result.INVALID_PATH, 'inf'),
    'nan heading': ({'path': _broken(-1, z=math.nan)}, Result.INVALID_PATH, 'nan'),
    'controller': ({'path': line(DOCK, EAST), 'controller_id': 'MPPI'}, Result.INVALID_CONTROLLER, "'MPPI'"),
    'goal checker': ({'path': line(DOCK, EAST), 'goal_checker_id': 'exact'}, Result.UNKNOWN, "'exact'"),
    'progress checker': ({'path': line(DOCK, EAST), 'progress_checker_id': 'none'}, Result.UNKNOWN, "'none'"),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_cannot_be_followed_is_refused_with_nav2s_code(world: RobotProbe, case: str) -> None:
    fields, code, said = REFUSED[case]
    there = world.place(DOCK)
    result = aborted(world.follow(**fields), code)
    assert said in result.error_msg
    assert world.later(0.3)[1:] == there[1:]


@pytest.mark.parametrize('case', ['empty', 'frame', 'controller'])
def test_a_refused_path_stops_the_robot_on_the_one_that_it_was_to_replace(world: RobotProbe, case: str) -> None:
    """As in Nav2: a tree that replaces its path does not watch the older goal."""
    fields, code, _ = REFUSED[case]
    world.place(DOCK)
    goal = world.follow(line(DOCK, EAST))
    world.wait_driving()
    aborted(world.send(names.SPIN, target_yaw=math.nan), Spin.Result.UNKNOWN)
    assert not goal.ended
    aborted(world.follow(**fields), code)
    assert 'was to replace it' in aborted(goal, Result.NONE).error_msg
    world.wait_at_rest()


def test_a_path_into_a_wall_ends_before_it(world: RobotProbe) -> None:
    world.place(DOCK)
    aborted(world.follow(line(DOCK, (DOCK[0], 6.5))), Result.PATIENCE_EXCEEDED)
    rest = world.wait_at_rest()
    assert rest.y < 5.4 - MODEL.footprint.radius


def test_a_path_to_where_the_robot_is_ends_with_the_turn(world: RobotProbe) -> None:
    world.place(DOCK)
    path = Path(poses=[pose((DOCK[0], DOCK[1], 2.0))])
    assert world.follow(path).wait().status is GoalStatus.SUCCEEDED
    rest = world.wait_at_rest()
    assert rest.distance(DOCK) < 0.02
    assert rest.yaw == pytest.approx(2.0, abs=0.15)


def test_clients_that_take_the_robot_from_each_other_end_with_one_goal(world: RobotProbe) -> None:
    world.place(DOCK)
    goals = []
    for number in range(10):
        goals.append(world.follow(line(DOCK, EAST if number % 2 else (0.8, 4.0))))
        world.later(0.2)
    *replaced, last = goals
    assert {goal.wait().status for goal in replaced} == {GoalStatus.ABORTED}
    assert not last.ended
    last.cancel()
    assert last.wait().status is GoalStatus.CANCELED
    world.wait_at_rest()


def test_the_speed_of_the_controller_can_be_set_while_it_works(world: RobotProbe) -> None:
    world.place(DOCK)
    path = world.plan(OFFICE).result.path
    for speed in (0.1, 0.26):
        wanted = [Parameter('FollowPath.desired_linear_vel', value=speed).to_parameter_msg()]
        request = SetParameters.Request(parameters=wanted)
        assert world.ask(SetParameters, 'controller_server/set_parameters', request).results[0].successful
        before = world.now
        goal = world.follow(path)
        wait_until(partial(_is_away, world, (before.x, before.y)), 'half a metre')
        driven = [seen for seen in world.sightings if seen.time > before.time]
        assert 0.8 * speed < max(world.speeds(driven)) < 1.1 * speed
        goal.cancel()
        goal.wait()


def _is_away(world: RobotProbe, place: tuple[float, float]) -> bool:
    return world.now.distance(place) > 0.5
