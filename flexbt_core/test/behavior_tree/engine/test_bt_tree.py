# SPDX-License-Identifier: BSD-3-Clause
"""The running tree: ticking, waking, halting, failures, errors, observation, depth; and the library it comes from."""

from __future__ import annotations

import gc
import inspect
import re
import threading
import weakref
from asyncio import CancelledError
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction, ThreadedAction
from flexbt_core.behavior_tree.engine.context import UnfinishedWork
from flexbt_core.behavior_tree.engine.function_nodes import SimpleAction, simple_action
from flexbt_core.behavior_tree.engine.leaf import Condition, LeafNode, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import Control, Decorator
from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skills
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import (
    NodeExecutionError,
    PortError,
    RegistrationError,
    TickAbandoned,
    TreeLoadError,
)
from flexbt_core.behavior_tree.model.ports import STRING, inout_port, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.skills.literals import Predicate
from flexbt_core.skills.skill import Outcome, OutcomeClass, Skill
from flexbt_testing.behavior_trees.steps import check, step
from flexbt_testing.waiting import DEADLINE

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = NodeStatus


class Work(StatefulAction):
    """Gives the results of the list that the host provides under the name of the node; RUNNING when there is none."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.halts = 0

    def result(self) -> NodeStatus:
        results = self.services.get(self.name, [])
        result = results.pop(0) if results else RUNNING
        if isinstance(result, Exception):
            raise result
        return self.fail(result) if isinstance(result, str) else result

    def on_start(self) -> NodeStatus:
        return self.result()

    def on_running(self) -> NodeStatus:
        return self.result()

    def on_halted(self) -> None:
        self.halts += 1
        if self.services.get('halt error') == self.name:
            raise RuntimeError(f'{self.name} cannot stop')


class Patient(Work):
    """Asks for a tick in 5 s, whatever comes before it."""

    def on_start(self) -> NodeStatus:
        self.wake_at(self.clock.now() + 5.0)
        return self.result()


class Instant(SyncAction):
    """A ``Work`` of one tick."""

    def tick(self) -> NodeStatus:
        result = self.services[self.name].pop(0)
        return self.fail(result) if isinstance(result, str) else result


class Returns(SyncAction):
    """Returns whatever the host provides."""

    def tick(self) -> NodeStatus:
        return self.services['return']


class Check(Condition):
    def tick(self) -> NodeStatus:
        return SUCCESS if self.services.get(self.name) else self.fail(f'{self.name} does not hold')


class Pass(Decorator):
    """A decorator of one's own."""

    ports = {'mood': input_port(STRING, default='fine')}

    def tick(self) -> NodeStatus:
        status = self.tick_child()
        return FAILURE if status is SKIPPED else status


class All(Control):
    """A control of one's own."""

    def tick(self) -> NodeStatus:
        results = [self.tick_child(index) for index in range(len(self.children))]
        if RUNNING in results:
            return RUNNING
        self.reset_children()
        return FAILURE if FAILURE in results else SUCCESS


class HaltedDecorator(Decorator):
    """Notes in the services that it is halted."""

    def tick(self) -> NodeStatus:
        return self.tick_child()

    def on_halt(self) -> None:
        self.services.setdefault('halted', []).append(self.name)


class HaltedControl(Control):
    def tick(self) -> NodeStatus:
        return self.tick_child(0)

    def on_halt(self) -> None:
        self.services.setdefault('halted', []).append(self.name)


class Stubborn(Decorator):
    def tick(self) -> NodeStatus:
        return self.tick_child()

    def on_halt(self) -> None:
        raise ValueError('no')


class Faulty(HaltedDecorator):
    """Halts its child, then raises."""

    def halt(self) -> None:
        super().halt()
        raise ValueError('no')


NODES = (HaltedControl, HaltedDecorator, Stubborn, Faulty, Work, Patient, Instant, Returns, Check, Pass, All)


def library(*bodies: str, **trees: str) -> TreeLibrary:
    registry = builtin_registry()
    registry.register_classes(NODES)
    named = {**{f'T{index}' if index else 'Main': body for index, body in enumerate(bodies)}, **trees}
    xml = ''.join(f'<BehaviorTree ID="{id}">{body}</BehaviorTree>' for id, body in named.items())
    return TreeLibrary([load_xml(f'<root BTCPP_format="4">{xml}</root>', 'file.xml', registry)])


def tree(*bodies: str, services: dict[str, Any] | None = None, **options: Any) -> Tree:
    options.setdefault('clock', ManualClock())
    return Tree(library(*bodies), 'Main', services=services if services is not None else {}, **options)


# -- halting ---------------------------------------------------------------------------------------------


def test_only_nodes_that_are_running_are_told_that_they_are_halted() -> None:
    """As the onHalted of a stateful action of BehaviorTree.CPP, whose halt() is called for all nodes."""
    services: dict[str, Any] = {}
    halted = tree(
        '<HaltedControl name="outer"><Sequence>'
        '<HaltedDecorator name="completed"><AlwaysSuccess/></HaltedDecorator>'
        '<HaltedDecorator name="running"><HaltedControl name="inner"><Work name="w"/></HaltedControl></HaltedDecorator>'
        '<HaltedControl name="never"><AlwaysSuccess/></HaltedControl>'
        '</Sequence></HaltedControl>',
        services=services,
    )
    halted.halt()
    assert 'halted' not in services
    assert halted.tick_exactly_once() is RUNNING
    halted.halt()
    assert services['halted'] == ['outer', 'running', 'inner']
    halted.halt()
    assert services['halted'] == ['outer', 'running', 'inner']


# -- waking ----------------------------------------------------------------------------------------------


def test_tick_once_completes_a_chain_of_nodes_that_yield() -> None:
    body = '<SequenceWithMemory>' + '<AlwaysSuccess/>' * 5 + '</SequenceWithMemory>'
    assert tree(body).tick_once() is SUCCESS
    slow = tree(body)
    assert [slow.tick_exactly_once() for _ in range(5)] == [RUNNING] * 4 + [SUCCESS]


