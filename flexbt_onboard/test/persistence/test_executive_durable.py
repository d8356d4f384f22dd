# SPDX-License-Identifier: BSD-3-Clause
"""kill -9 at any moment: the run goes on where it was, and each command has its effect once or is refused.

FLEXBT_KILLS sets how often the executive is killed, FLEXBT_SEED when.
"""

from __future__ import annotations

import contextlib
import functools
import os
import random
import resource
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus, QueueOptions
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.errors import OnboardError
from flexbt_onboard.node.executive import open_executive
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.persistence.run_metrics import metrics_of, read_events
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.system.fork_server import ForkedProcess
from flexbt_testing.system.python_processes import logged_python_process
from flexbt_testing.waiting import wait_until

pytestmark = pytest.mark.dds('the executive is killed as a process')

C = ExecutiveCommand
KILLS = int(os.environ.get('FLEXBT_KILLS', '6'))
SEED = int(os.environ.get('FLEXBT_SEED', '1'))


LOADED = ('flexbt_onboard.node', 'flexbt_testing.nodes.executive_bench', 'flexbt_testing.state_machines')


class DurableBench(Operator):
    """A console, and an executive in a process of its own that can be killed."""

    def __init__(self, directory: Path) -> None:
        super().__init__(NodeRuntime('console', args=()))
        self.directory = directory
        self._due = 0.0
        self._launched = 0
        self._process: ForkedProcess | subprocess.Popen[bytes] | None = None

    def launch(self, *kill_at: int) -> int:
        """Start the executive; gives the state that it shows first. ``kill_at``: see durable_process."""
        known = {status.executive_id for status in self.statuses}
        self._launched = len(self.statuses)
        script = str(Path(__file__).with_name('durable_process.py'))
        with (self.directory / 'log').open('ab') as log:
            self._process = logged_python_process(
                [script, str(self.directory), *map(str, kill_at)], log.fileno(), LOADED
            )
        wait_until(lambda: self.statuses and self.status.executive_id not in known, 'first status')
        return int(self.status.state)

    @property
    def has_ended(self) -> bool:
        """True if the process is gone."""
        return self._process is not None and self._process.poll() is not None

    def result(self, command_id: str) -> CommandResult:
        """Return the result of a command, which is sent until there is one, as a console does."""
        self._due = time.monotonic() + 0.2

        def find() -> CommandResult | None:
            if time.monotonic() > self._due:
                self._due = time.monotonic() + 0.1
                self._commands.publish(self.sent[command_id])
            new = self.statuses[self._launched :]
            return next((one for status in new for one in status.results if one.command_id == command_id), None)

        found = wait_until(find, lambda: f'result of {command_id}; {self.status}')
        assert isinstance(found, CommandResult)
        return found

    def kill(self, number: int = signal.SIGKILL) -> int:
        """End the process; gives its exit code."""
        assert self._process is not None
        self._process.send_signal(number)
        return self.wait_end()

    def wait_end(self) -> int:
        """Wait for the end of the process; gives its exit code."""
        assert self._process is not None
        return self._process.wait(60.0)

    def answer(self, command_id: str) -> CommandResult | None:
        """Return what is known of a command."""
        for status in reversed(self.statuses[-50:]):
            for result in status.results:
                if result.command_id == command_id:
                    assert isinstance(result, CommandResult)
                    return result
        return None

    def close(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        super().close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[DurableBench]:
    bench = DurableBench(tmp_path)
    yield bench
    bench.close()


def test_no_command_is_lost_or_doubled_when_the_executive_is_killed_at_any_moment(bench: DurableBench) -> None:
    source = random.Random(SEED)
    assert bench.launch() == ExecutiveStatus.IDLE
    run_id = bench.start(autonomy=3)
    applied: set[str] = set()
    sent: list[tuple[str, str]] = []
    number = 0
    for kill in range(KILLS):
        timer = threading.Timer(source.uniform(0.0, 0.3), bench._process.kill)  # type: ignore[union-attr]
        timer.start()
        while timer.is_alive() and bench._process.poll() is None:  # type: ignore[union-attr]
            decisions = bench.status.decisions
            if decisions and decisions[0].id not in [decision for _, decision in sent]:
                number += 1
                sent.append((f'confirm-{number}', decisions[0].id))
                own = bench.status.executive_id
                bench.send(C.CONFIRM, id=sent[-1][0], decision_id=sent[-1][1], run_id=run_id, executive_id=own)
        timer.join()
        bench.kill()
        applied |= {id for id, _ in sent if (known := bench.answer(id)) and known.code == CommandResult.APPLIED}
        assert bench.launch() == ExecutiveStatus.INTERRUPTED, f'after kill {kill}'
        assert bench.run_id == run_id
        assert bench.status.active_states[0].path.startswith('/Inner/')
        # Whatever was said before is true, and what the executive before did not write down has no effect any more.
        for command_id, _ in sent[-8:]:
            bench.resend(command_id)
        assert 'interrupted' in bench.refused(C.START, behavior='Test')  # now all of them were read
        for command_id, _ in sent[-8:]:
            result = bench.answer(command_id)
            is_applied = result is not None and result.code == CommandResult.APPLIED
            assert is_applied or command_id not in applied, command_id
            if is_applied:
                applied.add(command_id)
        bench.applied(C.RESUME_RUN)
        bench.wait_for(lambda status: status.decisions, 'decision after the crash')
    print(f'{KILLS} kills, {len(sent)} commands, {len(applied)} applied')
    assert len(applied) >= KILLS // 2
    bench.applied(C.FORCE, path='/Inner/Ask', outcome='out')
    assert bench.wait_idle() == 'finished'
    assert bench.logged('counted').text == f'counted {len(applied)}'
    bench.kill(signal.SIGTERM)
    assert bench.launch() == ExecutiveStatus.IDLE
    (run,) = metrics_of(read_events([bench.directory / 'onboard_executive.jsonl']))
    assert (run.run, run.outcome) == (run_id, 'finished')


def test_what_was_set_for_a_run_holds_again_and_a_stop_is_not_forgotten(bench: DurableBench) -> None:
    bench.launch()
    bench.start(autonomy=3, id='start')
    bench.wait_active('/Inner/Ask')
    bench.applied(C.LOCK, path='/Inner')
    bench.applied(C.BREAKPOINT, path='/Inner/Add')
    bench.applied(C.AUTONOMY, autonomy=1, path='/Inner')
    bench.applied(C.SWITCH, behavior='Changed')
    bench.applied(C.PAUSE)
    bench.kill()
    bench.launch()
    assert bench.status.behavior == 'Changed'

    def marks() -> list[object]:
        status = bench.status
        levels = [(entry.path, entry.level) for entry in status.autonomy_levels]
        return [list(status.locked), list(status.breakpoints), levels, status.autonomy]

    expected = [['/Inner'], ['/Inner/Add'], [('/Inner', 1)], 3]
    assert marks() == expected
    bench.applied(C.RESUME_RUN)
    bench.wait_for(lambda status: status.state == ExecutiveStatus.PAUSED, 'paused as before')
    (shown,) = bench.status.active_states
    assert (shown.path, shown.paused) == ('/Inner/Ask', True)
    assert marks() == expected
    bench.applied(C.RESUME)
    bench.send(C.START, id='start', behavior='Test')
    assert bench.result('start').code == CommandResult.APPLIED
    bench.applied(C.STOP, id='stop')
    bench.kill()
    assert bench.launch() == ExecutiveStatus.IDLE


class Hold(EventState):
    """Stays until it is forced."""

    def __init__(self) -> None:
        super().__init__(outcomes=['on'], desired_rate=None)


def holding() -> OperatableStateMachine:
    """One state in a machine of its own."""
    inner, outer = OperatableStateMachine(outcomes=['on']), OperatableStateMachine(outcomes=['end'])
    with inner:
        OperatableStateMachine.add('Hold', Hold(), {'on': 'on'})
    with outer:
        OperatableStateMachine.add('Inner', inner, {'on': 'end'})
    return outer


def test_a_run_that_was_paused_shows_where_it_is_when_it_is_resumed_after_a_crash(tmp_path: Path) -> None:
    parameters = ExecutiveParameters(peers=(), journal_directory=str(tmp_path))
    with contextlib.closing(ExecutiveBench(behavior_of(holding), parameters=parameters)) as before:
        before.start(autonomy=3)
        before.wait_active('/Inner/Hold')
        before.applied(C.PAUSE)
        before.wait_for(lambda status: status.active_states[0].paused, 'paused')
        journal = {file: file.read_bytes() for file in tmp_path.iterdir()}
    for file, content in journal.items():  # as a crash leaves it
        file.write_bytes(content)
    with contextlib.closing(ExecutiveBench(behavior_of(holding), parameters=parameters)) as after:
        assert [(one.path, one.paused) for one in after.status.active_states] == [('/Inner/Hold', True)]
        assert 'was paused; resume it, which leaves it paused' in after.status.message
        after.applied(C.RESUME_RUN)
        after.wait_for(lambda status: status.state == ExecutiveStatus.PAUSED, 'paused as before')
        (state,) = after.status.active_states
        told = ['is entered when the run is resumed']
        assert (state.path, state.paused, list(state.activity)) == ('/Inner/Hold', True, told)
        after.applied(C.RESUME)
        after.wait_for(lambda status: not status.active_states[0].paused, 'entered')
        assert [(one.path, list(one.activity)) for one in after.status.active_states] == [('/Inner/Hold', [])]


def test_a_full_disk_ends_no_run_and_is_told_and_what_happened_is_written_when_it_can_be(bench: DurableBench) -> None:
    bench.launch()
    run_id = bench.start(autonomy=3)
    bench.wait_for(lambda status: status.decisions, 'question')
    assert bench._process is not None
    size = (bench.directory / 'onboard_executive.journal').stat().st_size
    resource.prlimit(bench._process.pid, resource.RLIMIT_FSIZE, (size + 10, resource.RLIM_INFINITY))
    bench.applied(C.LOCK, path='/Inner', id='lock')
    bench.wait_for(lambda status: 'the journal' in status.message and 'cannot be written' in status.message, 'notice')
    assert bench.status.locked == ['/Inner']
    resource.prlimit(bench._process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    bench.logged('the journal is written again')
    bench.wait_for(lambda status: 'the journal' not in status.message, 'no notice')
    bench.kill()
    assert bench.launch() == ExecutiveStatus.INTERRUPTED
    assert (bench.run_id, list(bench.status.locked)) == (run_id, ['/Inner'])
    bench.resend('lock')
    assert bench.result('lock').code == CommandResult.APPLIED


def test_an_executive_that_leaves_a_run_behind_says_so_by_its_exit_code(bench: DurableBench) -> None:
    bench.launch()
    bench.start('Stuck')
    bench.wait_active('/Stuck')
    assert bench.kill(signal.SIGTERM) == 1


def test_a_crash_before_the_first_state_keeps_the_autonomy_of_the_start(bench: DurableBench) -> None:
    bench.launch()
    start = bench.send(C.START, behavior='Crash', autonomy=3)

    def ends() -> bool:
        bench.resend(start)  # as a console, while there is no answer
        return bench.has_ended

    wait_until(ends, 'the crash', every=0.1)
    assert bench.wait_end() == -signal.SIGKILL
    assert bench.launch() == ExecutiveStatus.INTERRUPTED
    assert (bench.status.behavior, bench.status.autonomy) == ('Crash', 3)
    bench.applied(C.RESUME_RUN)
    bench.wait_active('/Crash')
    assert bench.status.autonomy == 3


def test_the_autonomy_that_was_set_for_the_next_run_outlives_a_crash_and_not_an_end(bench: DurableBench) -> None:
    bench.launch()
    bench.applied(C.AUTONOMY, autonomy=3)
    bench.kill()
    bench.launch()
    assert bench.status.autonomy == 3
    assert bench.kill(signal.SIGTERM) == 0
    bench.launch()
    assert bench.status.autonomy == ExecutiveParameters().autonomy


def test_an_interrupted_run_is_aborted_and_one_that_cannot_go_on_says_why(bench: DurableBench) -> None:
    bench.launch()
    run_id = bench.start('Spoil')
    bench.wait_active('/Spoil')
    bench.logged('builtins.object')
    bench.kill()
    assert bench.launch() == ExecutiveStatus.INTERRUPTED
    assert 'builtins.object' in bench.refused(C.RESUME_RUN)
    assert 'other' in bench.refused(C.ABORT_RUN, run_id='other')
    assert bench.status.state == ExecutiveStatus.INTERRUPTED
    assert 'resume or abort it first' in bench.refused(C.AUTONOMY, autonomy=0)
    bench.applied(C.ABORT_RUN, operator_id='ann')
    assert bench.wait_idle() == 'preempted'
    assert ('ann' in bench.status.message, bench.run_id) == (True, run_id)
    assert 'no run was interrupted' in bench.refused(C.RESUME_RUN)
    bench.start('Spoil')
    assert bench.kill(signal.SIGTERM) == 0  # which stops the run
    assert bench.launch() == ExecutiveStatus.IDLE


def test_where_neither_journal_nor_event_log_can_be_used_nothing_is_told_but_that(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'onboard_executive.journal')
    (tmp_path / 'onboard_executive.jsonl').symlink_to('/dev/zero')
    parameters = ExecutiveParameters(
        peers=(), journal_directory=str(tmp_path), event_log_directory=str(tmp_path), heartbeat_period=60.0
    )
    with contextlib.closing(NodeRuntime('onboard_executive', args=())) as runtime:
        faults: list[BaseException] = []
        runtime.on_fault(faults.append)
        with pytest.raises(OnboardError, match='it is a pipe or device'):
            open_executive(runtime, parameters, BehaviorLibrary(()))
        runtime.call(lambda: None)  # what was asked for before has been done
        assert faults == []


def has_news(bench: DurableBench, count: int) -> bool:
    """Return whether more statuses have come than these, or the executive is gone."""
    return len(bench.statuses) > count or bench.has_ended


QUEUE_KILLS = int(os.environ.get('FLEXBT_QUEUE_KILLS', '6'))
WRITES = 16
"""Writes of the journal for three entries, at least."""


@pytest.mark.parametrize(
    'kill_at', sorted(random.Random(SEED).sample([*range(1, WRITES), *range(-WRITES, 0)], QUEUE_KILLS))
)
def test_no_entry_of_the_queue_is_lost_or_runs_twice_wherever_the_executive_is_killed(
    bench: DurableBench, kill_at: int
) -> None:
    bench.launch(kill_at)
    marks = bench.directory / 'marks'
    retry, drop = (QueueOptions(on_failure=how, retries=1) for how in (QueueOptions.RETRY, QueueOptions.DROP))
    wanted = [('A', retry), ('B', drop), ('C', retry)]
    sent: list[str] = []
    resumed: list[int] = []
    deadline = time.monotonic() + 300.0
    while time.monotonic() < deadline:
        if bench.has_ended:
            if bench.launch() == ExecutiveStatus.INTERRUPTED:
                assert 1 <= bench.status.queue_entry <= 3
                resumed.append(bench.status.queue_entry)
                bench.send(C.RESUME_RUN, id=f'resume-{len(resumed)}')
            for command_id in sent:  # as a console does, which does not know what was decided
                bench.resend(command_id)
        answers = [bench.answer(command_id) for command_id in sent]
        if len(sent) < len(wanted) and all(answers):
            behavior, options = wanted[len(sent)]
            sent.append(f'add-{behavior}')
            bench.send(C.QUEUE_ADD, id=sent[-1], run_id='', behavior=behavior, autonomy=3, queue_options=[options])
        if len(answers) == len(wanted) and all(answers) and not bench.has_ended:
            assert {one.code for one in answers if one} == {CommandResult.APPLIED}
            if bench.status.state == ExecutiveStatus.IDLE and not bench.status.queue_length:
                break
        with contextlib.suppress(AssertionError):
            wait_until(functools.partial(has_news, bench, len(bench.statuses)), 'a status', 1.0)
        for command_id, answer in zip(sent, answers, strict=False):
            if answer is None and not bench.has_ended:
                bench.resend(command_id)
    assert bench.status.queue_length == 0, bench.queue
    assert not bench.status.queue_held
    ran = marks.read_text().split()
    for number, name in enumerate('ABC', 1):
        # The state that was active is entered again by a resumed run: docs/how_to/real_robot.md.
        assert 1 <= ran.count(name) <= 1 + resumed.count(number), (kill_at, ran, resumed)


def test_an_entry_that_cannot_continue_after_a_crash_holds_the_queue(bench: DurableBench) -> None:
    bench.launch()
    options = [QueueOptions(on_failure=QueueOptions.CONTINUE)]
    for behavior in ('Spoil', 'A'):
        bench.applied(C.QUEUE_ADD, run_id='', behavior=behavior, autonomy=3, queue_options=options)
    bench.wait_active('/Spoil')
    bench.logged('cannot be journaled')
    bench.kill()
    assert bench.launch() == ExecutiveStatus.INTERRUPTED
    bench.wait_for(
        lambda status: 'entry 1 ran when the executive ended, and cannot continue' in status.queue_held, 'hold'
    )
    assert 'cannot continue where it was' in bench.refused(C.RESUME_RUN)
    bench.applied(C.ABORT_RUN)
    bench.wait_for(lambda status: "entry 1 ended by 'preempted'" in status.queue_held, 'another hold')
    bench.applied(C.QUEUE_REMOVE, queue_number=1, run_id='')
    hold = wait_until(lambda: bench.queue.hold, 'the hold')
    bench.applied(C.QUEUE_RELEASE, queue_number=hold, run_id='')
    bench.wait_for(lambda status: not status.queue_length, 'the end of entry 2')
    assert (bench.directory / 'marks').read_text() == 'A\n'
