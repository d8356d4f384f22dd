# SPDX-License-Identifier: BSD-3-Clause
"""Managed nodes, asked as lifecycle managers do."""

from __future__ import annotations

import contextlib
import gc
import itertools
import signal
import threading
import weakref
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lifecycle_msgs.msg import TransitionEvent
from lifecycle_msgs.srv import ChangeState
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.lifecycle.managed_node import ManagedNode, NodeScope, unconfigured
from flexbt_common.lifecycle.presence import PresenceToken
from flexbt_common.middleware.implementation import implementation
from flexbt_common.runtime.node_runtime import NodeRuntime, Runtime
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.errors import FlexbtError
from flexbt_msgs.action import BtLoad
from flexbt_testing.nodes.clients import LifecycleClient
from flexbt_testing.system.python_processes import PythonProcess, python_process
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until


def speed(node: Node) -> float:
    """Declare the parameter, and gives its value."""
    return ParameterDeclarer(node).real('speed', 1.0, 0.0, 9.0, 'speed in m/s')


class Machine:
    """What is managed: it has one of each kind of entity, and fails on request."""

    def __init__(self, runtime: Runtime, bench: Bench) -> None:
        self.runtime = runtime
        self.bench = bench
        bench.notes.append('configure')
        runtime.on_close(lambda: bench.notes.append('close'))
        self.speed = runtime.call(lambda: speed(runtime.node))
        runtime.call(self._open)
        self.token = LivelinessToken(runtime)
        self.watch = LivelinessWatch(runtime, 'somebody', lambda _alive: None)
        runtime.on_fault(lambda error: bench.faults.append(error))
        bench.fail('configure')

    def _open(self) -> None:
        node = self.runtime.node
        node.create_subscription(Empty, 'in', lambda _message: None, 1)
        node.create_service(Trigger, 'serve', lambda _request, response: response)
        node.create_client(Trigger, 'ask')
        node.create_timer(100.0, lambda: None)
        node.create_guard_condition(lambda: None)
        ActionClient(node, BtLoad, 'load')

    def activate(self) -> None:
        self.bench.notes.append('activate')
        self.bench.fail('activate')

    def deactivate(self, why: str, refusal: str, within: float) -> None:
        self.bench.notes.append('deactivate')
        if self.bench.hold is not None:
            # It comes to rest on the executor thread, as all that runs does.
            rest = threading.Event()
            self.bench.on_rest = lambda: self.runtime.post(rest.set)
            self.bench.hold.set()
            assert rest.wait(within)
        self.bench.fail('deactivate')


class Bench:
    """A managed node, and a manager on another node."""

    def __init__(self, node: NodeRuntime, manager: NodeRuntime, autostart: bool = False) -> None:
        self.node = node
        self.notes: list[str] = []
        self.faults: list[BaseException] = []
        self.failing: str = ''
        self.hold: threading.Event | None = None
        self.on_rest: Any = None
        assert isinstance(node.node, ManagedNode)
        self.managed = node.node
        LivelinessWatch(node, 'somebody', lambda _alive: None)  # those on a node share one subscription, which stays
        self.managed.manage(
            node,
            lambda runtime, refusal: Machine(runtime, self),
            parameters=speed,
        )
        self.before = self.entities()
        self.client = LifecycleClient(manager, 'managed')
        self.events: list[tuple[str, str]] = []
        manager.call(
            lambda: manager.node.create_subscription(TransitionEvent, 'managed/transition_event', self._on_event, 1000)
        )

    def _on_event(self, event: TransitionEvent) -> None:
        self.events.append((event.start_state.label, event.goal_state.label))

    def fail(self, step: str) -> None:
        if step == self.failing:
            raise FlexbtError(f'{step} fails')

    def entities(self) -> Counter[type]:
        """Return what there is on the node, by kind."""

        def count() -> Counter[type]:
            node = self.managed
            kinds = (node.publishers, node.subscriptions, node.clients, node.services, node.timers, node.guards)
            return Counter(type(entity) for kind in (*kinds, node.waitables) for entity in kind)

        return self.node.call(count)


