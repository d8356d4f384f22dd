# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's default trees against scripted servers. The counts are those that Nav2's own tests of its trees assert."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from typing import Any

import pytest
from nav2_msgs.action import ComputePathToPose, FollowPath, Spin
from rosgraph_msgs.msg import Clock

from flexbt_common import names
from flexbt_core.behavior_tree.model.definition import NodeDefinition
from flexbt_core.behavior_tree.nodes.nav2.registration import NAV2_BRANCHES, Nav2Branch
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.stock_trees import stock_trees
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result

_PLAN = """
            <ComputePathToPose goal="{goal}" path="{path}" planner_id="{selected_planner}"
                               error_code_id="{compute_path_error_code}"/>
"""
_TREE = """
<root BTCPP_format="4" main_tree_to_execute="%(id)s">
  <BehaviorTree ID="%(id)s">
    <RecoveryNode number_of_retries="6" name="NavigateRecovery">
      <PipelineSequence name="NavigateWithReplanning">
        %(selectors)s
        <ControllerSelector selected_controller="{selected_controller}" default_controller="FollowPath"
                            topic_name="controller_selector"/>
        <PlannerSelector selected_planner="{selected_planner}" default_planner="GridBased"
                         topic_name="planner_selector"/>
        <RateController hz="1.0">
          <RecoveryNode number_of_retries="1" name="ComputePathToPose">
            %(plan)s
            <Sequence>
              <WouldAPlannerRecoveryHelp error_code="{compute_path_error_code}"/>
              <ClearEntireCostmap service_name="global_costmap/clear_entirely_global_costmap"/>
            </Sequence>
          </RecoveryNode>
        </RateController>
        <RecoveryNode number_of_retries="1" name="FollowPath">
          <FollowPath path="{path}" controller_id="{selected_controller}" error_code_id="{follow_path_error_code}"
                      %(plugins)s/>
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
DEFAULT_TREE = _TREE % {'id': 'MainTree', 'selectors': '', 'plan': _PLAN, 'plugins': ''}
DEFAULT_TREE_OF_MAIN = _TREE % {
    'id': 'NavigateToPoseWReplanningAndRecovery',
    'selectors': """
        <ProgressCheckerSelector selected_progress_checker="{progress}" default_progress_checker="progress_checker"/>
        <GoalCheckerSelector selected_goal_checker="{goal_checker}" default_goal_checker="general_goal_checker"/>
        <PathHandlerSelector selected_path_handler="{handler}" default_path_handler="path_handler"/>
    """,
    'plan': f"""
            <Fallback>
              <ReactiveSequence>
                <Inverter><GlobalUpdatedGoal/></Inverter>
                <IsGoalNearby path="{{path}}" proximity_threshold="4.0" max_robot_pose_search_dist="1.5"/>
                <TruncatePathLocal input_path="{{path}}" output_path="{{remaining_path}}" distance_forward="-1"
                                   distance_backward="0.0"/>
                <ValidatePath path="{{remaining_path}}"/>
              </ReactiveSequence>
              {_PLAN}
            </Fallback>
    """,
    'plugins': 'progress_checker_id="{progress}" goal_checker_id="{goal_checker}" path_handler_id="{handler}"',
}
"""What upstream tests in both branches: the same but for the names, main's gate before the planner, and RoundRobin."""

TREES = {'jazzy': ('MainTree', DEFAULT_TREE), 'main': ('NavigateToPoseWReplanningAndRecovery', DEFAULT_TREE_OF_MAIN)}


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world() as opened:
        yield opened


def counts(world: ServerWorld) -> dict[str, int]:
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


# How many first goals of which server fail; the result; and the goals of planner and controller, spin, wait and backup,
# and how often the global and the local costmap are cleared: in jazzy, and in main.
CASES: Any = {
    'AllSuccess': ({}, Result.SUCCESS, [1, 1, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 0]),
    'AllFailure': (
        dict.fromkeys(('compute', 'follow', 'spin', 'wait', 'backup'), ALWAYS), Result.FAILURE,
        [14, 0, 5, 5, 5, 13, 6], [4, 0, 1, 1, 1, 3, 1],
    ),
    'NavigateSubtreeRecoveries': (
        {'compute': 1, 'follow': 1}, Result.SUCCESS, [2, 2, 0, 0, 0, 1, 1], [2, 2, 0, 0, 0, 1, 1],
    ),
    'NavigateRecoverySimple': (
        {'compute': 1, 'follow': 3}, Result.SUCCESS, [3, 4, 0, 0, 0, 2, 3], [3, 4, 0, 0, 0, 2, 3],
    ),
    'NavigateRecoveryComplex': (
        {'follow': 14, 'spin': 1}, Result.FAILURE, [7, 14, 2, 2, 1, 2, 9], [3, 6, 1, 1, 1, 1, 4],
    ),
    'RecoverySubtreeGoalUpdated': ({'follow': 4}, Result.SUCCESS, [3, 5, 1, 0, 0, 1, 3], [3, 5, 1, 0, 0, 1, 3]),
}  # fmt: skip


