# SPDX-License-Identifier: BSD-3-Clause
"""The event log: everything that an operator or the robot did is in it, and a disk that fails harms nobody."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.persistence import event_log
from flexbt_onboard.persistence.event_log import STUCK_SECONDS, EventLog, rotated
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until


class Go(EventState):
    """Done at once."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done', 'out'], desired_rate=None)

    def execute(self, userdata: Any) -> str:
        return 'done'


def loop() -> OperatableStateMachine:
    """Return a nested machine of two instantaneous states, then one that asks."""
    inner = OperatableStateMachine(outcomes=['done'])
    with inner:
        OperatableStateMachine.add('A', Go(), {'done': 'B', 'out': 'done'})
        OperatableStateMachine.add('B', Go(), {'done': 'done', 'out': 'done'})
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Inner', inner, {'done': 'Ask'})
        OperatableStateMachine.add('Ask', Go(), {'done': 'Inner', 'out': 'finished'}, autonomy={'done': Autonomy.Full})
    return machine


@pytest.fixture
def make_bench() -> Iterator[Callable[..., ExecutiveBench]]:
    """Make a bench with an event log in a directory, and closes it."""
    benches: list[ExecutiveBench] = []

    def make(directory: Path) -> ExecutiveBench:
        parameters = ExecutiveParameters(peers=(), event_log_directory=str(directory))
        benches.append(ExecutiveBench(behavior_of(loop), parameters=parameters))
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


def events(directory: Path) -> list[dict[str, Any]]:
    """Return what the event log says."""
    text = (directory / 'onboard_executive.jsonl').read_text()
    return [json.loads(line) for line in text.splitlines() if line]


def commands_of(told: list[dict[str, Any]]) -> list[str]:
    """Return the kinds of the commands among events."""
    return [one['command'] for one in told if one['event'] == 'command']


def test_commands_decisions_and_states_are_recorded_with_their_effect(
    make_bench: Callable[..., ExecutiveBench], tmp_path: Path
) -> None:
    bench = make_bench(tmp_path / 'new' / 'directory')
    run_id = bench.start(operator_id='ann', autonomy=3)
    decision = bench.wait_for(lambda status: status.decisions, 'decision')[0]
    bench.applied(ExecutiveCommand.CONFIRM, decision_id=decision.id, operator_id='ann', reason='looks good')
    bench.wait_for(lambda status: status.decisions and status.decisions[0].id != decision.id, 'second decision')
    bench.refused(ExecutiveCommand.CONFIRM, decision_id=decision.id, operator_id='bob')
    bench.applied(ExecutiveCommand.FORCE, path='/Ask', outcome='out', operator_id='ann')
    assert bench.wait_idle() == 'finished'
    bench.runtime.close()
    seen = events(tmp_path / 'new' / 'directory')
    assert [event['time'] for event in seen] == sorted(event['time'] for event in seen)
    of_run = [event for event in seen if event.get('run') == run_id]
    states = [(event['event'], event['path']) for event in of_run if event['event'] in ('entered', 'left')]
    one_round = [
        *(('entered', '/Inner/A'), ('left', '/Inner/A'), ('entered', '/Inner/B'), ('left', '/Inner/B')),
        *(('left', '/Inner'), ('entered', '/Ask'), ('left', '/Ask')),
    ]
    assert states == one_round * 2
    assert [event['decision'] for event in of_run if event['event'] in ('waiting', 'decided')][:2] == [decision.id] * 2
    commands = {(event['command'], event['operator'], event['effect']) for event in seen if event['event'] == 'command'}
    assert commands == {
        ('START', 'ann', 'applied'),
        ('CONFIRM', 'ann', 'applied'),
        ('CONFIRM', 'bob', 'refused'),
        ('FORCE', 'ann', 'applied'),
    }
    confirmed, refused = [event for event in seen if event.get('command') == 'CONFIRM']
    assert (confirmed['because'], confirmed['run'], confirmed['decision']) == ('looks good', run_id, decision.id)
    assert 'not pending' in refused['why']
    forced = [event for event in of_run if event['event'] == 'left' and event.get('reason') == 'forced']
    assert [(event['outcome'], event['target']) for event in forced] == [('out', '=finished')]
    assert [event['event'] for event in seen if 'behavior' in event and event['event'] != 'command'] == [
        'started',
        'ended',
    ]


def test_a_stop_is_recorded_once_with_the_first_reason(
    make_bench: Callable[..., ExecutiveBench], tmp_path: Path
) -> None:
    bench = make_bench(tmp_path)
    bench.start(autonomy=3)
    run = bench.executive.runs.run
    assert run is not None
    for why in ('one', 'two', 'three'):
        run.stop(why)
    assert bench.wait_idle() == 'preempted'
    bench.runtime.close()
    assert [event['why'] for event in events(tmp_path) if event['event'] == 'stopping'] == ['one']


