# SPDX-License-Identifier: BSD-3-Clause
"""compute_path_to_pose and compute_path_through_poses."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
from nav2_msgs.msg import CostmapFilterInfo
from nav_msgs.msg import Path
from simulation_interfaces.msg import EntityState
from simulation_interfaces.srv import DeleteEntity, SetEntityState, SpawnEntity

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.values.message_fields import seconds_of
from flexbt_sim.messages import pose_of
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import DOCK, OFFICE, RobotProbe, aborted, open_sim_world, pose
from flexbt_testing.waiting import DEADLINE

Result = ComputePathToPose.Result
Through = ComputePathThroughPoses.Result
KITCHEN = (10.0, 2.3, 0.0)
IN_WALL = (1.0, 3.45)
FAR_AWAY = (100.0, 100.0)
NOWHERE = (math.nan, 1.0)


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world() as probe:
        yield probe


def through(world: RobotProbe, *places: tuple[float, ...], **fields: Any) -> SentGoal:
    """Ask for a path through places."""
    return world.send(names.COMPUTE_PATH_THROUGH_POSES, goals=[pose(place) for place in places], **fields)


def ends(path: Path) -> tuple[PoseStamped, PoseStamped]:
    """First and last pose."""
    return path.poses[0], path.poses[-1]


def at(stamped: PoseStamped, place: tuple[float, ...]) -> bool:
    """Return whether a pose is at a place (x, y), or also has the heading of one (x, y, yaw)."""
    return math.dist(pose_of(stamped.pose)[: len(place)], place) < 1e-6


def test_a_path_leads_from_the_robot_to_exactly_the_goal(world: RobotProbe) -> None:
    began = world.place(DOCK).time
    plans: list[Path] = []
    subscription = world.runtime.call(
        lambda: world.runtime.node.create_subscription(Path, names.PLAN, plans.append, names.transient_local_qos())
    )
    goal = world.plan(OFFICE, planner_id='GridBased')
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert goal.result.error_code == Result.NONE
    path = goal.result.path
    first, last = ends(path)
    assert at(first, DOCK[:2])
    assert at(last, OFFICE)
    assert {stamped.header.frame_id for stamped in path.poses} == {path.header.frame_id} == {'map'}
    stamp = seconds_of(path.header.stamp)
    assert began <= stamp
    world.wait(lambda: world.now.time >= stamp, 'the time of the path, which is not in the future')
    spent = goal.result.planning_time
    assert 0.0 < spent.sec + spent.nanosec * 1e-9 < DEADLINE
    world.runtime.call(lambda: world.runtime.node.destroy_subscription(subscription))


def test_a_start_of_ones_own_is_used_only_when_asked_for(world: RobotProbe) -> None:
    world.place(DOCK)
    assert at(ends(world.plan(OFFICE, start=pose(KITCHEN), use_start=True).result.path)[0], KITCHEN[:2])
    assert at(ends(world.plan(OFFICE, start=pose(KITCHEN)).result.path)[0], DOCK[:2])
    assert at(ends(world.plan(OFFICE, start=pose(NOWHERE, 'odom')).result.path)[0], DOCK[:2])


REFUSED = {
    'planner': ({'goal': pose(OFFICE), 'planner_id': 'SmacPlanner'}, Result.INVALID_PLANNER, "'SmacPlanner'"),
    'frame': ({'goal': pose(OFFICE, 'moon')}, Result.TF_ERROR, "'moon'"),
    'frame of the start': (
        {'goal': pose(OFFICE), 'start': pose(DOCK, 'gripper'), 'use_start': True},
        Result.TF_ERROR,
        "'gripper'",
    ),
    'goal outside': ({'goal': pose(FAR_AWAY)}, Result.GOAL_OUTSIDE_MAP, '100.00'),
    'goal nowhere': ({'goal': pose(NOWHERE)}, Result.GOAL_OUTSIDE_MAP, 'nan'),
    'goal of infinity': ({'goal': pose((0.0, -math.inf))}, Result.GOAL_OUTSIDE_MAP, 'inf'),
    'heading of the goal': ({'goal': pose((*OFFICE[:2], math.nan))}, Result.GOAL_OUTSIDE_MAP, 'nan'),
    'goal in a wall': ({'goal': pose(IN_WALL)}, Result.GOAL_OCCUPIED, '3.45'),
    'goal too near to a wall': ({'goal': pose((1.0, 3.7))}, Result.GOAL_OCCUPIED, '3.70'),
    'start outside': (
        {'goal': pose(OFFICE), 'start': pose(FAR_AWAY), 'use_start': True},
        Result.START_OUTSIDE_MAP,
        '100.00',
    ),
    'start nowhere': (
        {'goal': pose(OFFICE), 'start': pose(NOWHERE), 'use_start': True},
        Result.START_OUTSIDE_MAP,
        'nan',
    ),
    'start in a wall': (
        {'goal': pose(OFFICE), 'start': pose((1.6, 1.25)), 'use_start': True},
        Result.START_OCCUPIED,
        '1.25',
    ),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_cannot_be_planned_is_refused_with_nav2s_code(world: RobotProbe, case: str) -> None:
    fields, code, said = REFUSED[case]
    result = aborted(world.send(names.COMPUTE_PATH_TO_POSE, **fields), code)
    assert said in result.error_msg
    assert not result.path.poses


def test_a_path_through_places_visits_them_in_order_without_double_poses(world: RobotProbe) -> None:
    world.place(DOCK)
    goal = through(world, KITCHEN, (6.0, 4.0), OFFICE)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    poses = goal.result.path.poses
    visits = [
        [index for index, stamped in enumerate(poses) if at(stamped, place)]
        for place in ((10.0, 2.3), (6.0, 4.0), OFFICE[:2])
    ]
    assert all(len(found) == 1 for found in visits)
    assert visits == sorted(visits)
    assert visits[-1] == [len(poses) - 1]
    assert not [one for one, other in pairwise(poses) if one.pose.position == other.pose.position]


@pytest.mark.parametrize(
    ('places', 'fields', 'code'),
    [
        ((), {}, Through.NO_VIAPOINTS_GIVEN),
        ((KITCHEN, IN_WALL, OFFICE), {}, Through.GOAL_OCCUPIED),
        ((KITCHEN, NOWHERE), {}, Through.GOAL_OUTSIDE_MAP),
        ((KITCHEN,), {'planner_id': 'x'}, Through.INVALID_PLANNER),
        ((KITCHEN,), {'start': pose(FAR_AWAY), 'use_start': True}, Through.START_OUTSIDE_MAP),
    ],
)
def test_one_leg_that_cannot_be_planned_fails_the_whole_path(
    world: RobotProbe, places: tuple[Any, ...], fields: dict[str, Any], code: int
) -> None:
    result = aborted(through(world, *places, **fields), code)
    assert not result.path.poses


def test_every_one_of_many_requests_at_once_gets_its_own_path(world: RobotProbe) -> None:
    """More than the ten that a service keeps by default; a newer request does not take an older one's answer."""
    world.place(DOCK)
    places = [(1.0 + 0.2 * number, 3.95, 0.05 * number) for number in range(40)]
    goals = [world.plan(place) for place in places]
    for place, goal in zip(places, goals, strict=True):
        assert goal.wait().status is GoalStatus.SUCCEEDED
        assert at(ends(goal.result.path)[1], place)


