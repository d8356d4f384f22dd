# SPDX-License-Identifier: BSD-3-Clause
"""The fate of commands."""

from __future__ import annotations

import random
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.mirror.command_tracker import LONGEST_RESEND, CommandState, Confirmation
from flexbt_console.mirror.mirror import GUARD_SECONDS, Mirror, Transit
from flexbt_console.mirror.records import (
    CommandKind,
    CommandResult,
    ExecutiveSnapshot,
    OperatorCommand,
    ResultCode,
    StopGuard,
)
from flexbt_console.present.rendering import alarm_line, command_result_lines
from flexbt_core.clock.clock import ManualClock


def command(id: str, kind: CommandKind = CommandKind.STOP) -> OperatorCommand:
    return OperatorCommand(id, kind, 'ann', executive_id='e')


def answers(sequence: int, *codes: tuple[str, ResultCode, str], executive: str = 'e') -> ExecutiveSnapshot:
    return ExecutiveSnapshot(executive, sequence, results=tuple(CommandResult(*code) for code in codes))


def linked() -> tuple[ManualClock, Mirror]:
    clock = ManualClock()
    mirror = Mirror(clock)
    mirror.receive_snapshot(ExecutiveSnapshot('e', 1), Transit(0.0, 0.0))
    return clock, mirror


def state(mirror: Mirror, id: str) -> CommandState:
    tracked = mirror.command(id)
    assert tracked is not None
    return tracked.state


def test_it_is_sent_again_with_the_same_id_until_it_is_answered() -> None:
    clock, mirror = linked()
    mirror.give(command('a'), 5.0)
    sent = []
    while clock.now() < 3.0:
        sent += mirror.due_commands(True)
        due = mirror.next_command_time(True)
        assert due is not None and due > clock.now()
        clock.set(due)
    assert {entry.id for entry in sent} == {'a'}
    assert 4 <= len(sent) <= 6
    mirror.receive_snapshot(answers(2, ('a', ResultCode.APPLIED, '')))
    assert state(mirror, 'a') is CommandState.APPLIED
    assert mirror.due_commands(True) == []
    assert mirror.next_command_time(True) is None


def test_one_that_was_lost_is_not_received_after_a_later_one() -> None:
    clock, mirror = linked()
    mirror.give(command('resume', CommandKind.RESUME), 60.0)
    for _ in range(8):
        clock.advance(0.7)
        mirror.due_commands(True)
    mirror.give(command('pause', CommandKind.PAUSE), 60.0)
    for _ in range(20):
        sent = [one.id for one in mirror.due_commands(True)]
        assert 'pause' not in sent or sent == ['resume', 'pause']
        clock.advance(0.05)


def test_the_reason_of_a_refusal_is_kept() -> None:
    _, mirror = linked()
    mirror.give(command('a'), 5.0)
    mirror.receive_snapshot(answers(2, ('a', ResultCode.REFUSED, 'stale')))
    tracked = mirror.command('a')
    assert tracked is not None and (tracked.state, tracked.reason) == (CommandState.REFUSED, 'stale')


def test_a_late_answer_corrects_the_timeout() -> None:
    clock, mirror = linked()
    mirror.give(command('a'), 1.0)
    mirror.due_commands(True)
    clock.advance(1.0)
    assert mirror.due_commands(True) == []
    assert state(mirror, 'a') is CommandState.TIMEOUT
    mirror.receive_snapshot(answers(2, ('a', ResultCode.APPLIED, '')))
    assert state(mirror, 'a') is CommandState.APPLIED


def test_an_answer_is_final() -> None:
    _, mirror = linked()
    mirror.give(command('a'), 1.0)
    mirror.receive_snapshot(answers(2, ('a', ResultCode.APPLIED, '')))
    mirror.receive_snapshot(answers(3, ('a', ResultCode.REFUSED, 'no')))
    assert state(mirror, 'a') is CommandState.APPLIED


