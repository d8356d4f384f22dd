# SPDX-License-Identifier: BSD-3-Clause
"""No operator for some time: the run goes on, is held, or is stopped, as its behavior wants it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace

import pytest

from flexbt_common.lifecycle.presence import PresenceToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, OperatorGone
from flexbt_testing.nodes.executive_bench import ExecutiveBench
from flexbt_testing.waiting import DEADLINE

AFTER = 0.6


def waiting() -> EventState:
    """Return a state that waits for ever."""
    return EventState(outcomes=['done'], desired_rate=None)


def behavior(
    policy: object,
    after: object = AFTER,
    state: str = 'Wait',
    name: str = '',
    make: Callable[[], EventState] = waiting,
) -> type[Behavior]:
    """Return a behavior that waits for ever in a state, with a policy."""

    class Waiting(Behavior):
        manifest = BehaviorManifest(name or str(getattr(policy, 'value', policy)))

        def create(self) -> OperatableStateMachine:
            machine = OperatableStateMachine(outcomes=['done'])
            with machine:
                OperatableStateMachine.add(state, make(), {'done': 'done'})
            return machine

    Waiting.operator_gone = policy  # type: ignore[assignment]
    Waiting.operator_gone_after = after  # type: ignore[assignment]
    return Waiting


@pytest.fixture
def bench() -> Iterator[ExecutiveBench]:
    bench = ExecutiveBench(
        *map(behavior, OperatorGone), behavior('sometimes'), behavior(OperatorGone.STOP, state='Other', name='unlike')
    )
    yield bench
    bench.close()


@pytest.fixture
def operator(bench: ExecutiveBench) -> Iterator[NodeRuntime]:
    """Yield a console, as far as the executive sees that it is there."""
    runtime = NodeRuntime('console', args=())
    PresenceToken(runtime, 'ann')
    bench.wait_for(lambda _status: bench.executive.presence.present, 'seen')
    yield runtime
    runtime.close()


def test_a_run_is_stopped_in_time_after_the_last_console_has_gone(bench: ExecutiveBench, operator: NodeRuntime) -> None:
    second = NodeRuntime('console', args=())
    PresenceToken(second, '')
    bench.start('stop')
    operator.close()
    until = time.monotonic() + 2 * AFTER
    bench.wait_for(lambda _status: time.monotonic() > until, 'longer than the time')
    assert bench.status.state == ExecutiveStatus.RUNNING  # the other one is there
    left = time.monotonic()  # it says that it goes before close() returns
    second.close()
    assert bench.wait_idle() == 'preempted'
    assert time.monotonic() - left >= AFTER
    assert f'no operator was there for {AFTER:g} s' in bench.status.message


def test_a_run_is_held_until_an_operator_resumes_it(bench: ExecutiveBench, operator: NodeRuntime) -> None:
    bench.start('hold')
    operator.close()
    bench.wait_for(lambda status: status.state == ExecutiveStatus.PAUSED, 'held')
    bench.logged('paused until an operator resumes it')
    with NodeRuntime.open('console') as back:
        PresenceToken(back, 'ann')
        bench.logged('an operator is there')
        assert bench.status.state == ExecutiveStatus.PAUSED
        bench.applied(ExecutiveCommand.RESUME)
        bench.wait_for(lambda status: status.state == ExecutiveStatus.RUNNING, 'continues')


def test_a_run_that_could_not_begin_while_the_time_was_over_is_held_when_it_begins(bench: ExecutiveBench) -> None:
    runs, unready, later = bench.executive.runs, ['/bt_server'], threading.Event()
    runs._services = replace(runs._services, unready=lambda: tuple(unready))
    bench.send(ExecutiveCommand.START, behavior='hold', autonomy=3)
    bench.logged('waits until /bt_server is ready')
    bench.runtime.call(lambda: bench.runtime.post_in(2.0 * AFTER, later.set))
    assert later.wait(DEADLINE)
    unready.clear()
    bench.runtime.call(runs.nodes_changed)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.PAUSED, 'held')
    assert sum('paused until an operator resumes it' in line.text for line in bench.logs) == 1


@pytest.mark.parametrize('policy', [OperatorGone.HOLD, OperatorGone.STOP])
def test_a_run_that_is_being_stopped_is_told_neither_paused_nor_stopped_again(policy: OperatorGone) -> None:
    at_rest, later = threading.Event(), threading.Event()

    class Braking(EventState):
        def __init__(self) -> None:
            super().__init__(outcomes=['done'], desired_rate=None)

        def halting(self) -> str | None:
            return None if at_rest.is_set() else 'braking'

    with closing(ExecutiveBench(behavior(policy, name='Test', make=Braking))) as bench:
        bench.start()
        bench.applied(ExecutiveCommand.STOP)
        bench.runtime.call(lambda: bench.runtime.post_in(AFTER, later.set))  # after that of the run, which began before
        assert later.wait(DEADLINE)
        at_rest.set()
        assert bench.wait_idle() == 'preempted'
        assert not [line.text for line in bench.logs if 'no operator was there' in line.text]


def test_who_comes_and_goes_is_no_news_where_the_run_goes_on_anyway(bench: ExecutiveBench) -> None:
    bench.start('continue')
    presence = bench.executive.presence
    with NodeRuntime.open('console') as visitor:
        PresenceToken(visitor, 'ann')
        bench.wait_for(lambda _status: presence.present, 'there')
    bench.wait_for(lambda _status: not presence.present, 'gone')
    bench.applied(ExecutiveCommand.STOP)
    bench.logged('stopped')
    assert not [line.text for line in bench.logs if 'operator is there' in line.text]


def test_a_run_goes_on_by_default_and_one_that_begins_without_an_operator_has_its_time(bench: ExecutiveBench) -> None:
    bench.start('continue')
    until = time.monotonic() + 2 * AFTER
    bench.wait_for(lambda _status: time.monotonic() > until, 'longer than the time')
    assert bench.status.state == ExecutiveStatus.RUNNING
    bench.applied(ExecutiveCommand.STOP)
    bench.wait_idle()
    began = time.monotonic()
    bench.start('stop')
    assert bench.wait_idle() == 'preempted'
    assert time.monotonic() - began >= AFTER
    assert 'operator_gone' in bench.refused(ExecutiveCommand.START, behavior='sometimes')


def test_a_switch_brings_the_policy_of_the_other_behavior_when_it_is_accepted(bench: ExecutiveBench) -> None:
    bench.start('continue')
    assert 'Wait' in bench.refused(ExecutiveCommand.SWITCH, behavior='unlike')
    run = bench.executive.runs.run
    assert run is not None and run.snapshot.operator_gone is OperatorGone.CONTINUE
    began = time.monotonic()
    bench.applied(ExecutiveCommand.SWITCH, behavior='stop')
    assert bench.wait_idle() == 'preempted'
    assert time.monotonic() - began >= AFTER  # the time counts from the switch
