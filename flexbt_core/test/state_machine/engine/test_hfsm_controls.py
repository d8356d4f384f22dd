# SPDX-License-Identifier: BSD-3-Clause
"""What the operator does to a run besides confirming and forcing: pause, lock, breakpoints, repeat."""

from __future__ import annotations

import logging
import re
from typing import Any

import pytest

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.engine import operator_commands
from flexbt_core.state_machine.engine.events import (
    CommandDecided,
    RunEnding,
    RunEvent,
    RunReader,
    RunRested,
    TransitionBlocked,
)
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy, DecisionKind
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing


class Stubborn(Scripted):
    """Goes on while it is blocked."""

    runs_while_blocked = True


def subject() -> tuple[Scripted, Bench]:
    """FlexBE's fixture, in a machine of its own."""
    state = Scripted('done', 'failed')
    levels = {'done': Autonomy.Low, 'failed': Autonomy.High}
    ways = {'done': 'done', 'failed': 'failed'}
    inner = machine(Child('subject', state, ways, levels), outcomes=['done', 'failed'])
    return state, Bench(machine(Child('M', inner, ways), outcomes=['done', 'failed']))


# -- pause -----------------------------------------------------------------------------------------------------------


def test_what_is_returned_or_due_during_a_pause_counts_after_it() -> None:
    state, bench = subject()
    assert bench.resume() == 'the run is not paused'
    assert bench.pause() is None
    assert (state.trace[-1], bench.run.is_paused) == ('on_pause', True)
    assert bench.pause() == 'the run is paused already'
    state.end('done')
    bench.settle()
    bench.pass_time(10.0)
    assert state.trace[-1] == 'on_pause'
    for refusal in (bench.force('/M/subject', 'done'), bench.repeat('/M')):
        assert refusal == 'the run is paused; resume it first'
    assert bench.resume() is None
    assert bench.outcome == 'done'
    assert state.trace[-4:] == ['on_resume', 'execute', 'on_exit OUTCOME', 'on_stop']


def test_a_decision_is_kept_during_a_pause_but_not_answered() -> None:
    state, bench = subject()
    bench.set_autonomy(Autonomy.Off)
    state.end('done')
    bench.settle()
    decision = bench.decision
    bench.pause()
    assert (bench.decision, bench.confirm()) == (decision, 'the run is paused; resume it first')
    assert bench.set_autonomy(Autonomy.Full) is None, 'it counts afterwards'
    bench.resume()
    assert bench.outcome == 'done'


@pytest.mark.parametrize('pauses', [(3.0, 3.0), (0.1, 0.2), (1e9, 1e-9), (1 / 3, 7.7)])
def test_the_time_of_a_state_stands_still_while_it_is_paused(pauses: tuple[float, ...]) -> None:
    rung: list[float] = []

    def enter(state: Scripted, _: Any) -> None:
        state.wake_at(state.clock.now() + 1.3)
        state.clock.call_at(state.clock.now() + 1.2, lambda: rung.append(state.clock.now()))

    def execute(state: Scripted, _: Any) -> str | None:
        if state.clock.now() >= began + 1.3:
            return 'done'
        state.wake_at(began + 1.3)
        return None

    state = Scripted(do={'on_enter': enter, 'execute': execute})
    bench = Bench(machine(Child('A', state, {'done': 'ended'})), start=False)
    bench.clock.set(1234.5)
    began = 1234.5
    bench.run.start()
    bench.settle()
    for pause in pauses:
        bench.pass_time(0.4)
        bench.pause()
        stands = state.clock.now()
        bench.pass_time(pause)
        assert state.clock.now() == stands
        bench.resume()
    bench.pass_time(0.49)
    assert (bench.outcome, len(rung)) == (None, 1)
    bench.pass_time(0.02)
    assert bench.outcome == 'ended'
    assert rung == [pytest.approx(began + 1.2, abs=1e-6)]


