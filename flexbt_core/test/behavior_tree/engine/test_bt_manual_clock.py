# SPDX-License-Identifier: BSD-3-Clause
"""Every node that has to do with time goes by the clock that the tree was given, and by nothing else."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction, ThreadedAction
from flexbt_core.behavior_tree.engine.leaf import StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.ports import DOUBLE, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.decorators import SpeedController
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock

START = 1000.0
PERIOD = 1.5


class Count(SyncAction):
    """Counts its ticks on the blackboard."""

    def tick(self) -> NodeStatus:
        self.blackboard.set('n', self.blackboard.get_or('n', 0) + 1)
        return NodeStatus.SUCCESS


class Forever(StatefulAction):
    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        pass


class Doze(CoroutineAction):
    async def run(self) -> NodeStatus:
        await self.sleep(PERIOD)
        return NodeStatus.SUCCESS


class Nap(ThreadedAction):
    def run(self) -> NodeStatus:
        self.sleep(PERIOD)
        return NodeStatus.SUCCESS


class AtRest(SpeedController):
    def speed(self) -> float:
        return 0.0


def registry() -> NodeRegistry:
    nodes = builtin_registry()
    register_nav2(nodes)
    nodes.register_classes((Count, Forever, Doze, Nap, AtRest, WakesAt))
    return nodes


class Case(NamedTuple):
    """A tree that changes when the period is over, and how that shows."""

    body: str
    changed: Callable[[Tree, NodeStatus], bool]


def ends(status: NodeStatus) -> Callable[[Tree, NodeStatus], bool]:
    return lambda tree, given: given is status


def second_run(tree: Tree, status: NodeStatus) -> bool:
    return bool(tree.blackboard.get('n') == 2)


RATE = 1.0 / PERIOD
CASES = {
    'Sleep': Case('<Sleep msec="1500"/>', ends(NodeStatus.SUCCESS)),
    'Delay': Case('<Delay delay_msec="1500"><AlwaysSuccess/></Delay>', ends(NodeStatus.SUCCESS)),
    'Timeout': Case('<Timeout msec="1500"><Forever/></Timeout>', ends(NodeStatus.FAILURE)),
    'CoroutineAction': Case('<Doze/>', ends(NodeStatus.SUCCESS)),
    'RateController': Case(
        f'<PipelineSequence><RateController hz="{RATE!r}"><Count/></RateController><Forever/></PipelineSequence>',
        second_run,
    ),
    'SpeedController': Case(
        f'<PipelineSequence><AtRest min_rate="{RATE!r}" max_rate="{RATE!r}"><Count/></AtRest><Forever/>'
        '</PipelineSequence>',
        second_run,
    ),
    'TimeExpired': Case(
        '<WhileDoElse><TimeExpired seconds="1.5"/><AlwaysSuccess/><Forever/></WhileDoElse>', ends(NodeStatus.SUCCESS)
    ),
    'PathExpiringTimer': Case(
        '<ReactiveFallback><PathExpiringTimer seconds="1.5"/><Forever/></ReactiveFallback>', ends(NodeStatus.SUCCESS)
    ),
}


def start(body: str, clock: ManualClock, **options: Any) -> Tree:
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
    tree = Tree(TreeLibrary([load_xml(text, 't.xml', registry())]), 'T', clock=clock, **options)
    assert tree.tick_once() is NodeStatus.RUNNING
    return tree


class WakesAt(StatefulAction):
    """Requests a tick at a time of no use."""

    ports = {'when': input_port(DOUBLE)}

    def on_start(self) -> NodeStatus:
        self.wake_at(self.get_input('when'))
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        pass


BESIDE = '<Parallel success_count="1" failure_count="2"><WakesAt when="{when}"/><Sleep msec="1500"/></Parallel>'


@pytest.mark.parametrize('when', ['inf', '-inf', '-1', '1e308', '1000.7'])
def test_a_time_of_no_use_delays_no_other_node(when: str) -> None:
    clock = ManualClock(START)
    tree = start(BESIDE.replace('{when}', when), clock)
    while tree.status is NodeStatus.RUNNING:
        assert clock.now() < START + PERIOD
        due = tree.next_wake
        assert due is not None
        clock.set(max(due, clock.now()))
        tree.tick_once()
    assert clock.now() == START + PERIOD


@pytest.mark.parametrize(
    'body', [BESIDE.replace('{when}', 'nan'), '<Fallback><TimeExpired seconds="nan"/><Forever/></Fallback>']
)
def test_a_time_that_is_no_number_is_an_error_of_its_node(body: str) -> None:
    with pytest.raises(NodeExecutionError, match='cannot be woken at the time nan') as caught:
        start(body, ManualClock(START))
    assert caught.value.node_id in body


def test_the_table_has_every_node_class_that_uses_the_clock() -> None:
    def uses_clock(node_class: type[Any]) -> bool:
        functions = [member for member in vars(node_class).values() if inspect.isfunction(member)]
        return any({'clock', 'wake_at'} & set(function.__code__.co_names) for function in functions)

    def subclasses(of: type[Any]) -> set[type[Any]]:
        return {of}.union(*(subclasses(derived) for derived in of.__subclasses__()))

    timed = {
        node_class.__name__
        for node_class in subclasses(TreeNode)
        if node_class is not TreeNode
        and node_class.__module__.startswith('flexbt_core.behavior_tree')
        and uses_clock(node_class)
    }
    assert timed == CASES.keys() | {'ThreadedAction'}


@pytest.mark.parametrize('name', CASES)
@given(data=st.data())
def test_it_changes_at_the_first_tick_after_the_time_and_at_no_other(name: str, data: st.DataObject) -> None:
    clock = ManualClock(START)
    tree = start(CASES[name].body, clock)
    assert tree.next_wake == pytest.approx(START + PERIOD)
    for step in data.draw(st.lists(st.sampled_from([0.0, 0.0, 0.2, 0.4999, 0.7]), max_size=8)):
        clock.advance(step)
        if data.draw(st.booleans()):
            tree.wake()
        given_status = tree.tick_once()
        over = clock.now() >= START + PERIOD
        assert CASES[name].changed(tree, given_status) is over
        if over:
            return
        # Who asks the tree when to come again is told the same as before.
        assert tree.next_wake == pytest.approx(START + PERIOD)
    due = tree.next_wake
    assert due is not None
    clock.set(due)
    assert CASES[name].changed(tree, tree.tick_once())


@pytest.mark.parametrize('name', CASES)
def test_a_clock_that_is_set_back_does_no_harm(name: str) -> None:
    clock = ManualClock(START)
    tree = start(CASES[name].body, clock)
    clock.set(START + 1.0)
    assert not CASES[name].changed(tree, tree.tick_once())
    clock.set(10.0)
    for _ in range(3):
        assert not CASES[name].changed(tree, tree.tick_once())
    clock.set(START + PERIOD)
    assert CASES[name].changed(tree, tree.tick_once())


@pytest.mark.parametrize('name', sorted(CASES.keys() - {'PathExpiringTimer'}))  # whose time is that of the path
def test_a_second_activation_begins_a_time_of_its_own(name: str) -> None:
    clock = ManualClock(START)
    tree = start(CASES[name].body, clock)
    clock.advance(1.0)
    tree.halt()
    assert tree.next_wake is None
    tree.blackboard.unset('n')
    clock.advance(1.0)
    assert tree.tick_once() is NodeStatus.RUNNING
    assert tree.next_wake == pytest.approx(START + 2.0 + PERIOD)
    clock.advance(1.0)
    assert not CASES[name].changed(tree, tree.tick_once())
    clock.advance(0.5)
    assert CASES[name].changed(tree, tree.tick_once())


def test_a_thread_sleeps_by_the_clock_of_the_tree() -> None:
    clock = ManualClock(START)
    woken = threading.Event()
    tree = start('<Nap/>', clock, on_wake=woken.set)
    while clock.next_timer() is None:
        assert not woken.wait(0.001)
    assert clock.next_timer() == START + PERIOD
    clock.advance(1.4999)
    clock.set(10.0)
    assert tree.tick_once() is NodeStatus.RUNNING
    assert not woken.is_set()
    clock.set(START + PERIOD)
    assert woken.wait(60.0)
    assert tree.tick_once() is NodeStatus.SUCCESS
