# SPDX-License-Identifier: BSD-3-Clause
"""Watching a tree: a log tells what other observers hear, in the same order, and nothing more."""

from __future__ import annotations

import operator
import random
from collections.abc import Callable
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.observers import LogReader, StatusLog
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees.random_trees import script_case, wheel_case
from flexbt_testing.behavior_trees.scripted_nodes import NAMES
from flexbt_testing.behavior_trees.user_node_trees import make, random_body, run_some

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus


def transition(uid: int, before: int, after: int) -> tuple[int, int, int]:
    return uid, before, after


Heard = list[tuple[int, NodeStatus, NodeStatus]]


def on_board(body: str) -> Tree:
    board = Blackboard()
    board.set('n', 1)
    return make(body, blackboard=board, max_rounds=50)


def lives(seeds: range, watch: Callable[[str], tuple[Tree, Callable[[], Heard]]]) -> list[Heard]:
    """Return what is heard of random trees in some steps of their lives."""
    found = []
    for seed in seeds:
        tree, heard = watch(random_body(seed))
        for step in range(25):
            run_some(tree, seed * 100 + step)
        found.append(heard())
        statuses = [IDLE] * len(tree.nodes)
        for uid, before, after in found[-1]:
            assert statuses[uid - 1] is before is not after
            statuses[uid - 1] = after
        assert statuses == [node.status for node in tree.nodes], f'seed {seed}'
    return found


def observed(body: str) -> tuple[Tree, Callable[[], Heard]]:
    heard: Heard = []
    tree = on_board(body)
    tree.observe(lambda node, before, after: heard.append((node.uid, before, after)))
    return tree, lambda: heard


def recorded(body: str) -> tuple[Tree, Callable[[], Heard]]:
    log: list[int] = []
    tree = on_board(body)
    tree.observe(StatusLog(log))
    reader = LogReader(tree.nodes, transition)
    return tree, lambda: [(uid, NodeStatus(one), NodeStatus(other)) for uid, one, other in reader.read(log)]


@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('block', range(3))
def test_all_ways_of_watching_hear_the_same(block: int) -> None:
    seeds = range(block * 70, (block + 1) * 70)
    told, logged = lives(seeds, observed), lives(seeds, recorded)
    for seed, one, two in zip(seeds, told, logged, strict=True):
        assert one == two, f'seed {seed}: {random_body(seed)}'
    assert sum(map(len, told)) > 1000


class RecordedRun(bt_scripted.Run):
    """The same run, recorded from some step on, and observed from another on."""

    def __init__(self, case: dict[str, Any], seed: int) -> None:
        super().__init__(case, observed=False)
        self._random = random.Random(seed)
        self._begin = self._random.choice((0, 0, 1, 3))
        self._steps = 0
        self.changes: list[list[Any]] = []
        self.log: list[int] | None = None

    def _step(self, tree: Tree, op: list[Any]) -> dict[str, Any]:
        begins = self.log is None and self._steps >= self._begin
        if begins:
            self._reader, self.log, self.began = LogReader(tree.nodes, transition), [], self._steps
        if begins or self._random.random() < 0.2:
            others = self._random.choice(([], [lambda *event: None]))
            tree.observe(*([] if self.log is None else [StatusLog(self.log)]), *others)
        step = super()._step(tree, op)
        self._steps += 1
        if self.log is not None:
            read = self._reader.read(self.log)
            self.changes += [
                [tree.nodes[uid - 1].name, NAMES[NodeStatus(a)], NAMES[NodeStatus(b)]] for uid, a, b in read
            ]
            self.log.clear()
            assert list(self._reader.statuses[1:]) == [node.status for node in tree.nodes]
        return step


