# SPDX-License-Identifier: BSD-3-Clause
"""BtGetData and BtSetData on a live server: typed, all or nothing, apart by blackboard."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.values.entries import Encoding, from_entry, to_entry
from flexbt_msgs.action import BtExecute, BtGetData, BtSetData
from flexbt_msgs.msg import BlackboardEntry
from flexbt_server.trees.tree_store import TreeStore
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until


@pytest.fixture(scope='module')
def world() -> Iterator[ServerWorld]:
    with open_server_world() as opened:
        yield opened


VALUES: list[tuple[str, Any, str]] = [
    ('flag', True, 'bool'),
    ('tiny', -5, 'int8'),
    ('code', 65535, 'uint16'),
    ('count', 7, 'int64'),
    ('large', 2**64 - 1, 'uint64'),
    ('real', math.pi, 'float64'),
    ('infinite', -math.inf, 'float64'),
    ('text', 'grüß "Gott"', 'string'),
    ('number_like', '12', 'string'),
    ('pose', pose_stamped(1, 2), 'geometry_msgs/msg/PoseStamped'),
    ('path', Path(poses=[pose_stamped(1), pose_stamped(2)]), 'nav_msgs/msg/Path'),
    ('poses', [pose_stamped(1), pose_stamped(2)], 'geometry_msgs/msg/PoseStamped[]'),
    ('no_poses', [], 'geometry_msgs/msg/PoseStamped[]'),
    ('reals', [1.5, 2.5], 'float64[]'),
    ('no_texts', [], 'string[]'),
]


@pytest.mark.parametrize('encoding', list(Encoding))
def test_what_is_written_is_read_back_with_its_type(world: ServerWorld, encoding: Encoding) -> None:
    board = f'values {encoding}'
    written = world.client.set(*(to_entry(key, value, type, encoding) for key, value, type in VALUES), blackboard=board)
    assert written.code == BtSetData.Result.SUCCESS, written.message
    read = world.client.get(*(key for key, _, _ in VALUES), blackboard=board, encoding=int(encoding))
    assert read.code == BtGetData.Result.SUCCESS, read.message
    assert [(entry.key, from_entry(entry), entry.type) for entry in read.entries] == VALUES
    everything = world.client.get(blackboard=board)
    assert [entry.key for entry in everything.entries] == sorted(key for key, _, _ in VALUES)


def test_text_as_written_in_a_shell(world: ServerWorld) -> None:
    entry = BlackboardEntry(key='goal', type='geometry_msgs/PoseStamped', text='{pose: {position: {x: 1.5}}}')
    assert world.client.set(entry, blackboard='shell').code == BtSetData.Result.SUCCESS
    (read,) = world.client.get('goal', blackboard='shell').entries
    assert isinstance(value := from_entry(read), PoseStamped)
    assert value.pose.position.x == 1.5


@pytest.mark.parametrize(
    ('bad', 'fragments'),
    [
        (BlackboardEntry(key='b', type='float64', text='fast'), ['b', 'float64', 'fast']),
        (BlackboardEntry(key='b', type='no_such_msgs/msg/Thing', text='1'), ['b', 'no_such_msgs']),
        (BlackboardEntry(key='', type='float64', text='1'), ['key']),
        (BlackboardEntry(key='typed', type='string', text='not a path'), ['typed']),
        (BlackboardEntry(key='poses', type='string[]', text='[a, b]'), ['poses', 'PoseStamped[]', 'string[]']),
    ],
)
def test_a_refused_entry_writes_nothing_of_the_goal(
    world: ServerWorld, bad: BlackboardEntry, fragments: list[str]
) -> None:
    board = f'refused {bad.key} {bad.type}'
    poses = to_entry('poses', [], 'geometry_msgs/msg/PoseStamped[]')
    before = (to_entry('typed', Path()), poses, to_entry('a', 1))
    assert world.client.set(*before, blackboard=board).code == BtSetData.Result.SUCCESS
    result = world.client.set(to_entry('a', 2), bad, blackboard=board)
    assert result.code == BtSetData.Result.FAILURE
    for fragment in fragments:
        assert fragment in result.message
    (entry,) = world.client.get('a', blackboard=board).entries
    assert from_entry(entry) == 1


def test_missing_keys_are_named_and_the_others_given(world: ServerWorld) -> None:
    world.client.set(to_entry('there', 1), blackboard='partial')
    result = world.client.get('nowhere', 'there', blackboard='partial')
    assert result.code == BtGetData.Result.FAILURE
    assert "'nowhere'" in result.message and "'partial'" in result.message
    assert [entry.key for entry in result.entries] == ['there']


@pytest.mark.parametrize('fault', [RuntimeError('very ' * 100 + 'broken'), SystemExit('of a library')])
def test_an_internal_fault_is_told_in_full(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch, fault: BaseException
) -> None:
    """To who waits, and to the node on its own thread."""
    told: list[tuple[BaseException, bool]] = []
    runtime = world.server_runtime
    runtime.on_fault(lambda error: told.append((error, runtime.on_executor_thread)))

    def fails(*_: Any) -> None:
        raise fault

    monkeypatch.setattr('flexbt_server.actions.data_servers.entries_of', fails)
    for name in ('find', 'load'):
        monkeypatch.setattr(TreeStore, name, fails)
    client = world.client
    for result in (client.get('there', blackboard='partial'), client.load('a.xml'), client.execute().result):
        assert (result.code, result.message) == (result.ERROR, f'fault in the BT server: {fault!r}')
    assert told == [(fault, True)] * 3


def test_blackboards_are_apart_and_the_shared_one_is_shared_by_trees(world: ServerWorld) -> None:
    world.client.load_tree('<ComputePathToPose goal="{goal}" path="{path}"/>', 'Planner')
    world.client.load_tree('<FollowPath path="{path}"/>', 'Controller')
    assert world.client.execute('Planner', goals=[pose_stamped(4)]).result.code == BtExecute.Result.SUCCESS
    assert world.client.execute('Controller').result.code == BtExecute.Result.SUCCESS
    follow = world.navigation.actions['follow_path']
    assert follow.goals[-1].path.poses[-1] == pose_stamped(4)
    apart = world.client.execute('Controller', blackboard='apart')
    assert apart.wait(DEADLINE).status is GoalStatus.ABORTED
    assert 'path' in apart.result.message


def test_a_write_wakes_the_tree_that_runs_on_the_blackboard(world: ServerWorld) -> None:
    world.navigation.hold.add('follow_path')
    follow = world.navigation.actions['follow_path']
    world.client.load_tree('<FollowPath path="{path}"/>', 'Follower')
    world.client.set(to_entry('path', Path(poses=[pose_stamped(1)])), blackboard='woken')
    goal = world.client.execute('Follower', blackboard='woken')
    wait_until(lambda: follow.running)
    world.client.set(to_entry('path', Path(poses=[pose_stamped(7)])), blackboard='woken')
    wait_until(lambda: follow.goals[-1].path.poses[-1] == pose_stamped(7))
    follow.end(len(follow.goals) - 1)
    assert goal.result.code == BtExecute.Result.SUCCESS
    world.navigation.hold.clear()
