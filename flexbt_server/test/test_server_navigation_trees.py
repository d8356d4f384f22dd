# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's default tree against scripted servers. The counts are those that Nav2's own tree tests assert (Jazzy)."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from nav2_msgs.action import ComputePathToPose, FollowPath, Spin

from flexbt_common import names
from flexbt_msgs.action import BtExecute
from flexbt_testing.nodes.server_world import DEADLINE, World, open_world, pose
from flexbt_testing.waiting import wait_until

Result = BtExecute.Result

DEFAULT_TREE = """
<root BTCPP_format="4" main_tree_to_execute="MainTree">
  <BehaviorTree ID="MainTree">
    <RecoveryNode number_of_retries="6" name="NavigateRecovery">
      <PipelineSequence name="NavigateWithReplanning">
        <ControllerSelector selected_controller="{selected_controller}" default_controller="FollowPath"
                            topic_name="controller_selector"/>
        <PlannerSelector selected_planner="{selected_planner}" default_planner="GridBased"
                         topic_name="planner_selector"/>
        <RateController hz="1.0">
          <RecoveryNode number_of_retries="1" name="ComputePathToPose">
            <ComputePathToPose goal="{goal}" path="{path}" planner_id="{selected_planner}"
                               error_code_id="{compute_path_error_code}"/>
            <Sequence>
              <WouldAPlannerRecoveryHelp error_code="{compute_path_error_code}"/>
              <ClearEntireCostmap service_name="global_costmap/clear_entirely_global_costmap"/>
            </Sequence>
          </RecoveryNode>
        </RateController>
        <RecoveryNode number_of_retries="1" name="FollowPath">
          <FollowPath path="{path}" controller_id="{selected_controller}" error_code_id="{follow_path_error_code}"/>
          <Sequence>
            <WouldAControllerRecoveryHelp error_code="{follow_path_error_code}"/>
            <ClearEntireCostmap service_name="local_costmap/clear_entirely_local_costmap"/>
          </Sequence>
        </RecoveryNode>
      </PipelineSequence>
      <Sequence>
        <Fallback>
          <WouldAControllerRecoveryHelp error_code="{follow_path_error_code}"/>
          <WouldAPlannerRecoveryHelp error_code="{compute_path_error_code}"/>
        </Fallback>
        <ReactiveFallback name="RecoveryFallback">
          <GoalUpdated/>
          <RoundRobin name="RecoveryActions">
            <Sequence name="ClearingActions">
              <ClearEntireCostmap service_name="local_costmap/clear_entirely_local_costmap"/>
              <ClearEntireCostmap service_name="global_costmap/clear_entirely_global_costmap"/>
            </Sequence>
            <Spin spin_dist="1.57" error_code_id="{spin_error_code}"/>
            <Wait wait_duration="5.0"/>
            <BackUp backup_dist="0.30" backup_speed="0.15" error_code_id="{backup_code_id}"/>
          </RoundRobin>
        </ReactiveFallback>
      </Sequence>
    </RecoveryNode>
  </BehaviorTree>
</root>
"""

STOCK_TREES = Path(os.environ.get('FLEXBT_SHARED_DATA', Path(__file__).parents[3] / 'shared/data')) / 'nav2/jazzy_trees'


@pytest.fixture
def world() -> Iterator[World]:
    with open_world() as opened:
        yield opened


def counts(world: World) -> dict[str, int]:
    navigation = world.navigation
    names_of = {
        'compute': names.COMPUTE_PATH_TO_POSE, 'follow': names.FOLLOW_PATH, 'spin': names.SPIN, 'wait': names.WAIT,
        'backup': names.BACKUP,
    }  # fmt: skip
    return {short: navigation.count(name) for short, name in names_of.items()} | {
        f'clear {which}': number for which, number in navigation.cleared.items()
    }


PLANNER_TIMEOUT = ComputePathToPose.Result.TIMEOUT
NO_VALID_CONTROL = FollowPath.Result.NO_VALID_CONTROL
ALWAYS = 1000


@pytest.mark.parametrize(
    ('failures', 'code', 'expected'),
    [
        pytest.param({}, Result.SUCCESS, [1, 1, 0, 0, 0, 0, 0], id='all succeed'),
        pytest.param(
            dict.fromkeys(('compute', 'follow', 'spin', 'wait', 'backup'), ALWAYS),
            Result.FAILURE, [14, 0, 5, 5, 5, 13, 6], id='all fail',
        ),
        pytest.param({'compute': 1, 'follow': 1}, Result.SUCCESS, [2, 2, 0, 0, 0, 1, 1], id='contextual recoveries'),
        pytest.param({'compute': 1, 'follow': 3}, Result.SUCCESS, [3, 4, 0, 0, 0, 2, 3], id='simple recovery'),
        pytest.param({'follow': 14, 'spin': 1}, Result.FAILURE, [7, 14, 2, 2, 1, 2, 9], id='complex recovery'),
    ],
)  # fmt: skip
def test_counts_of_the_default_tree(world: World, failures: dict[str, int], code: int, expected: list[int]) -> None:
    short = {
        'compute': (names.COMPUTE_PATH_TO_POSE, PLANNER_TIMEOUT),
        'follow': (names.FOLLOW_PATH, NO_VALID_CONTROL),
        'spin': (names.SPIN, Spin.Result.TIMEOUT),
        'wait': (names.WAIT, 1),
        'backup': (names.BACKUP, 711),
    }
    for name, number in failures.items():
        server, error_code = short[name]
        world.navigation.fail[server] = (number, error_code)
    assert world.client.load(xml=DEFAULT_TREE).code == 1
    result = world.client.execute('MainTree', goals=[pose(2)]).result
    assert result.code == code, result.message
    order = ('compute', 'follow', 'spin', 'wait', 'backup', 'clear global', 'clear local')
    seen = counts(world)
    assert [seen[name] for name in order] == expected