def test_an_alarm_that_is_due_in_a_pause_rings_after_it_unless_it_was_cancelled() -> None:
    rung: list[str] = []
    state, bench = subject()
    for name in ('one', 'two'):
        timer = state.clock.call_at(state.clock.now() + 1.0, lambda name=name: rung.append(name))  # type: ignore[misc]
    bench.pause()
    bench.pass_time(5.0)
    timer.cancel()
    bench.resume()
    assert rung == []
    bench.pass_time(1.5)
    assert rung == ['one']


def test_what_comes_to_rest_in_a_pause_is_followed_after_it() -> None:
    busy = ['braking']
    first, then = Scripted(do={'halting': lambda *_: busy[0] if busy else None}, outcome='done'), Scripted()
    bench = Bench(machine(Child('A', first, {'done': 'B'}), Child('B', then, {'done': 'ended'})))
    bench.pause()
    assert 'on_pause' not in first.trace, 'it was left already'
    busy.clear()
    first.wake()
    bench.settle()
    assert then.trace == ['on_start']
    bench.resume()
    assert bench.active == ('/B',)


def test_all_commands_that_have_arrived_in_a_pause_are_applied_at_once() -> None:
    _, bench = subject()
    bench.pause()
    for number in range(3):
        bench.run.command(number, operator_commands.set_breakpoint, '/M')
    bench.settle()
    assert bench.answers[-3:] == [None, *['/M has a breakpoint already'] * 2]


def test_stop_works_during_a_pause() -> None:
    state, bench = subject()
    bench.pause()
    bench.stop()
    assert (bench.outcome, state.trace[-2:]) == ('preempted', ['on_exit PREEMPTED', 'on_stop'])


# -- lock: FlexBE's tests, where a request is a decision -------------------------------------------------------------


@pytest.mark.parametrize('path', ['/M/subject', '/M', '/'])
def test_a_lock_holds_back_what_would_leave_it(path: str) -> None:
    state, bench = subject()
    assert bench.lock(path) is None
    assert bench.lock(path) == f'{path} is locked already'
    state.end('done')
    bench.settle()
    assert (bench.active, bench.run.decisions, bench.run.locked) == (('/M/subject',), [], [path])
    state.end('failed')
    bench.pass_time(10.0)
    assert state.trace[-1] == 'execute', 'it is frozen'
    assert bench.unlock(path) is None
    assert bench.outcome == 'done'
    assert bench.unlock('/nowhere') == 'the run has ended'


def test_what_is_inside_a_locked_machine_goes_on() -> None:
    first, last = Scripted(), Scripted()
    inner = machine(Child('A', first, {'done': 'B'}), Child('B', last, {'done': 'ended'}))
    bench = Bench(machine(Child('M', inner, {'ended': 'ended'})))
    bench.lock('/M')
    first.end('done')
    last.do['on_enter'] = lambda state, _: setattr(state, 'outcome', 'done')
    bench.settle()
    assert (bench.active, last.calls('on_exit')) == (('/M/B',), 0)
    bench.unlock('/M')
    assert bench.outcome == 'ended'


def test_a_lock_on_a_level_holds_back_what_would_leave_it_from_around_it() -> None:
    state, bench = subject()
    bench.lock('/M/subject')
    assert bench.force('/M', 'failed') is None
    assert bench.active == ('/M/subject',)
    bench.unlock('/M/subject')
    assert (bench.outcome, state.trace[-2]) == ('failed', 'on_exit PARENT_LEFT')


def test_a_forced_outcome_is_held_back_and_a_stop_is_not() -> None:
    state, bench = subject()
    bench.set_autonomy(Autonomy.Off)
    bench.lock('/M/subject')
    assert bench.force('/M/subject', 'failed') is None
    assert bench.active == ('/M/subject',)
    bench.unlock('/M/subject')
    assert (bench.outcome, state.trace[-2]) == ('failed', 'on_exit FORCED')
    state, bench = subject()
    bench.lock('/M')
    state.end('done')
    bench.settle()
    bench.stop()
    assert bench.outcome == 'preempted'


