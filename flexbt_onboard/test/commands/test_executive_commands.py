# SPDX-License-Identifier: BSD-3-Clause
"""Commands of an operator: at most once, only for what they were meant for, and always answered."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.action import ActionClient

from flexbt_common import names
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import implementation
from flexbt_common.middleware.received_messages import reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.action import OperatorInput
from flexbt_msgs.msg import (
    BehaviorArgument,
    BlackboardEntry,
    CommandResult,
    ExecutiveCommand,
    ExecutiveLog,
    ExecutiveStatus,
    PendingDecision,
    QueueOptions,
)
from flexbt_onboard.commands.command_bounds import COMMAND_LENGTHS, OPEN_REQUESTS
from flexbt_onboard.commands.command_registry import LOGGED, command_fields
from flexbt_onboard.link.console_link import COMMAND_BURST, COMMAND_RATE, CommandIntake
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until

START, AUTONOMY, STOP, CONFIRM, FORCE = (
    ExecutiveCommand.START,
    ExecutiveCommand.AUTONOMY,
    ExecutiveCommand.STOP,
    ExecutiveCommand.CONFIRM,
    ExecutiveCommand.FORCE,
)


def test_the_event_log_has_all_that_a_command_says() -> None:
    said = ('id', 'operator_id', 'executive_id', 'run_id', 'decision_id', 'path', 'outcome', 'tree_run_id', 'behavior')
    command = ExecutiveCommand(
        **{name: f'the {name}' for name in (*said, 'grantee', 'text', 'reason')},
        kind=ExecutiveCommand.QUEUE_ADD,
        stamp=Time(sec=12, nanosec=345_678_900),
        autonomy=2,
        arguments=[BehaviorArgument(name='rooms', value='x' * (LOGGED + 1))],
        inputs=[
            BlackboardEntry(key='goal', type='string', text='kitchen'),
            BlackboardEntry(key='map', type='bytes'),
            BlackboardEntry(key='long', type='string', text='x' * (LOGGED + 1)),
        ],
        hold_queue=True,
        queue_number=7,
        queue_options=[
            QueueOptions(priority=3, not_before=Time(sec=60), wanted=['done'], on_failure=QueueOptions.DROP)
        ],
        wait_queue=1.25,
        wait_interaction=0.0,
    )
    told = command_fields(command, 'ADD')
    for long in (told.pop('arguments')['rooms'], told['inputs'].pop('long').removeprefix('string: ')):
        assert LOGGED // 2 < len(long) <= LOGGED
    assert told == {
        'id': 'the id',
        'command': 'ADD',
        'operator': 'the operator_id',
        'given': 12.345679,
        'executive': 'the executive_id',
        'run': 'the run_id',
        'decision': 'the decision_id',
        'path': 'the path',
        'outcome': 'the outcome',
        'tree_run': 'the tree_run_id',
        'behavior': 'the behavior',
        'inputs': {'goal': 'string: kitchen', 'map': 'bytes: ...'},
        'grantee': 'the grantee',
        'text': 'the text',
        'because': 'the reason',
        'autonomy': 2,
        'entry': 7,
        'hold_queue': True,
        'queue_options': {'priority': 3, 'not_before': 60.0, 'on_failure': 4, 'wanted': ('done',)},
        'wait_queue': 1.25,
        'wait_interaction': 0.0,
    }
    for unknown in (math.inf, math.nan, -1.0):
        waiting = command_fields(ExecutiveCommand(id='1', wait_queue=unknown, wait_interaction=unknown), 'NOTE')
        assert waiting == {'id': '1', 'command': 'NOTE', 'given': 0.0}
    wrong = QueueOptions(battery=math.nan, distance=math.inf, interval=-math.inf, on_failure=QueueOptions.HOLD)
    added = command_fields(ExecutiveCommand(id='1', queue_options=[wrong]), 'ADD')['queue_options']
    assert added == {'battery': 'nan', 'distance': 'inf', 'interval': '-inf'}  # JSON has no such numbers
    moved = ExecutiveCommand(id='1', kind=ExecutiveCommand.QUEUE_MOVE, queue_number=7, queue_before=5)
    assert command_fields(moved, 'MOVE') == {'id': '1', 'command': 'MOVE', 'given': 0.0, 'entry': 7, 'before': 5}
    released = ExecutiveCommand(id='2', kind=ExecutiveCommand.QUEUE_RELEASE, queue_number=9)
    assert command_fields(released, 'RELEASE') == {'id': '2', 'command': 'RELEASE', 'given': 0.0, 'hold': 9}


class Loop(EventState):
    """Wants to be left at once, and counts how often it was."""

    def __init__(self, entered: list[str]) -> None:
        super().__init__(outcomes=['again', 'out'], desired_rate=None)
        self._entered = entered

    def on_enter(self, userdata: Any) -> None:
        self._entered.append(self.path)

    def execute(self, userdata: Any) -> str:
        return 'again'


class LoopBench(ExecutiveBench):
    """A behavior that asks before each of its rounds."""

    def __init__(self) -> None:
        self.entered: list[str] = []
        super().__init__(behavior_of(self._machine), behavior_of(self._machine, 'Other'))

    def _machine(self) -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            for label, other in (('A', 'B'), ('B', 'A')):
                OperatableStateMachine.add(
                    label,
                    Loop(self.entered),
                    {'again': other, 'out': 'finished'},
                    autonomy={'again': Autonomy.Full, 'out': Autonomy.Full},
                )
        return machine

    def decision(self, path: str) -> PendingDecision:
        """Wait for the decision of a state."""

        def find(status: ExecutiveStatus) -> Any:
            return next((decision for decision in status.decisions if decision.path == path), None)

        found = self.wait_for(find, f'decision of {path}')
        assert isinstance(found, PendingDecision)
        return found


@pytest.fixture
def bench() -> Iterator[LoopBench]:
    bench = LoopBench()
    yield bench
    bench.close()


def test_a_command_that_is_sent_many_times_has_one_effect_and_is_answered_each_time(bench: LoopBench) -> None:
    bench.start()
    first = bench.decision('/A')
    for _ in range(20):
        bench.send(CONFIRM, id='same', decision_id=first.id)
    bench.decision('/B')
    assert bench.result('same').code == CommandResult.APPLIED
    for number in range(40):  # more than are reported
        bench.send(CONFIRM, id=f'stale-{number}', decision_id=first.id)
    bench.wait_for(lambda status: status.results and status.results[-1].command_id == 'stale-39', 'all answered')
    assert len(bench.status.results) == 32
    assert 'same' not in [result.command_id for result in bench.status.results]
    bench.send(CONFIRM, id='same', decision_id=first.id)
    assert bench.result('same').code == CommandResult.APPLIED
    assert bench.entered == ['/A', '/B']


def test_an_answer_to_a_decision_that_is_over_is_refused(bench: LoopBench) -> None:
    bench.start()
    stale = bench.decision('/A')
    bench.applied(CONFIRM, decision_id=stale.id)
    bench.decision('/B')
    assert stale.id not in bench.refused(CONFIRM, decision_id='')
    assert 'not pending' in bench.refused(CONFIRM, decision_id=stale.id)
    assert 'not pending' in bench.refused(FORCE, path='/B', outcome='out', decision_id=stale.id)
    assert 'does not belong to this run' in bench.refused(CONFIRM, decision_id='nonsense')
    assert bench.entered == ['/A', '/B']


def test_commands_for_another_executive_are_ignored_except_a_stop(bench: LoopBench) -> None:
    other, own = uuid.uuid4().hex, bench.status.executive_id
    ignored = [
        bench.send(START, behavior='Test', executive_id=other),
        bench.send(AUTONOMY, autonomy=3, executive_id=other),
    ]
    bench.applied(STOP, executive_id=other)
    started = bench.applied(START, behavior='Test', executive_id=own)
    bench.decision('/A')
    ignored.append(bench.send(FORCE, path='/A', outcome='out', executive_id=other))
    bench.applied(STOP, executive_id=other)
    bench.wait_idle()
    results = {result.command_id for status in bench.statuses for result in status.results}
    assert started.command_id in results and results.isdisjoint(ignored)
    assert bench.entered == ['/A']


def test_a_stop_has_a_way_of_its_own_on_which_nothing_else_is_taken(
    bench: LoopBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.start()
    bench.decision('/A')
    monkeypatch.setattr(bench, '_publish', bench._stops.publish)  # there alone
    wait_until(bench._stops.get_subscription_count, f'who hears {names.EXECUTIVE_STOP}')
    dropped = bench.send(AUTONOMY, autonomy=0)
    assert bench.logged(f'belongs on {names.EXECUTIVE_COMMAND}').severity == ExecutiveLog.WARN
    bench.applied(STOP)
    assert bench.wait_idle() == 'preempted'
    assert dropped not in {result.command_id for status in bench.statuses for result in status.results}


def test_what_a_stop_has_overtaken_starts_nothing(bench: LoopBench) -> None:
    """A STOP is taken before other commands that wait."""
    is_held, may_go_on = threading.Event(), threading.Event()

    def hold() -> None:
        is_held.set()
        may_go_on.wait()

    bench.runtime.post(hold)
    is_held.wait()
    start = bench.send(START, behavior='Test')
    stop = bench.send(STOP)
    may_go_on.set()
    assert bench.result(stop).code == CommandResult.APPLIED
    refused = bench.result(start)
    assert (refused.code, 'has arrived after it' in refused.reason) == (CommandResult.REFUSED, True)
    assert bench.statuses[-1].state == ExecutiveStatus.IDLE and not bench.entered
    bench.applied(START, behavior='Test')


def test_commands_of_another_run_are_refused(bench: LoopBench) -> None:
    first_run = bench.start()
    stale = bench.decision('/A')
    bench.applied(STOP)
    bench.wait_idle()
    bench.applied(STOP)  # meant for a run that has ended: the robot is kept at rest, whoever drives it
    second_run = bench.start()
    assert second_run != first_run
    decision = bench.decision('/A')
    assert decision.id != stale.id
    for kind, fields in (
        (CONFIRM, {'decision_id': decision.id}),
        (FORCE, {'path': '/A', 'outcome': 'out'}),
        (AUTONOMY, {'autonomy': 3}),
        (ExecutiveCommand.ANSWER, {'decision_id': decision.id, 'inputs': [to_entry('x', 1)]}),
    ):
        assert first_run in bench.refused(kind, run_id=first_run, **fields)
        assert 'run' in bench.refused(kind, run_id='', **fields)
    assert 'does not belong' in bench.refused(CONFIRM, decision_id=stale.id)
    assert bench.entered == ['/A', '/A']


@pytest.mark.parametrize(
    ('said', 'logged'),
    [
        ({'run_id': ''}, 'stopped by'),
        ({'run_id': 'of a forger', 'executive_id': 'of a forger'}, 'has seen another run'),
        ({'reason': 'x' * 5000, 'operator_id': 'ann'}, 'ann: reason has at most 1000 characters, not 5000'),
    ],
)
def test_a_stop_stops_what_runs_whatever_it_says(bench: LoopBench, said: dict[str, str], logged: str) -> None:
    bench.start()
    bench.decision('/A')
    bench.applied(STOP, **said)
    assert bench.wait_idle() == 'preempted'
    bench.logged(logged)


@pytest.mark.parametrize(
    ('path', 'outcome', 'words'),
    [
        ('/A', 'sideways', 'again, out'),
        ('/B', 'out', 'not active'),
        ('/C', 'out', "no state '/C'"),
        ('', 'out', 'path'),
        ('/A', '', 'outcome'),
    ],
)
def test_only_what_is_active_can_be_forced_by_what_it_declares(
    bench: LoopBench, path: str, outcome: str, words: str
) -> None:
    bench.start()
    bench.decision('/A')
    assert words in bench.refused(FORCE, path=path, outcome=outcome)
    bench.applied(FORCE, path='/A', outcome='out')
    assert bench.wait_idle() == 'finished'
    assert bench.logged("A left by 'out'").path == '/'  # no reason for what A wants when it is entered again


def test_what_later_versions_know_is_refused_by_name(bench: LoopBench) -> None:
    for kind, name in ((0, '0'), (200, '200')):
        reason = bench.refused(kind)
        assert 'not supported by this version' in reason
        assert name in reason


def test_a_command_without_an_id_is_ignored_and_logged(bench: LoopBench) -> None:
    bench._commands.publish(ExecutiveCommand(kind=START, behavior='Test', operator_id='eva'))
    assert 'eva' in bench.logged('no id').text
    assert bench.status.state == ExecutiveStatus.IDLE


@pytest.mark.parametrize('id', ['', 'x' * 1000])
def test_a_stop_whose_id_cannot_be_used_stops_all_the_same(bench: LoopBench, id: str) -> None:
    bench.start()
    bench._commands.publish(ExecutiveCommand(id=id, kind=ExecutiveCommand.STOP, operator_id='eva'))
    assert bench.wait_idle() == 'preempted'


def test_the_autonomy_of_an_idle_executive_is_kept_for_the_operator(bench: LoopBench) -> None:
    bench.applied(AUTONOMY, autonomy=3, run_id='')
    assert bench.status.autonomy == 3
    assert 'no behavior is running' in bench.refused(AUTONOMY, autonomy=3, path='/A', run_id='')
    bench.start()
    bench.applied(STOP)
    bench.wait_idle()
    stale = bench.run_id
    assert f'run {stale} is not active' in bench.refused(
        AUTONOMY, autonomy=0, run_id=stale
    )  # it was meant for that run
    assert bench.status.autonomy == 3


def test_a_fault_in_a_command_is_its_answer_and_told_and_the_run_goes_on(
    bench: LoopBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.start()
    decision = bench.decision('/A')

    def broken(*_arguments: object) -> None:
        raise ZeroDivisionError('of a test')

    monkeypatch.setattr('flexbt_core.state_machine.engine.operator_commands._mark', broken)
    assert 'ZeroDivisionError: of a test' in bench.refused(ExecutiveCommand.LOCK, path='/A')
    bench.logged('ZeroDivisionError')
    monkeypatch.setattr(bench.executive.library, 'find', broken)
    assert 'ZeroDivisionError: of a test' in bench.refused(ExecutiveCommand.SWITCH, behavior='Test')
    bench.applied(CONFIRM, decision_id=decision.id)
    bench.decision('/B')


def test_a_field_that_is_too_large_is_refused_by_name(bench: LoopBench) -> None:
    too_large: list[tuple[str, Any]] = [
        *(
            (field, 'x' * (limit + 1))
            for field, limit in COMMAND_LENGTHS.items()
            if field not in ('id', 'executive_id')
        ),
        ('arguments', [BehaviorArgument(name='n', value='x' * 10_001)]),
        ('arguments', [BehaviorArgument()] * 101),
        ('inputs', [BlackboardEntry(key='k', text='x' * 100_001)]),
        ('inputs', [BlackboardEntry(key='k', data=bytes(1_000_001))]),
    ]
    for field, value in too_large:
        reason = bench.refused(START, **{'behavior': 'Test', field: value})
        assert field in reason and 'at most' in reason
    assert reason == 'inputs: data has at most 1000000 bytes, not 1000001'
    assert bench.status.state == ExecutiveStatus.IDLE
    asker = Asker(bench)
    for field, value in (('prompt', 'x' * 1001), ('asker', 'x' * 4097), ('choices', ['1'] * 101), ('type', 'x' * 257)):
        asker.ask(**{'type': 'int8', field: value})
        result = asker.result()
        assert result.code == OperatorInput.Result.ERROR and field in result.message
    asker.ask(type='int8', asker='x' * 4096)
    for _ in range(OPEN_REQUESTS):
        asker.ask(type='int8')
    assert 'no more are taken' in asker.result().message
    bench.wait_for(lambda status: len(status.decisions) == OPEN_REQUESTS, 'all that are taken')


def test_names_and_reasons_cannot_write_to_the_terminal_of_the_robot(
    bench: LoopBench, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.start(operator_id='eve\x1b[2J')
    bench.applied(STOP, operator_id='eve\x1b[2J', reason='\x1b]0;owned\x07\u202e\n[ERROR] lost')
    bench.wait_idle()
    bench.logged('owned')
    told = wait_until(lambda: capfd.readouterr().err, 'the log of the node')
    assert 'owned' in told and not {'\x1b', '\x07', '\u202e'} & set(told)
    assert '[ERROR] lost' in told and '\n[ERROR] lost' not in told, 'a line of its own'


class Asker:
    """A node that asks the operator."""

    def __init__(self, bench: ExecutiveBench) -> None:
        self.bench = bench
        self.results: list[Any] = []
        self.client: Any = bench.console.call(lambda: ActionClient(bench.console.node, OperatorInput, 'operator_input'))
        wait_until(lambda: bench.console.call(self.client.server_is_ready), 'operator_input')

    def ask(self, **goal: Any) -> None:
        """Ask; the result comes later."""

        def accepted(future: Any) -> None:
            self.handle = future.result()
            self.handle.get_result_async().add_done_callback(lambda done: self.results.append(done.result()))

        def send() -> None:
            self.client.send_goal_async(OperatorInput.Goal(**goal)).add_done_callback(accepted)

        self.bench.console.call(send)

    def result(self) -> Any:
        """Return the next result."""
        wait_until(lambda: self.results, 'result')
        return self.results.pop(0).result

    def decision(self) -> PendingDecision:
        """Return the decision as the console sees it."""

        def find(status: ExecutiveStatus) -> Any:
            return next((one for one in status.decisions if one.kind == PendingDecision.INPUT), None)

        found = self.bench.wait_for(find, 'decision')
        assert isinstance(found, PendingDecision)
        return found


def test_a_node_may_ask_while_no_behavior_runs(bench: LoopBench) -> None:
    asker = Asker(bench)
    asker.ask(prompt='how many?', type='int8', asker='/counter')
    decision = asker.decision()
    assert (decision.prompt, decision.input_type, decision.path) == ('how many?', 'int8', '/counter')
    assert '300' in bench.refused(
        ExecutiveCommand.ANSWER, decision_id=decision.id, inputs=[BlackboardEntry(text='300')]
    )
    assert 'one value' in bench.refused(ExecutiveCommand.ANSWER, decision_id=decision.id)
    assert asker.results == []
    bench.applied(ExecutiveCommand.ANSWER, id='answer', decision_id=decision.id, inputs=[BlackboardEntry(text='30')])
    result = asker.result()
    assert (result.code, result.operator_id, result.value.text) == (OperatorInput.Result.SUCCESS, 'tester', '30')
    bench.wait_for(lambda status: not status.decisions, 'decision gone')
    bench.send(ExecutiveCommand.ANSWER, id='answer', decision_id=decision.id, inputs=[BlackboardEntry(text='31')])
    assert 'not open' in bench.refused(ExecutiveCommand.DECLINE, decision_id=decision.id)


def test_a_decision_that_cannot_be_asked_is_an_error_with_the_reason(bench: LoopBench) -> None:
    asker = Asker(bench)
    asker.ask(prompt='?', type='no_such/msg/Thing')
    result = asker.result()
    assert result.code == OperatorInput.Result.ERROR
    assert 'no_such' in result.message


def test_a_decision_can_be_declined_and_withdrawn_and_is_no_transition(bench: LoopBench) -> None:
    asker = Asker(bench)
    bench.start()
    bench.decision('/A')
    asker.ask(prompt='?', type='string')
    decision = asker.decision()
    for kind in (CONFIRM, ExecutiveCommand.STEP_INTO):
        assert 'asks for a value' in bench.refused(kind, decision_id=decision.id)
    assert decision.required_autonomy == -1
    bench.applied(ExecutiveCommand.DECLINE, decision_id=decision.id, reason='busy')
    result = asker.result()
    assert (result.code, 'busy' in result.message) == (OperatorInput.Result.DECLINED, True)
    asker.ask(prompt='??', type='string')
    bench.wait_for(lambda status: any(one.prompt == '??' for one in status.decisions), 'second decision')
    bench.console.call(asker.handle.cancel_goal_async)
    assert asker.result().code == OperatorInput.Result.CANCELED
    bench.wait_for(lambda status: [one.kind for one in status.decisions] == [PendingDecision.TRANSITION], 'withdrawn')


def test_the_end_of_the_executive_withdraws_the_decisions(bench: LoopBench) -> None:
    asker = Asker(bench)
    asker.ask(prompt='?', type='string')
    asker.decision()
    bench.runtime.close()
    bench.wait_for(lambda status: not status.decisions, 'withdrawn')


def test_a_note_is_for_every_console_and_needs_neither_run_nor_authority(bench: LoopBench) -> None:
    bench.applied(ExecutiveCommand.NOTE, text='the floor is wet', operator_id='eva')
    assert bench.logged('the floor is wet').text == 'eva notes: the floor is wet'
    run_id = bench.start()
    bench.decision('/A')
    bench.applied(ExecutiveCommand.CLAIM_AUTHORITY, operator_id='bob')
    bench.applied(ExecutiveCommand.NOTE, text='one\ntwo \x1b[2J', operator_id='eva')
    line = bench.logged('one')
    assert (line.run_id, line.text) == (run_id, 'eva notes: one\ntwo \\e[2J')
    assert bench.status.authority == 'bob' and bench.entered == ['/A']


def test_a_note_without_text_or_of_more_than_its_length_is_refused(bench: LoopBench) -> None:
    longest = 'x' * ExecutiveCommand.NOTE_LENGTH
    bench.applied(ExecutiveCommand.NOTE, text=longest)
    assert 'text' in bench.refused(ExecutiveCommand.NOTE)
    assert '1000 characters' in bench.refused(ExecutiveCommand.NOTE, text=longest + 'x')


MANY = """
import time, uuid
import rclpy
from rclpy.context import Context
from flexbt_common import names
from flexbt_msgs.msg import ExecutiveCommand

publishers = []
for number in range(4):
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node(f'many{number}', context=context)
    publishers.append(node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos()))
while True:
    for publisher in publishers:
        publisher.publish(ExecutiveCommand(id=uuid.uuid4().hex, kind=ExecutiveCommand.NOTE, text='many'))
    time.sleep(0.04)
"""
"""Each of the participants is within the limit."""


@pytest.mark.dds('another process sends, with many participants')
@pytest.mark.skipif(implementation() != FAST_DDS, reason='needs Fast DDS')
@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_a_process_has_one_limit_however_many_participants_it_has() -> None:
    with NodeRuntime.open('executive') as runtime:
        taken: list[ExecutiveCommand] = []
        told: list[str] = []
        began = runtime.steady.now()
        runtime.call(
            lambda: CommandIntake(runtime, lambda one, *_: taken.append(one), lambda _, text: told.append(text))
        )
        with subprocess.Popen([sys.executable, '-c', MANY]) as child:
            try:
                wait_until(lambda: told, 'that some were dropped')
            finally:
                child.kill()
        seconds = runtime.steady.now() - began
        assert len(taken) <= COMMAND_BURST + COMMAND_RATE * seconds
        assert 'many' in told[0] and 'more than 50 a second' in told[0]
