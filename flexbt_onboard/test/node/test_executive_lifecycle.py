# SPDX-License-Identifier: BSD-3-Clause
"""The executive as a managed node: what operators and programs are told in which state."""

from __future__ import annotations

import random
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.files import node_file
from flexbt_common.lifecycle.managed_node import ManagedNode
from flexbt_common.runtime.node_runtime import NodeRuntime, Runtime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.action import ExecuteBehavior, OperatorInput
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.node.executive import Executive, open_executive
from flexbt_onboard.node.executive_parameters import declare_parameters
from flexbt_onboard.node.onboard_executive import show_unconfigured
from flexbt_onboard.persistence import journal
from flexbt_testing.nodes.clients import LifecycleClient, SentGoal
from flexbt_testing.nodes.executive_bench import behavior_of, entry_of
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.pytest_plugin import entities_of
from flexbt_testing.waiting import DEADLINE, wait_until

START = ExecutiveCommand.START
INACTIVE = 'the executive is inactive; activate it (ros2 lifecycle set /onboard_executive activate)'
UNCONFIGURED = (
    'the executive is unconfigured; configure and activate it (ros2 lifecycle set /onboard_executive configure)'
)


class Hold(EventState):
    """Stays until it is stopped, and is at rest when it is told."""

    rest: threading.Event
    left: list[Any]

    def __init__(self) -> None:
        super().__init__(outcomes=['on'], desired_rate=None)

    def on_exit(self, userdata: Any) -> None:
        self.left.append(self.exit_reason)
        self.rest.wait(60.0)


def holding() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('Hold', Hold(), {'on': 'done'})
    return machine


class ManagedBench(Operator):
    """A managed executive; the node of the console is its lifecycle manager as well."""

    def __init__(self, directory: Path, journal: str = '.') -> None:
        parameters = {
            'autostart': False,
            'peers': [''],
            'event_log_directory': str(directory),
            'journal_directory': str(directory / journal),
        }
        self.runtime = NodeRuntime(names.ONBOARD_EXECUTIVE, args=(), parameters=parameters, node_class=ManagedNode)
        assert isinstance(self.runtime.node, ManagedNode)
        self.node = self.runtime.node
        super().__init__(NodeRuntime('console', args=()))
        Hold.rest, Hold.left = threading.Event(), []
        Hold.rest.set()
        self.node.manage(self.runtime, self._configure, show_unconfigured, declare_parameters)
        self.manager = LifecycleClient(self.console, names.ONBOARD_EXECUTIVE)
        self.links = ActionLinks(self.console)

    def _configure(self, runtime: Runtime, refusal: str) -> Executive:
        parameters = runtime.call(lambda: declare_parameters(runtime.node))
        library = BehaviorLibrary([entry_of(behavior_of(holding))])
        return open_executive(runtime, parameters, library, refusal)

    def change(self, *labels: str) -> None:
        """Make transitions that have to succeed."""
        for label in labels:
            assert self.manager.change(label), label

    def wait_message(self, text: str) -> None:
        """Wait until the status shows a message, and commands arrive."""
        wait_until(lambda: self.statuses and self.status.message == text, lambda: f'{text}; {self.statuses[-1:]}')
        wait_until(self._commands.get_subscription_count, 'link up')

    def wait_shown(self, state: str) -> None:
        """Wait until the status, which may tell of the last run first, shows a state, and commands arrive."""

        def is_shown() -> bool:
            refusal = next((one for one in (UNCONFIGURED, INACTIVE) if self.status.message.endswith(one)), '')
            return refusal == {'unconfigured': UNCONFIGURED, 'inactive': INACTIVE}.get(state, '')

        wait_until(lambda: self.statuses and is_shown() and self._commands.get_subscription_count(), state)

    def entities(self) -> Counter[type]:
        """Return what there is on the node, by kind."""

        return self.runtime.call(lambda: entities_of(self.node))

    def close(self) -> None:
        """End both nodes."""
        self.runtime.close()
        super().close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[ManagedBench]:
    opened = ManagedBench(tmp_path)
    yield opened
    opened.close()


