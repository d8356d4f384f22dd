# SPDX-License-Identifier: BSD-3-Clause
"""The registry of commands: what each command calls, with what, and with which words it is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import MagicMock, Mock, call

import pytest

from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.engine import operator_commands as machine
from flexbt_msgs.msg import BehaviorArgument, BlackboardEntry, ExecutiveCommand, ExecutiveLog, QueueOptions
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.commands.authority import Authority
from flexbt_onboard.commands.command_registry import CommandRegistry
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.runs.run_snapshot import RunPhase

ENTRY = Mock(error='')
ARGUMENTS = [BehaviorArgument(name='room', value='kitchen')]
INPUTS = [BlackboardEntry(key='goal', type='string', text='x')]
REQUEST = RunRequest(ENTRY, (('room', 'kitchen'),), tuple(INPUTS), 1, 'ann', 'id')
INTERRUPTED = Mock(
    name='interrupted',
    run_id='run',
    behavior='Old',
    arguments=(('a', 'b'),),
    inputs=INPUTS,
    autonomy=2,
    queue_entry=7,
)


class Desk:
    """A registry, and notes of what it calls: ``seen`` has the calls of all but the authority."""

    def __init__(self, *, is_running: bool = True, interrupted: Any = None) -> None:
        self.seen = seen = MagicMock()
        seen.runs.snapshot = Mock(run_id='run', behavior='Drive', autonomy=2, phase=RunPhase.RUNNING, is_stopping=False)
        seen.runs.run.run_id = 'run'
        seen.runs.run.snapshot = seen.runs.snapshot
        seen.runs.run.decision_number = 'the number of {}'.format
        seen.runs.interrupted = interrupted
        seen.runs.shown.run_id = 'run'
        seen.inputs.is_open = 'for a value'.__eq__
        if not is_running:
            seen.runs.run = seen.runs.snapshot = None
        seen.library.find = {'Drive': ENTRY, 'Old': ENTRY}.__getitem__
        seen.queue.has_entries = True
        seen.queue.changing.return_value.__enter__.return_value = seen.entries
        seen.queue.new_entry = lambda sent: ('new', sent)
        seen.queue.changed_entry = lambda sent: ('changed', sent)
        presence, other = Mock(present=frozenset()), Mock(steady=ManualClock())
        self.authority = Authority(other, presence, 1.0, other, other)
        self.registry = CommandRegistry(
            'here',
            seen.library,
            seen.runs,
            seen.names,
            self.authority,
            seen.inputs,
            seen.trees,
            seen.queue,
            seen.report,
        )

    def send(self, name: str, *, arrived: float = 1.0, **fields: Any) -> ExecutiveCommand:
        """Apply a command, and return it. ``is_applied``: it has had its effect."""
        sent = ExecutiveCommand(
            **{'id': 'id', 'run_id': 'run', 'operator_id': 'ann', **fields}, kind=getattr(ExecutiveCommand, name)
        )
        self.is_applied = self.registry.apply(sent, b'writer', arrived)
        return sent

    def refusal(self, name: str, **fields: Any) -> str:
        """Return why a command is refused."""
        with pytest.raises(CommandRefusedError) as refusal:
            self.send(name, **fields)
        return str(refusal.value)

    def calls(self) -> list[Any]:
        """Return what was called, without the check of the operator's name."""
        return [one for one in self.seen.mock_calls if one != call.names.check('ann', b'writer')]


PATH = {'path': '/A'}
DECISION = {'decision_id': 'd'}
START = {'behavior': 'Drive', 'arguments': ARGUMENTS, 'inputs': INPUTS, 'autonomy': 1, 'run_id': ''}
MACHINE = call.runs.run.command


