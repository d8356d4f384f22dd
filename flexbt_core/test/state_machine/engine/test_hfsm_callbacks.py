# SPDX-License-Identifier: BSD-3-Clause
"""When the callbacks of a state are called, in which order across the levels, and what they are told."""

from __future__ import annotations

import fractions
from dataclasses import dataclass
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import EventState, ExitReason
from flexbt_core.state_machine.model.state_host import Progress, Severity
from flexbt_core.state_machine.model.userdata import StateError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing


def two_levels(first: Scripted, inner: Scripted, last: Scripted) -> OperatableStateMachine:
    """First, then Middle with Inner, then Last, which may also go back to Middle."""
    middle = machine(Child('Inner', inner, {'done': 'left'}), outcomes=['left'])
    return machine(
        Child('First', first, {'done': 'Middle'}),
        Child('Middle', middle, {'left': 'Last'}),
        Child('Last', last, {'done': 'ended', 'again': 'Middle'}),
    )


def test_all_states_are_started_first_and_stopped_last_and_each_is_left_before_the_next_is_entered() -> None:
    bench = Bench(two_levels(passing(), passing(), Scripted('done', 'again', outcome='done')))
    assert bench.outcome == 'ended'
    assert bench.trace == [
        *('on_start /First', 'on_start /Middle/Inner', 'on_start /Last'),
        *('on_enter /First', 'execute /First', 'on_exit /First OUTCOME'),
        *('on_enter /Middle/Inner', 'execute /Middle/Inner', 'on_exit /Middle/Inner OUTCOME'),
        *('on_enter /Last', 'execute /Last', 'on_exit /Last OUTCOME'),
        *('on_stop /First', 'on_stop /Middle/Inner', 'on_stop /Last'),
    ]
    assert bench.transitions == [
        ('/First', 'done', '/Middle', ExitReason.OUTCOME),
        ('/Middle/Inner', 'done', '=left', ExitReason.OUTCOME),
        ('/Middle', 'left', '/Last', ExitReason.OUTCOME),
        ('/Last', 'done', '=ended', ExitReason.OUTCOME),
    ]


def test_a_state_that_is_visited_again_is_entered_and_left_again_but_started_once() -> None:
    answers = iter(['again', 'again', 'done'])
    inner, last = passing(), Scripted('done', 'again', do={'execute': lambda state, _: next(answers)})
    bench = Bench(two_levels(passing(), inner, last))
    assert bench.outcome == 'ended'
    for state in (inner, last):
        assert [state.calls(name) for name in ('on_start', 'on_enter', 'on_exit', 'on_stop')] == [1, 3, 3, 1]


def test_states_that_are_never_visited_are_started_and_stopped_too() -> None:
    never = Scripted()
    bench = Bench(
        machine(
            Child('One', passing(outcomes=['done', 'other']), {'done': 'ended', 'other': 'Never'}),
            Child('Never', never, {'done': 'ended'}),
        )
    )
    assert bench.outcome == 'ended'
    assert never.trace == ['on_start', 'on_stop']


def test_a_state_that_waits_is_executed_once_and_nothing_is_called_meanwhile() -> None:
    state = Scripted()
    bench = Bench(nested(state, 'A/B/C'))
    bench.pass_time(1000.0)
    assert state.trace == ['on_start', 'on_enter', 'execute']
    state.end('done')
    bench.settle()
    assert state.trace == ['on_start', 'on_enter', 'execute', 'execute', 'on_exit OUTCOME', 'on_stop']
    assert bench.outcome == 'done'


def stop(bench: Bench) -> None:
    bench.stop()


def force_it(bench: Bench) -> None:
    assert bench.force('/A/B/C', 'done') is None


def force_what_is_around(bench: Bench) -> None:
    assert bench.force('/A', 'failed') is None


def raise_in_it(bench: Bench) -> None:
    bench.run.active_states()[0].state.wake()
    bench.settle()


def end_it(bench: Bench) -> None:
    state = bench.run.active_states()[0].state
    assert isinstance(state, Scripted)
    state.do.clear()
    state.end('failed')
    bench.settle()


@pytest.mark.parametrize(
    ('leave', 'reason', 'outcome'),
    [
        (end_it, ExitReason.OUTCOME, 'failed'),
        (raise_in_it, ExitReason.FAULT, 'failed'),
        (force_it, ExitReason.FORCED, 'done'),
        (force_what_is_around, ExitReason.PARENT_LEFT, 'failed'),
        (stop, ExitReason.PREEMPTED, 'preempted'),
    ],
)
def test_a_state_is_told_why_it_is_left(leave: Any, reason: ExitReason, outcome: str) -> None:
    def execute(state: Scripted, _: Any) -> None:
        if state.calls('execute') > 1:
            raise ArithmeticError

    state = Scripted('done', 'failed', do={'execute': execute})
    bench = Bench(nested(state, 'A/B/C'))
    assert state.exit_reason is None
    leave(bench)
    assert state.trace[-2:] == [f'on_exit {reason.name}', 'on_stop']
    assert bench.outcome == outcome


