# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that ask a service: they answer within the tick, and a tick that waits holds up nobody else."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from nav2_msgs.srv import GetCost, IsPathValid
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.behavior_tree.engine.tick_control import TickCommand
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_server.leaves import service_leaf
from flexbt_testing.nodes.server_world import ServerWorld, document, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result
NEVER = 600_000
"""Longer than a test waits for anything, ms."""


@pytest.fixture(scope='module')
def opened() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=50.0) as world:
        yield world


@pytest.fixture
def world(opened: ServerWorld, monkeypatch: pytest.MonkeyPatch) -> ServerWorld:
    """Return the one world, with servers that have forgotten what they were asked for, and that answer soon, however
    busy the machine is."""
    monkeypatch.setattr(service_leaf, 'ANSWER_SECONDS', DEADLINE)
    for server in opened.navigation.actions.values():
        server.forget()
    opened.navigation.hold.clear()
    opened.navigation.path_valid = True
    return opened


class Stuck:
    """A service whose node does not answer before it is let go."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.asked = threading.Event()
        self.may_answer = threading.Event()
        runtime.call(lambda: runtime.node.create_service(IsPathValid, 'stuck/is_path_valid', self._answer))

    def _answer(self, request: Any, response: Any) -> Any:
        self.asked.set()
        self.may_answer.wait(DEADLINE)
        response.is_valid = True
        return response


@pytest.fixture
def stuck() -> Iterator[Stuck]:
    with NodeRuntime.open('stuck') as runtime:
        service = Stuck(runtime)
        yield service
        service.may_answer.set()


@pytest.mark.parametrize('body', [
    '<ReactiveFallback><IsPathValid path="{path}"/>{action}</ReactiveFallback>',
    '<ReactiveFallback><ValidatePath path="{path}"/>{action}</ReactiveFallback>',
    '<ReactiveSequence><Inverter><IsPathValid path="{path}"/></Inverter>{action}</ReactiveSequence>',
    '<ReactiveSequence><ClearEntireCostmap service_name="' + names.CLEAR_LOCAL_COSTMAP + '"/>{action}'
    '</ReactiveSequence>',
    '<ReactiveSequence><CancelSpin/>{action}</ReactiveSequence>',
    '<WhileDoElse><IsPathValid path="{path}"/><AlwaysFailure/>{action}</WhileDoElse>',
])  # fmt: skip
def test_an_action_behind_a_service_below_a_reactive_control_is_not_begun_anew(world: ServerWorld, body: str) -> None:
    """Reported with Nav2 (3907): IsPathValid before ComputePathToPose."""
    world.navigation.hold.add(names.COMPUTE_PATH_TO_POSE)
    planner = world.navigation.actions[names.COMPUTE_PATH_TO_POSE]
    world.client.load_tree(body.replace('{action}', '<ComputePathToPose goal="{goal}" path="{path}"/>'))
    goal = world.client.execute(goals=[pose_stamped(3.0)], blackboard=body)
    wait_until(lambda: planner.goals, 'the planner is asked')
    seen = len(goal.feedback)
    wait_until(lambda: len(goal.feedback) > seen + 3, 'many ticks have gone by')
    assert (planner.running, planner.cancels) == ([0], 0)
    planner.end(0)
    assert goal.result.code == Result.SUCCESS, goal.result.message
    assert len(planner.goals) == 1


def test_several_requests_of_a_leaf_are_answered_within_the_tick(world: ServerWorld) -> None:
    name = 'global_costmap/get_cost_global_costmap'
    runtime, asked = world.navigation_runtime, []

    def answer(request: Any, response: Any) -> Any:
        asked.append(request.x)
        response.cost = 254.0 if request.x == 2.0 else 0.0
        return response

    service = runtime.call(lambda: runtime.node.create_service(GetCost, name, answer))
    removal = f'<RemoveInCollisionGoals service_name="{name}" input_goals="{{goals}}" output_goals="{{left}}"/>'
    world.client.load_tree(f'<ReactiveSequence>{removal}<Wait wait_duration="1"/></ReactiveSequence>')
    world.navigation.hold.add(names.WAIT)
    wait = world.navigation.actions[names.WAIT]
    goal = world.client.execute(inputs={'goals': [pose_stamped(1), pose_stamped(2)]}, blackboard='several')
    wait_until(lambda: len(asked) > 8 and wait.goals, 'several ticks have asked')
    wait.end(0)
    assert goal.result.code == Result.SUCCESS, goal.result.message
    assert (len(wait.goals), wait.cancels) == (1, 0)
    runtime.call(lambda: runtime.node.destroy_service(service))


@pytest.mark.parametrize('leaf', ['IsPathValid', 'ValidatePath'])
def test_a_tick_that_waits_for_an_answer_does_not_hold_up_a_cancel(world: ServerWorld, stuck: Stuck, leaf: str) -> None:
    ask = f'<{leaf} service_name="stuck/is_path_valid" server_timeout="{NEVER}"/>'
    world.client.load_tree(f'<Sequence>{ask}<Wait wait_duration="1"/></Sequence>')
    goal = world.client.execute()
    assert stuck.asked.wait(DEADLINE)
    goal.cancel()
    assert goal.result.code == Result.CANCELED, goal.result.message
    assert not stuck.may_answer.is_set()
    assert not world.navigation.actions[names.WAIT].goals


def test_a_tree_that_asks_again_and_again_can_be_paused(world: ServerWorld) -> None:
    """Each attempt is made within the tick, and the next follows at once."""
    world.navigation.path_valid = False
    world.client.load_tree(
        '<RetryUntilSuccessful num_attempts="-1"><IsPathValid path="{path}"/></RetryUntilSuccessful>'
    )
    goal = world.client.execute(inputs={'path': Path(poses=[pose_stamped(1.0)])}, blackboard='again')
    running_trees = world.server.goals.running
    [running] = wait_until(lambda: [one for one in running_trees.all() if one.blackboard == 'again'], 'the run')
    answers: list[str] = []
    running.run.control(TickCommand.PAUSE, answers.append)
    wait_until(lambda: answers == [''], 'the tree is paused')
    running.run.control(TickCommand.RESUME, answers.append)
    world.navigation.path_valid = True
    assert goal.result.code == Result.SUCCESS, goal.result.message


def test_a_node_that_yields_is_ticked_again_at_once_after_a_leaf_has_waited() -> None:
    """Not at the tick rate, with which this tree would take five minutes."""
    with open_server_world(tick_rate=0.1) as world:
        world.client.load_tree('<Repeat num_cycles="30"><IsPathValid path="{path}"/></Repeat>')
        path = Path(poses=[pose_stamped(1.0)])
        assert world.client.execute(inputs={'path': path}).result.code == Result.SUCCESS


def test_other_trees_go_on_while_one_waits_for_an_answer(world: ServerWorld, stuck: Stuck) -> None:
    world.client.load_tree(f'<IsPathValid service_name="stuck/is_path_valid" server_timeout="{NEVER}"/>', 'Waits')
    waits = world.client.execute('Waits', blackboard='waits')
    assert stuck.asked.wait(DEADLINE)
    world.client.load_tree('<Wait wait_duration="1"/>', 'Other')
    assert world.client.execute('Other').result.code == Result.SUCCESS
    assert not waits.ended
    stuck.may_answer.set()
    assert waits.result.code == Result.SUCCESS


def test_a_condition_that_is_not_answered_fails_in_time_and_its_tree_does_not_count_as_one_that_hangs(
    world: ServerWorld, stuck: Stuck, capfd: pytest.CaptureFixture[str]
) -> None:
    world.client.load_tree('<IsPathValid service_name="stuck/is_path_valid" server_timeout="1300"/>')
    result = world.client.execute().result
    assert result.code == Result.FAILURE
    assert re.search("'stuck/is_path_valid'.* did not answer within 1.3 s", result.message)
    told = capfd.readouterr().err
    assert 'has not answered' not in told
    assert 'ticks took longer' not in told


def test_a_service_that_is_not_there_is_no_hang_either(world: ServerWorld) -> None:
    world.client.load_tree('<CancelSpin server_name="nobody" server_timeout="30"/>')
    result = world.client.execute().result
    assert result.code == Result.FAILURE
    assert 'nobody/_action/cancel_goal' in result.message


KEEP_PATH = """
<PipelineSequence>
  <RateController hz="20">
    <ReactiveFallback>
      <ReactiveSequence><Inverter><GlobalUpdatedGoal/></Inverter><IsPathValid path="{path}"/></ReactiveSequence>
      <ComputePathToPose goal="{goal}" path="{path}"/>
    </ReactiveFallback>
  </RateController>
  <FollowPath path="{path}"/>