@pytest.mark.parametrize(
    ('name', 'fields', 'calls'),
    [
        ('PAUSE', {}, [MACHINE('id', machine.pause)]),
        ('RESUME', {}, [MACHINE('id', machine.resume)]),
        ('REPEAT', PATH, [MACHINE('id', machine.repeat, '/A')]),
        ('LOCK', PATH, [MACHINE('id', machine.lock, '/A')]),
        ('UNLOCK', PATH, [MACHINE('id', machine.unlock, '/A')]),
        ('BREAKPOINT', PATH, [MACHINE('id', machine.set_breakpoint, '/A')]),
        ('CLEAR_BREAKPOINT', PATH, [MACHINE('id', machine.clear_breakpoint, '/A')]),
        ('CONFIRM', DECISION, [MACHINE('id', machine.confirm, 'the number of d')]),
        ('STEP_INTO', DECISION, [MACHINE('id', machine.step, 'into', 'the number of d')]),
        ('STEP_OVER', DECISION, [MACHINE('id', machine.step, 'over', 'the number of d')]),
        ('STEP_OUT', DECISION, [MACHINE('id', machine.step, 'out', 'the number of d')]),
        ('FORCE', {**PATH, 'outcome': 'o'}, [MACHINE('id', machine.force, '/A', 'o', '')]),
        ('FORCE', {**PATH, 'outcome': 'o', **DECISION}, [MACHINE('id', machine.force, '/A', 'o', 'the number of d')]),
        ('AUTONOMY', {'autonomy': 3, **PATH}, [MACHINE('id', machine.set_autonomy, 3, '/A')]),
        ('SWITCH', {**START, 'run_id': 'run'}, [call.runs.run.switch(replace(REQUEST, inputs=(), autonomy=2))]),
        ('START', START, [call.runs.start(REQUEST)]),
        (
            'START',
            {**START, 'hold_queue': True},
            [call.runs.start(REQUEST), call.queue.hold("by operator ann, with the start of 'Drive'")],
        ),
    ],
)
def test_a_command_that_takes_effect_later_asks_the_run_for_it(
    name: str, fields: dict[str, Any], calls: list[Any]
) -> None:
    desk = Desk()
    desk.send(name, **fields)
    assert desk.calls() == calls
    assert not desk.is_applied


def test_a_run_that_was_interrupted_is_resumed_where_it_was_or_aborted() -> None:
    desk = Desk(is_running=False, interrupted=INTERRUPTED)
    desk.send('RESUME_RUN')
    at = INTERRUPTED.position()
    request = RunRequest(ENTRY, (('a', 'b'),), tuple(INPUTS), 2, 'ann', 'id', at, queue_entry=7)
    assert desk.calls() == [call.runs.start(request, 'run')]
    assert not desk.is_applied
    desk.send('ABORT_RUN')
    assert desk.calls()[1:] == [call.runs.abort(INTERRUPTED, 'interrupted, and aborted by operator ann')]
    assert desk.is_applied


OPTIONS = {'queue_options': [QueueOptions()], 'behavior': 'Drive', 'queue_number': 5}


@pytest.mark.parametrize(
    ('name', 'fields', 'change'),
    [
        ('QUEUE_ADD', OPTIONS, lambda entries, sent: entries.add(('new', sent))),
        ('QUEUE_EDIT', OPTIONS, lambda entries, sent: entries.edit(('changed', sent))),
        ('QUEUE_REMOVE', {'queue_number': 5}, lambda entries, _: entries.remove(5)),
        ('QUEUE_MOVE', {'queue_number': 5, 'queue_before': 3}, lambda entries, _: entries.move(5, 3)),
        ('QUEUE_HOLD', {'reason': 'wet'}, lambda entries, _: entries.hold('by operator ann: wet')),
        ('QUEUE_HOLD', {'operator_id': ''}, lambda entries, _: entries.hold('by the operator')),
        ('QUEUE_RELEASE', {'queue_number': 5}, lambda entries, _: entries.release(5)),
        ('QUEUE_CLEAR', {'queue_number': 5}, lambda entries, _: entries.clear(5)),
    ],
)
def test_a_command_of_the_queue_is_one_change_of_it(name: str, fields: dict[str, Any], change: Any) -> None:
    desk = Desk()
    sent = desk.send(name, **fields)
    assert desk.seen.queue.changing.call_args_list == [call('id')]
    expected = Mock()
    change(expected, sent)
    assert desk.seen.entries.mock_calls == expected.mock_calls
    assert desk.is_applied


def test_the_commands_of_the_debugger_go_to_the_bt_server() -> None:
    desk = Desk(is_running=False)
    for command in CommandRegistry.COMMANDS:
        if command.name.startswith('TREE_'):
            desk.seen.reset_mock()
            sent = desk.send(command.name, path='/A', outcome='SUCCESS', text='x')
            kind = getattr(ControlTree.Request, command.name.removeprefix('TREE_'))
            assert desk.calls() == [call.trees.send(sent, kind, desk.registry.decided)]
            assert not desk.is_applied


def test_the_commands_about_the_authority_change_it() -> None:
    desk = Desk()
    for name, operator, grantee, expected in (
        ('CLAIM_AUTHORITY', 'ann', '', ('ann', [])),
        ('CLAIM_AUTHORITY', 'bob', '', ('ann', ['bob'])),
        ('CLAIM_AUTHORITY', 'eve', '', ('ann', ['bob', 'eve'])),
        ('REFUSE_AUTHORITY', 'ann', 'bob', ('ann', ['eve'])),
        ('HAND_OVER_AUTHORITY', 'ann', 'joe', ('joe', ['eve'])),
        ('RELEASE_AUTHORITY', 'joe', '', ('', ['eve'])),
    ):
        desk.send(name, operator_id=operator, grantee=grantee)
        assert (desk.authority.holder, desk.authority.requests) == expected
        assert desk.is_applied