def test_what_was_given_before_a_stop_is_not_sent_after_it() -> None:
    clock, mirror = linked()
    for id, kind in (('start', CommandKind.START), ('stop', CommandKind.STOP), ('note', CommandKind.NOTE)):
        mirror.give(command(id, kind), 100.0)
    sent = set()
    while clock.now() < 20.0:
        sent |= {one.id for one in mirror.due_commands(True)}
        clock.advance(0.5)
    assert sent == {'stop', 'note'}
    assert state(mirror, 'start') is CommandState.TIMEOUT
    mirror.receive_snapshot(answers(2, ('start', ResultCode.APPLIED, '')))  # it had been sent all the same
    assert state(mirror, 'start') is CommandState.APPLIED


def test_what_waited_when_a_stop_was_given_is_refused() -> None:
    _, mirror = linked()
    before = CommandBuilder('ann').command(mirror.view(), CommandKind.START)
    mirror.give(command('stop', CommandKind.STOP), 5.0)
    after = CommandBuilder('ann').command(mirror.view(), CommandKind.START)
    for one in (before, after):
        mirror.give(one, 5.0)
    assert [one.id for one in mirror.due_commands(True)] == ['stop', after.id]
    assert state(mirror, before.id) is CommandState.REFUSED


def test_a_restarted_executive_does_not_get_the_old_command() -> None:
    """The executive that was killed may have applied it: another start must not repeat it."""
    clock, mirror = linked()
    mirror.give(command('a'), 60.0)
    assert mirror.due_commands(True)
    clock.advance(5.0)
    mirror.receive_snapshot(ExecutiveSnapshot('f', 1))
    assert state(mirror, 'a') is CommandState.TIMEOUT
    assert mirror.due_commands(True) == []


def test_a_stop_that_is_not_answered_in_time_was_not_got_by_who_is_shown() -> None:
    clock, mirror = linked()
    mirror.give(command('a'), 60.0)
    mirror.give(replace(command('b'), kind=CommandKind.CONFIRM), 60.0)  # it waits for the behavior
    assert len(mirror.due_commands(True)) == 2
    for sequence, seconds in ((2, 2.9), (3, 0.2)):
        assert mirror.passed_over_stops() == frozenset()
        clock.advance(seconds)
        mirror.receive_snapshot(answers(sequence))
    assert mirror.passed_over_stops() == {'a'}
    mirror.receive_snapshot(answers(4, ('a', ResultCode.APPLIED, '')))
    assert mirror.passed_over_stops() == frozenset()


def test_a_command_that_waits_for_hours_is_sent_all_the_time() -> None:
    clock, mirror = linked()
    mirror.give(command('a'), 36_000.0)
    for _ in range(1100):
        assert len(mirror.due_commands(True)) == 1
        clock.advance(LONGEST_RESEND)


def test_a_stop_that_waits_is_not_forgotten_however_many_commands_follow() -> None:
    clock, mirror = linked()
    mirror.give(command('stop'), 60.0)
    for number in range(1000):
        mirror.give(command(f'n{number}', CommandKind.NOTE), 1.0)
    clock.advance(2.0)
    assert [one.id for one in mirror.due_commands(True)] == ['stop']
    mirror.give(command('last', CommandKind.NOTE), 1.0)
    assert mirror.command('n0') is None and state(mirror, 'n999') is CommandState.TIMEOUT


def test_nothing_is_sent_to_nobody() -> None:
    clock, mirror = linked()
    mirror.give(command('a', CommandKind.PAUSE), 1.0)
    assert mirror.due_commands(False) == []
    assert mirror.next_command_time(False) == 1.0
    clock.advance(1.0)
    mirror.due_commands(False)
    tracked = mirror.command('a')
    assert tracked is not None and 'nothing was sent' in tracked.reason


def test_a_stop_is_sent_whoever_is_there_and_again_when_somebody_comes() -> None:
    clock, mirror = linked()
    mirror.give(command('a'), 5.0)
    assert [one.id for one in mirror.due_commands(False)] == ['a']
    assert mirror.due_commands(False) == []
    mirror.send_stops_again()
    assert [one.id for one in mirror.due_commands(False)] == ['a']
    due = mirror.next_command_time(False)
    assert due is not None and due < 1.0
    clock.advance(5.0)
    mirror.due_commands(False)
    tracked = mirror.command('a')
    assert tracked is not None and 'stop the robot by other means' in tracked.reason
    assert 'neither the executive nor the stop guard' in command_result_lines(tracked)[0]