def test_a_wake_up_stays_pending_until_it_is_taken() -> None:
    running = tree('<Work name="w"/>')
    running.wake()
    assert running.wake_pending
    assert running.take_wake()
    assert not running.take_wake()


def test_a_tree_that_wakes_itself_for_ever_gives_control_back(caplog: pytest.LogCaptureFixture) -> None:
    running = tree('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>', max_rounds=50)
    assert running.tick_once() is RUNNING
    assert running.wake_pending
    assert 'woke itself 50 times' in caplog.text
    running.halt()
    assert running.status is IDLE


def test_wake_from_another_thread_reaches_the_host() -> None:
    event = threading.Event()
    services: dict[str, Any] = {}
    running = tree('<Work name="w"/>', services=services, on_wake=event.set)
    assert running.tick_once() is RUNNING
    node = running.root

    def finish() -> None:
        services['w'] = [SUCCESS]
        node.wake()

    thread = threading.Thread(target=finish)
    thread.start()
    assert event.wait(DEADLINE)
    thread.join()
    assert running.take_wake()
    assert running.tick_once() is SUCCESS


def test_next_wake_is_the_earliest_deadline_and_goes_with_its_node() -> None:
    clock = ManualClock(100.0)
    running = tree(
        '<Parallel failure_count="3"><Timeout msec="500"><Work name="a"/></Timeout><Sleep msec="200"/>'
        '<Delay delay_msec="300"><AlwaysSuccess/></Delay></Parallel>',
        clock=clock,
    )
    assert running.next_wake is None
    running.tick_once()
    assert running.next_wake == pytest.approx(100.2)
    clock.advance(0.1)
    running.tick_once()
    assert running.next_wake == pytest.approx(100.2)
    clock.set(100.25)
    assert running.tick_once() is RUNNING
    assert running.next_wake == pytest.approx(100.3)
    clock.set(100.3)
    assert running.tick_once() is RUNNING
    assert running.next_wake == pytest.approx(100.5)
    clock.set(100.5)
    assert running.tick_once() is FAILURE
    assert running.next_wake is None
    running.tick_once()
    running.halt()
    assert running.next_wake is None


@pytest.mark.parametrize('end', [SUCCESS, FAILURE, SKIPPED, IDLE, ZeroDivisionError('oops'), None])
def test_a_leaf_that_has_ended_or_was_halted_asks_for_no_tick(end: Any) -> None:
    services = {'a': [RUNNING, RUNNING if end is None else end], 'b': [RUNNING, FAILURE if end is None else RUNNING]}
    running = tree('<Parallel failure_count="1"><Patient name="a"/><Work name="b"/></Parallel>', services=services)
    assert (running.tick_once(), running.next_wake) == (RUNNING, 5.0)
    if end is IDLE or isinstance(end, Exception):
        with pytest.raises(NodeExecutionError):
            running.tick_once()
    else:
        running.tick_once()
    assert running.next_wake is None


def test_tick_while_running_waits_for_what_the_tree_needs() -> None:
    clock = ManualClock()
    waits: list[float] = []

    def wait(until: float) -> None:
        waits.append(until)
        clock.set(until)

    running = tree(
        '<Sequence><Sleep msec="200"/><Delay delay_msec="300"><AlwaysSuccess/></Delay></Sequence>', clock=clock
    )
    assert running.tick_while_running(wait, sleep_time=1.0) is SUCCESS
    assert waits == [pytest.approx(0.2), pytest.approx(0.5)]

    # Loops ask for nothing, and go on with the next tick; a Sleep that is due sooner comes before it.
    waits.clear()
    running = tree('<LoopInt queue="1;2" value="{i}"><Sleep msec="15"/></LoopInt>', clock=clock)
    assert running.tick_while_running(wait) is SUCCESS
    assert waits == pytest.approx([0.51, 0.515, 0.525, 0.535, 0.54, 0.55])


# -- halting ---------------------------------------------------------------------------------------------


def test_halt_stops_what_runs_and_only_that() -> None:
    running = tree(
        '<Parallel failure_count="3"><Work name="a"/><Work name="b"/><Sequence><Work name="c"/></Sequence></Parallel>'
    )
    running.halt()
    running.tick_once()
    assert running.active_nodes() == ['Parallel::1', 'a', 'b', 'Sequence::4', 'c']
    assert running.active_nodes(leaves_only=True) == ['a', 'b', 'c']
    running.halt()
    running.halt()
    assert [node.halts for node in running.nodes if isinstance(node, Work)] == [1, 1, 1]
    assert all(node.status is IDLE for node in running.nodes)


def test_a_leaf_that_cannot_be_halted_does_not_keep_the_others_from_it() -> None:
    running = tree(
        '<Parallel failure_count="2"><Work name="a"/><Work name="b"/></Parallel>', services={'halt error': 'a'}
    )
    running.tick_once()
    with pytest.raises(NodeExecutionError, match=r'\[a\] \(Work\): RuntimeError: a cannot stop'):
        running.halt()
    assert [node.halts for node in running.nodes if isinstance(node, Work)] == [1, 1]
    assert running.active_nodes() == [] and running.status is IDLE
    running.halt()


def test_a_decorator_that_raises_while_halting_does_not_keep_its_child_from_it() -> None:
    running = tree('<Stubborn name="s"><Work name="a"/></Stubborn>')
    running.tick_once()
    with pytest.raises(NodeExecutionError, match=r'\[s\] \(Stubborn\): ValueError: no'):
        running.halt()
    assert [node.halts for node in running.nodes if isinstance(node, Work)] == [1]
    assert running.active_nodes() == []