@pytest.mark.parametrize('branch', NAV2_BRANCHES)
@pytest.mark.parametrize('case', CASES)
def test_counts_of_the_default_tree(case: str, branch: Nav2Branch) -> None:
    """On simulated time, which stands still unless the test moves it: however slow the machine is, nothing is planned
    once more meanwhile."""
    failures, code, *expected = CASES[case]
    short = {
        'compute': (names.COMPUTE_PATH_TO_POSE, PLANNER_TIMEOUT),
        'follow': (names.FOLLOW_PATH, NO_VALID_CONTROL),
        'spin': (names.SPIN, Spin.Result.TIMEOUT),
        'wait': (names.WAIT, 1),
        'backup': (names.BACKUP, 711),
    }
    id, tree = TREES[branch]
    with open_server_world(use_sim_time=True) as world:
        for name, number in failures.items():
            server, error_code = short[name]
            world.navigation.fail[server] = (number, error_code)
        set_clock(world, 100)
        assert world.client.load(xml=tree).code == BtLoad.Result.SUCCESS
        if case == 'RecoverySubtreeGoalUpdated':
            result = with_another_goal_while_it_spins(world, id)
        else:
            result = world.client.execute(id, goals=[pose_stamped(2)]).result
        assert result.code == code, result.message
        order = ('compute', 'follow', 'spin', 'wait', 'backup', 'clear global', 'clear local')
        seen = counts(world)
        assert [seen[name] for name in order] == expected[NAV2_BRANCHES.index(branch)]


@pytest.mark.parametrize('branch', NAV2_BRANCHES)
def test_a_path_is_planned_once_a_second_of_simulated_time_at_any_speed(branch: Nav2Branch) -> None:
    """Nav2's RateController goes by the machine: at 20 times real time it plans every 20 s."""
    id, tree = TREES[branch]
    with open_server_world(use_sim_time=True) as world:
        set_clock(world, 100)
        world.client.load(xml=tree)
        world.navigation.hold.add(names.FOLLOW_PATH)
        goal = world.client.execute(id, goals=[pose_stamped(2)])
        for second in range(1, 6):
            wait_until(
                lambda second=second: world.navigation.count(names.FOLLOW_PATH) == second,  # type: ignore[misc]
                f'the path of {second} s',
            )
            set_clock(world, 100 + second)
        wait_until(lambda: world.navigation.count(names.COMPUTE_PATH_TO_POSE) == 6, 'the last path')
        goal.call.cancel(DEADLINE)
        assert goal.result.code == Result.CANCELED


STOCK = 'navigate_to_pose_w_replanning_and_recovery.xml'


@pytest.mark.parametrize('branch', [branch for branch in NAV2_BRANCHES if stock_trees(branch)])
def test_these_trees_are_those_of_nav2_node_by_node(branch: Nav2Branch) -> None:
    def shape(node: NodeDefinition) -> Any:
        return node.manifest.id, [shape(child) for child in node.children]

    registry = node_registry(lambda _source, _error: None)
    id, ours = TREES[branch]
    shapes = [shape(load_xml(text, id, registry).trees[id].root) for text in (ours, stock_trees(branch)[STOCK])]
    assert shapes[0] == shapes[1]


def set_clock(world: ServerWorld, seconds: int) -> None:
    """Set simulated time, and wait until the server knows."""
    runtime, server = world.client.runtime, world.server_runtime
    publisher = runtime.call(lambda: runtime.node.create_publisher(Clock, names.CLOCK, 1))
    message = Clock()
    message.clock.sec = seconds
    wait_until(
        lambda: (publisher.publish(message), server.call(server.clock.stamp) == message.clock)[1],
        'the time at the server',
    )