@pytest.mark.parametrize(
    ('leave', 'reason'),
    [(stop, ExitReason.PREEMPTED), (force_what_is_around, ExitReason.PARENT_LEFT), (force_it, ExitReason.FORCED)],
)
def test_the_reason_is_that_of_leaving_not_of_what_the_state_had_wanted_before(leave: Any, reason: ExitReason) -> None:
    """The state raised, and 'failed' waits for the operator, who decides something else."""

    def execute(state: Scripted, _: Any) -> None:
        raise ArithmeticError

    state = Scripted('done', 'failed', do={'execute': execute})
    bench = Bench(nested(state, 'A/B/C', {'failed': Autonomy.Full}))
    assert bench.decision.outcome == 'failed'
    leave(bench)
    assert state.trace[-2:] == [f'on_exit {reason.name}', 'on_stop']


def test_an_old_reason_is_forgotten_when_the_state_is_entered_again() -> None:
    seen: list[Any] = []
    state = Scripted('done', 'again', do={'on_enter': lambda state, _: seen.append(state.exit_reason)})
    bench = Bench(machine(Child('One', state, {'done': 'ended', 'again': 'One'})))
    assert bench.force('/One', 'again') is None
    assert seen == [None, None]
    state.end('done')
    bench.settle()
    assert state.trace[-2:] == ['on_exit OUTCOME', 'on_stop']


def test_the_operator_sees_a_state_before_its_on_enter_which_may_take_long() -> None:
    def look(state: Scripted, _: Any) -> None:
        shown.append(bench[0].snapshots[-1].active if bench else ())

    shown: list[Any] = []
    bench: list[Bench] = []
    second = Scripted(do={'on_enter': look})
    inner = machine(Child('Second', second, {'done': 'ended'}))
    first = Scripted()
    bench.append(Bench(machine(Child('First', first, {'done': 'Inner'}), Child('Inner', inner, {'ended': 'ended'}))))
    first.end('done')
    bench[0].settle()
    assert shown == [('/Inner/Second',)]


def test_what_a_state_may_use_in_its_callbacks() -> None:
    def use(state: Scripted, _: Any) -> None:
        seen.append((state.name, state.path, state.clock.now(), state.services))
        state.log_warn('hot')

    seen: list[Any] = []
    state = Scripted(outcome='done', do=dict.fromkeys(('on_start', 'on_enter', 'execute', 'on_exit', 'on_stop'), use))
    bench = Bench(nested(state, 'A/B'))
    assert bench.outcome == 'done'
    assert seen == [('B', '/A/B', 0.0, bench)] * 5
    assert bench.lines == [(Severity.WARN, '/A/B', 'hot')] * 5


def test_what_a_state_tells_the_operator_has_the_types_of_messages() -> None:
    def tell(state: Scripted, _: Any) -> None:
        told: Any = 5
        state.log_info(told)
        state.ask(told)

    state = Scripted(do={'on_enter': tell})
    bench = Bench(nested(state, 'A'))
    assert bench.lines == [(Severity.INFO, '/A', '5')]
    assert bench.decision.prompt == '5'


@pytest.mark.parametrize(
    ('value', 'is_usable'), [(fractions.Fraction(7, 2), True), (2, True), ('far', False), (None, False)]
)
def test_the_progress_of_a_state_has_the_types_of_its_message(value: Any, is_usable: bool) -> None:
    class Moving(Scripted):
        def progress(self) -> Progress:
            return Progress(distance=value, poses=10**6, recoveries=-1)

    bench = Bench(nested(Moving(), 'A'))
    (leaf,) = bench.run.active_states()
    told = leaf.progress()
    if is_usable:
        assert told == Progress(distance=float(value), poses=2**15 - 1)
        assert type(told.distance) is float
    else:
        assert told is None
        assert bench.faults[0][0] == '/A'


def test_progress_keeps_to_the_bounds_of_its_message_and_is_known_if_it_has_a_figure() -> None:
    assert Progress('7') == Progress('7', -1.0, -1.0, -1, 0, None)
    assert Progress(poses=-5, recoveries=-5) == Progress(poses=-1, recoveries=0)
    most = Progress(poses=10**9, recoveries=10**9)
    assert (most.poses, most.recoveries) == (2**15 - 1, 2**16 - 1)
    assert not Progress('7').is_known
    figures: list[dict[str, Any]] = [{'distance': 0}, {'time': 0}, {'poses': 0}, {'recoveries': 1}, {'goal': 'here'}]
    assert all(Progress(**figure).is_known for figure in figures)
    given: Any = ('7', 1, 2, 3.0, 4.0)
    plain = Progress(*given)
    assert [type(one) for one in (plain.distance, plain.time, plain.poses, plain.recoveries)] == [
        float,
        float,
        int,
        int,
    ]