@pytest.mark.parametrize(
    ('name', 'fields', 'calls'),
    [
        ('ANSWER', {**DECISION, 'inputs': INPUTS}, [call.inputs.answer('d', INPUTS[0], 'ann')]),
        ('DECLINE', {**DECISION, 'reason': 'busy'}, [call.inputs.decline('d', 'ann', 'busy')]),
        ('NOTE', {'text': 'a\n\x1b'}, [call.report.log(ExecutiveLog.INFO, 'ann notes: a\n\\e', run_id='run')]),
        (
            'NOTE',
            {'text': 'wet', 'operator_id': '', 'run_id': ''},
            [call.names.check('', b'writer'), call.report.log(ExecutiveLog.INFO, 'an operator notes: wet', run_id='')],
        ),
    ],
)
def test_a_command_that_needs_no_run_takes_effect_at_once(name: str, fields: dict[str, Any], calls: list[Any]) -> None:
    desk = Desk(is_running=False)
    desk.send(name, **fields)
    assert desk.calls() == calls
    assert desk.is_applied


def test_the_autonomy_of_an_idle_executive_is_that_of_the_next_run() -> None:
    desk = Desk(is_running=False)
    desk.send('AUTONOMY', autonomy=3, run_id='')
    assert desk.calls() == [call.runs.set_next_autonomy(3)]
    assert desk.is_applied
    assert desk.refusal('AUTONOMY', autonomy=3, path='/A', run_id='') == (
        "no behavior is running, so there is no state '/A'"
    )


STOPPED = 'by operator ann: fire'
HELD = call.queue.hold(f'STOP {STOPPED}')
HALT = call.runs.halt_robot()


@pytest.mark.parametrize(
    ('meant', 'is_stopping', 'calls'),
    [
        ('run', False, [HELD, call.runs.run.stop(f'stopped {STOPPED}'), HALT]),
        ('', False, [HELD, call.runs.run.stop(f'stopped {STOPPED}'), HALT]),
        (
            'other',
            False,
            [
                HELD,
                call.report.log(ExecutiveLog.WARN, 'operator ann stops what runs, and has seen another run'),
                call.runs.run.stop(f'stopped {STOPPED}'),
                HALT,
            ],
        ),
        ('run', True, [HELD, call.runs.run.abort(f'aborted {STOPPED}'), HALT]),
        (
            'run',
            None,
            [HELD, call.report.log(ExecutiveLog.INFO, f'the robot is stopped {STOPPED}'), HALT],
        ),
    ],
    ids=['run', 'no run named', 'other run', 'second stop', 'no run'],
)
def test_a_stop_holds_the_queue_stops_the_run_and_the_robot(
    meant: str, is_stopping: bool | None, calls: list[Any]
) -> None:
    desk = Desk(is_running=is_stopping is not None)
    if is_stopping is not None:
        desk.seen.runs.snapshot.is_stopping = is_stopping
    desk.authority.claim('bob')
    desk.send('STOP', run_id=meant, reason='fire')
    assert desk.seen.mock_calls == calls, 'nor is the name of the operator checked'
    assert desk.is_applied
    desk.seen.reset_mock()
    desk.seen.queue.has_entries = False
    desk.send('STOP', run_id=meant, reason='fire')
    assert desk.seen.mock_calls == calls[1:]


@pytest.mark.parametrize(
    ('is_running', 'name', 'fields', 'words'),
    [
        (True, 'UNKNOWN', {}, 'kind 0 is not supported by this version'),
        (False, 'PAUSE', {}, 'no behavior is running; run run is not active'),
        (False, 'PAUSE', {'run_id': ''}, 'no behavior is running'),
        (True, 'PAUSE', {'run_id': ''}, 'the command must name the run that it is meant for in run_id'),
        (True, 'PAUSE', {'run_id': 'old'}, 'meant for run old, but run run is active now'),
        (False, 'AUTONOMY', {}, 'no behavior is running; run run is not active'),
        (True, 'AUTONOMY', {'run_id': ''}, 'the command must name the run that it is meant for in run_id'),
        (True, 'AUTONOMY', {'autonomy': 4}, 'autonomy 4 is none of 0 Off, 1 Low, 2 High, 3 Full'),
        (True, 'DECLINE', {'run_id': 'old'}, 'meant for run old, but run run is shown now'),
        (True, 'DECLINE', {'run_id': ''}, 'meant for run none, but run run is shown now'),
        (False, 'ABORT_RUN', {}, 'no run was interrupted'),
        (True, 'FORCE', {}, 'FORCE must name path and outcome'),
        (
            True,
            'CONFIRM',
            {'decision_id': 'for a value'},
            "decision 'for a value' asks for a value: answer it, or decline",
        ),
        (True, 'ANSWER', {'inputs': INPUTS * 2}, 'ANSWER must carry one value in inputs, not 2'),
    ],
)
def test_a_command_is_refused_with_the_reason(is_running: bool, name: str, fields: dict[str, Any], words: str) -> None:
    desk = Desk(is_running=is_running)
    assert desk.refusal(name, **fields) == words
    assert desk.calls() == []