def test_a_node_whose_own_halt_raises_does_not_keep_the_others_from_theirs() -> None:
    services: dict[str, Any] = {'b': [RUNNING, FAILURE]}
    running = tree('<Parallel><Faulty name="f"><Work name="a"/></Faulty><Work name="b"/></Parallel>', services=services)
    for _ in range(2):
        running.tick_once()
        with pytest.raises(NodeExecutionError, match=r'\[f\] \(Faulty\): ValueError: no'):
            running.tick_once() if len(services['b']) == 1 else running.halt()
        with pytest.raises(NodeExecutionError):
            running.halt()
        assert all(node.status is IDLE for node in running.nodes)
    assert [node.halts for node in running.nodes if isinstance(node, Work)] == [2, 1]


def test_an_error_while_halting_within_a_tick_is_raised_by_the_tick() -> None:
    services = {'halt error': 'a', 'b': [FAILURE]}
    running = tree('<Parallel><Work name="a"/><Work name="b"/></Parallel>', services=services)
    with pytest.raises(NodeExecutionError, match='cannot stop'):
        running.tick_once()
    assert running.active_nodes() == []


def test_unfinished_work_outlives_the_halt() -> None:
    wakes: list[int] = []
    running = tree('<Work name="a"/>', on_wake=lambda: wakes.append(1))
    first = running.root.context.add_unfinished('canceling goal of spin')
    second = running.root.context.add_unfinished('canceling goal of spin')
    running.halt()
    assert list(running.unfinished) == ['canceling goal of spin'] * 2
    thread = threading.Thread(target=first.done)
    thread.start()
    thread.join()
    assert list(running.unfinished) == ['canceling goal of spin']
    assert len(wakes) == 1
    first.done()
    assert len(wakes) == 1
    second.done()
    assert list(running.unfinished) == []
    assert isinstance(second, UnfinishedWork)


def test_work_that_needs_ticks_gets_them_until_it_ends_whatever_other_work_has_ended() -> None:
    running = tree('<Work name="a"/>', services={'a': [RUNNING]})
    got: list[str] = []
    add = running.root.context.add_unfinished
    first, second, idle = (
        add('first', lambda: got.append('first')),
        add('second', lambda: got.append('second')),
        add(''),
    )
    for ended, ticked in ((first, 'second'), (idle, 'second'), (second, '')):
        ended.done()
        got.clear()
        running.tick_once()
        assert ''.join(got) == ticked


# -- failures and errors ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('body', 'services', 'path', 'reason'),
    [
        ('<Work name="a"/>', {'a': ['no way']}, 'a', 'no way'),
        (
            '<Sequence name="s"><AlwaysSuccess/><AlwaysFailure name="f"/></Sequence>',
            {},
            'f',
            'AlwaysFailure returned FAILURE',
        ),
        ('<Fallback><Check name="x"/><Work name="a"/></Fallback>', {'a': ['blocked']}, 'a', 'blocked'),
        # What was recovered from does not count.
        (
            '<Sequence><ForceSuccess><Work name="a"/></ForceSuccess>'
            '<Fallback><Check name="x"/><AlwaysSuccess/></Fallback><Work name="b"/></Sequence>',
            {'a': ['recovered'], 'b': ['final']},
            'b',
            'final',
        ),
        ('<Inverter name="i"><Check name="x"/></Inverter>', {'x': True}, 'i', 'the child [x] succeeded'),
        ('<ForceFailure name="f"><AlwaysSuccess name="x"/></ForceFailure>', {}, 'f', 'the child [x] completed'),
        ('<ReactiveSequence><AlwaysSuccess/><Check name="x"/></ReactiveSequence>', {}, 'x', 'x does not hold'),
        ('<ReactiveFallback><Check name="x"/><Check name="y"/></ReactiveFallback>', {}, 'y', 'y does not hold'),
        (
            '<Parallel success_count="2" failure_count="3"><Work name="a"/><AlwaysSuccess/><Work name="b"/></Parallel>',
            {'a': ['first'], 'b': ['second']},
            'b',
            'second',
        ),
        (
            '<RetryUntilSuccessful num_attempts="2"><Work name="a"/></RetryUntilSuccessful>',
            {'a': ['1st', '2nd']},
            'a',
            '2nd',
        ),
        (
            '<RetryUntilSuccessful name="r" num_attempts="0"><Work name="a"/></RetryUntilSuccessful>',
            {},
            'r',
            'no attempt',
        ),
        ('<Timeout msec="50"><Work name="a"/></Timeout>', {'a': ['quick']}, 'a', 'quick'),
        ('<SubTree ID="T1" name="sub"/>', {'a': ['inside']}, 'sub/a', 'inside'),
        ('<Pass><Work name="a"/></Pass>', {'a': ['own decorator']}, 'a', 'own decorator'),
        ('<All><Work name="a"/><AlwaysSuccess/></All>', {'a': ['own control']}, 'a', 'own control'),
    ],
)
def test_the_failure_names_the_node_responsible(body: str, services: dict[str, Any], path: str, reason: str) -> None:
    running = tree(body, '<KeepRunningUntilFailure><Work name="a"/></KeepRunningUntilFailure>', services=services)
    assert running.tick_once() is FAILURE
    failure = running.failure
    assert failure is not None
    assert failure.path == path
    assert reason in failure.reason
    assert failure.chain[-1] == path
    assert failure.chain[0] == running.root.path


def test_the_failure_of_a_timeout_is_its_own() -> None:
    clock = ManualClock()
    services: dict[str, Any] = {}
    running = tree('<Timeout name="t" msec="1000"><Work name="a"/></Timeout>', services=services, clock=clock)
    running.tick_once()
    clock.advance(1.0)
    assert running.tick_once() is FAILURE
    assert running.failure is not None
    assert (running.failure.path, running.failure.chain) == ('t', ('t',))
    assert 'the time is up' in running.failure.reason
    services['a'] = [SUCCESS]
    assert running.tick_once() is SUCCESS
    assert running.failure is None