def test_a_goal_outside_the_map_fails_without_recovery(world: World) -> None:
    world.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (ALWAYS, ComputePathToPose.Result.GOAL_OUTSIDE_MAP)
    world.client.load(xml=DEFAULT_TREE)
    result = world.client.execute('MainTree', goals=[pose(100)]).result
    assert (result.code, result.error_code) == (Result.FAILURE, ComputePathToPose.Result.GOAL_OUTSIDE_MAP)
    assert counts(world)['compute'] == 1
    assert sum(counts(world).values()) == 1


def test_the_goal_is_replaced_without_stopping_the_robot(world: World) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load(xml=DEFAULT_TREE)
    world.client.execute('MainTree', goals=[pose(1)])
    wait_until(lambda: follow.running)
    second = world.client.execute('MainTree', goals=[pose(2)])
    wait_until(lambda: follow.goals[-1].path.poses[-1] == pose(2), 'the path to the new goal')
    assert follow.running == [len(follow.goals) - 1]
    assert 'canceled' not in follow.statuses.values()
    follow.end(len(follow.goals) - 1)
    assert second.result.code == Result.SUCCESS


def test_cancel_during_a_recovery(world: World) -> None:
    world.navigation.fail[names.FOLLOW_PATH] = (ALWAYS, NO_VALID_CONTROL)
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    world.client.load(xml=DEFAULT_TREE)
    goal = world.client.execute('MainTree', goals=[pose(1)])
    wait_until(lambda: spin.running)
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED
    assert spin.statuses == {0: 'canceled'}
    wait_until(lambda: not goal.feedback or goal.feedback[-1].number_of_recoveries >= 0)


def test_from_the_result_of_a_leaf_to_the_next_goal_takes_little_time(world: World) -> None:
    """Event-driven: the median is far below the period of a polling tick (Nav2: 10 ms, here 100 ms at most)."""
    leaves = 40
    spin = world.navigation.actions[names.SPIN]
    times: list[float] = []

    def answer(number: int, goal: Any) -> Any:
        times.append(time.perf_counter())
        return 'succeed', Spin.Result()

    spin.answer = answer
    world.client.load_tree('<Sequence>' + '<Spin/>' * leaves + '</Sequence>')
    assert world.client.execute().result.code == Result.SUCCESS
    gaps = sorted(later - earlier for earlier, later in itertools.pairwise(times))
    assert gaps[len(gaps) // 2] < 0.03, f'median {gaps[len(gaps) // 2] * 1e3:.1f} ms'


needs_stock_trees = pytest.mark.skipif(not STOCK_TREES.is_dir(), reason="Nav2's trees are not on this machine")


@needs_stock_trees
def test_nav2s_own_default_file_runs_as_it_is() -> None:
    with open_world(allowed_directories=[str(STOCK_TREES)]) as world:
        file = str(STOCK_TREES / 'navigate_to_pose_w_replanning_and_recovery.xml')
        assert world.client.load(file).code == 1
        assert world.client.execute(file, goals=[pose(1)]).result.code == Result.SUCCESS


@needs_stock_trees
@pytest.mark.parametrize(
    ('file', 'goals'),
    [
        ('navigate_w_replanning_time.xml', 1),
        ('navigate_w_replanning_only_if_goal_is_updated.xml', 1),
        ('navigate_w_replanning_only_if_path_becomes_invalid.xml', 1),
        ('navigate_w_recovery_and_replanning_only_if_path_becomes_invalid.xml', 1),
        ('navigate_through_poses_w_replanning_and_recovery.xml', 3),
        ('odometry_calibration.xml', 0),
    ],
)
def test_other_stock_files_run_as_they_are(file: str, goals: int) -> None:
    with open_world(allowed_directories=[str(STOCK_TREES)]) as world:
        path = str(STOCK_TREES / file)
        runtime = world.navigation_runtime
        robot = runtime.call(lambda: runtime.node.create_publisher(type(pose(0)), names.POSE, names.latched()))
        wait_until(lambda: (robot.publish(pose(0)), world.server.goals.pose)[1])
        result = world.client.execute(path, goals=[pose(number + 1) for number in range(goals)]).result
        assert result.code == Result.SUCCESS, result.message
