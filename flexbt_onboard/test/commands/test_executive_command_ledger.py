# SPDX-License-Identifier: BSD-3-Clause
"""The ledger of commands: each has its effect at most once, and is answered as often as it is sent."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_core.clock.clock import SteadyClock
from flexbt_core.state_machine.engine.events import CommandDecided
from flexbt_msgs.msg import (
    BehaviorArgument,
    BehaviorStructure,
    BlackboardEntry,
    CommandResult,
    ExecutiveCommand,
    QueueOptions,
)
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.commands.command_bounds import (
    ARGUMENT_LENGTHS,
    ARGUMENTS,
    COMMAND_LENGTHS,
    INPUT_LENGTHS,
    INPUTS,
    OPTION_LENGTHS,
    OUTCOME_LENGTH,
    excess_of_command,
)
from flexbt_onboard.commands.command_ledger import OPEN_COMMANDS, REPORT_TIME, CommandHandling, CommandLedger
from flexbt_onboard.commands.command_registry import CommandRegistry, command_fields
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.persistence.event_log import EventLog
from flexbt_onboard.persistence.run_journal import RunJournal
from flexbt_onboard.runs.run_events import RunBuilt, RunRefused

STOP, START = ExecutiveCommand.STOP, ExecutiveCommand.START


class Books(CommandHandling):
    """A ledger, and commands with effects that are counted: START is decided later, REPEAT is refused, LOCK raises."""

    def __init__(self, remembered: int = 4096, directory: str = '') -> None:
        super().__init__()
        self.effects: list[str] = []
        self.handed: list[tuple[ExecutiveCommand, bytes, float]] = []
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.changes = 0
        self.time = 100.0
        self.told: list[str] = []
        self.journal = RunJournal(
            Path(directory, 'executive.journal') if directory else None, self.told.append, SteadyClock()
        )
        clock: Any = SimpleNamespace(stamp=None)
        stream: Any = SimpleNamespace(add=lambda event, fields: self.events.append((event, fields)))
        report = Reporter(
            lambda _severity, text, path='', run_id='': self.told.append(text),
            EventLog(None, clock, clock, print),
            stream,
        )
        runtime: Any = SimpleNamespace(post=self._post)
        status: Any = SimpleNamespace(changed=self._changed)
        self.ledger = CommandLedger(runtime, self, self.journal, report, status, remembered, now=lambda: self.time)

    def send(self, id: str, kind: int = STOP) -> None:
        """Let a command arrive."""
        self.ledger.receive(ExecutiveCommand(id=id, kind=kind, executive_id='other' if id == 'other' else ''))

    def results(self) -> list[tuple[str, int]]:
        """Return what is reported."""
        return [(result.command_id, result.code) for result in self.ledger.results()]

    def is_addressed(self, command: ExecutiveCommand) -> bool:
        return not command.executive_id

    def fields(self, command: ExecutiveCommand) -> dict[str, Any]:
        return {'id': command.id, 'operator': command.operator_id, 'because': command.reason}

    def apply(self, command: ExecutiveCommand, writer: bytes, arrived: float) -> bool:
        self.handed.append((command, writer, arrived))
        if command.kind == ExecutiveCommand.REPEAT:
            raise CommandRefusedError('no')
        if command.kind == ExecutiveCommand.LOCK:
            raise ValueError('broken')
        self.effects.append(command.id)
        return bool(command.kind != START)

    def _post(self, fn: Callable[[], None]) -> None:
        fn()

    def _changed(self) -> None:
        self.changes += 1


A, R = CommandResult.APPLIED, CommandResult.REFUSED


def test_a_resend_has_no_effect_and_its_result_is_reported_last() -> None:
    books = Books()
    books.send('a', ExecutiveCommand.REPEAT)
    books.send('b')
    assert books.results() == [('a', R), ('b', A)]
    books.send('a', ExecutiveCommand.REPEAT)
    books.send('b')
    books.send('a')
    assert books.results() == [('b', A), ('a', R)]
    assert books.ledger.results()[1].reason == 'no'
    assert books.effects == ['b']


def test_a_command_that_is_decided_later_is_reported_then_and_the_first_decision_counts() -> None:
    books = Books()
    books.send('start', START)
    books.send('start', START)
    assert (books.results(), books.effects) == ([], ['start'])
    books.ledger.read(CommandDecided('start', None))
    books.ledger.read(CommandDecided('start', 'too late'))
    assert books.results() == [('start', A)]


def test_an_executive_that_cannot_work_refuses_every_command_with_the_reason() -> None:
    handling, command = CommandHandling('no library'), ExecutiveCommand(id='a', executive_id='other')
    assert handling.is_addressed(command) and handling.fields(command) == {}
    with pytest.raises(CommandRefusedError, match=r'^no library$'):
        handling.apply(command, b'', 0.0)


def test_a_command_whose_handler_fails_is_refused_and_the_fault_is_told() -> None:
    books = Books()
    with pytest.raises(ValueError, match='broken'):
        books.send('a', ExecutiveCommand.LOCK)
    assert books.results() == [('a', R)]
    assert 'ValueError: broken' in books.ledger.results()[0].reason


def test_the_event_log_has_each_command_with_its_effect_and_why() -> None:
    books = Books()
    books.send('a')
    books.send('b', ExecutiveCommand.REPEAT)
    books.send('other')
    assert books.changes == 3, 'the sender of a command for another executive looks at a status'
    large = 'x' * 1001
    for id, executive in (('c', ''), ('d', 'other')):
        books.ledger.receive(
            ExecutiveCommand(id=id, kind=START, operator_id='ann', reason=large, executive_id=executive)
        )
    for id in 'ef':
        books.send(id, START)
    built: Any = SimpleNamespace(command_id='e')
    books.ledger.read(RunBuilt(built, BehaviorStructure(), OperatorGone.CONTINUE, 1.0))
    books.ledger.read(RunRefused(SimpleNamespace(command_id='f'), 'broken'))  # type: ignore[arg-type]
    too_large = 'reason has at most 1000 characters, not 1001'
    assert books.events == [
        ('command', {'id': id, 'operator': operator, 'because': '', 'effect': effect, 'why': why})
        for id, operator, effect, why in (
            ('a', '', 'applied', ''),
            ('b', '', 'refused', 'no'),
            ('other', '', 'ignored', 'meant for another executive'),
            ('c', 'ann', 'refused', too_large),
            ('d', 'ann', 'ignored', 'meant for another executive'),
            ('e', '', 'applied', ''),
            ('f', '', 'refused', 'broken'),
        )
    ]
    assert books.results() == [('a', A), ('b', R), ('c', R), ('e', A), ('f', R)]


def test_a_command_that_cannot_be_answered_is_ignored_and_told_every_few_seconds() -> None:
    books = Books()
    longest = COMMAND_LENGTHS['id']
    for id, seconds in (('', 0.0), ('', COMPLAINT_SECONDS - 0.1), ('x' * (longest + 1), 0.1)):
        books.time += seconds
        books.ledger.receive(ExecutiveCommand(id=id, kind=START, operator_id='eva'))
    assert (books.results(), books.handed) == ([], [])
    reasons = ['it has no id', 'its id has 129 characters, and may have 128']
    assert books.told == [f"a command of operator 'eva' was ignored: {why}" for why in reasons]
    assert books.events == [
        ('command', {'operator': 'eva', 'kind': START, 'effect': 'ignored', 'why': why}) for why in reasons
    ]
    books.time += COMPLAINT_SECONDS
    books.ledger.receive(ExecutiveCommand(kind=START, operator_id='x' * 10_000))
    assert len(books.told[-1]) < len(books.told[0]) + COMMAND_LENGTHS['operator_id']
    books.send('x' * longest)
    assert books.results() == [('x' * longest, A)]


@given(st.lists(st.integers(0, 8), max_size=100))
def test_a_command_among_the_last_remembered_ones_is_never_applied_twice(sends: list[int]) -> None:
    books = Books(remembered=4)
    order: list[int] = []  # model: distinct commands in the order of their first arrival
    for number in sends:
        new = number not in order[-4:]
        before = len(books.effects)
        books.send(str(number))
        assert (len(books.effects) > before) == new
        if new:
            order = [*(n for n in order if n != number), number]
        assert books.results()[-1] == (str(number), A)


def test_a_result_is_reported_for_a_time_and_again_when_it_is_asked_for() -> None:
    books = Books()
    books.send('a')
    books.time += REPORT_TIME
    assert books.results() == [('a', A)]
    books.time += 0.1
    assert books.results() == []
    books.send('a')
    assert books.results() == [('a', A)]


def test_of_many_results_the_latest_are_reported() -> None:
    books = Books()
    for number in range(50):
        books.send(str(number))
    assert [name for name, _ in books.results()] == [str(number) for number in range(18, 50)]


def test_a_command_that_is_not_decided_is_not_forgotten() -> None:
    books = Books(remembered=3)
    books.send('start', START)
    for number in range(10):
        books.send(str(number))
    books.send('start', START)
    assert books.effects.count('start') == 1


def test_of_one_writer_only_so_many_commands_wait_for_their_effect() -> None:
    books = Books()
    for number in range(OPEN_COMMANDS + 10):
        books.ledger.receive(ExecutiveCommand(id=str(number), kind=START), b'flooder')
    assert len(books.effects) == OPEN_COMMANDS
    assert {code for _, code in books.results()} == {R}
    assert 'wait for their effect' in books.ledger.results()[0].reason
    books.ledger.receive(ExecutiveCommand(id='other', kind=START), b'operator')
    books.ledger.receive(ExecutiveCommand(id='stop', kind=STOP), b'flooder')
    assert books.effects[-2:] == ['other', 'stop']


def test_of_a_command_that_is_too_large_nothing_is_kept(tmp_path: Path) -> None:
    books = Books(directory=str(tmp_path))
    large = 'x' * 1_000_000
    books.ledger.receive(ExecutiveCommand(id=large, kind=START))
    books.ledger.receive(ExecutiveCommand(id='a', kind=START, reason=large, operator_id=large))
    stop = ExecutiveCommand(id='b', kind=STOP, reason=large, operator_id=large, stamp=Time(sec=7))
    books.ledger.receive(stop, b'writer', 5.0)
    assert (books.results(), books.effects) == ([('a', R), ('b', A)], ['b'])
    assert 'at most 128' in books.ledger.results()[0].reason
    ((command, *source),) = books.handed
    assert (command.reason, command.stamp, source) == (books.ledger.results()[0].reason, stop.stamp, [b'writer', 5.0])
    assert len(command.operator_id) <= 128
    books.time += REPORT_TIME + 1.0
    for id, kind in (('a', START), ('b', STOP)):
        books.ledger.receive(ExecutiveCommand(id=id, kind=kind, reason=large, operator_id=large))
    assert books.results() == [('a', R), ('b', A)], 'a resend is answered again'
    books.journal.close()
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) < 1000
    assert max(map(len, books.told)) < 1000


def test_what_cannot_be_journaled_is_answered_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    books = Books()
    monkeypatch.setattr(books.journal, 'decide', lambda *_arguments: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        books.send('a')
    assert books.results() == [('a', A)]


def test_what_was_decided_before_a_restart_is_remembered(tmp_path: Path) -> None:
    books = Books(directory=str(tmp_path))
    books.send('a')
    books.send('b', ExecutiveCommand.REPEAT)
    books.send('open', START)
    books.journal.close()
    again = Books(directory=str(tmp_path))
    for name in ('a', 'b', 'open'):
        again.send(name)
    assert again.results() == [('a', A), ('b', R), ('open', A)]
    assert again.effects == ['open']
    again.journal.close()


def test_a_long_reason_is_cut_and_told_as_before_after_a_restart(tmp_path: Path) -> None:
    books = Books(directory=str(tmp_path))
    books.send('start', START)
    reason = 'x' * 5000
    books.journal.decide('with a move', reason)  # which the ledger hears later
    books.ledger.read(CommandDecided('start', reason))
    (result,) = books.ledger.results()
    assert 'characters left out' in result.reason
    books.journal.close()
    again = Books(directory=str(tmp_path))
    for name in ('start', 'with a move'):
        again.send(name)
    assert [one.reason for one in again.ledger.results()] == [result.reason] * 2
    again.journal.close()


def test_every_text_of_a_command_has_a_bound_and_is_in_the_event_log() -> None:
    texts = [name for name, kind in ExecutiveCommand.get_fields_and_field_types().items() if kind == 'string']
    assert set(COMMAND_LENGTHS) == {*texts}
    fields = command_fields(ExecutiveCommand(**{name: f'the {name}' for name in texts}), 'START')
    assert {f'the {name}' for name in texts} <= set(fields.values())


def of_length(count: int, field: str) -> Any:
    """Return a value of a field with so many characters, bytes or outcomes."""
    return {'data': bytes(count), 'wanted': [''] * count}.get(field, 'x' * count)


@pytest.mark.parametrize(
    ('part', 'lengths', 'make'),
    [
        ('', COMMAND_LENGTHS, lambda field, value: {field: value}),
        ('arguments: ', ARGUMENT_LENGTHS, lambda field, value: {'arguments': [BehaviorArgument(**{field: value})]}),
        ('inputs: ', INPUT_LENGTHS, lambda field, value: {'inputs': [BlackboardEntry(**{field: value})]}),
        ('queue_options: ', OPTION_LENGTHS, lambda field, value: {'queue_options': [QueueOptions(**{field: value})]}),
    ],
)
def test_each_part_of_a_command_has_its_limit(part: str, lengths: dict[str, int], make: Any) -> None:
    for field, limit in lengths.items():
        unit = {'data': 'bytes', 'wanted': 'outcomes'}.get(field, 'characters')
        assert excess_of_command(ExecutiveCommand(**make(field, of_length(limit, field)))) == ''
        excess = excess_of_command(ExecutiveCommand(**make(field, of_length(limit + 1, field))))
        assert excess == f'{part}{field} has at most {limit} {unit}, not {limit + 1}'


def test_lists_of_a_command_and_the_outcomes_in_them_have_their_limits() -> None:
    for field, one, limit in (
        ('arguments', BehaviorArgument(), ARGUMENTS),
        ('inputs', BlackboardEntry(), INPUTS),
        ('queue_options', QueueOptions(), 1),
    ):
        assert excess_of_command(ExecutiveCommand(**{field: [one] * limit})) == ''
        excess = excess_of_command(ExecutiveCommand(**{field: [one] * (limit + 1)}))
        assert excess == f'{field} has at most {limit} entries, not {limit + 1}'
    for length, excess in (
        (OUTCOME_LENGTH, ''),
        (OUTCOME_LENGTH + 1, 'queue_options: an outcome has at most 256 characters, not 257'),
    ):
        options = QueueOptions(wanted=['', 'x' * length, 'x'])
        assert excess_of_command(ExecutiveCommand(queue_options=[options])) == excess


def test_every_constant_of_the_message_is_a_command() -> None:
    names = [
        name for name in dir(ExecutiveCommand) if name.isupper() and isinstance(getattr(ExecutiveCommand, name), int)
    ]
    assert {command.name for command in CommandRegistry.COMMANDS} == {*names} - {'UNKNOWN', 'NOTE_LENGTH'}
    assert len({command.kind for command in CommandRegistry.COMMANDS}) == len(CommandRegistry.COMMANDS)