@pytest.mark.parametrize('leaf', ['Work', 'Instant'])
def test_a_reason_is_not_kept_for_the_next_failure(leaf: str) -> None:
    services: dict[str, Any] = {'a': ['one', FAILURE]}
    running = tree(f'<{leaf} name="a"/>', services=services)
    running.tick_once()
    assert running.failure is not None
    assert running.failure.reason == 'one'
    running.tick_once()
    assert running.failure.reason == f'{leaf} returned FAILURE'


def test_exceptions_name_the_innermost_node_and_leave_the_tree_to_be_halted() -> None:
    services: dict[str, Any] = {'a': [ZeroDivisionError('oops'), SUCCESS]}
    running = tree(
        '<Sequence name="s"><AlwaysSuccess name="f"/><Pass><SubTree ID="T1" name="sub"/></Pass></Sequence>',
        '<All name="all"><Inverter><Work name="a"/></Inverter></All>',
        services=services,
    )
    with pytest.raises(NodeExecutionError, match=r'in node \[sub/a\] \(Work\): ZeroDivisionError: oops') as caught:
        running.tick_once()
    assert (caught.value.node_path, caught.value.node_id) == ('sub/a', 'Work')
    assert isinstance(caught.value.cause, ZeroDivisionError)
    assert caught.value.__cause__ is caught.value.cause
    # As in BehaviorTree.CPP: nothing is halted, and the next tick goes on where it was.
    assert running.root.status is RUNNING
    assert running.nodes[1].status is SUCCESS
    assert running.tick_once() is FAILURE
    services['a'] = [ZeroDivisionError('again')]
    with pytest.raises(NodeExecutionError):
        running.tick_once()
    running.halt()
    assert running.active_nodes() == []


NOT_RUNNING = 'a synchronous action must not return RUNNING; use StatefulAction for work that takes time'


@pytest.mark.parametrize(
    ('value', 'reason'),
    [
        *((value, f'a tick has to return a NodeStatus, not {value!r}') for value in (None, True, 2, 'SUCCESS')),
        (IDLE, 'a tick must not return IDLE'),
        (RUNNING, NOT_RUNNING),
    ],
)
def test_nonsense_from_a_leaf_is_an_error_of_the_leaf(value: Any, reason: str) -> None:
    running = tree('<Sequence><Returns name="r"/></Sequence>', services={'return': value})
    with pytest.raises(NodeExecutionError) as caught:
        running.tick_once()
    assert str(caught.value) == f'exception in node [r] (Returns): {reason}'


@pytest.mark.parametrize('parent', ['Sequence', 'All', 'Pass'])
def test_ports_that_fail_within_a_node_of_the_engine_name_it(parent: str) -> None:
    running = tree(f'<{parent}><Repeat name="r" num_cycles="{{n}}"><AlwaysSuccess/></Repeat></{parent}>')
    with pytest.raises(NodeExecutionError, match=r'\[r\] \(Repeat\).*\[num_cycles\].*never written') as caught:
        running.tick_once()
    assert caught.value.trace.chain == (f'{parent}::1', 'r')
    running.blackboard.set('n', 2)
    assert running.tick_once() is SUCCESS
    running = tree('<SetBlackboard name="s" value="{n}" output_key="m"/>')
    running.blackboard.unset('n')
    with pytest.raises(NodeExecutionError) as caught:
        running.tick_once()
    cause = caught.value.cause
    assert isinstance(cause, PortError) and (cause.port, cause.key, cause.is_absent) == ('value', 'n', True)
    assert str(cause).endswith('[s]: the blackboard has no such entry')


@pytest.mark.parametrize(('control', 'passing'), [('Sequence', 'S'), ('Fallback', 'F')])
def test_a_control_goes_on_at_the_child_that_raised(control: str, passing: str) -> None:
    raises = f'<Precondition if="x" else="FAILURE">{step(passing, 1)}</Precondition>'
    body = f'<{control}>{step(passing)}{raises}{step(passing, 2)}{step(passing, 3)}</{control}>'
    check(body, f'error 0{passing} | x=1 {passing} 1{passing} 2{passing} 3{passing}')


def test_a_skip_counts_no_longer_after_another_child_has_raised() -> None:
    raises = f'<Precondition if="x" else="FAILURE">{step("S", 1)}</Precondition>'
    check(f'<Parallel success_count="-1">{step("KR")}{raises}</Parallel>', 'error 0K | x=1 R 0R 1S')


@pytest.mark.parametrize('value', ['a', '{k}'])
def test_each_write_of_set_blackboard_counts_once(value: str) -> None:
    running = tree(f'<SetBlackboard value="{value}" output_key="n"/>')
    running.blackboard.set('k', 1)
    for count in range(1, 5):
        assert running.tick_once() is SUCCESS
        entry = running.blackboard.entry('n')
        assert entry is not None and entry.sequence == count


def test_skipped_is_given_but_not_stored() -> None:
    running = tree('<Sequence><Returns name="r"/></Sequence>', services={'return': SKIPPED})
    assert running.tick_once() is SKIPPED
    assert running.status is SKIPPED
    assert running.root.status is RUNNING
    assert running.nodes[1].status is IDLE


# -- observation -----------------------------------------------------------------------------------------