def test_what_a_state_is_made_with_is_what_people_can_write() -> None:
    @dataclass
    class Options:
        speed: float = 0.5
        tool: object = None

    class Drive(Scripted):
        def __init__(self) -> None:
            super().__init__(rate=2.0)
            self._goal = 'dock'
            self.options = Options()

    made = Drive().made_with
    assert {name: made.get(name) for name in ('goal', 'speed', 'desired_rate', 'tool', 'is_resumed')} == {
        'goal': 'dock', 'speed': '0.5', 'desired_rate': '2.0', 'tool': None, 'is_resumed': None,
    }  # fmt: skip
    assert Drive().type_name == 'Drive'


@pytest.mark.parametrize('write', ['info', 'hint', 'warn', 'error'])
def test_a_line_for_the_operator_has_the_severity_of_its_method(write: str) -> None:
    state = Scripted(do={'on_enter': lambda state, _: getattr(state, f'log_{write}')('hot')})
    assert Bench(nested(state, 'A')).lines == [(Severity[write.upper()], '/A', 'hot')]


def test_what_a_state_declares_wrongly_is_refused_with_the_reason() -> None:
    suggests = Scripted('done', 'failed', do={'on_enter': lambda state, _: state.ask('?', 'gone')})
    assert "/A: suggests 'gone', which is none of done, failed" in Bench(nested(suggests, 'A')).faults[0][1]
    with pytest.raises(StateError, match=r'^Scripted: desired_rate has to be positive, or None, not 0$'):
        Scripted(rate=0)
    keys: Any = [True]
    for what, options in (('an outcome', {'outcomes': keys}), ('a userdata key', {'input_keys': keys})):
        with pytest.raises(StateError, match=f'^EventState: True cannot be {what}: it is not text; in YAML, quote it$'):
            EventState(**options)


def test_outside_of_a_run_there_is_nothing_to_use_and_waking_is_harmless() -> None:
    state = passing()
    assert (state.is_resumed, state.exit_reason, state.bound_to) == (False, None, None)
    for _ in range(2):
        state.wake()
        assert state.path == 'Scripted'
        for use in (lambda: state.clock, lambda: state.services, lambda: state.ask('?'), lambda: state.wake_at(1.0)):
            with pytest.raises(StateError, match=r'^Scripted: is not part of a run; this works only in its callbacks$'):
                use()
        assert Bench(nested(state, 'A')).outcome == 'done'


def test_a_state_can_be_in_one_run_at_a_time() -> None:
    state = Scripted()
    made = nested(state, 'A')
    first = Bench(made)
    second = Bench(made, start=False)
    with pytest.raises(StateError, match='/A: the state is part of a run that has not ended'):
        second.run.start()
    second.run.fail('it could not be started')
    second.settle()
    second.run.step()
    assert second.outcome == 'error'
    assert (first.active, state.calls('on_stop')) == (('/A',), 0)
    first.stop()
    assert Bench(made).active == ('/A',)


def test_what_a_state_reports_of_its_work_is_text() -> None:
    class Reports(Scripted):
        def activity(self) -> list[Any]:
            return ['drives', 5]

        def not_paused(self) -> list[Any]:
            return ['fan: it is loud', 7]

    bench = Bench(nested(Reports(), 'A'))
    (leaf,) = bench.run.active_states()
    assert (leaf.activity(), leaf.not_paused(), leaf.progress()) == (['drives', '5'], [], None)
    bench.pause()
    assert leaf.not_paused() == ['fan: it is loud', '7']
    assert leaf.next_wake() is None


@pytest.mark.parametrize('report', ['activity', 'progress', 'not_paused'])
def test_a_report_that_raises_is_a_fault_of_that_report(report: str) -> None:
    broken = type('Broken', (Scripted,), {report: lambda _: 1 / 0})
    bench = Bench(nested(broken(), 'A'))
    bench.pause()
    (leaf,) = bench.run.active_states()
    assert getattr(leaf, report)() is None
    ((path, text),) = bench.faults
    assert path == '/A' and text.startswith(f'{report} raised:\nTraceback')


def test_a_command_that_raises_is_refused_and_the_run_continues() -> None:
    def broken(run: Any, what: str) -> str | None:
        raise KeyError(what)

    bench = Bench(nested(Scripted(), 'A'))
    assert bench.answer_to(broken, 'x') == "fault in the state machine: KeyError: 'x'"
    ((path, text),) = bench.faults
    assert path == '/' and text.startswith('a command raised; the run continues:\nTraceback')
    assert text.endswith("KeyError: 'x'")
    assert (bench.active, bench.run.is_ending) == (('/A',), False)
    bench.stop()
    assert bench.run.is_ending


def test_a_run_is_woken_for_its_readers_too() -> None:
    class Reader(Bench):
        due: float | None = None

        def next_wake(self) -> float | None:
            return self.due

    state = Scripted(do={'on_enter': lambda state, _: state.wake_at(5.0)})
    bench = Reader(nested(state, 'A'))
    for bench.due, due in ((None, 5.0), (7.0, 5.0), (3.0, 3.0)):
        assert bench.run.next_wake == due