def test_the_operator_is_told_in_every_state_why_nothing_can_be_started(bench: ManagedBench) -> None:
    bench.wait_message(UNCONFIGURED)
    assert bench.refused(START, behavior='Test') == UNCONFIGURED
    first = bench.status.executive_id

    bench.change('configure')
    bench.wait_message(INACTIVE)
    assert bench.status.executive_id != first  # consoles begin anew
    wait_until(lambda: bench.lists, 'behaviors')
    assert bench.refused(START, behavior='Test') == INACTIVE
    bench.applied(ExecutiveCommand.CLAIM_AUTHORITY)

    bench.change('activate')
    bench.wait_message('')
    bench.start()
    bench.wait_active('/Hold')

    bench.change('deactivate')
    wait_until(lambda: bench.status.outcome == 'preempted', lambda: bench.status)
    assert bench.status.state == ExecutiveStatus.IDLE
    assert bench.status.message == f'the executive was deactivated; {INACTIVE}'
    assert len(Hold.left) == 1
    assert bench.refused(START, behavior='Test') == INACTIVE

    bench.change('cleanup')
    bench.wait_message(UNCONFIGURED)
    # What was stopped in order is not resumed.
    bench.change('configure', 'activate')
    bench.wait_message('')
    assert bench.status.state == ExecutiveStatus.IDLE
    bench.start()


def test_a_transition_waits_for_the_robot_and_the_operator_sees_it(bench: ManagedBench) -> None:
    bench.change('configure', 'activate')
    bench.wait_message('')
    Hold.rest.clear()
    bench.start()
    bench.wait_active('/Hold')
    done = bench.manager.begin('deactivate')
    bench.wait_for(lambda status: status.state == ExecutiveStatus.STOPPING, 'stopping')
    assert INACTIVE in bench.status.message
    assert bench.manager.state() == 'deactivating'
    assert bench.refused(START, behavior='Test') == INACTIVE
    assert not done.done()
    Hold.rest.set()
    assert done.result(DEADLINE)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.IDLE, 'idle')


def test_programs_are_refused_and_their_goals_ended(bench: ManagedBench) -> None:
    request = OperatorInput.Goal(prompt='?', type='bool')
    bench.change('configure')
    behaviors = bench.links.link(ExecuteBehavior, names.EXECUTE_BEHAVIOR)
    requests = bench.links.link(OperatorInput, names.OPERATOR_INPUT)
    for refused in (SentGoal(behaviors, ExecuteBehavior.Goal(behavior='Test')), SentGoal(requests, request)):
        assert refused.wait().status is GoalStatus.REJECTED

    bench.change('activate')
    run, asked = SentGoal(behaviors, ExecuteBehavior.Goal(behavior='Test')), SentGoal(requests, request)
    bench.wait_active('/Hold')
    bench.wait_for(lambda status: status.decisions, 'decision')
    bench.change('deactivate')
    assert run.result.code == ExecuteBehavior.Result.CANCELED
    assert (asked.result.code, asked.result.message) == (
        OperatorInput.Result.CANCELED,
        'the executive was deactivated',
    )


def test_many_rounds_leave_nothing_behind(bench: ManagedBench) -> None:
    before = bench.entities()
    threads: set[int] = set()
    for round in range(8):
        bench.change('configure', 'activate')
        if round % 2:
            bench.wait_message('')
            bench.start()
        bench.change('deactivate', 'cleanup')
        assert bench.entities() == before
        if round > 1:
            threads.add(threading.active_count())
    assert max(threads) - min(threads) <= 1, threads  # a thread may be about to end
    assert len(Hold.left) == 4