def test_an_observer_hears_every_transition_and_can_come_and_go() -> None:
    heard: list[tuple[str, str, str]] = []

    def hear(node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        heard.append((node.path, before.name, after.name))

    running = tree(
        '<Sequence name="s"><Check name="c"/><Work name="a"/></Sequence>', services={'c': True, 'a': [RUNNING]}
    )
    running.observe(hear)
    running.tick_once()
    assert heard == [('s', 'IDLE', 'RUNNING'), ('c', 'IDLE', 'SUCCESS'), ('a', 'IDLE', 'RUNNING')]
    assert isinstance(running.nodes[2], Work)
    assert 'Work' in repr(running.nodes[2])
    running.observe()
    running.tick_once()
    assert len(heard) == 3
    running.observe(hear)
    running.observe(hear)
    running.halt()
    assert heard[3:] == [('c', 'SUCCESS', 'IDLE'), ('a', 'RUNNING', 'IDLE'), ('s', 'RUNNING', 'IDLE')]


def test_two_trees_of_one_library_are_apart() -> None:
    shared = library('<Work name="a"/>')
    heard: list[TreeNode] = []
    first = Tree(shared, 'Main', services={})
    first.observe(lambda node, before, after: heard.append(node))
    second = Tree(shared, 'Main', services={'a': [SUCCESS]})
    assert second.tick_once() is SUCCESS
    assert heard == []
    assert first.tick_once() is RUNNING
    assert heard == [first.root]
    assert second.status is SUCCESS


def test_a_tree_is_freed_when_nobody_uses_it() -> None:
    running = tree('<Sequence><SubTree ID="T1"/></Sequence>', '<Work name="a"/>')
    running.tick_once()
    reference = weakref.ref(running.nodes[2])
    del running
    gc.collect()
    assert reference() is None


# -- depth -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize('wrap', ['Inverter', 'Pass', 'All', 'ReactiveFallback'])
def test_depth_is_no_limit(wrap: str) -> None:
    levels, nested = 20, 250
    trees = [
        f'<{wrap}>' * nested
        + (f'<SubTree ID="T{level + 1}"/>' if level < levels else '<Work name="leaf"/>')
        + f'</{wrap}>' * nested
        for level in range(levels + 1)
    ]
    services: dict[str, Any] = {}
    running = tree(*trees, services=services)
    for observers in ([], [lambda *event: None]):
        running.observe(*observers)
        services['leaf'] = [RUNNING, 'deep']
        assert running.tick_once() is RUNNING
        running.halt()
        services['leaf'] = ['deep']
        assert running.tick_once() in (SUCCESS, FAILURE)
    if wrap != 'Inverter':
        assert running.failure is not None
        assert running.failure.reason == 'deep'


# -- the library -----------------------------------------------------------------------------------------


def document(id: str, body: str, file: str) -> Any:
    return load_xml(
        f'<root BTCPP_format="4"><BehaviorTree ID="{id}">{body}</BehaviorTree></root>', file, builtin_registry()
    )


def test_staging_is_all_or_nothing() -> None:
    first = TreeLibrary().stage([document('A', '<SubTree ID="B"/>', 'a'), document('B', '<AlwaysSuccess/>', 'b')])
    with pytest.raises(TreeLoadError) as caught:
        first.stage([document('C', '<AlwaysSuccess/>', 'c'), document('D', '<SubTree ID="X"/>', 'd')])
    assert [error.file for error in caught.value.errors] == ['d']
    with pytest.raises(TreeLoadError, match='recursion'):
        first.stage([document('B', '<SubTree ID="A"/>', 'b')])
    with pytest.raises(TreeLoadError, match=r'a:1.*no tree \[B\]'):
        first.stage([document('Other', '<AlwaysSuccess/>', 'b')])
    assert first.tree_ids() == ['A', 'B']
    assert Tree(first, 'A').tick_once() is SUCCESS
    second = first.stage([document('B', '<AlwaysFailure/>', 'b')])
    assert Tree(second, 'A').tick_once() is FAILURE
    assert Tree(first, 'A').tick_once() is SUCCESS


def test_files_with_trees_of_the_same_name_do_not_disturb_each_other() -> None:
    def pair(file: str, leaf: str) -> Any:
        text = (
            '<root BTCPP_format="4" main_tree_to_execute="MainTree"><BehaviorTree ID="MainTree"><SubTree ID="Sub"/>'
            f'</BehaviorTree><BehaviorTree ID="Sub"><{leaf}/></BehaviorTree></root>'
        )
        return load_xml(text, file, builtin_registry())

    both = TreeLibrary([pair('one', 'AlwaysSuccess'), pair('two', 'AlwaysFailure')])
    assert Tree(both, 'MainTree', file='one').tick_once() is SUCCESS
    assert Tree(both, 'MainTree', file='two').tick_once() is FAILURE
    # Without a file: the one that was staged last.
    assert Tree(both, 'MainTree').tick_once() is FAILURE
    assert Tree(both.stage([pair('one', 'AlwaysSuccess')]), 'MainTree').tick_once() is SUCCESS


def test_an_unknown_tree_is_named_with_those_that_are_known() -> None:
    with pytest.raises(LookupError, match=r'^there is no tree \[Nope\]; known trees: Main, T1$'):
        Tree(library('<AlwaysSuccess/>', '<AlwaysSuccess/>'), 'Nope')


@pytest.mark.parametrize(
    ('bodies', 'reason'),
    [
        (
            ['<SubTree ID="Nope"/>', '<AlwaysSuccess/>'],
            "'Nope'>: there is no tree [Nope]; load the file that defines it, too. Known trees: Main, T1",
        ),
        (
            ['<SubTree ID="T1"/>', '<Sequence><SubTree ID="T2"/></Sequence>', '<SubTree ID="T1"/>'],
            "'T1'>: recursion: tree [T1] contains itself (T1 > T2 > T1)",
        ),
        (
            ['<Inverter><SubTree ID="Main"/></Inverter>'],
            "'Main'>: recursion: tree [Main] contains itself (Main > Main)",
        ),
    ],
)
def test_a_library_that_cannot_be_is_refused_with_the_place(bodies: list[str], reason: str) -> None:
    with pytest.raises(TreeLoadError) as caught:
        library(*bodies)
    (error,) = caught.value.errors
    assert str(error) == f'file.xml:{error.line}:{error.column}: <SubTree {reason}'


def test_two_sub_trees_with_one_path_are_refused() -> None:
    body = '<Sequence><SubTree ID="T1" name="s"/><SubTree ID="T1" name="s"/></Sequence>'
    with pytest.raises(TreeLoadError, match=r'two sub-trees have the path \[s\]; give them different names$') as caught:
        tree(body, '<AlwaysSuccess/>')
    (error,) = caught.value.errors
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}'
    assert error.column == xml.rindex('name="s"') + 1