def with_another_goal_while_it_spins(world: ServerWorld, tree: str) -> Any:
    """Return the result of the second goal; the spin takes 1 s."""
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    first = world.client.execute(tree, goals=[pose_stamped(1)])
    wait_until(lambda: spin.running, 'the robot to spin')
    second = world.client.execute(tree, goals=[pose_stamped(2)])
    assert first.result.code == Result.CANCELED
    set_clock(world, 101)
    spin.end(0)
    return second.result


@pytest.mark.parametrize(('recovery', 'failures'), [(names.SPIN, 4), (names.WAIT, 6), (names.BACKUP, 8)])
def test_the_goal_changes_during_a_recovery_which_ends_before_the_robot_drives_there(
    world: ServerWorld, recovery: str, failures: int
) -> None:
    """GoalUpdated does not end a recovery, as in Nav2 (its issue 6082)."""
    world.navigation.fail[names.FOLLOW_PATH] = (failures, NO_VALID_CONTROL)
    world.navigation.hold.add(recovery)
    server, follow = world.navigation.actions[recovery], world.navigation.actions[names.FOLLOW_PATH]
    world.client.load(xml=DEFAULT_TREE)
    world.client.execute('MainTree', goals=[pose_stamped(1)])
    wait_until(lambda: server.running, 'the recovery')
    second = world.client.execute('MainTree', goals=[pose_stamped(2)])
    wait_until(lambda: second.feedback, 'the run to be taken over')
    assert (server.running, len(follow.goals)) == ([0], failures)
    server.end(0)
    assert second.result.code == Result.SUCCESS
    assert server.statuses == {0: 'succeed'}
    assert follow.goals[-1].path.poses[-1] == pose_stamped(2)


def test_who_cancels_the_controller_stops_the_robot_and_no_recovery_drives_on(world: ServerWorld) -> None:
    """Nav2 takes it for a success; here it is none, but no code asks for a recovery."""
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load(xml=DEFAULT_TREE)
    goal = world.client.execute('MainTree', goals=[pose_stamped(1)])
    wait_until(lambda: follow.running, 'the robot to drive')
    world.client.load_tree('<CancelControl/>', 'Joystick')
    assert world.client.execute('Joystick', blackboard='other').result.code == Result.SUCCESS
    assert (goal.result.code, goal.result.error_code) == (Result.FAILURE, 0)
    assert follow.statuses == {0: 'canceled'}
    assert sum(counts(world).values()) == 2


def test_a_goal_outside_the_map_fails_without_recovery(world: ServerWorld) -> None:
    world.navigation.fail[names.COMPUTE_PATH_TO_POSE] = (ALWAYS, ComputePathToPose.Result.GOAL_OUTSIDE_MAP)
    world.client.load(xml=DEFAULT_TREE)
    result = world.client.execute('MainTree', goals=[pose_stamped(100)]).result
    assert (result.code, result.error_code) == (Result.FAILURE, ComputePathToPose.Result.GOAL_OUTSIDE_MAP)
    assert counts(world)['compute'] == 1
    assert sum(counts(world).values()) == 1


def test_the_goal_is_replaced_without_stopping_the_robot(world: ServerWorld) -> None:
    world.navigation.hold.add(names.FOLLOW_PATH)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.client.load(xml=DEFAULT_TREE)
    world.client.execute('MainTree', goals=[pose_stamped(1)])
    wait_until(lambda: follow.running)
    second = world.client.execute('MainTree', goals=[pose_stamped(2)])
    wait_until(lambda: follow.goals[-1].path.poses[-1] == pose_stamped(2), 'the path to the new goal')
    wait_until(lambda: follow.running == [len(follow.goals) - 1], 'the end of the goal before')
    assert 'canceled' not in follow.statuses.values()
    follow.end(len(follow.goals) - 1)
    assert second.result.code == Result.SUCCESS


def test_cancel_during_a_recovery(world: ServerWorld) -> None:
    world.navigation.fail[names.FOLLOW_PATH] = (ALWAYS, NO_VALID_CONTROL)
    world.navigation.hold.add(names.SPIN)
    spin = world.navigation.actions[names.SPIN]
    world.client.load(xml=DEFAULT_TREE)
    goal = world.client.execute('MainTree', goals=[pose_stamped(1)])
    wait_until(lambda: spin.running)
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED
    assert spin.statuses == {0: 'canceled'}
    wait_until(lambda: not goal.feedback or goal.feedback[-1].number_of_recoveries >= 0)


def test_from_the_result_of_a_leaf_to_the_next_goal_takes_little_time(world: ServerWorld) -> None:
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