@pytest.fixture
def bench_without_journal(tmp_path: Path) -> Iterator[ManagedBench]:
    (tmp_path / 'journal').touch()  # no directory
    opened = ManagedBench(tmp_path, 'journal')
    yield opened
    opened.close()


def test_a_journal_that_cannot_be_written_is_an_error_that_can_be_mended(
    bench_without_journal: ManagedBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = bench_without_journal
    before = bench.entities()
    threads: list[int] = []
    for _ in range(3):
        assert not bench.manager.change('configure')
        assert bench.manager.state() == 'unconfigured'
        assert bench.entities() == before
        threads.append(threading.active_count())
    assert threads[0] == threads[-1]
    heard: list[DiagnosticStatus] = []
    bench.console.call(
        lambda: bench.console.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda array: heard.extend(array.status), 10
        )
    )
    wait_until(lambda: heard, 'diagnostics')
    assert (heard[-1].name, heard[-1].level) == ('/onboard_executive: lifecycle', DiagnosticStatus.ERROR)
    assert str(tmp_path / 'journal') in heard[-1].message
    (tmp_path / 'journal').unlink()
    bench.change('configure', 'activate')
    wait_until(lambda: 'active' in [one.message for one in heard if one.name.endswith('lifecycle')], 'active')
    bench.wait_message('')
    bench.start()

    # Nobody is held up while a slow disk has the journal of before.
    waited: list[bool] = []

    class Writing(threading.Thread):
        def join(self, timeout: float | None = None) -> None:
            waited.append(bench.runtime.on_executor_thread)

    bench.change('deactivate', 'cleanup')
    writing, file = Writing(), node_file(str(tmp_path / 'journal'), f'/{names.ONBOARD_EXECUTIVE}', '.journal')
    assert file is not None
    monkeypatch.setitem(journal._closing, file, writing)
    bench.change('configure')
    assert waited and not waited[0]


GOALS_OF = {
    'unconfigured': {'configure': 'inactive'},
    'inactive': {'activate': 'active', 'cleanup': 'unconfigured'},
    'active': {'deactivate': 'inactive'},
}


@pytest.mark.parametrize('seed', [1, 2])
def test_no_run_outlives_the_active_state_whatever_transitions_come(bench: ManagedBench, seed: int) -> None:
    chance = random.Random(seed)
    before = bench.entities()
    state = 'unconfigured'
    started = 0
    for _ in range(40):
        if chance.random() < 0.7:
            bench.wait_shown(state)
            if state != 'active':
                assert bench.refused(START, behavior='Test') in (UNCONFIGURED, INACTIVE)
            elif bench.status.state == ExecutiveStatus.IDLE:
                bench.start()
                started += 1
        label = chance.choice(['configure', 'activate', 'activate', 'deactivate', 'cleanup'])
        goal = GOALS_OF[state].get(label)
        assert bench.manager.change(label) == (goal is not None)
        state = goal or state
        if state != 'active':
            assert len(Hold.left) == started
        if state == 'unconfigured':
            assert bench.entities() == before
    assert started > 0


def test_what_decides_over_files_and_limits_is_as_the_node_was_started(bench: ManagedBench) -> None:
    attempts: list[tuple[str, Any]] = [
        ('journal_directory', '/etc'),
        ('event_log_directory', '/etc'),
        ('event_log_size', 10**12),
        ('event_log_files', 1),
        ('machine_directory', '/etc'),
        ('capability_directories', ['/etc']),
        ('synthesis_memory', 10**13),
        ('places', '/etc/hostname'),
        ('requirements', '/etc/hostname'),
    ]

    def results() -> list[bool]:
        parameters = [Parameter(name, value=value) for name, value in attempts]
        return [one.successful for one in bench.runtime.call(lambda: bench.node.set_parameters(parameters))]

    assert results() == [False] * len(attempts)
    bench.change('configure', 'activate', 'deactivate', 'cleanup')
    assert results() == [False] * len(attempts)