@contextlib.contextmanager
def open_bench(**parameters: Any) -> Iterator[Bench]:
    with (
        NodeRuntime.open('manager') as manager,
        NodeRuntime.open('managed', parameters={'autostart': False} | parameters, node_class=ManagedNode) as node,
    ):
        yield Bench(node, manager)


# The model: https://design.ros2.org/articles/node_lifecycle.html and the numbers of lifecycle_msgs/Transition.
CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE = 1, 2, 3, 4
GOALS = {
    'unconfigured': {CONFIGURE: 'inactive', 5: 'finalized'},
    'inactive': {CLEANUP: 'unconfigured', ACTIVATE: 'active', 6: 'finalized'},
    'active': {DEACTIVATE: 'inactive', 7: 'finalized'},
    'finalized': {},
}
LABELS = {1: 'configure', 2: 'cleanup', 3: 'activate', 4: 'deactivate', 5: 'shutdown', 6: 'shutdown', 7: 'shutdown'}
NUMBERS = {label: number for number, label in LABELS.items()}
DURING = {
    1: 'configuring', 2: 'cleaningup', 3: 'activating', 4: 'deactivating',
    5: 'shuttingdown', 6: 'shuttingdown', 7: 'shuttingdown',
}  # fmt: skip

# Shutdown is rarer than the others, after which nothing is possible. 0, 8 and 'fly' are no transitions, and 40 is
# 'transition_success', by which rclpy ends one.
REQUESTS = st.sampled_from([1, 1, 2, 3, 3, 4, 4, 'configure', 'cleanup', 'activate', 'deactivate'] * 2 + [
    5, 6, 7, 'shutdown', 0, 8, 'fly',
])  # fmt: skip
FAILURES = st.sampled_from(['', '', '', 'configure', 'activate', 'deactivate'])


@settings(max_examples=6, deadline=None, database=None)
@given(st.lists(st.tuples(REQUESTS, FAILURES), min_size=3, max_size=14))
def test_any_transitions_go_as_in_the_design(steps: list[tuple[int | str, str]]) -> None:
    with open_bench() as bench:
        state = 'unconfigured'
        is_open = False
        events = []
        for request, failing in steps:
            bench.failing = failing
            bench.notes.clear()
            number = request
            if isinstance(request, str):
                number = next((number for number in GOALS[state] if LABELS[number] == request), -1)
            goal = GOALS[state].get(int(number))
            fails = goal is not None and LABELS[int(number)] == failing
            notes = []
            assert bench.client.change(request) == (goal is not None and not fails)
            if goal is not None:
                during = DURING[int(number)]
                events.append((state, during))
                label = LABELS[int(number)]
                if label in ('configure', 'activate', 'deactivate'):
                    notes.append(label)
                if fails:
                    events += [(during, 'errorprocessing'), ('errorprocessing', 'unconfigured')]
                    state = 'unconfigured'
                else:
                    events.append((during, goal))
                    state = goal
                if state in ('unconfigured', 'finalized') and (is_open or label == 'configure'):
                    notes.append('close')
                is_open = state in ('inactive', 'active')
            assert bench.notes == notes
            assert bench.client.state() == state
            possible = {number: label for number, label, _start in bench.client.transitions()}
            assert possible == {number: LABELS[number] for number in GOALS[state]}
            assert (bench.entities() == bench.before) == (not is_open)
        wait_until(lambda: len(bench.events) >= len(events))
        assert bench.events == events
        assert bench.faults == []


def test_the_graph_is_that_of_the_design() -> None:
    with open_bench() as bench:
        graph = bench.client.transitions('get_transition_graph')
        for state, goals in GOALS.items():
            assert {number for number, _label, start in graph if start == state} == set(goals)
        assert {'unconfigured', 'inactive', 'active', 'finalized'} < set(bench.client.states())