def test_a_child_whose_end_would_end_a_concurrency_container_is_held_back_by_a_lock_on_another() -> None:
    one, other = Scripted(), Scripted()
    both = machine(Child('A', one), Child('B', other), conditions=[('ended', [('A', 'done')])])
    bench = Bench(both)
    bench.lock('/B')
    one.end('done')
    bench.settle()
    assert bench.active == ('/A', '/B')
    bench.unlock('/B')
    assert bench.outcome == 'ended'


def test_a_lock_holds_back_the_last_child_also_while_another_that_has_ended_still_halts() -> None:
    braking = ['braking']
    one, other = Scripted(do={'halting': lambda *_: next(iter(braking), None)}), Scripted()
    children = Child('A', one), Child('B', other), Child('C', Scripted())
    bench = Bench(machine(*children, conditions=[('ended', [('A', 'done'), ('B', 'done')])]))
    bench.lock('/C')
    for state in (one, other):
        state.end('done')
        bench.settle()
    braking.clear()
    one.wake()
    bench.settle()
    assert bench.active == ('/B', '/C')
    bench.unlock('/C')
    assert bench.outcome == 'ended'


def halting_a() -> tuple[Scripted, list[str]]:
    """Return a state that halts as long as the list is not empty."""
    braking = ['braking']
    return Scripted(do={'halting': lambda *_: next(iter(braking), None)}), braking


def test_a_lock_that_is_set_while_the_last_needed_child_halts_holds_the_others() -> None:
    one, braking = halting_a()
    bench = Bench(machine(Child('A', one), Child('B', Scripted()), conditions=[('ended', [('A', 'done')])]))
    one.end('done')
    bench.settle()
    bench.lock('/B')
    assert bench.run.blocked == [TransitionBlocked('/A', 'done', ('/B',))]
    braking.clear()
    one.wake()
    bench.pass_time(10.0)
    assert (bench.active, one.calls('on_exit')) == (('/A', '/B'), 1)
    bench.unlock('/B')
    assert (bench.outcome, bench.run.blocked) == ('ended', [])


@pytest.mark.parametrize('concurrent', [False, True])
def test_a_lock_that_is_set_while_the_last_state_halts_holds_the_machine_around_it(concurrent: bool) -> None:
    one, braking = halting_a()
    child = Child('A', one) if concurrent else Child('A', one, {'done': 'ended'})
    bench = Bench(machine(child, conditions=[('ended', [('A', 'done')])] if concurrent else ()))
    one.end('done')
    bench.settle()
    bench.lock('/')
    braking.clear()
    one.wake()
    bench.settle()
    assert bench.active == ('/A',)
    bench.unlock('/')
    assert bench.outcome == 'ended'


def test_a_lock_of_what_is_being_left_already_comes_too_late_and_tells_it() -> None:
    one, braking = halting_a()
    bench = Bench(machine(Child('A', one, {'done': 'B'}), Child('B', Scripted(), {'done': 'ended'})))
    bench.lock('/B')
    assert bench.lines == []
    one.end('done')
    bench.settle()
    assert bench.lock('/A') is None
    assert bench.lines == [
        (Severity.WARN, '/A', 'it is being left already; the lock holds it from the next time that it is entered')
    ]
    braking.clear()
    one.wake()
    bench.settle()
    assert bench.active == ('/B',)


def test_locks_and_breakpoints_of_what_there_is_not_are_refused() -> None:
    _, bench = subject()
    for command in (bench.lock, bench.set_breakpoint):
        assert command('/M/none') == "there is no state '/M/none'"
    assert bench.unlock('/M') == "'/M' is not one that is locked (none)"
    bench.set_breakpoint('/M/subject')
    assert bench.clear_breakpoint('/M') == "'/M' is not one that has a breakpoint (/M/subject)"
    assert bench.set_breakpoint('/') == (
        'a breakpoint holds a transition, and none leaves /; set it on one of its states'
    )


