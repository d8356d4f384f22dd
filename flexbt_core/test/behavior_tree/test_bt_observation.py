# SPDX-License-Identifier: BSD-3-Clause
"""Watching a tree: the methods that log in place tell what the plain ones do, in the same order, and nothing more."""

from __future__ import annotations

import inspect
import random
import types
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flexbt_core.behavior_tree import Blackboard, NodeStatus, Tree, TreeNode, builtin_registry
from flexbt_core.behavior_tree.acceleration import inlining
from flexbt_core.behavior_tree.acceleration.inlining import inlined_methods
from flexbt_core.behavior_tree.engine.control_decorator import ControlNode
from flexbt_core.behavior_tree.nodes import decorators
from flexbt_core.behavior_tree.nodes.nav2 import register as nav2_nodes
from flexbt_core.behavior_tree.observers import status_observer as observation
from flexbt_core.behavior_tree.observers.status_log import LogReader
from flexbt_testing.behavior_trees import random_nodes as bt_random_nodes
from flexbt_testing.behavior_trees import random_scripts as bt_random_scripts
from flexbt_testing.behavior_trees import random_trees as bt_random_trees
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees.scripted_nodes import NAMES
from flexbt_testing.behavior_trees.user_nodes import make, random_body, run_some

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus


def transition(uid: int, before: int, after: int) -> tuple[int, int, int]:
    return uid, before, after


Heard = list[tuple[int, NodeStatus, NodeStatus]]


@pytest.fixture
def no_inlining(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], None]]:
    """Call it, and what is observed from then on uses the property for every store."""

    def switch() -> None:
        monkeypatch.setattr(observation, 'inlined_methods', lambda node_class: {})
        observation._observed_class.cache_clear()

    yield switch
    monkeypatch.undo()
    observation._observed_class.cache_clear()


def on_board(body: str, **options: Any) -> Tree:
    board = Blackboard()
    board.set('n', 1)
    return make(body, blackboard=board, max_rounds=50, **options)


def lives(seeds: range, watch: Callable[[str], tuple[Tree, Callable[[], Heard]]]) -> list[Heard]:
    """What is heard of random trees in some steps of their lives."""
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
    tree = on_board(body, log=log)
    reader = LogReader(tree.nodes, transition)
    return tree, lambda: [(uid, NodeStatus(one), NodeStatus(other)) for uid, one, other in reader.read(log)]


@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('block', range(3))
def test_all_ways_of_watching_hear_the_same(block: int, no_inlining: Callable[[], None]) -> None:
    seeds = range(block * 70, (block + 1) * 70)
    told, logged = lives(seeds, observed), lives(seeds, recorded)
    no_inlining()
    plain = lives(seeds, observed)
    for seed, one, two, three in zip(seeds, told, logged, plain, strict=True):
        assert one == two == three, f'seed {seed}: {random_body(seed)}'
    assert sum(map(len, plain)) > 1000


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
        if self.log is None and self._steps >= self._begin:
            self._reader, self.log, self.began = LogReader(tree.nodes, transition), [], self._steps
            tree.record(self.log)
        if self._random.random() < 0.2:
            tree.observe(self._random.choice((None, lambda *event: None)))
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


@pytest.mark.parametrize(
    'make_case', [bt_random_trees.make_case, bt_random_nodes.make_case, bt_random_scripts.make_case]
)
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
    tree = make(body.replace('<Forever/>', '<Sleep msec="1000000"/>'), log=log)
    assert tree.tick_once() is RUNNING
    assert len(log) == len(tree.nodes)
    for _ in range(5):
        tree.tick_once()
    assert len(log) == len(tree.nodes)


def test_children_that_are_set_to_idle_are_one_entry() -> None:
    log: list[int] = []
    tree = make(f'<Sequence>{"<AlwaysSuccess/>" * 50}</Sequence>', log=log)
    reader = LogReader(tree.nodes, transition)
    assert tree.tick_once() is SUCCESS
    assert len(log) == 50 + 4
    transitions = reader.read(log)
    assert len(transitions) == 2 * 50 + 3
    assert transitions[51:53] == [(2, SUCCESS, IDLE), (3, SUCCESS, IDLE)]


def test_each_round_of_a_tick_ends_with_a_call_also_when_it_raises() -> None:
    ends: list[int] = []
    log: list[int] = []
    tree = make('<Sequence><Repeat num_cycles="3"><AlwaysSuccess/></Repeat><Flip name="raise"/></Sequence>')
    tree.record(log, lambda: ends.append(len(log)))
    for _ in range(2):
        tree.tick_once()
    assert len(ends) == 3 + 1 + 2
    with pytest.raises(Exception, match='as its name says'):
        for _ in range(9):
            tree.tick_once()
    assert ends == sorted(ends)
    tree.record(None)
    before = len(ends)
    tree.halt()
    tree.tick_once()
    assert len(ends) == before


def test_of_the_engine_nothing_is_left_out() -> None:
    """A method that stores a status and cannot be compiled anew works, but takes its time."""
    registry = builtin_registry()
    nav2_nodes.register(registry)
    for manifest in registry:
        node_class = manifest.node_class
        methods = inlined_methods(node_class)
        for name in dir(node_class):
            if name != '__init__' and isinstance(getattr(node_class, name), types.FunctionType):
                method = methods.get(name, getattr(node_class, name))
                assert 'status' not in method.__code__.co_names, f'{node_class.__name__}.{name} uses the property'


def test_a_file_that_was_replaced_meanwhile_is_not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    source = inspect.getsource(decorators)
    for text, compiled in (
        (source, True),
        (source.replace('self.status = FAILURE', 'self.status = RUNNING', 1), False),
    ):
        monkeypatch.setattr(inspect, 'getsource', lambda module: text)  # noqa: B023
        inlining._inlined.cache_clear()
        inlining._compiled.cache_clear()
        assert ('execute' in inlined_methods(decorators.Inverter)) is compiled
        assert 'execute' in inlined_methods(decorators.SubTree)
    inlining._inlined.cache_clear()
    inlining._compiled.cache_clear()


def test_nodes_whose_source_is_not_to_be_had_are_watched_as_well() -> None:
    names: dict[str, Any] = {'TreeNode': TreeNode}
    exec(  # noqa: S102 - a class that has no file
        'from flexbt_core.behavior_tree import SyncAction, NodeStatus\n'
        'class Made(SyncAction):\n'
        '    def tick(self):\n'
        '        self.status = NodeStatus.RUNNING\n'
        '        return NodeStatus.SUCCESS\n',
        names,
    )
    log: list[int] = []
    tree = make('<Inverter><Made/></Inverter>', more=(names['Made'],), log=log)
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
    tree.record([])
    tree.observe(lambda *event: None)
    run_some(tree, 1)
    assert [type(node) for node in tree.nodes] != classes
    tree.record(None)
    tree.observe(None)
    run_some(tree, 3)
    assert [type(node) for node in tree.nodes] == classes
    assert [node.execute for node in tree.nodes] == entries
    for node in tree.nodes:
        if isinstance(node, ControlNode):
            assert node._ticks == tuple(entries[child.uid - 1] for child in node.attached)