def test_paths_and_uids_are_those_of_btcpp() -> None:
    running = tree(
        '<Sequence><SubTree ID="T1"/><SubTree ID="T1" name="s"/><Work name="w"/></Sequence>',
        '<Inverter><Work name="a"/></Inverter>',
    )
    assert [(node.uid, node.path) for node in running.nodes] == [
        (1, 'Sequence::1'),
        (2, 'T1::2'),
        (3, 'T1::2/Inverter::3'),
        (4, 'T1::2/a'),
        (5, 's'),
        (6, 's/Inverter::6'),
        (7, 's/a'),
        (8, 'w'),
    ]


def test_trees_share_a_blackboard_that_the_host_gives() -> None:
    shared = Blackboard()
    trees = library(
        Write='<SetBlackboard value="route" output_key="path"/>',
        Read='<SetBlackboard value="{path}" output_key="copy"/>',
    )
    Tree(trees, 'Write', blackboard=shared).tick_once()
    Tree(trees, 'Read', blackboard=shared).tick_once()
    assert shared.get('copy') == 'route'


def test_halting_and_ticking_from_different_threads_in_turn_is_fine() -> None:
    running = tree('<Sequence><Work name="a"/></Sequence>')
    problems: list[BaseException] = []

    def run(action: Callable[[], object]) -> None:
        try:
            action()
        except BaseException as error:
            problems.append(error)

    for action in (running.tick_once, running.halt, running.tick_once, running.halt):
        thread = threading.Thread(target=run, args=(action,))
        thread.start()
        thread.join()
    assert problems == []
    assert running.status is IDLE


# -- within a tick -----------------------------------------------------------------------------------------


class Waits(Condition):
    """Waits within its tick for what the host provides."""

    def tick(self) -> NodeStatus:
        event: WakeEvent = self.services['answered']
        self.services['waits'].set()
        self.wait_in_tick(event, self.clock, self.clock.now() + 5.0)
        return SUCCESS if self.clock.now() < 5.0 else self.fail('no answer')


@pytest.fixture
def waiting() -> Iterator[tuple[Tree, list[object], threading.Thread]]:
    """Yield a tree whose tick waits in a thread, and what that ends with."""
    registry = builtin_registry()
    registry.register_classes((Waits,))
    body = '<Sequence><Waits/><AlwaysSuccess/></Sequence>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    waits = threading.Event()
    services: dict[str, object] = {'answered': WakeEvent(), 'waits': waits}
    running = Tree(TreeLibrary([load_xml(text, 'file', registry)]), 'Main', clock=ManualClock(), services=services)
    ended: list[object] = []

    def run() -> None:
        try:
            ended.append(running.tick_once())
        except NodeExecutionError as error:
            ended.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    assert waits.wait(DEADLINE)
    yield running, ended, thread
    running.callbacks.release()
    thread.join()


Waiting = tuple[Tree, list[object], threading.Thread]


def test_a_tick_that_waits_goes_on_with_the_answer(waiting: Waiting) -> None:
    running, ended, thread = waiting
    running.context.services['answered'].set()
    thread.join(DEADLINE)
    assert ended == [SUCCESS]


def test_a_tick_does_not_wait_any_longer_than_it_is_to(waiting: Waiting) -> None:
    running, ended, thread = waiting
    clock = running.context.clock
    assert isinstance(clock, ManualClock)
    while not ended:  # the wait may begin after the time has gone by
        clock.advance(5.0)
        thread.join(0.01)
    assert ended == [FAILURE]


def test_a_tree_that_is_to_be_stopped_does_not_wait_for_an_answer(waiting: Waiting) -> None:
    running, ended, thread = waiting
    running.callbacks.release()
    thread.join(DEADLINE)
    assert isinstance(ended[0], TickAbandoned)
    assert str(ended[0]).count('exception in node') == 1
    assert str(ended[0]).endswith('): the tree was stopped while this node waited for an answer')
    running.halt()
    assert all(node.status is IDLE for node in running.nodes)
    running.context.services['answered'].set()
    assert running.tick_once() is SUCCESS


class Late(Work):
    """What is declared as a condition, and takes time."""

    kind = NodeKind.CONDITION


class LateThread(ThreadedAction):
    kind = NodeKind.CONDITION

    def run(self) -> NodeStatus:
        return SUCCESS


class LateCoroutine(CoroutineAction):
    kind = NodeKind.CONDITION

    async def run(self) -> NodeStatus:
        await self.until(lambda: False)
        return SUCCESS


@pytest.mark.parametrize('node_class', [Late, LateThread, LateCoroutine, Check])
def test_a_condition_is_never_running(node_class: type[Any]) -> None:
    class Test(node_class):
        def tick(self) -> NodeStatus:
            return RUNNING

    registry = builtin_registry()
    registry.register_classes((Test,))
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Test name="x"/></BehaviorTree></root>'
    running = Tree(TreeLibrary([load_xml(text, 'file', registry)]), 'Main', services={})
    reason = 'a condition must not return RUNNING; use StatefulAction for a test that takes time'
    with pytest.raises(NodeExecutionError) as caught:
        running.tick_once()
    assert str(caught.value) == f'exception in node [x] (Test): {reason}'
    running.halt()
    assert running.root.status is IDLE
    assert getattr(running.root, 'halts', 1) == 1  # what it had begun


class Blames(SyncAction):
    """Raises the error of a node by itself."""

    def tick(self) -> NodeStatus:
        raise self.fault('of its own')


class BlamesIf(Check):
    tick = Blames.tick


class BlamesLater(CoroutineAction):
    async def run(self) -> NodeStatus:
        raise self.fault('of its own')


class BlamesInThread(ThreadedAction):
    def run(self) -> NodeStatus:
        raise self.fault('of its own')


