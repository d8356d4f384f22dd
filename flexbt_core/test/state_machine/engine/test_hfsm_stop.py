# SPDX-License-Identifier: BSD-3-Clause
"""Stopping a run at each point of it, and commands that come when it ends or has ended."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.events import CommandDecided, RunEvent
from flexbt_core.state_machine.engine.operator_commands import confirm, force, set_autonomy
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.userdata import StateMachineError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing

CALLBACKS = ('on_start', 'on_enter', 'execute', 'on_exit', 'on_stop')


def stop_run(state: Scripted, _: Any) -> None:
    state.services.run.preempt(f'in {state.path}')


def three(states: list[Scripted]) -> OperatableStateMachine:
    """Return the second is in machines of its own."""
    return machine(
        Child('One', states[0], {'done': 'Two'}),
        Child('Two', nested(states[1], 'A/B'), {'done': 'Three'}),
        Child('Three', states[2], {'done': 'ended'}),
    )


PATHS = ('/One', '/Two/A/B', '/Three')


@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize('callback', CALLBACKS)
def test_a_stop_in_any_callback_of_any_state_comes_before_everything_that_would_follow(
    callback: str, number: int
) -> None:
    states = [passing() for _ in range(3)]
    states[number].do[callback] = stop_run
    bench = Bench(three(states))
    is_over = callback == 'on_stop'
    assert bench.outcome == ('ended' if is_over else 'preempted')
    assert bench.run.message == ('' if is_over else f'in {PATHS[number]}')
    for state in states:
        assert (state.calls('on_start'), state.calls('on_stop')) == (1, 1)
        assert state.calls('on_enter') == state.calls('on_exit') <= 1
    entered = [number for number, state in enumerate(states) if state.calls('on_enter')]
    assert entered == list(range({'on_start': 0, 'on_stop': 3}.get(callback, number + 1)))
    if callback in ('on_enter', 'execute'):
        assert states[number].trace[-2:] == ['on_exit PREEMPTED', 'on_stop']
        assert states[number].calls('execute') == (callback == 'execute')


def test_a_stop_before_the_start_enters_nothing() -> None:
    states = [passing() for _ in range(3)]
    bench = Bench(three(states), start=False)
    bench.stop('changed my mind')
    assert [state.trace for state in states] == [[]] * 3
    bench.run.start()
    bench.settle()
    assert (bench.outcome, bench.run.message) == ('preempted', 'changed my mind')
    assert [state.trace for state in states] == [['on_start', 'on_stop']] * 3


def test_a_run_starts_once() -> None:
    bench = Bench(three([Scripted(), Scripted(), Scripted()]))
    with pytest.raises(StateMachineError, match='starts only once'):
        bench.run.start()
    assert bench.active == ('/One',)


@pytest.mark.parametrize('kind', ['transition', 'choice', 'machine'])
def test_a_stop_while_something_waits_for_the_operator(kind: str) -> None:
    state = passing() if kind != 'choice' else Scripted(do={'execute': lambda state, _: state.ask('?')})
    level = {'done': Autonomy.Full}
    inner = machine(Child('A', state, {'done': 'done'}, level if kind != 'machine' else {}), outcomes=['done'])
    bench = Bench(machine(Child('M', inner, {'done': 'ended'}, level)))
    decision = bench.decision
    bench.stop()
    assert bench.outcome == 'preempted'
    assert bench.snapshots[-1].decisions == ()
    assert bench.confirm(decision.id) == 'the run has ended'
    assert (state.calls('on_enter'), state.calls('on_exit')) == (1, 1)


def test_the_first_reason_of_a_stop_stays() -> None:
    state = Scripted(do={'halting': lambda *_: 'braking'})
    bench = Bench(nested(state, 'A'))
    for reason in ('lunch', 'fire'):
        bench.stop(reason)
    state.do.clear()
    state.wake()
    bench.settle()
    assert (bench.outcome, bench.run.message, state.calls('on_exit')) == ('preempted', 'lunch', 1)


def give_commands(bench: Bench) -> None:
    bench.run.command('a', confirm, '1')
    bench.run.command('b', force, '/A', 'done')
    bench.run.command('c', set_autonomy, Autonomy.Off)


@pytest.mark.parametrize('how', ['end', 'stop', 'fault'])
def test_commands_after_the_end_are_refused_at_once_each(how: str) -> None:
    def boom(*_: Any) -> None:
        raise ArithmeticError

    state = passing() if how == 'end' else Scripted(do={'execute': boom} if how == 'fault' else {})
    bench = Bench(nested(state, 'A'))
    bench.stop()
    outcome = {'end': 'done', 'stop': 'preempted', 'fault': 'error'}[how]
    assert bench.outcome == outcome
    give_commands(bench)
    assert (bench.answers, bench.answered) == (['the run has ended'] * 3, ['a', 'b', 'c'])
    bench.run.preempt('too late')
    assert not bench.run.step()
    assert (bench.outcome, bench.run.message) == (outcome, bench.run.message)
    assert 'too late' not in bench.run.message
    assert bench.run.controls.level('/A') == Autonomy.Full
    assert state.calls('on_stop') == 1


@pytest.mark.parametrize('callback', ['on_exit', 'on_stop'])
def test_commands_while_the_run_ends_are_refused_each_once(callback: str) -> None:
    state = Scripted(outcome='done', do={callback: lambda state, _: give_commands(state.services)})
    bench = Bench(nested(state, 'A'), start=False)
    bench.run.start()
    bench.run.preempt('test')
    bench.settle()
    assert bench.outcome == 'preempted'
    assert len(bench.answers) == 3
    assert set(bench.answers) <= {'the run is ending', 'the run has ended'}


def test_commands_that_are_given_before_a_stop_has_its_effect_are_refused() -> None:
    state = Scripted()
    bench = Bench(nested(state, 'A'))
    give_commands(bench)
    bench.run.preempt('now')
    bench.settle()
    assert (bench.answers, bench.answered) == (['the run is ending'] * 3, ['a', 'b', 'c'])
    assert state.trace[-2:] == ['on_exit PREEMPTED', 'on_stop']


def test_a_stop_while_a_command_is_applied_comes_before_the_next_step() -> None:
    def command(run: MachineRun) -> None:
        state.end('done')
        run.preempt('now')

    state = Scripted()
    bench = Bench(nested(state, 'A'))
    assert bench.answer_to(command) is None
    assert bench.outcome == 'preempted'
    assert state.trace == ['on_start', 'on_enter', 'execute', 'on_exit PREEMPTED', 'on_stop']


def test_a_command_before_the_start_is_kept_for_it() -> None:
    bench = Bench(nested(passing(), 'A', {'done': Autonomy.Low}), start=False)
    bench.run.command('', set_autonomy, Autonomy.Off)
    bench.settle()
    assert bench.answers == []
    bench.run.start()
    bench.settle()
    assert bench.answers == [None]
    assert bench.decision.path == '/A'


def test_of_two_commands_each_has_its_effect_before_the_other_is_looked_at() -> None:
    first, second = Scripted(), Scripted()
    bench = Bench(machine(Child('A', first, {'done': 'B'}), Child('B', second, {'done': 'ended'})))
    bench.run.command('', force, '/A', 'done')
    bench.run.command('', force, '/A', 'done')
    bench.settle()
    assert bench.answers == [None, '/A is being left already']
    assert bench.active == ('/B',)
    assert bench.force('/A', 'done') == '/A is not active (active: /B)'


class Retrying(Bench):
    """A host that gives a command again for each answer, until there were ``most``."""

    most = 3

    def read(self, event: RunEvent) -> None:
        super().read(event)
        if isinstance(event, CommandDecided) and self.outcome is None and len(self.answers) < self.most:
            self.run.command('', force, '/B', 'done')


def test_an_answer_may_give_the_next_command() -> None:
    bench = Retrying(nested(Scripted(), 'A'))
    bench.run.command('', force, '/B', 'done')
    bench.settle()
    assert bench.answers == ["there is no state '/B'"] * 3


def test_a_stop_ends_even_a_host_that_gives_a_command_for_each_answer() -> None:
    class Enough(Retrying):
        most = 1000

        def read(self, event: RunEvent) -> None:
            super().read(event)
            if len(self.answers) == 100:
                self.run.preempt('enough')

    bench = Enough(nested(Scripted(), 'A'))
    bench.run.command('', force, '/B', 'done')
    bench.settle()
    assert bench.outcome == 'preempted'
    assert len(bench.answers) < 1000