def test_twenty_rounds_leave_nothing_behind() -> None:
    with open_bench() as bench:
        threads = None
        for _ in range(20):
            for label in ('configure', 'activate', 'deactivate', 'cleanup'):
                assert bench.client.change(label)
            assert bench.entities() == bench.before
            threads = threads or threading.active_count()
            assert threading.active_count() == threads
        assert bench.notes == ['configure', 'activate', 'deactivate', 'close'] * 20
        bench.node.report_fault(RuntimeError('later'))
        assert bench.faults == []  # nobody is left who would listen


@pytest.mark.parametrize('stock', ['0', '1'])
def test_the_end_of_a_node_ends_its_participant(stock: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also before Python collects the node, which may be long after: each participant has eight threads."""
    monkeypatch.setenv('FLEXBT_STOCK_RCLPY', stock)
    gc.collect()
    gc.disable()
    try:
        counts = []
        for _ in range(3):
            with open_bench():
                pass
            counts.append(len(list(Path('/proc/self/task').iterdir())))
    finally:
        gc.enable()
    assert counts[-1] <= counts[0]


def test_the_node_answers_while_a_transition_waits_for_its_executor() -> None:
    with open_bench() as bench:
        assert bench.client.change('configure') and bench.client.change('activate')
        bench.hold = threading.Event()
        answer = bench.client.begin('deactivate')
        assert bench.hold.wait(DEADLINE)
        assert bench.client.state() == 'deactivating'
        later = bench.client.begin('cleanup')  # after the one that goes on
        assert not answer.done()
        bench.hold = None
        bench.on_rest()
        assert answer.result(DEADLINE)
        assert later.result(DEADLINE)
        assert bench.client.state() == 'unconfigured'


def test_what_ended_is_not_run_any_more() -> None:
    with open_bench() as bench:
        kept: list[Any] = []
        bench.managed._configure = lambda runtime, _: kept.append(runtime) or Machine(runtime, bench)  # type: ignore[func-returns-value]
        assert bench.client.change('configure') and bench.client.change('cleanup')
        late: list[str] = []
        kept[0].post(lambda: late.append('posted'))
        with pytest.raises(RuntimeError, match='has ended'):
            kept[0].call(lambda: late.append('called'))
        bench.node.call(lambda: None)
        assert late == []
        kept[0].close()  # a second time


def test_a_scope_has_every_member_of_a_runtime() -> None:
    members = [name for name in (*vars(Runtime), *Runtime.__annotations__) if not name.startswith('_')]
    with NodeRuntime.open('host') as host:
        scope = NodeScope(host)
        assert [name for name in members if not (hasattr(host, name) and hasattr(scope, name))] == []
        assert len(members) > 20
        scope.close()


def test_a_scope_runs_what_it_is_asked_to_until_it_ends() -> None:
    run: list[str] = []
    with NodeRuntime.open('host') as host:
        scope = NodeScope(host)
        now = scope.steady.now()
        scope.post(lambda: run.append('post'))
        scope.post_at(now, lambda: run.append('at'))
        scope.post_in(0.0, lambda: run.append('in'))
        scope.call(lambda: scope.call_near(now, 0.0, lambda: run.append('near')))
        assert scope.call(lambda: scope.on_executor_thread) and not scope.on_executor_thread
        wait_until(lambda: sorted(run) == ['at', 'in', 'near', 'post'], lambda: run)
        scope.on_close(lambda: run.append('first'))
        scope.on_close(lambda: run.append('second'))
        scope.on_close(run.clear)
        scope.cancel_on_close(run.clear)
        scope.on_fault(lambda error: run.append(str(error)))
        scope.report_fault(ValueError('fault'))
        PresenceToken(scope, 'somebody').close()
        numbers = itertools.count()
        kept = [one.call(lambda one=one: one.shared('key', lambda: next(numbers))) for one in (scope, host, scope)]  # type: ignore[misc]
        assert kept == [0, 1, 0]
        scope.close()
        assert run[4:] == ['fault', 'second', 'first']
        for late in (scope.post, lambda fn: scope.post_in(0.0, fn), lambda fn: scope.call_near(now, 0.0, fn)):
            host.call(lambda late=late: late(lambda: run.append('late')))  # type: ignore[misc]
        scope.report_fault(ValueError('later'))
        host.call(lambda: None)
        assert len(run) == 7 and not host.has_failed
        scope.fail('a part has failed')
        assert host.has_failed


class Part:
    """A part of a node that is held by callbacks, and by what others share."""

    def __init__(self, runtime: Runtime) -> None:
        self.link = ServiceLinks(runtime).link(Trigger, 'ask')
        runtime.on_fault(self.note)
        runtime.on_close(self.stop)
        runtime.call(lambda: runtime.shared('part', lambda: self))

    def note(self, _error: BaseException) -> None:
        pass

    def stop(self) -> None:
        pass


def test_what_a_scope_held_is_freed_with_it() -> None:
    with NodeRuntime.open('host') as host:
        scope = NodeScope(host)
        part = weakref.ref(Part(scope))
        assert part() is not None
        scope.close()
        gc.collect()
        assert part() is None


def test_the_clock_of_the_node_survives_a_scope_in_which_it_was_changed() -> None:
    done = threading.Event()
    with NodeRuntime.open('host') as host:
        scope = NodeScope(host)
        host.call(lambda: host.node.set_parameters([Parameter('use_sim_time', value=True)]))
        host.call(lambda: host.node.set_parameters([Parameter('use_sim_time', value=False)]))
        host.call(lambda: None)
        scope.close()
        host.clock.call_at(host.clock.now(), done.set)
        assert done.wait(DEADLINE)


def test_parameters_are_read_by_each_configure_and_fixed_in_between() -> None:
    def put(bench: Bench, value: Any) -> str:
        results = bench.node.call(lambda: bench.managed.set_parameters([Parameter('speed', value=value)]))
        return str(results[0].reason)

    why = (
        "is unconfigured because of an error: parameter 'speed': 'fast' is of type string, not double; write speed: 1.0"
    )
    with open_bench(speed='fast') as bench:
        assert unconfigured(bench.managed).startswith(why)  # which consoles show
        assert 'out of range' in put(bench, 10.0)
        for _ in range(2):  # a value that was refused is not replaced by the default
            assert not bench.client.change('configure')
            assert bench.client.state() == 'unconfigured'
            assert unconfigured(bench.managed).startswith(why)
        assert 'out of range' in put(bench, 11.0)
        assert put(bench, 2.0) == ''
        assert bench.client.change('configure')
        assert bench.managed._managed.speed == 2.0 and bench.managed.error is None
        assert 'speed is read when the node is configured' in put(bench, 3.0)
        assert bench.client.change('activate')
        assert 'it is active' in put(bench, 3.0)
        assert bench.client.change('deactivate') and bench.client.change('cleanup')
        assert put(bench, 4.0) == ''
        assert bench.client.change('configure')
        assert bench.managed._managed.speed == 4.0


PROGRAM = """
import sys
import time
from flexbt_core.errors import FlexbtError
from flexbt_common.lifecycle.managed_node import run_managed_node
from flexbt_common.runtime.parameters import ParameterDeclarer

def declare(node):
    ParameterDeclarer(node).fixed.integer('most', 1, 0, 9, 'how many there may be')

class Made:
    def __init__(self, runtime, refusal):
        runtime.on_close(lambda: print('closed', flush=True))
        if runtime.call(lambda: runtime.node.declare_parameter('broken', False).value):
            raise FlexbtError('it is broken; mend it')
        print('configured', refusal.partition(';')[0], flush=True)
    def activate(self):
        print('activated', flush=True)
    def deactivate(self, why, refusal, within):
        print('deactivating', flush=True)
        time.sleep(60.0)

sys.exit(run_managed_node('managed', Made, waiting=lambda runtime: print('waiting', flush=True), parameters=declare))
"""


@contextlib.contextmanager
def process(*parameters: str) -> Iterator[PythonProcess]:
    arguments = [argument for parameter in parameters for argument in ('-p', parameter)]
    with python_process(['-c', PROGRAM, '--ros-args', *arguments]) as child:
        try:
            yield child
        finally:
            child.kill()


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ('labels', 'printed'),
    [
        ([], []),
        (['configure'], ['configured is inactive', 'closed']),
        (['configure', 'activate'], ['configured is inactive', 'activated', 'closed']),
        (['shutdown'], []),
    ],
)
def test_a_signal_ends_the_process_in_any_state(labels: list[str], printed: list[str], number: signal.Signals) -> None:
    with NodeRuntime.open('manager') as manager, process('autostart:=false') as child:
        assert child.stdout is not None
        assert child.stdout.readline() == 'waiting\n'
        client = LifecycleClient(manager, 'managed')
        for label in labels:
            assert client.change(label)
        child.send_signal(number)
        out, err = child.communicate(timeout=60)
        assert (out.splitlines(), child.returncode) == (printed, 0), err
        assert 'Traceback' not in err


def own_lines(err: str) -> list[str]:
    """Return the lines of a process without that about the middleware."""
    return [line for line in err.splitlines() if implementation() not in line]


@pytest.mark.dds('another process takes part')
def test_a_parameter_that_is_refused_is_not_said_to_be_missing() -> None:
    with NodeRuntime.open('manager') as manager, process('autostart:=false', 'most:=many') as child:
        assert LifecycleClient(manager, 'managed').change('configure')
        child.send_signal(signal.SIGINT)
        _out, err = child.communicate(timeout=60)
    (line,) = own_lines(err)
    assert "cannot be configured so: parameter 'most': 'many' is of type string, not integer; write most: 1" in line
    assert 'there is no parameter' not in err


@pytest.mark.dds('another process takes part')
def test_a_transition_that_does_not_end_does_not_hold_up_the_end() -> None:
    with NodeRuntime.open('manager') as manager, process() as child:
        assert child.stdout is not None
        assert [child.stdout.readline() for _ in range(2)] == ['configured \n', 'activated\n']
        client = LifecycleClient(manager, 'managed')
        answer = client.begin('deactivate')
        assert child.stdout.readline() == 'deactivating\n'
        began = uncontended_time()
        child.send_signal(signal.SIGINT)
        _out, err = child.communicate(timeout=60)
        assert uncontended_time() - began < 2.5
        assert (child.returncode, 'did not come to an end' in err) == (1, True), err
        with pytest.raises(TimeoutError):  # that the node is gone is known soon, or by now
            answer.result(DEADLINE)


@pytest.mark.dds('another process takes part')
def test_a_node_that_nobody_manages_starts_by_itself_or_says_why_not() -> None:
    with process() as child:
        assert child.stdout is not None
        assert [child.stdout.readline() for _ in range(2)] == ['configured \n', 'activated\n']
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
        assert (out, own_lines(err), child.returncode) == ('closed\n', [], 0)
    with process('broken:=true') as child:
        told = child.communicate(timeout=60)
        assert (told, child.returncode) == (('closed\n', 'managed: cannot start: it is broken; mend it\n'), 1)


def test_a_node_that_never_was_managed_ends_although_it_was_asked_for_a_transition() -> None:
    def transitions() -> list[threading.Thread]:
        return [thread for thread in threading.enumerate() if thread.name.startswith('unmanaged_transitions')]

    with NodeRuntime.open('manager') as manager, NodeRuntime.open('unmanaged', node_class=ManagedNode):
        client = manager.call(lambda: manager.node.create_client(ChangeState, 'unmanaged/change_state'))
        assert client.wait_for_service(60.0)
        manager.call(lambda: client.call_async(ChangeState.Request()))
        wait_until(transitions)
        (thread,) = transitions()
    thread.join(60.0)
    assert not thread.is_alive()