def test_a_stop_that_the_guard_has_confirmed_goes_on_to_the_executive() -> None:
    clock, mirror = linked()
    mirror.give(command('a'), 5.0)
    mirror.give(command('b', CommandKind.PAUSE), 5.0)
    mirror.due_commands(True)
    clock.advance(0.2)
    mirror.receive_guard(StopGuard(('a', 'b', 'unknown'), holding=True, operator='ann'))
    tracked = mirror.command('a')
    assert tracked is not None
    assert (tracked.state, tracked.confirmed_by) == (CommandState.APPLIED, Confirmation.STOP_GUARD)
    assert 'confirmed by the stop guard' in command_result_lines(tracked)[0]
    assert state(mirror, 'b') is CommandState.PENDING, 'it stops, and does nothing else'
    assert 'HELD BY THE STOP GUARD' in alarm_line(mirror.view())
    clock.advance(GUARD_SECONDS + 0.1)
    assert 'STOP GUARD SILENT' in alarm_line(mirror.view()), 'it may have been killed'
    mirror.receive_guard(StopGuard(('a', 'b'), holding=True, operator='ann'))
    assert 'HELD BY THE STOP GUARD' in alarm_line(mirror.view())
    assert 'a' in [one.id for one in mirror.due_commands(True)]
    mirror.receive_snapshot(answers(2, ('a', ResultCode.REFUSED, 'unconfigured')))
    assert state(mirror, 'a') is CommandState.APPLIED, 'the robot is stopped all the same'
    mirror.receive_guard(StopGuard(('a',)))
    mirror.receive_snapshot(answers(3, ('a', ResultCode.APPLIED, '')))
    tracked = mirror.command('a')
    assert tracked is not None and tracked.confirmed_by is Confirmation.EXECUTIVE
    assert 'confirmed by the executive' in command_result_lines(tracked)[0]
    assert not alarm_line(mirror.view())
    mirror.receive_guard(StopGuard(('a',)))
    assert tracked == mirror.command('a')
    mirror.give(command('c'), 5.0)
    mirror.receive_guard(StopGuard(('c',)))
    clock.advance(5.0)
    mirror.due_commands(True)
    assert state(mirror, 'c') is CommandState.APPLIED, 'it is not without an answer, though the executive is'
    assert mirror.next_command_time(True) is None


@given(seed=st.integers(0, 2**32), loss=st.sampled_from([0.0, 0.3, 0.7]))
def test_each_command_has_one_effect_and_an_answer_over_a_lossy_link(seed: int, loss: float) -> None:
    """Both ways lose, double and delay; the executive applies an identifier once."""
    rng = random.Random(seed)
    clock, mirror = linked()
    effects: list[str] = []
    results: list[CommandResult] = []
    sequence = 1
    on_the_way: list[tuple[float, OperatorCommand]] = []
    ids = [f'c{number}' for number in range(6)]
    for id in ids:
        mirror.give(command(id), 1000.0)
    while any(state(mirror, id) is CommandState.PENDING for id in ids):
        clock.advance(0.1)
        for entry in mirror.due_commands(True):
            for _ in range(rng.choice([1, 2])):
                if rng.random() >= loss:
                    on_the_way.append((clock.now() + rng.random(), entry))
        for arrival, entry in list(on_the_way):
            if arrival <= clock.now():
                on_the_way.remove((arrival, entry))
                if entry.id not in effects:
                    effects.append(entry.id)
                    results.append(CommandResult(entry.id, ResultCode.APPLIED))
        sequence += 1
        if rng.random() >= loss:
            mirror.receive_snapshot(ExecutiveSnapshot('e', sequence, results=tuple(results)))
    assert sorted(effects) == ids
    assert all(state(mirror, id) is CommandState.APPLIED for id in ids)
