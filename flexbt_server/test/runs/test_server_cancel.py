# SPDX-License-Identifier: BSD-3-Clause
"""A goal is canceled at 0 to 20 ms after it was sent, over and over: never does a leaf go on.

``FLEXBT_CANCELS=1000 pytest test_server_cancel.py -s`` does it more often, and prints where the cancels came.
"""

from __future__ import annotations

import collections
import os
import random
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_server.trees.tree_store import FoundTree, TreeStore
from flexbt_testing.behavior_trees.faulty_leaves import Work, tree_threads
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, document, install_nodes, open_server_world
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

CANCELS = int(os.environ.get('FLEXBT_CANCELS', '80'))

# Leaves of all kinds, which begin at different times: within the first tick, later, after goals of others.
TREE = (
    '<Parallel success_count="5">'
    '<Runs ms="60000" name="state"/>'
    '<Sequence><Runs ms="3"/><SlowToStop ms="60000" name="coroutine"/></Sequence>'
    '<Sequence><Runs ms="6"/><InThread ms="60000" name="thread"/></Sequence>'
    '<Sequence><Wait wait_duration="1"/><Spin name="goal"/></Sequence>'
    '<Sequence><Runs ms="9"/><Spin name="later goal" server_name="spin"/></Sequence>'
    '</Parallel>'
)


@pytest.fixture(scope='session', autouse=True)
def nodes_of_ones_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    install_nodes(tmp_path_factory.mktemp('site'), server_nodes.__name__)


@pytest.fixture
def world() -> Iterator[ServerWorld]:
    with open_server_world() as opened:
        yield opened


def test_a_cancel_at_any_moment_leaves_no_leaf_running(world: ServerWorld) -> None:
    spin, wait = world.navigation.actions[names.SPIN], world.navigation.actions[names.WAIT]
    world.navigation.hold.add(names.SPIN)
    world.client.load_tree(TREE)
    wait_until(world.client.executor.is_ready)
    chance = random.Random(5)
    places: collections.Counter[str] = collections.Counter()
    slowest = 0.0
    for number in range(CANCELS):
        # Now and then the servers of the leaves take their time to accept, or to cancel.
        spin.delay_accept = 0.004 if number % 5 == 0 else 0.0
        spin.delay_cancel = 0.01 if number % 7 == 0 else 0.0
        goal = world.client.execute()
        time.sleep(chance.choice([0.0, 0.001, 0.005, 0.02, chance.uniform(0.0, 0.02)]))
        places['accepted' if goal.call.accepted else 'not accepted yet'] += 1
        places[f'{sum(Work.running().values()) + len(spin.running)} leaves at work'] += 1
        began = uncontended_time()
        goal.call.cancel(DEADLINE)
        outcome = goal.wait()
        slowest = max(slowest, uncontended_time() - began)
        assert outcome.status is GoalStatus.CANCELED, outcome
        assert outcome.result is None or outcome.result.code == BtExecute.Result.CANCELED, outcome.result.message
        assert not Work.running(), f'after {number} cancels'
        assert not spin.running and not wait.running, f'after {number} cancels'
        assert len(goal.outcomes) == 1
    wait_until(lambda: not tree_threads(), 'the end of the threads')
    print(f'\n{CANCELS} cancels, none left a leaf running; slowest {slowest * 1000:.0f} ms; {dict(places)}')
    assert places['not accepted yet'] and places['accepted'], 'the cancels came at different moments'
    assert slowest < 2.0


def test_goals_are_canceled_while_trees_are_read_from_a_disk_that_hangs(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    goes, hangs = threading.Event(), threading.Event()
    find, load = TreeStore.find, TreeStore.load

    def wait_for_disk() -> None:
        hangs.set()
        assert goes.wait(60.0)

    def hanging_find(store: TreeStore, name: str) -> FoundTree:
        wait_for_disk()
        return find(store, name)

    def hanging_load(store: TreeStore, *arguments: Any) -> Any:
        wait_for_disk()
        return load(store, *arguments)

    reader = world.server._reader
    reader._seconds = 0.1
    watch = LivelinessWatch(world.client.runtime, 'bt_server')
    LivelinessToken(world.server_runtime).set_ready(True)
    world.client.load_tree('<Runs ms="60000"/>')
    monkeypatch.setattr(TreeStore, 'find', hanging_find)
    goal = world.client.execute()
    assert hangs.wait(DEADLINE)
    wait_until(lambda: "tree 'Main' was not read" in watch.problem, 'why the server is not ready')
    waits = world.client.execute()
    wait_until(lambda: reader.waiting == 1, 'the goal that waits for its turn')
    for each in (goal, waits):
        each.call.cancel(DEADLINE)
        assert each.wait().status is GoalStatus.CANCELED
    assert reader.waiting == 0, 'nothing is kept of a goal that has ended'
    goes.set()
    wait_until(lambda: watch.ready, 'that the disk answers')

    # It may hang for another one of those whom the thread serves.
    for event in (goes, hangs):
        event.clear()
    monkeypatch.setattr(TreeStore, 'load', hanging_load)
    loading = SentGoal(world.client.loader, BtLoad.Goal(xml=document('<Runs ms="1"/>', 'Other')))
    assert hangs.wait(DEADLINE)
    later = world.client.execute()
    wait_until(lambda: names.BT_LOADER in watch.problem, 'why the server is not ready')
    goes.set()
    assert loading.result.code == BtLoad.Result.SUCCESS
    wait_until(lambda: len(tree_threads()) == 1 and watch.ready, 'the tree of the other goal')
    later.call.cancel(DEADLINE)
    assert later.wait().status is GoalStatus.CANCELED


def test_no_goal_is_taken_over_by_an_older_one(world: ServerWorld) -> None:
    world.client.load_tree('<Sequence><Runs ms="1"/><RaisesInTick/></Sequence>')
    wait_until(world.client.executor.is_ready)
    for _ in range(40):
        goals = [world.client.execute() for _ in range(5)]
        for goal in goals:
            goal.wait()
        assert goals[-1].result.code == BtExecute.Result.ERROR, goals[-1].result.message
