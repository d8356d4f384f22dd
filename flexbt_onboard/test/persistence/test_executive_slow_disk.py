# SPDX-License-Identifier: BSD-3-Clause
"""A disk that takes its time, or hangs: nobody is told what a crash could undo, and the operator hears of the rest."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.persistence import event_log, journal
from flexbt_onboard.persistence.event_log import EventLog
from flexbt_onboard.persistence.journal import JournalState, read_journal
from flexbt_onboard.persistence.run_journal import RunJournal
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until

C = ExecutiveCommand


class Wait(EventState):
    """Waits for ever."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)


def waiting() -> OperatableStateMachine:
    """Two states that wait."""
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('A', Wait(), {'done': 'B'})
        OperatableStateMachine.add('B', Wait(), {'done': 'finished'})
    return machine


def waiting_longer() -> OperatableStateMachine:
    """Return the same, and one more."""
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('A', Wait(), {'done': 'B'})
        OperatableStateMachine.add('B', Wait(), {'done': 'C'})
        OperatableStateMachine.add('C', Wait(), {'done': 'finished'})
    return machine


class Disk:
    """Answers only while it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.goes = threading.Event()
        self.goes.set()
        for name in ('fdatasync', 'fsync'):
            monkeypatch.setattr(os, name, self._waiting(getattr(os, name)))

    def _waiting(self, real: Any) -> Any:
        def wait(descriptor: int) -> None:
            assert self.goes.wait(60.0)
            real(descriptor)

        return wait


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


@pytest.fixture
def bench(disk: Disk, tmp_path: Path) -> Iterator[ExecutiveBench]:
    parameters = ExecutiveParameters(peers=(), journal_directory=str(tmp_path), heartbeat_period=0.05)
    bench = ExecutiveBench(behavior_of(waiting), behavior_of(waiting_longer, 'Longer'), parameters=parameters)
    yield bench
    disk.goes.set()
    bench.close()


def shown_active(status: ExecutiveStatus) -> list[str]:
    """Paths of the states that a status shows."""
    return [one.path for one in status.active_states]


def test_the_heartbeat_goes_on_while_nothing_is_shown_that_a_crash_could_undo(
    bench: ExecutiveBench, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, 'STUCK_SECONDS', 1000.0)
    bench.start()
    bench.wait_active('/A')
    disk.goes.clear()
    command = bench.send(C.FORCE, path='/A', outcome='done')
    run = bench.executive.runs.run
    assert run is not None
    wait_until(lambda: [leaf.path for leaf in run.snapshot.active] == ['/B'], 'effect of the command')
    sequence = bench.status.sequence + 5
    bench.wait_for(lambda status: status.sequence > sequence, 'heartbeats')
    assert shown_active(bench.status) == ['/A']
    assert not any(result.command_id == command for status in bench.statuses for result in status.results)
    disk.goes.set()
    bench.wait_active('/B')
    assert bench.result(command).code == CommandResult.APPLIED


@pytest.mark.parametrize('command', [C.START, C.SWITCH])
def test_no_structure_is_shown_that_a_crash_could_undo(
    bench: ExecutiveBench, disk: Disk, monkeypatch: pytest.MonkeyPatch, command: int
) -> None:
    monkeypatch.setattr(journal, 'STUCK_SECONDS', 1000.0)
    if command == C.SWITCH:
        bench.start()
        bench.wait_active('/A')
    disk.goes.clear()
    shown = len(bench.structures)
    bench.send(command, behavior='Longer')
    wait_until(lambda: (run := bench.executive.runs.run) and run.snapshot.behavior == 'Longer', 'effect of the command')
    sequence = bench.status.sequence + 5
    bench.wait_for(lambda status: status.sequence > sequence, 'heartbeats')
    assert len(bench.structures) == shown
    disk.goes.set()
    bench.wait_for(lambda status: status.behavior == 'Longer', 'the status')
    wait_until(lambda: [structure.behavior for structure in bench.structures[shown:]] == ['Longer'], 'the structure')


def test_a_disk_that_hangs_for_long_is_told_and_not_waited_for(
    bench: ExecutiveBench, disk: Disk, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(journal, 'STUCK_SECONDS', 0.1)
    bench.start()
    bench.wait_active('/A')
    disk.goes.clear()
    token = LivelinessWatch(bench.console, 'onboard_executive')
    LivelinessToken(bench.runtime).set_ready(True)
    wait_until(lambda: token.ready, 'executive ready')
    command = bench.send(C.FORCE, path='/A', outcome='done')
    bench.wait_active('/B')
    assert bench.logged('does not answer').severity >= ExecutiveLog.WARN
    bench.wait_for(lambda status: 'does not answer' in status.message, 'notice')
    wait_until(lambda: not token.ready, 'executive not ready')
    disk.goes.set()
    bench.logged('the journal is written again')
    wait_until(lambda: token.ready and not bench.status.message, 'executive ready again')
    state = JournalState()
    for line in read_journal((tmp_path / 'onboard_executive.journal').read_bytes()).lines:
        state.apply(line)
    assert state.position['active'] == ['/B'] and state.commands[command] == (CommandResult.APPLIED, '')


def test_a_disk_that_hangs_does_not_hold_up_a_stop(bench: ExecutiveBench, disk: Disk) -> None:
    bench.start()
    bench.wait_active('/A')
    disk.goes.clear()
    bench.send(C.STOP)
    wait_until(lambda: bench.executive.runs.run is None, 'end of the run')
    disk.goes.set()
    assert bench.wait_idle() == 'preempted'


def test_a_run_that_is_stopped_just_before_it_is_journaled_does_not_resume_after_a_crash(
    bench: ExecutiveBench, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begin = RunJournal.begin

    def stopped(journal: RunJournal, *arguments: Any) -> None:
        run = bench.executive.runs.run
        assert run is not None
        run.stop('just before')
        begin(journal, *arguments)

    monkeypatch.setattr(RunJournal, 'begin', stopped)
    bench.send(C.START, behavior='Test', autonomy=3)
    bench.logged("behavior 'Test' ended with 'preempted'")
    bench.close()
    (file,) = tmp_path.glob('*.journal')
    lines = read_journal(file.read_bytes()).lines
    begun = next(number for number, line in enumerate(lines) if 'begin' in line)
    assert lines[begun + 1].get('end') == 'just before'


def test_an_event_log_that_hangs_is_told_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    goes = threading.Event()
    append = EventLog._append

    def hang(*arguments: Any) -> None:
        assert goes.wait(60.0)
        append(*arguments)

    monkeypatch.setattr(EventLog, '_append', hang)
    monkeypatch.setattr(event_log, 'STUCK_SECONDS', 0.1)
    parameters = ExecutiveParameters(peers=(), event_log_directory=str(tmp_path))
    bench = ExecutiveBench(behavior_of(waiting), parameters=parameters)
    try:
        bench.start()
        bench.wait_active('/A')
        bench.logged('does not answer')
        bench.applied(C.STOP)
        assert bench.wait_idle() == 'preempted'
        goes.set()
        bench.logged('the event log is written again')
    finally:
        goes.set()
        bench.close()
    events = [json.loads(line)['event'] for line in next(tmp_path.rglob('*.jsonl')).read_text().splitlines()]
    assert events.index('started') < events.index('command', events.index('entered')) < events.index('ended')
    assert 'lost' not in events