def test_while_a_run_is_interrupted_only_what_is_meant_for_it_is_taken() -> None:
    desk = Desk(is_running=False, interrupted=INTERRUPTED)
    assert desk.refusal('AUTONOMY', run_id='') == ("behavior 'Old' was interrupted (run run); resume or abort it first")
    assert desk.refusal('RESUME_RUN', run_id='') == 'meant for run none, but run run was interrupted'
    assert desk.refusal('ABORT_RUN', run_id='other') == 'meant for run other, but run run was interrupted'


def test_of_a_run_that_starts_or_stops_only_the_autonomy_can_be_set() -> None:
    for phase in RunPhase:
        desk = Desk()
        desk.seen.runs.snapshot.phase = phase
        desk.send('AUTONOMY', autonomy=1)
        if phase in (RunPhase.RUNNING, RunPhase.PAUSED):
            desk.send('PAUSE')
        else:
            assert desk.refusal('PAUSE') == f"behavior 'Drive' is {phase.value}"


NEEDED = {
    ('decision_id',): 'CONFIRM STEP_INTO STEP_OVER STEP_OUT',
    ('path',): 'REPEAT LOCK UNLOCK BREAKPOINT CLEAR_BREAKPOINT TREE_RUN_TO TREE_BREAK',
    ('path', 'outcome'): 'FORCE TREE_FORCE TREE_DUMMY',
    ('text',): 'NOTE TREE_SET',
    ('behavior', 'queue_options'): 'QUEUE_ADD',
    ('queue_number', 'queue_options'): 'QUEUE_EDIT',
    ('queue_number',): 'QUEUE_REMOVE QUEUE_MOVE QUEUE_RELEASE QUEUE_CLEAR',
    ('grantee',): 'HAND_OVER_AUTHORITY REFUSE_AUTHORITY',
}


def test_each_field_that_a_command_needs_is_asked_for() -> None:
    desk = Desk()
    needed = {name: fields for fields, names in NEEDED.items() for name in names.split()}
    assert {command.name: (*command.fields,) for command in CommandRegistry.COMMANDS if command.fields} == needed
    for name, fields in needed.items():
        for left_out in fields:
            given = {'queue_options': [QueueOptions()], 'queue_number': 5}
            sent = {field: given.get(field, 'x') for field in fields if field != left_out}
            assert desk.refusal(name, **sent) == f'{name} must name {left_out}'


def test_what_a_stop_has_overtaken_needs_to_be_given_again() -> None:
    desk = Desk()
    desk.send('STOP', arrived=5.0)
    desk.send('STOP', arrived=3.0)  # of another console, and taken later
    for arrived in (4.0, 5.0):
        assert desk.refusal('PAUSE', arrived=arrived) == 'a STOP has arrived after it; give it again if it is meant'
        desk.send('NOTE', arrived=arrived, text='x')
        desk.send('CLAIM_AUTHORITY', arrived=arrived)
    desk.send('PAUSE', arrived=5.001)


def test_a_command_is_for_the_executive_that_it_names_and_a_stop_for_all() -> None:
    desk = Desk()
    for command in CommandRegistry.COMMANDS:
        for named, is_meant in (('', True), ('here', True), ('there', command.name == 'STOP')):
            sent = ExecutiveCommand(kind=command.kind, executive_id=named)
            assert desk.registry.is_addressed(sent) is is_meant
    assert not desk.registry.is_addressed(ExecutiveCommand(kind=200, executive_id='there'))
    assert desk.registry.fields(ExecutiveCommand(id='1', kind=200))['command'] == 'kind 200'
    assert desk.registry.fields(ExecutiveCommand(id='1', kind=1))['command'] == 'START'


def test_the_name_of_the_operator_and_the_authority_are_checked_before_all_else() -> None:
    desk = Desk()
    desk.send('PAUSE')
    assert desk.seen.mock_calls[0] == call.names.check('ann', b'writer')
    desk.seen.names.check.side_effect = CommandRefusedError('another console')
    assert desk.refusal('FORCE') == 'another console'
    desk.seen.names.check.side_effect = None
    desk.authority.claim('bob')
    assert "'bob' has the authority" in desk.refusal('FORCE')