def test_a_node_is_running_at_its_completion_as_its_class_declares() -> None:
    """Nodes of the engine without conditions, which complete a node without a tick; and not where a result stood."""
    checked: set[bool] = set()
    begun: dict[TreeNode, NodeStatus] = {}

    def begin(node: TreeNode) -> NodeStatus:
        begun[node] = node.status
        return IDLE

    def check(node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        of_engine = type(node).__module__.startswith('flexbt_core.') and node.conditions is None
        declared = node.running_at_completion if of_engine else None
        if declared is not None and before in (IDLE, RUNNING) and after in (SUCCESS, FAILURE):
            assert before is (RUNNING if declared else begun[node]), node
            checked.add(declared)

    for seed in range(100):
        tree = on_board(random_body(seed))
        tree.observe(check)
        for node in tree.nodes:
            tree.callbacks.set_pre_tick(node, begin)
        for step in range(25):
            run_some(tree, seed * 100 + step)
    assert checked == {True, False}


@pytest.mark.parametrize('make_case', [wheel_case, script_case])
def test_a_tree_can_be_recorded_and_observed_from_any_time_on(make_case: Callable[[int], dict[str, Any]]) -> None:
    compared = 0
    for seed in range(120):
        case = make_case(seed)
        plain = bt_scripted.Run(case).trace()
        if plain['load_error']:
            continue
        run = RecordedRun(case, seed)
        run.trace()
        if run.log is None:  # an error ended it before
            continue
        steps = [*plain['steps'], plain['final']][run.began :]
        assert run.changes == [event[1:] for step in steps for event in step['events'] if event[0] == 'st'], (
            f'seed {seed}'
        )
        compared += len(run.changes)
    assert compared > 1000


def test_a_tree_in_which_nothing_changes_logs_nothing() -> None:
    body = '<Parallel><Sequence><Inverter><Forever/></Inverter></Sequence><Fallback><Forever/></Fallback></Parallel>'
    log: list[int] = []
    tree = make(body.replace('<Forever/>', '<Sleep msec="1000000"/>'))
    tree.observe(StatusLog(log))
    assert tree.tick_once() is RUNNING
    assert len(log) == len(tree.nodes)
    for _ in range(5):
        tree.tick_once()
    assert len(log) == len(tree.nodes)


def test_each_round_of_a_tick_ends_with_a_call_also_when_it_raises() -> None:
    ends: list[int] = []
    log: list[int] = []
    tree = make('<Sequence><Repeat num_cycles="3"><AlwaysSuccess/></Repeat><Flip name="raise"/></Sequence>')
    tree.observe(StatusLog(log), after_round=lambda: ends.append(len(log)))
    for _ in range(2):
        tree.tick_once()
    assert len(ends) == 3 + 1 + 2
    with pytest.raises(Exception, match='as its name says'):
        for _ in range(9):
            tree.tick_once()
    assert ends == sorted(ends)
    tree.observe()
    before = len(ends)
    tree.halt()
    tree.tick_once()
    assert len(ends) == before


def test_nodes_whose_source_is_not_to_be_had_are_watched_as_well() -> None:
    names: dict[str, Any] = {'TreeNode': TreeNode}
    exec(  # noqa: S102 - a class that has no file
        'from flexbt_core import SyncAction, NodeStatus\n'
        'class Made(SyncAction):\n'
        '    def tick(self):\n'
        '        self.status = NodeStatus.RUNNING\n'
        '        return NodeStatus.SUCCESS\n',
        names,
    )
    log: list[int] = []
    tree = make('<Inverter><Made/></Inverter>', more=(names['Made'],))
    tree.observe(StatusLog(log))
    (watched,) = (type(node) for node in tree.nodes if node.id == 'Made')
    names_of = operator.attrgetter('__name__', '__qualname__', '__module__', '__doc__')
    assert watched is not names['Made'] and names_of(watched) == names_of(names['Made'])
    reader = LogReader(tree.nodes, transition)
    assert tree.tick_once() is FAILURE
    assert [(uid, after) for uid, _, after in reader.read(log)] == [
        (1, RUNNING),
        (2, RUNNING),
        (2, SUCCESS),
        (2, IDLE),
        (1, FAILURE),
        (1, IDLE),
    ]


def test_a_tree_is_as_it_was_when_nobody_watches_it_any_more() -> None:
    tree = on_board(random_body(7))
    entries = [node.execute for node in tree.nodes]
    classes = [type(node) for node in tree.nodes]
    tree.observe(StatusLog([]), lambda *event: None)
    run_some(tree, 1)
    tree.observe()
    run_some(tree, 3)
    assert [type(node) for node in tree.nodes] == classes
    assert [node.execute for node in tree.nodes] == entries
    for node in tree.nodes:
        if isinstance(node, ControlNode):
            assert node._ticks == tuple(entries[child.uid - 1] for child in node.attached)
