# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's nodes that reach ROS for a pose, the odometry, another goal, or requests: on a live server."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Goals, Odometry
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.errors import UnfitParameterError
from flexbt_common.values.entries import from_entry
from flexbt_msgs.action import BtExecute
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, install_nodes, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=50.0) as opened:
        yield opened


def publisher(world: ServerWorld, message_type: type[Any], topic: str) -> Callable[[Any], None]:
    """Publish messages, once somebody has subscribed."""
    runtime = world.client.runtime
    made = runtime.call(lambda: runtime.node.create_publisher(message_type, topic, 1))
    wait_until(made.get_subscription_count, f'a subscription of {topic}')
    return lambda message: runtime.call(lambda: made.publish(message))


def entry(world: ServerWorld, key: str) -> Any:
    """Return what the shared blackboard has under ``key``; None when it has nothing."""
    entries = world.client.get(key).entries
    return from_entry(entries[0]) if entries else None


def counting(decorator: str, ports: str = '') -> str:
    """Return a tree that runs for ever, in which each run of the decorator's child adds one to the entry [n]."""
    return (
        f'<PipelineSequence><{decorator} {ports}><Counts key="n"/></{decorator}><Sleep msec="1000000"/>'
        '</PipelineSequence>'
    )


def cancel(goal: SentGoal) -> None:
    goal.call.cancel(DEADLINE)
    assert goal.result.code == Result.CANCELED


def test_distance_controller_follows_the_pose_of_the_robot(world: ServerWorld) -> None:
    publish = publisher(world, PoseStamped, names.POSE)
    publish(pose_stamped(0.0))
    wait_until(lambda: world.server.goals.pose, 'the pose at the server')
    world.client.load_tree(counting('DistanceController', 'distance="2"'))
    goal = world.client.execute()
    wait_until(lambda: entry(world, 'n') == 1, 'the first run of the child')
    publish(pose_stamped(1.9))
    publish(pose_stamped(2.5))
    wait_until(lambda: entry(world, 'n') == 2, 'the second run of the child')
    cancel(goal)


def test_distance_controller_fails_while_the_pose_is_not_known(world: ServerWorld) -> None:
    world.client.load_tree(counting('DistanceController'))
    result = world.client.execute().result
    assert result.code == Result.FAILURE
    assert 'it is not known where the robot is' in result.message


def test_speed_controller_begins_its_child_the_more_often_the_faster_the_robot_is(world: ServerWorld) -> None:
    world.client.load_tree(counting('SpeedController', 'min_rate="0.001" max_rate="50" max_speed="1"'))
    goal = world.client.execute()
    publish = publisher(world, Odometry, names.ODOM)
    # After the first period, the robot stands: the next run of the child is far away.
    wait_until(lambda: entry(world, 'n') == 2, 'the second run of the child')
    cancel(goal)
    driving = Odometry()
    driving.twist.twist.linear.x, driving.twist.twist.linear.y = 0.6, 0.8
    publish(driving)
    goal = world.client.execute()
    wait_until(lambda: entry(world, 'n') > 6, 'more runs of the child')
    cancel(goal)


@pytest.mark.parametrize(('branch', 'stamp', 'taken'), [
    ('jazzy', 6, True), ('jazzy', 5, False), ('jazzy', 4, False), ('main', 5, True), ('main', 4, False),
])  # fmt: skip
def test_goal_updater_takes_a_newer_goal(branch: str, stamp: int, taken: bool) -> None:
    given, other = pose_stamped(1.0), pose_stamped(2.0)
    given.header.stamp.sec, other.header.stamp.sec = 5, stamp
    with open_server_world(nav2_branch=branch, tick_rate=50.0) as world:
        world.client.load_tree(
            '<KeepRunningUntilFailure><GoalUpdater input_goal="{goal}" output_goal="{new}">'
            '<Counts key="n"/></GoalUpdater></KeepRunningUntilFailure>'
        )
        goal = world.client.execute(goals=[given])
        wait_until(lambda: entry(world, 'new') == given, 'the goal that was given')
        publish = publisher(world, PoseStamped, 'goal_update')
        publish(other)
        seen = entry(world, 'n')
        wait_until(lambda: entry(world, 'n') > seen + 3, 'some more ticks')
        assert entry(world, 'new') == (other if taken else given)
        cancel(goal)


def test_goals_to_pass_are_updated_in_main() -> None:
    """And they alone, where the tree gives no other goal."""
    with open_server_world(nav2_branch='main', tick_rate=50.0) as world:
        world.client.load_tree(
            '<KeepRunningUntilFailure><GoalUpdater input_goals="{goals}" output_goals="{new}">'
            '<Counts key="n"/></GoalUpdater></KeepRunningUntilFailure>'
        )
        given = [pose_stamped(1.0), pose_stamped(2.0)]
        given[0].header.stamp.sec = 5
        goal = world.client.execute(inputs={'goals': given}, goals=[pose_stamped(0.0)])
        wait_until(lambda: entry(world, 'new') == given, 'the goals that were given')
        publish = publisher(world, Goals, 'goals_update')
        newer = Goals(goals=[pose_stamped(7.0)])
        publish(newer)  # without a stamp
        newer.header.stamp.sec = 5
        seen = entry(world, 'n')
        wait_until(lambda: entry(world, 'n') > seen + 3, 'some more ticks')
        assert entry(world, 'new') == given
        publish(newer)
        wait_until(lambda: entry(world, 'new') == [pose_stamped(7.0)], 'the newer goals')
        cancel(goal)


def test_a_tree_is_paused_and_resumed_by_services(world: ServerWorld) -> None:
    world.client.load_tree(
        '<PauseResumeController pause_service_name="pause" resume_service_name="resume">'
        '<Sleep msec="1000000" name="work"/><Sleep msec="1000000" name="paused"/>'
        '<Counts key="pauses"/></PauseResumeController>'
    )
    links = ServiceLinks(world.client.runtime)

    def ask(service: str) -> Any:
        return service_outcome(links.link(Trigger, service), Trigger.Request(), DEADLINE).response

    def active() -> list[str]:
        return list(goal.feedback[-1].active_nodes) if goal.feedback else []

    goal = world.client.execute()
    wait_until(lambda: 'work' in active(), 'the work')
    assert not ask('resume').success
    assert ask('pause').success
    wait_until(lambda: 'paused' in active(), 'the pause')
    assert entry(world, 'pauses') == 1
    refused = ask('pause')
    assert not refused.success
    assert 'no running tree' in refused.message
    assert ask('resume').success
    wait_until(lambda: 'work' in active(), 'the work again')
    cancel(goal)
    # Nothing runs any more; the next run is found under the same names.
    assert not ask('pause').success
    goal = world.client.execute()
    wait_until(lambda: 'work' in active(), 'the work of the next run')
    assert ask('pause').success
    cancel(goal)


def test_an_unknown_branch_is_refused() -> None:
    with (
        pytest.raises(UnfitParameterError, match="'nav2_branch': there is no 'humble'; known: jazzy, main"),
        open_server_world(nav2_branch='humble'),
    ):
        pass
