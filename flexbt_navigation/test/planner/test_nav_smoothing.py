# SPDX-License-Identifier: BSD-3-Clause
"""smooth_path: results and error codes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from nav2_msgs.action import SmoothPath
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import DOCK, OFFICE, RobotProbe, aborted, line, open_sim_world, pose

Result = SmoothPath.Result


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world() as probe:
        yield probe


def smooth(world: RobotProbe, path: Path, **fields: Any) -> SentGoal:
    """Within 10 s, unless said otherwise."""
    return world.send(names.SMOOTH_PATH, **({'path': path, 'max_smoothing_duration': Duration(sec=10)} | fields))


def corner() -> Path:
    """Along the corridor, then across it."""
    path = line(DOCK, (2.8, 4.45))
    path.poses += line((2.8, 4.45), (2.8, 4.0)).poses[1:]
    return path


def points(path: Path) -> list[tuple[float, float]]:
    return [(stamped.pose.position.x, stamped.pose.position.y) for stamped in path.poses]


@pytest.mark.parametrize('smoother', ['', 'simple_smoother', 'route_smoother'])
def test_a_path_is_smoothed_between_its_ends(world: RobotProbe, smoother: str) -> None:
    shown: list[Path] = []
    node = world.runtime.node
    subscription = world.runtime.call(lambda: node.create_subscription(Path, names.PLAN_SMOOTHED, shown.append, 1))
    world.wait(lambda: node.count_publishers(names.PLAN_SMOOTHED), 'the topic')
    path = corner()
    goal = smooth(world, path, smoother_id=smoother, check_for_collisions=True)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    result = goal.result
    assert (result.error_code, result.was_completed) == (Result.NONE, True)
    assert 0 < result.smoothing_duration.sec * 10**9 + result.smoothing_duration.nanosec < 10**10
    assert len(result.path.poses) == len(path.poses)
    assert (points(result.path)[0], points(result.path)[-1]) == (points(path)[0], points(path)[-1])
    at = points(path).index((2.8, 4.45))
    assert math.dist(points(result.path)[at], (2.8, 4.45)) > 0.01
    assert {stamped.header.frame_id for stamped in result.path.poses} == {'map'}
    world.runtime.call(lambda: node.destroy_subscription(subscription))


def test_a_planned_path_is_smoothed_without_a_collision(world: RobotProbe) -> None:
    world.place(DOCK)
    plan = world.plan(OFFICE)
    goal = smooth(world, plan.result.path, check_for_collisions=True)
    assert goal.wait().status is GoalStatus.SUCCEEDED, goal.result.error_msg


THROUGH_THE_WALL = line((0.8, 4.45), (0.8, 2.5))
REFUSED = {
    'no poses': ({'path': Path()}, Result.INVALID_PATH, 'no poses'),
    'no place': ({'path': Path(poses=[pose((math.nan, 1.0))])}, Result.INVALID_PATH, 'pose 0'),
    'frame': ({'path': line(DOCK, (2.0, 4.45), 'moon')}, Result.UNKNOWN, "'moon'"),
    'smoother': ({'smoother_id': 'ceres'}, Result.INVALID_SMOOTHER, "'ceres'"),
    'no time': ({'max_smoothing_duration': Duration()}, Result.TIMEOUT, '0 s'),
    'collision': (
        {'path': THROUGH_THE_WALL, 'check_for_collisions': True},
        Result.SMOOTHED_PATH_IN_COLLISION,
        'in collision at (0.80, 3.',
    ),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_cannot_be_smoothed_is_refused_with_nav2s_code(world: RobotProbe, case: str) -> None:
    fields, code, said = REFUSED[case]
    result = aborted(smooth(world, **({'path': corner()} | fields)), code)
    assert said in result.error_msg
    assert result.was_completed is (case == 'collision')


def test_without_the_check_a_path_through_a_wall_is_smoothed(world: RobotProbe) -> None:
    assert smooth(world, THROUGH_THE_WALL).wait().status is GoalStatus.SUCCEEDED


def test_every_one_of_many_requests_gets_its_answer_or_its_cancel(world: RobotProbe) -> None:
    goals = [smooth(world, corner()) for _ in range(30)]
    for goal in goals[15:]:
        goal.cancel()
    assert {goal.wait().status for goal in goals[:15]} == {GoalStatus.SUCCEEDED}
    assert {goal.wait().status for goal in goals[15:]} <= {GoalStatus.SUCCEEDED, GoalStatus.CANCELED}
