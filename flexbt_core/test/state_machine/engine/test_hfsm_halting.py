# SPDX-License-Identifier: BSD-3-Clause
"""What was left has halted before anything else begins; and when it does not, that is known after a while."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.engine import RunLimits
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing


class Braking(Scripted):
    """Has halted when it is told."""

    def __init__(self, *outcomes: str, outcome: str | None = None) -> None:
        super().__init__(*outcomes, outcome=outcome)
        self.at_rest = False
        self.asked = 0

    def halting(self) -> str | None:
        self.asked += 1
        return None if self.at_rest else 'braking'

    def rest(self) -> None:
        self.at_rest = True
        self.wake()


def before_next(state: Scripted, next_state: Scripted | None = None) -> OperatableStateMachine:
    """Return the state in machines that it ends, and another one after them."""
    ways = dict.fromkeys(state.outcomes, 'Next')
    return machine(
        Child('Inner', nested(state, 'A/B'), ways), Child('Next', next_state or Scripted(), {'done': 'ended'})
    )


def test_the_next_state_is_entered_when_the_last_one_is_at_rest() -> None:
    state, after = Braking(), Scripted()
    bench = Bench(before_next(state, after))
    state.end('done')
    bench.settle()
    assert state.trace[-1] == 'on_exit OUTCOME'
    assert bench.active == ('/Inner/A/B',), 'it is still at work'
    bench.pass_time(2.9)
    assert after.trace == ['on_start']
    assert (bench.faults, bench.transitions) == ([], [])
    state.rest()
    bench.settle()
    assert bench.active == ('/Next',)
    bench.pass_time(100.0)
    assert bench.faults == []


def test_a_state_that_comes_to_rest_is_not_asked_all_the_time() -> None:
    state = Braking(outcome='done')
    bench = Bench(before_next(state))
    asked = state.asked
    bench.pass_time(2.5)
    assert state.asked == asked
    assert bench.run.next_wake is None


def test_after_its_time_it_is_reported_and_the_machine_goes_on() -> None:
    state = Braking(outcome='done')
    bench = Bench(before_next(state))
    bench.pass_time(3.0)
    assert bench.faults == [('/Inner/A/B', 'had not halted 3 s after it was left: braking')]
    assert bench.active == ('/Next',)
    assert state.calls('on_exit') == 1


def test_a_container_waits_for_what_halts_whatever_that_says() -> None:
    texts = ['']
    state = Scripted(do={'halting': lambda *_: next(iter(texts), None)})
    both = machine(Child('A', passing()), Child('B', state), conditions=[('ended', [('A', 'done')])])
    bench = Bench(both)
    assert bench.active == ('/B',)
    texts.clear()
    state.wake()
    bench.settle()
    assert bench.outcome == 'ended'


def test_the_time_is_wall_time_not_that_of_the_run() -> None:
    steady = ManualClock()
    bench = Bench(before_next(Braking(outcome='done')), steady=steady)
    bench.pass_time(1000.0)
    assert bench.active == ('/Inner/A/B',)
    steady.advance(3.0)
    bench.settle()
    assert bench.active == ('/Next',)


UNCONFIRMED = 'not confirmed to have halted 3 s after the stop: braking'


def stopped_while_braking(reason: str = 'lunch') -> tuple[Braking, Bench]:
    """Return a run that was stopped, and whose time to halt is over."""
    state = Braking()
    bench = Bench(before_next(state))
    bench.stop(reason)
    bench.pass_time(3.0)
    return state, bench


def test_a_stop_that_is_not_confirmed_is_told_and_goes_on_until_it_is() -> None:
    state, bench = stopped_while_braking()
    assert state.trace[-1] == 'on_exit PREEMPTED'
    assert bench.faults == [('/Inner/A/B', UNCONFIRMED)]
    assert bench.shown_end() == (None, '/Inner/A/B: braking')
    assert bench.active == ('/Inner/A/B',)
    assert state.calls('on_stop') == 0
    bench.pass_time(6.0)
    state.rest()
    bench.settle()
    assert bench.shown_end() == ('preempted', '')
    assert bench.run.message == 'lunch'
    assert (state.calls('on_exit'), state.calls('on_stop'), len(bench.faults)) == (1, 1, 1)
    assert bench.clock.next_timer() is None


@pytest.mark.parametrize(('reason', 'shown'), [('lunch', 'lunch; '), ('', '')])
def test_a_stop_that_is_never_confirmed_ends_as_an_error_after_a_while(reason: str, shown: str) -> None:
    state, bench = stopped_while_braking(reason)
    bench.pass_time(6.9)
    assert bench.shown_end()[0] is None
    bench.pass_time(0.2)
    assert bench.shown_end()[0] == 'error'
    assert bench.run.message == f'{shown}aborted 10 s after the stop, while /Inner/A/B: braking'
    assert (state.calls('on_exit'), state.calls('on_stop')) == (1, 1)


def test_a_stop_waits_no_longer_than_for_the_states_if_its_own_time_is_shorter() -> None:
    clock = ManualClock()
    limits = RunLimits(exit_timeout=3.0, stop_timeout=2.0)
    run = MachineRun(define(before_next(Braking())), clock, [], limits=limits)
    run.start()
    run.step()
    run.preempt('lunch')
    for now, outcome in ((0.0, None), (2.9, None), (3.0, 'error')):
        clock.set(now)
        run.step()
        assert run.outcome == outcome


def test_a_stop_that_is_not_confirmed_can_be_aborted() -> None:
    _, bench = stopped_while_braking()
    bench.run.abort('stopped again')
    bench.settle()
    assert (bench.outcome, bench.run.message) == ('error', 'lunch; stopped again, while /Inner/A/B: braking')
    assert bench.clock.next_timer() is None


def test_a_stop_is_not_aborted_before_its_time_to_halt_is_over() -> None:
    state = Braking()
    bench = Bench(before_next(state))
    bench.run.abort('not stopped at all')
    bench.stop('lunch')
    bench.run.abort('stopped twice, in a hurry')
    bench.pass_time(5.0)
    assert bench.shown_end()[0] is None
    state.rest()
    bench.settle()
    assert (bench.outcome, bench.run.message) == ('preempted', 'lunch')


def test_what_ends_by_a_fault_halts_as_what_is_stopped_does() -> None:
    def boom(*_: Any) -> None:
        raise ArithmeticError

    state = Braking()
    state.do['execute'] = boom
    bench = Bench(nested(state, 'A'))
    bench.pass_time(5.0)
    assert bench.shown_end() == (None, '/A: braking')
    state.rest()
    bench.settle()
    assert (bench.outcome, bench.run.message) == ('error', "/A raised, and has no outcome 'failed' to leave by")


def test_a_stop_while_a_state_comes_to_rest_gives_it_its_full_time() -> None:
    state, after = Braking(outcome='done'), Scripted()
    bench = Bench(before_next(state, after))
    bench.pass_time(2.0)
    bench.stop()
    bench.pass_time(2.0)
    assert bench.run.outcome is None
    state.rest()
    bench.settle()
    assert (bench.outcome, bench.run.message, bench.faults) == ('preempted', 'test', [])
    assert after.trace == ['on_start', 'on_stop']
    assert state.calls('on_exit') == 1
    assert bench.clock.next_timer() is None


@pytest.mark.parametrize('path', ['/Inner/A/B', '/Inner/A', '/Inner'])
def test_a_force_while_a_state_comes_to_rest(path: str) -> None:
    """The state is being left, which cannot be undone; what is around it may be left as well, when it has halted."""
    state = Braking('done', 'other', outcome='done')
    bench = Bench(before_next(state))
    refusal = bench.force(path, 'other')
    state.rest()
    bench.settle()
    assert bench.active == ('/Next',)
    assert state.calls('on_exit') == 1
    taken = [(where, outcome, reason) for where, outcome, _, reason in bench.transitions]
    if path == '/Inner/A/B':
        assert refusal == '/Inner/A/B is being left already'
        assert taken[0] == ('/Inner/A/B', 'done', ExitReason.OUTCOME)
    else:
        assert refusal is None
        assert taken[0] == (path, 'other', ExitReason.FORCED)


@pytest.mark.parametrize('path', ['/Inner/A/B', '/Inner/A', '/Inner'])
def test_nothing_in_a_machine_that_is_being_left_can_be_forced(path: str) -> None:
    state = Braking('done', 'other')
    bench = Bench(before_next(state))
    assert bench.force('/Inner', 'done') is None
    assert state.trace[-1] == 'on_exit PARENT_LEFT'
    assert bench.force(path, 'other') == f'{path} is being left already'
    state.rest()
    bench.settle()
    assert [taken[:2] for taken in bench.transitions] == [('/Inner', 'done')]


def test_a_machine_that_was_forced_while_it_came_to_rest_is_as_new_when_it_is_entered_again() -> None:
    state = Braking('done', 'again', outcome='done')
    inner = machine(
        Child('B', state, {'done': 'C', 'again': 'again'}),
        Child('C', Scripted(), {'done': 'again'}),
        outcomes=['again'],
    )
    bench = Bench(machine(Child('A', inner, {'again': 'A'})))
    assert bench.force('/A', 'again') is None
    state.outcome = None
    state.rest()
    bench.settle()
    assert bench.active == ('/A/B',)
    assert (state.calls('on_enter'), state.calls('on_exit'), state.calls('execute')) == (2, 1, 2)
    bench.pass_time(10.0)
    assert (bench.active, bench.faults) == (('/A/B',), [])
    state.end('done')
    bench.settle()
    assert bench.active == ('/A/C',)


def test_the_time_for_rest_is_not_that_of_an_earlier_visit() -> None:
    state = Braking('done', outcome='done')
    inner = machine(Child('B', state, {'done': 'out'}), outcomes=['out'])
    bench = Bench(machine(Child('A', inner, {'out': 'A'})))
    bench.pass_time(1.0)
    assert bench.force('/A', 'out') is None
    state.outcome = None
    state.rest()
    bench.settle()
    assert state.calls('on_enter') == 2
    state.at_rest = False
    state.end('done')
    bench.settle()
    assert bench.clock.next_timer() == 4.0
    bench.pass_time(2.9)
    assert bench.faults == []
    bench.pass_time(0.2)
    assert len(bench.faults) == 1


def test_each_visit_has_the_full_time_again() -> None:
    state = Braking('again', outcome='again')
    bench = Bench(machine(Child('A', state, {'again': 'A'})))
    for number in range(1, 4):
        bench.pass_time(3.0)
        assert len(bench.faults) == number
    assert state.calls('on_exit') == 4


def test_a_state_may_say_that_it_is_at_rest_already_in_on_exit() -> None:
    def rest(state: Any, _: Any) -> None:
        state.rest()

    state = Braking(outcome='done')
    state.do['on_exit'] = rest
    bench = Bench(before_next(state))
    assert bench.active == ('/Next',)