def test_a_command_gets_its_arguments() -> None:
    def refuse(run: MachineRun, path: str, *, why: str) -> str:
        return f'{path} of {run.root.path}: {why}'

    _, bench = subject()
    bench.run.command('seventh', refuse, '/M', why='busy')
    bench.settle()
    assert (bench.answered[-1], bench.answers[-1]) == ('seventh', '/M of /: busy')


# -- breakpoints -----------------------------------------------------------------------------------------------------


def test_a_breakpoint_makes_each_transition_wait_whatever_the_autonomy() -> None:
    state, bench = subject()
    bench.set_breakpoint('/M/subject')
    state.end('done')
    bench.settle()
    decision = bench.decision
    assert (decision.kind, decision.path, decision.outcome) == (DecisionKind.TRANSITION, '/M/subject', 'done')
    assert bench.set_autonomy(Autonomy.Full) is None
    assert bench.decision == decision
    assert bench.confirm() is None
    assert bench.outcome == 'done'


def test_without_the_breakpoint_the_autonomy_decides_again() -> None:
    state, bench = subject()
    bench.set_breakpoint('/M')
    state.end('done')
    bench.settle()
    assert bench.decision.path == '/M'
    assert bench.clear_breakpoint('/M') is None
    assert bench.outcome == 'done'


# -- repeat ----------------------------------------------------------------------------------------------------------


def test_repeat_leaves_and_enters() -> None:
    state, bench = subject()
    for path in ('/M/subject', '/M'):
        state.trace.clear()
        assert bench.repeat(path) is None
        reason = ExitReason.REPEATED if path == '/M/subject' else ExitReason.PARENT_LEFT
        assert state.trace == [f'on_exit {reason.name}', 'on_enter', 'execute']
        assert bench.transitions[-1] == (path, '', path, ExitReason.REPEATED)
    assert bench.repeat('/') == 'the root cannot be left: stop the run'
    assert bench.repeat('/x') == "there is no state '/x'"


def test_since_when_a_state_is_active_is_told_on_the_clock_of_the_run() -> None:
    _, bench = subject()
    bench.pause()
    bench.pass_time(2.0)
    bench.resume()
    assert [leaf.entered_at for leaf in bench.run.active_states()] == [0.0]
    bench.repeat('/M/subject')
    assert [leaf.entered_at for leaf in bench.run.active_states()] == [2.0]


def test_repeat_waits_for_rest_and_forgets_what_was_wanted() -> None:
    busy: list[str] = []
    state = Scripted('done', outcome='done', do={'halting': lambda *_: busy[0] if busy else None})
    bench = Bench(nested(state, 'A', {'done': Autonomy.Full}))
    decision = bench.decision
    state.outcome = None
    busy.append('braking')
    assert bench.repeat('/A') is None
    assert (bench.run.decisions, state.calls('on_enter')) == ([], 1)
    assert bench.repeat('/A') == '/A is being left already'
    busy.clear()
    state.wake()
    bench.settle()
    assert (bench.run.decisions, state.calls('on_enter')) == ([], 2)
    assert bench.confirm(decision.id) is not None


def test_repeat_of_what_is_around_something_locked_is_refused() -> None:
    _, bench = subject()
    bench.lock('/M/subject')
    assert bench.repeat('/M') == '/M cannot be left, since /M/subject is locked; unlock it first'
    assert bench.repeat('/M/subject') is None