@pytest.mark.parametrize(
    'node_class', [Blames, BlamesIf, BlamesLater, BlamesInThread, simple_action(lambda node: IDLE)]
)
def test_the_error_of_a_node_names_it_once(node_class: type[Any]) -> None:
    registry = builtin_registry()
    registry.register('Test', node_class)
    text = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Test name="x"/></BehaviorTree></root>'
    woken = threading.Event()
    running = Tree(TreeLibrary([load_xml(text, 'file', registry)]), 'Main', services={}, on_wake=woken.set)
    with pytest.raises(NodeExecutionError) as caught:
        while running.tick_once() is RUNNING:
            assert woken.wait(DEADLINE)
    reason = 'a tick must not return IDLE' if issubclass(node_class, SimpleAction) else 'of its own'
    assert str(caught.value) == f'exception in node [x] (Test): {reason}'
    assert caught.value.__cause__ is caught.value.cause is None


def test_what_an_earlier_run_has_left_is_emptied_where_it_was_not_given() -> None:
    class Plan(SyncAction):
        ports = {'path': output_port(STRING), 'cost': output_port(STRING)}
        begins_without = ('path', 'cost')

        def tick(self) -> NodeStatus:
            self.set_output('path', 'a way')
            return SUCCESS

    registry = builtin_registry()
    registry.register_classes((Plan,))
    trees = (
        '<BehaviorTree ID="Main"><Sequence><Plan path="{path}" cost="{cost}"/><SubTree ID="Sub" inner="{@outer}" />'
        '</Sequence></BehaviorTree><BehaviorTree ID="Sub"><Plan path="{inner}"/></BehaviorTree>'
    )
    known = TreeLibrary([load_xml(f'<root BTCPP_format="4">{trees}</root>', 'file', registry)])
    board = Blackboard()
    running = Tree(known, 'Main', blackboard=board)
    running.empty_outputs()
    assert board.get_or('path', 'never written') == 'never written'
    assert running.tick_once() is SUCCESS
    again = Tree(known, 'Main', blackboard=board)
    again.empty_outputs({'path'})
    assert (board.get('path'), board.get('outer')) == ('a way', '')
    last = Tree(known, 'Main', blackboard=board)
    last.empty_outputs()
    assert board.get('path') == ''
    board.unset('path')
    board.set('cost', '3')
    last.empty_outputs()
    assert (board.get_or('path', 'removed'), board.get('cost')) == ('removed', '')


# -- registering -------------------------------------------------------------------------------------------


def test_a_class_without_a_docstring_has_no_description() -> None:
    class Bare(SyncAction):
        def tick(self) -> NodeStatus:
            return SUCCESS

    class Told(Bare):
        """Does something.

        In two paragraphs.
        """

    class BareAgain(Told):
        pass

    registry = builtin_registry()
    descriptions = [registry.register(one.__name__, one).description for one in (Bare, Told, BareAgain)]
    assert descriptions == ['', 'Does something.\n\nIn two paragraphs.', '']


class PortsMethod(SyncAction):
    def ports(self) -> dict[str, Any]:  # type: ignore[override]
        """As providedPorts of BehaviorTree.CPP."""
        return {}

    def tick(self) -> NodeStatus:
        return SUCCESS


class PortsProperty(PortsMethod):
    ports = property(lambda self: {})


class PortsList(PortsMethod):
    ports = ['goal']  # type: ignore[assignment]


class NoKind(LeafNode):
    def execute(self) -> NodeStatus:
        return SUCCESS


class EmptiesWhatHasNoType(Returns):
    ports = {'path': output_port()}
    begins_without = ('path',)


class EmptiesNoPort(Returns):
    begins_without = ('path',)


EMPTIED = "'path', which has to be a port with a type: the empty value is that of the type"
BASES = 'SyncAction, StatefulAction, Condition, Decorator or Control'


@pytest.mark.parametrize(
    ('node_class', 'words'),
    [
        (PortsMethod, "ports = {'name': input_port(STRING)}, not "),
        (PortsProperty, "ports = {'name': input_port(STRING)}, not "),
        (PortsList, "ports = {'name': input_port(STRING)}, not "),
        (
            NoKind,
            'NoKind has no kind; derive it from SyncAction, StatefulAction or Condition, or write kind = '
            'NodeKind.ACTION',
        ),
        *((emptying, f'begins_without names {EMPTIED}') for emptying in (EmptiesWhatHasNoType, EmptiesNoPort)),
        (int, f'{int!r} is not a node class; derive it from {BASES}'),
        (StatefulAction, 'StatefulAction does not implement on_halted, on_running, on_start'),
    ],
)
def test_what_is_declared_in_another_form_is_refused_with_what_to_write(node_class: type[Any], words: str) -> None:
    with pytest.raises(RegistrationError, match=re.escape('node ID [X]: ') + '.*' + re.escape(words)):
        builtin_registry().register('X', node_class)


def test_attributes_that_mean_something_else_are_passed_over() -> None:
    class Other(SyncAction):
        outcomes = ['done']  # type: ignore[assignment]
        example = 'see the manual'  # type: ignore[assignment]

        def tick(self) -> NodeStatus:
            return SUCCESS

    manifest = builtin_registry().register('X', Other)
    assert (manifest.outcomes, manifest.example) == (None, None)


@pytest.mark.parametrize(('skill', 'problem'), [
    (Skill.of(cost=-1.0), 'cost: -1.0 has to be a number from 0 on'),
    (Skill.of(outcomes={'SUCCESS': ['a', 'not a']}), 'outcomes SUCCESS: has a and not a as effects'),
])  # fmt: skip
def test_a_skill_that_is_wrong_by_itself_is_refused_with_its_place(skill: Skill, problem: str) -> None:
    wrong = type('Wrong', (Returns,), {'skill': skill})
    with pytest.raises(RegistrationError, match=f'^node ID \\[X\\], skill: {problem}'):
        NodeRegistry().register('X', wrong)