</PipelineSequence>
"""
KEEP_PATH_THROUGH = KEEP_PATH.replace('ComputePathToPose goal="{goal}"', 'ComputePathThroughPoses goals="{goals}"')


@pytest.mark.parametrize(('body', 'before'), [(KEEP_PATH, []), (KEEP_PATH_THROUGH, [pose_stamped(1.0)])])
def test_a_new_goal_is_driven_to_by_a_tree_that_plans_when_the_path_is_invalid(
    world: ServerWorld, body: str, before: list[Any]
) -> None:
    """Reported with Nav2 (3156, 3090, 3907): the path of the goal before was driven."""
    assert world.client.load(xml=document(body, 'Keep')).code == BtLoad.Result.SUCCESS
    follow = world.navigation.actions[names.FOLLOW_PATH]
    world.navigation.hold.add(names.FOLLOW_PATH)
    first = world.client.execute('Keep', goals=[*before, pose_stamped(3.0)])
    wait_until(lambda: follow.goals, 'the controller drives')
    first.cancel()
    assert first.result.code == Result.CANCELED
    second = world.client.execute('Keep', goals=[*before, pose_stamped(-4.0)])
    wait_until(lambda: len(follow.goals) > 1, 'the controller drives again')
    assert follow.goals[1].path.poses[-1] == pose_stamped(-4.0)
    # And one that takes the run over.
    third = world.client.execute('Keep', goals=[*before, pose_stamped(5.0)])
    assert second.result.code == Result.CANCELED
    wait_until(lambda: len(follow.goals) > 2, 'the controller has the newest path')
    assert follow.goals[2].path.poses[-1] == pose_stamped(5.0)
    follow.end(2)
    assert third.result.code == Result.SUCCESS, third.result.message


def test_a_path_that_is_given_with_the_goal_counts(world: ServerWorld) -> None:
    body = '<Fallback><IsPathValid path="{path}"/><ComputePathToPose goal="{goal}" path="{path}"/></Fallback>'
    world.client.load_tree(body)
    planner = world.navigation.actions[names.COMPUTE_PATH_TO_POSE]
    given = Path(poses=[pose_stamped(0.0), pose_stamped(1.0)])
    assert world.client.execute(goals=[pose_stamped(1.0)], inputs={'path': given}).result.code == Result.SUCCESS
    assert not planner.goals
    assert world.client.execute(goals=[pose_stamped(2.0)]).result.code == Result.SUCCESS
    assert len(planner.goals) == 1


def test_a_tree_without_a_planner_has_the_path_that_another_has_planned(world: ServerWorld) -> None:
    world.client.load_tree('<ComputePathToPose goal="{goal}" path="{path}"/>', 'Plans')
    assert world.client.execute('Plans', goals=[pose_stamped(7.0)]).result.code == Result.SUCCESS
    world.client.load_tree('<FollowPath path="{path}"/>', 'Drives')
    assert world.client.execute('Drives').result.code == Result.SUCCESS
    assert world.navigation.actions[names.FOLLOW_PATH].goals[0].path.poses[-1] == pose_stamped(7.0)