def test_nothing_can_be_made_of_what_is_in_a_machine_that_is_to_be_left() -> None:
    one, other = Scripted(), Scripted()
    both = machine(Child('A', one), Child('B', other), conditions=[('ended', [('A', 'done'), ('B', 'done')])])
    bench = Bench(machine(Child('M', both, {'ended': 'ended'})))
    bench.set_breakpoint('/M/A')
    one.end('done')
    bench.settle()
    bench.lock('/M/B')
    assert bench.force('/M', 'ended') is None
    for path, refusal in (
        ('A', bench.confirm()),
        ('A', bench.force('/M/A', 'done')),
        ('B', bench.repeat('/M/B')),
    ):
        assert refusal == f"/M/{path} stands still, since /M is to be left by 'ended'"
    bench.unlock('/M/B')
    assert bench.outcome == 'ended'
    assert [event for event in bench.trace if 'on_exit' in event] == [
        f'on_exit /M/{label} PARENT_LEFT' for label in 'AB'
    ]


# -- states that go on while they are blocked ------------------------------------------------------------------------


def test_a_state_that_goes_on_may_change_its_mind() -> None:
    state = Stubborn('done', 'failed', outcome='done', rate=1.0)
    bench = Bench(nested(state, 'A', {'done': Autonomy.Full, 'failed': Autonomy.Full}))
    first = bench.decision
    bench.pass_time(3.0)
    assert (bench.decision, state.calls('execute')) == (first, 4)
    state.outcome = None
    bench.pass_time(1.0)
    assert bench.run.decisions == []
    state.outcome = 'failed'
    bench.pass_time(1.0)
    assert (bench.decision.outcome, bench.decision.id != first.id) == ('failed', True)
    assert bench.confirm(first.id) is not None
    assert bench.confirm() is None
    assert bench.outcome == 'failed'


def test_such_a_state_leaves_at_once_by_an_outcome_that_needs_nobody() -> None:
    state = Stubborn('done', 'free', outcome='done', rate=1.0)
    bench = Bench(nested(state, 'A', {'done': Autonomy.Full, 'free': Autonomy.Off}))
    assert bench.decision.outcome == 'done'
    state.outcome = 'free'
    bench.pass_time(1.0)
    assert bench.outcome == 'free'


def test_what_such_a_state_was_forced_to_or_failed_by_stands() -> None:
    def boom(*_: Any) -> Any:
        raise ArithmeticError

    state = Stubborn('done', 'failed', outcome='done', rate=1.0)
    bench = Bench(nested(state, 'A', {'done': Autonomy.Full, 'failed': Autonomy.Full}))
    bench.lock('/A')
    bench.force('/A', 'done')
    bench.pass_time(3.0)
    assert state.calls('execute') == 1
    bench.unlock('/A')
    assert bench.outcome == 'done'
    state = Stubborn('done', 'failed', do={'execute': boom}, rate=1.0)
    bench = Bench(nested(state, 'A', {'done': Autonomy.Full, 'failed': Autonomy.Full}))
    bench.pass_time(3.0)
    assert (state.calls('execute'), bench.decision.outcome) == (1, 'failed')


def test_levels_of_sub_trees_are_told_where_they_differ() -> None:
    bench = Bench(
        machine(Child('M', nested(Scripted(), 'A/B'), {'done': 'N'}), Child('N', passing(), {'done': 'ended'}))
    )
    bench.set_autonomy(Autonomy.Low, '/M')
    bench.set_autonomy(Autonomy.Full, '/M/A/B')
    assert bench.run.controls.levels() == {'/': 3, '/M': 1, '/M/A/B': 3}
    bench.set_autonomy(Autonomy.Off)
    replaced = 'its level of autonomy is Off now, instead of those of /M (Low), /M/A/B (Full)'
    assert bench.lines[-1] == (Severity.INFO, '/', replaced)


def test_a_state_that_takes_longer_than_its_period_is_left_all_the_same() -> None:
    """It is due again as soon as it was executed; what it wants comes first."""

    def take_long(state: Scripted, _: Any) -> str:
        clock = state.services.clock
        clock.set(clock.now() + 0.5)
        return 'done'

    slow = Stubborn(do={'execute': take_long}, rate=10.0)
    bench = Bench(machine(Child('Slow', slow, {'done': 'ended'})))
    assert (bench.outcome, slow.calls('execute')) == ('ended', 1)