def test_of_many_requests_those_that_are_canceled_have_no_path_and_the_others_have_theirs(world: RobotProbe) -> None:
    world.place(DOCK)
    goals = [world.plan(KITCHEN) for _ in range(40)]
    assert goals[10].accepted.wait(DEADLINE)
    for goal in goals[10:]:
        goal.cancel()
    assert {goal.wait().status for goal in goals[:10]} == {GoalStatus.SUCCEEDED}
    for goal in goals[10:]:
        outcome = goal.wait()
        assert outcome.status in (GoalStatus.CANCELED, GoalStatus.SUCCEEDED)
        if outcome.result is not None:
            assert bool(outcome.result.path.poses) is (outcome.status is GoalStatus.SUCCEEDED)
            assert outcome.result.error_code == Result.NONE


def test_no_path_leads_into_a_no_go_zone_that_comes_is_moved_and_goes(world: RobotProbe) -> None:
    def wait_for_plan(code: int) -> None:
        deadline = time.monotonic() + DEADLINE
        while world.plan(OFFICE).result.error_code != code:
            assert time.monotonic() < deadline, f'no plan ended with {code}'

    infos = world.runtime.call(
        lambda: world.runtime.node.create_publisher(
            CostmapFilterInfo, names.KEEPOUT_FILTER_INFO, names.transient_local_qos()
        )
    )
    world.place(DOCK)
    lawn = f'zones: {{lawn: {{kind: no_go, pose: {[*OFFICE[:2], 0.0]}, area: [1.0, 1.0]}}}}'
    world.ask(SpawnEntity, 'simulator/spawn_entity', SpawnEntity.Request(resource_string=lawn))
    wait_for_plan(Result.GOAL_OCCUPIED)
    wrong = [CostmapFilterInfo(type=2, filter_mask_topic='speed')]
    wrong += [CostmapFilterInfo(filter_mask_topic=topic) for topic in ('a b', '/clock', '/cmd_vel')]
    for info in wrong:
        infos.publish(info)  # they are no masks of areas to keep out of: that of the zone stays
    for place, code in (((9.0, 1.2, 0.0), Result.NONE), (OFFICE, Result.GOAL_OCCUPIED)):
        moved = EntityState(pose=pose(place).pose)
        world.ask(SetEntityState, 'simulator/set_entity_state', SetEntityState.Request(entity='lawn', state=moved))
        wait_for_plan(code)
    world.ask(DeleteEntity, 'simulator/delete_entity', DeleteEntity.Request(entity='lawn'))
    wait_for_plan(Result.NONE)
