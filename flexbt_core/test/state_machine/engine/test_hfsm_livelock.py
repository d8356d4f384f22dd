# SPDX-License-Identifier: BSD-3-Clause
"""Chains of instantaneous transitions are one step; a chain without an end is reported, and does not hang the host."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.wrappers import with_retry
from flexbt_core.state_machine.engine.engine import MAX_TRANSITIONS
from flexbt_core.state_machine.engine.operator_commands import set_autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, passing


def deep(depth: int) -> OperatableStateMachine:
    """Machines whose only states end at once."""
    state = deep(depth - 1) if depth else passing()
    return machine(Child(f'L{depth}', state, {('ended' if depth else 'done'): 'ended'}))


def loop_of(*inner: OperatableStateMachine) -> OperatableStateMachine:
    """Machines in a ring."""
    labels = [f'M{number}' for number in range(len(inner))]
    places = (
        Child(label, one, {'ended': labels[(number + 1) % len(labels)]})
        for number, (label, one) in enumerate(zip(labels, inner, strict=True))
    )
    return machine(*places)


@pytest.mark.parametrize('count', [1, 2, 200])
def test_a_chain_of_instantaneous_states_is_one_step_and_may_have_as_many_as_are_allowed(count: int) -> None:
    labels = [*(f'S{number}' for number in range(count)), 'ended']

    def run(most: int) -> Bench:
        places = [Child(labels[i], passing(), {'done': labels[i + 1]}) for i in range(count)]
        return Bench(machine(*places), max_transitions=most)

    bench = run(count)
    assert (bench.outcome, bench.steps, len(bench.transitions)) == ('ended', 1, count)
    assert run(count - 1).outcome == 'error'


@pytest.mark.parametrize('machines', [1, 2, 7])
@pytest.mark.parametrize('depth', [0, 1, 3])
def test_a_loop_without_a_wait_ends_the_run_and_names_the_states(depth: int, machines: int) -> None:
    bench = Bench(loop_of(*(deep(depth) for _ in range(machines))))
    assert bench.outcome == 'error'
    ((path, text),) = bench.faults
    assert text == f'{MAX_TRANSITIONS} transitions without waiting for anything'
    assert bench.run.message.startswith(f'livelock: {text}, the last of them from /')
    assert path in bench.run.message
    assert ', /M' in bench.run.message
    assert bench.steps == 1
    assert MAX_TRANSITIONS - 1 <= len(bench.transitions) <= MAX_TRANSITIONS
    enters, exits = (sum(event.startswith(name) for event in bench.trace) for name in ('on_enter', 'on_exit'))
    assert enters == exits


@pytest.mark.parametrize('delay', [0.0, 0.1])
def test_a_loop_of_instant_states_with_retries_is_a_livelock_unless_they_wait(delay: float) -> None:
    state = passing(outcome='failed', outcomes=['failed'])
    bench = Bench(machine(Child('A', with_retry(state, 3, delay=delay), {'failed': 'A'})))
    bench.pass_time(10.0)
    if delay:
        assert bench.active == ('/A',)
    else:
        assert bench.run.message.startswith(f'livelock: {MAX_TRANSITIONS} transitions'), bench.run.message


def test_many_attempts_without_a_delay_come_to_their_end_and_let_a_stop_through() -> None:
    attempts = 3 * MAX_TRANSITIONS
    state = passing(outcome='failed', outcomes=['failed'])
    bench = Bench(machine(Child('A', with_retry(state, attempts), {'failed': 'ended'})))
    assert (bench.outcome, state.calls('on_enter')) == ('ended', attempts)
    assert bench.steps == 1 + attempts // (MAX_TRANSITIONS + 1), 'the host gets its turn after so many attempts'


def test_a_loop_that_waits_now_and_then_goes_on() -> None:
    def execute(state: Scripted, _: Any) -> str | None:
        return None if state.calls('execute') % 100 == 0 else 'again'

    state = Scripted('again', do={'execute': execute}, rate=10.0)
    bench = Bench(machine(Child('A', state, {'again': 'A'})))
    bench.pass_time(10.0)
    assert bench.active == ('/A',)
    assert state.calls('on_enter') > MAX_TRANSITIONS


def test_a_stop_gets_through_in_the_middle_of_a_loop() -> None:
    def execute(state: Scripted, _: Any) -> str:
        if state.calls('execute') == 50:
            state.services.run.preempt('by another thread')
        return 'again'

    bench = Bench(machine(Child('A', Scripted('again', do={'execute': execute}), {'again': 'A'})))
    assert bench.outcome == 'preempted'
    assert len(bench.transitions) == 49


def test_a_level_that_is_lowered_gets_through_in_the_middle_of_a_loop() -> None:
    def execute(state: Scripted, _: Any) -> str:
        if state.calls('execute') == 50:
            state.services.run.command('', set_autonomy, 0)
        return 'again'

    bench = Bench(machine(Child('A', Scripted('again', do={'execute': execute}), {'again': 'A'}, {'again': 0})))
    assert bench.answers == [None]
    assert bench.decision.path == '/A'
    assert len(bench.transitions) == 49


def test_confirming_without_end_is_no_livelock() -> None:
    bench = Bench(machine(Child('A', passing(outcome='again', outcomes=['again']), {'again': 'A'}, {'again': 3})))
    for _ in range(2 * MAX_TRANSITIONS):
        assert bench.confirm() is None
    assert bench.active == ('/A',)