# -- steps -----------------------------------------------------------------------------------------------------------


def stepped() -> Bench:
    """Return a run of /A, then /M with /M/B and /M/N with /M/N/C, then /Z, held at /A; each is done at once."""
    deepest = machine(Child('C', passing(), {'done': 'done'}), outcomes=['done'])
    inner = machine(Child('B', passing(), {'done': 'N'}), Child('N', deepest, {'done': 'done'}), outcomes=['done'])
    first = Scripted('done')
    bench = Bench(
        machine(
            Child('A', first, {'done': 'M'}), Child('M', inner, {'done': 'Z'}), Child('Z', passing(), {'done': 'done'}),
            outcomes=['done'],
        )
    )  # fmt: skip
    bench.set_autonomy(Autonomy.Full)
    bench.set_breakpoint('/A')
    first.end('done')
    bench.settle()
    return bench


def walk(bench: Bench, *steps: str) -> list[str]:
    """Return where the run is held after each step; '' where it has ended."""
    places = []
    for how in steps:
        assert bench.step_by(how, bench.decision.id) is None
        places.append(bench.decision.path if bench.outcome is None else '')
    return places


def test_steps_hold_the_next_transition_at_their_depth() -> None:
    everywhere = ['/M/B', '/M/N/C', '/M/N', '/M', '/Z', '']
    assert walk(stepped(), *['into'] * 6) == everywhere
    assert walk(stepped(), *['over'] * 3) == ['/M', '/Z', '']
    assert walk(stepped(), 'into', 'over', 'out') == ['/M/B', '/M/N', '/M']
    assert walk(stepped(), 'into', 'into', 'out', 'over') == ['/M/B', '/M/N/C', '/M/N', '/M']


def test_a_step_is_over_with_the_next_answer_and_a_breakpoint_on_its_way_holds() -> None:
    bench = stepped()
    bench.set_breakpoint('/M/N/C')
    assert walk(bench, 'over') == ['/M/N/C']
    assert str(bench.run.controls.step) == 'over /A'
    assert bench.confirm() is None
    assert (bench.run.controls.step, bench.outcome) == (None, 'done')
    bench = stepped()
    assert walk(bench, 'over') == ['/M']
    assert bench.force('/M', 'done') is None and bench.outcome == 'done'


def test_steps_that_cannot_be_are_refused_and_change_nothing() -> None:
    bench = stepped()
    first = bench.decision.id
    assert 'in no container' in str(bench.step_by('out', first))
    assert bench.step_by('sideways', first) == "there is no step 'sideways'; there are into, over, out"
    assert 'not pending' in str(bench.step_by('over', '99'))
    assert bench.run.controls.step is None and bench.decision.path == '/A'
    bench.pause()
    assert 'paused' in str(bench.step_by('into', first))
    bench.resume()
    assert walk(bench, 'into') == ['/M/B']
    teller = Teller()
    bench.run.add_reader(teller)
    assert bench.clear_breakpoint('/A') is None  # the breakpoint, and then the step
    assert bench.clear_breakpoint('/A') is None
    assert teller.text.count("BreakpointSet('/A', False)") == 2
    assert bench.outcome == 'done'


# -- what is told ----------------------------------------------------------------------------------------------------