def test_a_directory_that_cannot_be_written_is_told_once_and_harms_nobody(
    make_bench: Callable[..., ExecutiveBench], tmp_path: Path
) -> None:
    blocked = tmp_path / 'file'
    blocked.write_text('')
    bench = make_bench(blocked / 'below')
    bench.start(autonomy=0)
    for _ in range(3):
        bench.applied(ExecutiveCommand.AUTONOMY, autonomy=1)
    bench.applied(ExecutiveCommand.STOP)
    assert bench.wait_idle() == 'preempted'
    bench.logged('cannot be written')
    assert sum('cannot be written' in line.text for line in bench.logs) == 1
    blocked.unlink()
    bench.logged('written again')
    bench.applied(ExecutiveCommand.AUTONOMY, autonomy=1, run_id='')
    commands = ['START', *['AUTONOMY'] * 3, 'STOP', 'AUTONOMY']
    wait_until(lambda: len(commands_of(events(blocked / 'below'))) == len(commands), 'the commands')
    told = events(blocked / 'below')
    assert commands_of(told) == commands
    assert told[0]['event'] == 'executive' and not [one for one in told if one['event'] == 'lost']


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_onboard.persistence.event_log import EventLog
from flexbt_onboard.persistence import event_log
from flexbt_testing.waiting import wait_until
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
event_log.MOST_WAITING, event_log.RETRY_SECONDS = 150, 0.02
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, resource.RLIM_INFINITY))
with NodeRuntime.open('full') as runtime:
    problems = []
    file = Path(sys.argv[1])
    log = EventLog(file, runtime.clock, runtime.steady, problems.append)
    for number in range(200):
        log.add('number', number=number)
    wait_until(lambda: len(problems) == 1, 'the problem')
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    wait_until(lambda: len(problems) == 3, 'the end of it')
    log.add('last')
    wait_until(lambda: '"last"' in file.read_text(), 'the last event')
    assert 'too large' in problems[0] and 'lacks' in problems[1] and problems[2] == '', problems
"""


@pytest.mark.dds('a process whose files the system limits')
def test_what_a_full_disk_does_not_take_waits_and_what_is_more_is_counted(tmp_path: Path) -> None:
    file = tmp_path / 'r.jsonl'
    file.write_text('{"event": "cut o')
    subprocess.run([sys.executable, '-c', FULL_DISK, str(file)], check=True, timeout=60, env=os.environ)
    cut, *lines = file.read_text().splitlines()
    *told, last = [json.loads(line) for line in lines]
    following = lost = 0
    for one in told:
        if one['event'] == 'lost':
            lost += one['number']
            following += one['number']
        else:
            assert one['number'] == following
            following += 1
    assert (cut, following, last['event']) == ('{"event": "cut o', 200, 'last')
    assert 15 <= lost <= 50


class Unwritable:
    def __str__(self) -> str:
        raise RuntimeError('no text for this')


def test_each_reason_not_to_write_is_told_and_none_ends_the_log(tmp_path: Path) -> None:
    problems: list[str] = []
    file = tmp_path / 'r.jsonl'
    with NodeRuntime.open('odd') as runtime:
        log = EventLog(file, runtime.clock, runtime.steady, problems.append)
        log.add('odd', value=Unwritable())
        wait_until(lambda: len(problems) == 2, 'the problem, and the end of it')
        file.rename(tmp_path / 'before.jsonl')
        file.mkdir()
        log.add('kept')
        wait_until(lambda: len(problems) == 3, 'another problem')
        log.add('next')
        file.rmdir()
        wait_until(lambda: len(problems) == 4, 'the end of it')
        log.close()
    assert 'RuntimeError: no text for this' in problems[0] and 'directory' in problems[2]
    assert problems[1] == problems[3] == ''
    (lost,) = [json.loads(line) for line in (tmp_path / 'before.jsonl').read_text().splitlines()]
    assert (lost['event'], lost['number']) == ('lost', 1)
    assert [json.loads(line)['event'] for line in file.read_text().splitlines()] == ['kept', 'next']


def test_of_a_disk_that_hangs_and_then_fails_both_are_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    steady = ManualClock()
    problems: list[str] = []
    asked: SimpleQueue[Sequence[bytes]] = SimpleQueue()
    answers: SimpleQueue[OSError | None] = SimpleQueue()

    def hang(log: EventLog, lines: Sequence[bytes]) -> None:
        asked.put(lines)
        answer = answers.get(timeout=DEADLINE)
        if answer is not None:
            raise answer
        for _ in lines:
            log._waiting.popleft()

    monkeypatch.setattr(event_log, 'RETRY_SECONDS', 0.02)
    monkeypatch.setattr(EventLog, '_append', hang)
    clock: Any = SimpleNamespace(stamp=Time)
    log = EventLog(tmp_path / 'r.jsonl', clock, steady, problems.append)
    for answer in (OSError(errno.EIO, 'no answer'), OSError(errno.EIO, 'no answer'), None):
        log.add('number')
        asked.get(timeout=DEADLINE)
        steady.advance(STUCK_SECONDS + 0.1)
        answers.put(answer)
    log.add('last')
    assert asked.get(timeout=DEADLINE), 'what was before is done'
    stuck, failed, well = problems
    assert 'does not answer' in stuck and 'no answer' in failed and well == ''
    answers.put(None)
    log.close()


def test_files_are_rotated_and_nothing_is_lost_between_them(tmp_path: Path) -> None:
    file = tmp_path / 'r.jsonl'
    with NodeRuntime.open('rotating') as runtime:
        log = EventLog(file, runtime.clock, runtime.steady, lambda _text: None, size=2000, files=3)
        for number in range(300):
            log.add('number', number=number)
            wait_until(lambda: len(log._waiting) < 5, 'written')
        begin = uncontended_time()
        log.close()
        assert uncontended_time() - begin < 1.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ['r.1.jsonl', 'r.2.jsonl', 'r.jsonl']
    kept = [json.loads(line) for age in (2, 1, 0) for line in rotated(file, age).read_text().splitlines()]
    numbers = [event['number'] for event in kept]
    assert numbers == list(range(numbers[0], 300))
    assert all(rotated(file, age).stat().st_size <= 2000 for age in range(3))


def test_the_event_log_holds_nobody_up(make_bench: Callable[..., ExecutiveBench], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'onboard_executive.jsonl')  # opening it blocks for ever
    bench = make_bench(tmp_path)
    bench.start(autonomy=0)
    bench.applied(ExecutiveCommand.STOP)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.IDLE, 'stopped')
    begin = uncontended_time()
    bench.runtime.close()
    assert uncontended_time() - begin < 1.5