class BadOutcome(Returns):
    skill = Skill.of(outcomes={'DONE': []})


def test_a_skill_with_an_unknown_outcome_is_refused_and_an_id_in_use_keeps_its_type_if_the_host_says_so() -> None:
    scripts = ScriptLibrary()
    registry = NodeRegistry(scripts)
    assert registry.scripts is builtin_registry(scripts).scripts is scripts
    problem = "'DONE' is not an outcome of a leaf; it ends by SUCCESS or FAILURE"
    with pytest.raises(RegistrationError, match=f'^node ID \\[X\\], skill: {problem}$'):
        registry.register('X', BadOutcome)
    first = registry.register('X', Returns)
    clashes: list[str] = []
    registry.on_clash = lambda id, error: clashes.append(f'{id}: {error}')
    assert registry.register('X', Work) is first
    assert clashes == [f'X: node ID [X] is registered already, for {__name__}.Returns; choose another ID']


class Hangs(Work):
    def on_pause(self) -> str:
        if 'no pause' in self.services:
            raise self.services['no pause']
        return super().on_pause()

    def on_resume(self) -> None:
        raise OSError('no current')

    def abandon(self) -> None:
        self.services['abandoned'] = self.services.get('abandoned', '') + self.name
        raise OSError('no current')


def test_each_leaf_that_runs_is_paused_and_abandoned_and_one_that_raises_is_named() -> None:
    registry = builtin_registry()
    registry.register('Hangs', Hangs)
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Parallel failure_count="2"><Hangs name="a"/><AlwaysSuccess/>'
        '<Hangs name="b"/></Parallel></BehaviorTree></root>'
    )
    running = Tree(TreeLibrary([load_xml(text, 'file', registry)]), 'Main', services={})
    assert running.tick_once() is RUNNING
    running.abandon()
    assert running.context.services == {'abandoned': 'ab'}
    assert running.pause() == (f'a: {LeafNode.goes_on}', f'b: {LeafNode.goes_on}')
    running.context.services['no pause'] = CancelledError()
    assert running.pause() == tuple(f'{name}: on_pause raised CancelledError' for name in 'ab')
    assert running.context.paused
    with pytest.raises(NodeExecutionError, match=r'in node \[a\] \(Hangs\): OSError: no current$') as caught:
        running.resume()
    assert caught.value.trace.chain == ('Parallel::1', 'a')
    assert isinstance(caught.value.__cause__, OSError)
    assert not running.context.paused


class Grab(Work):
    ports = {'what': input_port(STRING), 'held': output_port(STRING), 'both': inout_port(STRING)}
    skill = Skill.of(resources=['arm'], preconditions=['near(door)'], outcomes={'SUCCESS': ['holding']}, cost=3.0)


class Look(Check):
    skill = Skill.of(outcomes={'SUCCESS': ['holding']}, predicates=[Predicate('holding')])


class Clash(Look):
    skill = Skill.of(resources=['base'], predicates=[Predicate('holding', {'what': 'arm'})])


def test_faulty_declarations_of_a_skill_are_told_with_their_place_and_the_rest_of_it_is_kept() -> None:
    registry = NodeRegistry()
    registry.register_classes((Grab, Look, All))
    told: list[str] = []
    library = node_skills(registry, told.append)
    line = inspect.getsourcelines(Grab)[1]
    assert told == [
        f"{__file__}:{line}: skill of Grab: preconditions: near(door): there is no predicate 'near' (holding)"
    ]
    assert library.skills.keys() == {'Grab', 'Look'}
    grab, look = library.skills['Grab'], library.skills['Look']
    assert (grab.preconditions, grab.resources, grab.cost, grab.duration) == ((), ('arm',), 3.0, (0.0, None))
    assert (grab.reads, grab.writes) == (('what', 'both'), ('held', 'both'))
    assert grab.outcomes == {'SUCCESS': Outcome(OutcomeClass.COMPLETED), 'FAILURE': Outcome(OutcomeClass.FAILED)}
    assert look.duration == (0.0, 0.0)
    assert (look.outcomes['FAILURE'].kind, str(look.outcomes['SUCCESS'].effects[0])) == (
        OutcomeClass.ANSWERED,
        'holding',
    )


class Reach(Returns):
    skill = Skill.of(resources=['hand'], outcomes={'SUCCESS': ['near(cup)']})


class LookAtNothing(Look):
    skill = Skill.of(resources=['eye'], predicates=[Predicate('not')])


def test_a_faulty_predicate_or_effect_is_told_at_the_leaf_that_declares_it() -> None:
    registry = NodeRegistry()
    registry.register_classes((Look, LookAtNothing, Reach))
    told: list[str] = []
    library = node_skills(registry, told.append)
    for text, leaf, words in zip(told, (LookAtNothing, Reach), (
        "skill of LookAtNothing: predicate not: 'not' cannot name a predicate",
        "skill of Reach: outcomes SUCCESS: near(cup): there is no predicate 'near'",
    ), strict=True):  # fmt: skip
        assert text.startswith(f'{__file__}:{inspect.getsourcelines(leaf)[1]}: {words}')
    assert library.skills['Reach'].resources == ('hand',)
    assert library.skills['LookAtNothing'].resources == ('eye',)
    assert library.skills['Look'].predicates == (Predicate('holding'),)


def test_a_predicate_that_two_leaves_declare_differently_is_that_of_the_first() -> None:
    registry = NodeRegistry()
    registry.register_classes((Look, Clash, Grab))
    told: list[str] = []
    library = node_skills(registry, told.append)
    line = inspect.getsourcelines(Clash)[1]
    why = 'the predicate holding is declared twice, and differently; declare it once'
    assert told[0] == f'{__file__}:{line}: skill of Clash: {why}'
    assert library.predicates == {'holding': Predicate('holding')}
    assert library.skills['Clash'].resources == ('base',)