SUGGESTED = "TRANSITION, '/M/subject', 'done', ('done', 'failed'), 1, '', 0.0"
OF_MACHINE = "TRANSITION, '/M', 'done', ('done', 'failed'), -1, '', 0.0"
TOLD = f"""
Logged(INFO, '/M', 'its level of autonomy is Low now')
AutonomySet('/M', 1)
Logged(INFO, '/', 'its level of autonomy is Off now, instead of those of /M (Low)')
AutonomySet('/', 0)
BreakpointSet('/M/subject', True)
BreakpointSet('/M/subject', False)
RunPaused(True)
StatePaused('/M/subject', True)
RunPaused(False)
StatePaused('/M/subject', False)
LockSet('/M', True)
TransitionBlocked('/M/subject', 'done', ('/M',))
LockSet('/M', False)
DecisionAsked(Decision('1', {SUGGESTED}))
TransitionUnblocked('/M/subject')
DecisionClosed(Decision('1', {SUGGESTED}))
StateExited('/M/subject')
StateLeft('/M/subject', '', '/M/subject', REPEATED)
StateEntered('/M/subject')
DecisionAsked(Decision('2', {SUGGESTED}))
DecisionTaken('2')
DecisionClosed(Decision('2', {SUGGESTED}))
OutcomeTaken('/M/subject', 'done', 1)
StateExited('/M/subject')
StateLeft('/M/subject', 'done', '=done', OUTCOME)
DecisionAsked(Decision('3', {OF_MACHINE}))
OutcomeForced('/M', 'failed')
DecisionClosed(Decision('3', {OF_MACHINE}))
OutcomeTaken('/M', 'failed', -1)
StateLeft('/M', 'failed', '=failed', FORCED)
RunEnded('failed', '')
"""


class Teller(RunReader):
    """Writes events with fields as lines, without the answers to commands."""

    def __init__(self) -> None:
        self.text = '\n'

    def read(self, event: RunEvent) -> None:
        if not isinstance(event, CommandDecided | RunEnding | RunRested):
            self.text += re.sub(r'\w+=|<\w+\.(\w+): [^>]*>', r'\1', repr(event)) + '\n'


def test_every_command_and_what_follows_from_it_is_told_once() -> None:
    state, bench = subject()
    teller = Teller()
    bench.run.add_reader(teller)
    for command, arguments in (
        (bench.set_autonomy, (Autonomy.Low, '/M')),
        (bench.set_autonomy, (Autonomy.Off,)),
        (bench.set_breakpoint, ('/M/subject',)),
        (bench.clear_breakpoint, ('/M/subject',)),
        (bench.pause, ()),
        (bench.resume, ()),
        (bench.lock, ('/M',)),
        (state.end, ('done',)),
        (bench.settle, ()),
        (bench.unlock, ('/M',)),
        (bench.repeat, ('/M/subject',)),
        (bench.step_by, ('over', '2')),
        (bench.force, ('/M', 'failed')),
    ):
        assert command(*arguments) is None
    assert teller.text == TOLD


def test_a_run_that_nobody_reads_writes_to_the_log(caplog: pytest.LogCaptureFixture) -> None:
    def enter(state: Scripted, _: Any) -> None:
        for severity in Severity:
            state.log(severity, severity.name)

    first, second = Scripted(do={'on_enter': enter}), Scripted('done', 'failed', do={'execute': lambda *_: 1 / 0})
    made = machine(Child('A', first, {'done': 'B'}), Child('B', second, {'done': 'ended', 'failed': 'ended'}))
    run = MachineRun(define(made), ManualClock())
    with caplog.at_level(logging.DEBUG):
        run.start()
        run.step()
        run.command(1, operator_commands.repeat, '/A')
        run.step()
        first.end('done')
        run.step()
    lines = [f'{record.levelname} {record.getMessage()}' for record in caplog.records]
    told = ['DEBUG /A: DEBUG', 'INFO /A: INFO', 'INFO /A: HINT', 'WARNING /A: WARN', 'ERROR /A: ERROR']
    assert sorted(lines[:5]) == sorted(told)
    assert lines[5] == 'INFO /A > (again), the state is entered again'
    assert lines[11] == 'INFO /A > done, the state returned an outcome'
    assert lines[12].startswith('ERROR /B: execute raised:\nTraceback')
    assert lines[13:] == ['INFO /B > failed, the state, or another one, raised an exception']
