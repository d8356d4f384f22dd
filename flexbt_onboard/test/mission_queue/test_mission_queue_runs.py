# SPDX-License-Identifier: BSD-3-Clause
"""The queue of a running executive: runs one after the other, holds, conditions, races, limits, and a full disk."""

from __future__ import annotations

import errno
import math
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import BatteryState

from flexbt_common.values import queue_options
from flexbt_common.values.queue_options import OnFailure
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.events import RunEvent, RunReader
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_core.values.places import Place
from flexbt_msgs.msg import BehaviorArgument, BlackboardEntry, CommandResult, ExecutiveStatus, QueueOptions
from flexbt_msgs.msg import ExecutiveCommand as C
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.mission_queue import conditions, queue_runner
from flexbt_onboard.mission_queue.mission_queue import ENTRIES, QUEUE_SIZE
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.persistence.journal import Journal
from flexbt_onboard.persistence.queue_entries import QueueEntry, QueueState
from flexbt_onboard.runs.run_events import BehaviorEnded
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until

LATER = Time(sec=2_000_000_000)
HOLD, CONTINUE, RETRY, DROP = QueueOptions.HOLD, QueueOptions.CONTINUE, QueueOptions.RETRY, QueueOptions.DROP


class Gate(EventState):
    """Wait for the test, and leave by the outcome that it says."""

    entered = 0
    outcome: str | None = None

    def __init__(self) -> None:
        super().__init__(outcomes=['finished', 'failed'], desired_rate=100)

    def on_enter(self, userdata: UserData) -> None:
        type(self).entered += 1

    def execute(self, userdata: UserData) -> str | None:
        outcome, type(self).outcome = self.outcome, None
        return outcome


class Work(EventState):
    """Note that it ran, and fail as often as it was told."""

    ran = 0
    failures = 0

    def __init__(self) -> None:
        super().__init__(outcomes=['finished', 'failed'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        kind = type(self)
        kind.ran += 1
        kind.failures -= 1
        return 'failed' if kind.failures >= 0 else 'finished'


class Ask(EventState):
    """Ask the operator for an outcome."""

    def __init__(self) -> None:
        super().__init__(outcomes=['finished', 'failed'], desired_rate=None)

    def on_enter(self, userdata: UserData) -> None:
        self.ask('And now?')


class Break(EventState):
    """Raise an error."""

    def __init__(self) -> None:
        super().__init__(outcomes=['finished'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        raise RuntimeError('broken')


def machine_of(state: type[EventState]) -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        made = state()
        OperatableStateMachine.add('Only', made, {outcome: outcome for outcome in made.outcomes})
    return machine


class Slow:
    """A behavior that takes its time to be built."""

    goes, entered = threading.Event(), threading.Event()

    @classmethod
    def machine(cls) -> OperatableStateMachine:
        cls.entered.set()
        assert cls.goes.wait(60.0)
        return machine_of(Work)


BEHAVIORS = [behavior_of(lambda: machine_of(Gate), 'Gate'), behavior_of(lambda: machine_of(Work), 'Work')]
BEHAVIORS += [behavior_of(lambda: machine_of(Break), 'Break'), behavior_of(lambda: machine_of(Ask), 'Ask')]
BEHAVIORS += [behavior_of(Slow.machine, 'Slow')]


class QueueBench(ExecutiveBench):
    """An executive whose queue the test fills."""

    def add(self, behavior: str, on_failure: int = HOLD, **options: Any) -> int:
        """Add an entry, and return its number."""
        options.setdefault('on_failure', on_failure)
        known = {one.number for one in self.queue.entries}
        self.applied(C.QUEUE_ADD, behavior=behavior, autonomy=3, run_id='', queue_options=[QueueOptions(**options)])
        numbers = wait_until(lambda: {one.number for one in self.queue.entries} - known, 'the new entry')
        return int(max(numbers))

    def numbers(self) -> list[int]:
        return [one.number for one in self.queue.entries]

    def release(self) -> None:
        self.applied(C.QUEUE_RELEASE, queue_number=self.queue.hold)

    def wait_held(self, why: str) -> None:
        wait_until(lambda: why in self.queue.held, lambda: f'the queue held: {why}; {self.queue}')

    def wait_entries(self, *numbers: int) -> None:
        wait_until(lambda: self.numbers() == list(numbers), lambda: f'the entries {numbers}; {self.queue}')

    def wait_for_text(self, number: int, text: str) -> None:
        def told() -> list[str]:
            return [one.waits_for for one in self.queue.entries if one.number == number]

        wait_until(lambda: any(text in one for one in told()), lambda: f'{text}; {told()}')


def parameters_of(directory: Path) -> ExecutiveParameters:
    return ExecutiveParameters(peers=(), journal_directory=str(directory), places={'dock': Place(1.0, 2.0)})


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[QueueBench]:
    Gate.entered = Work.ran = Work.failures = 0
    Gate.outcome = None
    monkeypatch.setattr(queue_runner, 'PERIOD', 0.05)
    bench = QueueBench(*BEHAVIORS, parameters=parameters_of(tmp_path))
    yield bench
    bench.close()


def test_three_entries_of_which_one_fails_and_the_queue_goes_on_after_the_release(bench: QueueBench) -> None:
    bench.applied(C.QUEUE_HOLD, reason='until all are there')
    Work.failures = 1
    first, second, third = bench.add('Work'), bench.add('Work', count=2), bench.add('Work', priority=5)
    bench.wait_entries(third, first, second)
    bench.wait_held('by operator tester: until all are there')
    bench.release()
    bench.wait_held(f"entry {third} ended by 'failed'")
    assert Work.ran == 1
    assert bench.numbers() == [third, first, second]
    assert bench.queue.entries[0].outcome == 'failed'
    bench.applied(C.QUEUE_MOVE, queue_number=second, queue_before=first)
    bench.wait_entries(third, second, first)
    bench.release()
    bench.wait_entries()
    assert Work.ran == 5
    assert not bench.queue.held


def test_the_level_of_an_entry_does_not_become_that_of_the_operator_unless_he_sets_it(bench: QueueBench) -> None:
    bench.applied(C.AUTONOMY, autonomy=0, run_id='')
    for level, after in ((None, 0), (1, 1), (None, 1)):
        bench.add('Gate')
        bench.wait_active('/Only')
        assert bench.status.autonomy == 3
        if level is not None:
            bench.applied(C.AUTONOMY, autonomy=level)
        Gate.outcome = 'finished'
        bench.wait_entries()
        wait_until(lambda: bench.status.state == ExecutiveStatus.IDLE, 'the end')
        assert bench.status.autonomy == after


def test_a_stop_holds_the_queue_also_while_nothing_runs(bench: QueueBench) -> None:
    one = bench.add('Gate')
    bench.wait_active('/Only')
    assert bench.status.queue_entry == one
    bench.applied(C.STOP)
    bench.wait_held(f"entry {one} ended by 'preempted'")
    assert bench.wait_idle() == 'preempted'
    assert bench.numbers() == [one]  # a person decides whether it runs again
    bench.release()
    bench.wait_active('/Only')
    Gate.outcome = 'finished'
    bench.wait_entries()
    later = bench.add('Work', not_before=LATER)
    bench.applied(C.STOP)
    bench.wait_held('STOP by operator tester')
    bench.applied(C.QUEUE_CLEAR, queue_number=later)
    bench.wait_entries()
    assert Work.ran == 0


@pytest.mark.parametrize('on_failure', [CONTINUE, DROP, RETRY])
def test_an_entry_that_is_stopped_while_it_is_built_stays_and_runs_again(bench: QueueBench, on_failure: int) -> None:
    Slow.goes.clear()
    bench.add('Slow', on_failure=on_failure, retries=1)
    assert Slow.entered.wait(20.0)
    bench.applied(C.STOP)
    Slow.goes.set()
    bench.wait_held("entry 1 ended by 'preempted': stopped before it began")
    wait_until(lambda: not bench.queue.entries[0].running, bench.queue)
    assert (bench.numbers(), bench.queue.entries[0].failures, Work.ran) == ([1], 0, 0)
    bench.release()
    bench.wait_entries()
    assert Work.ran == 1


def test_faults_and_forced_ends_hold_whatever_is_said_of_failures(bench: QueueBench) -> None:
    broken = bench.add('Break', CONTINUE)
    bench.wait_held(f"entry {broken} ended by 'error'")
    bench.applied(C.QUEUE_REMOVE, queue_number=broken)
    gate, work = bench.add('Gate', CONTINUE), bench.add('Work')
    bench.release()
    bench.wait_active('/Only')
    bench.applied(C.FORCE, path='/Only', outcome='failed')
    bench.wait_held(f"entry {gate} ended by 'failed'")
    assert bench.numbers() == [work]  # it went on, and is held
    assert Work.ran == 0
    Work.failures = 1
    bench.release()
    bench.wait_held(f'entry {work}')  # by its own rule
    retried, dropped = bench.add('Work', RETRY, retries=2), bench.add('Work', DROP, count=3)
    bench.applied(C.QUEUE_REMOVE, queue_number=work)
    Work.ran, Work.failures = 0, 2
    bench.release()
    bench.wait_entries()
    assert Work.ran == 3 + 3
    assert {retried, dropped}.isdisjoint(bench.numbers())


def test_an_answer_is_no_forced_end(bench: QueueBench) -> None:
    ask, gate = bench.add('Ask', CONTINUE), bench.add('Gate')
    decision = wait_until(lambda: bench.status.decisions, 'the question')[0]
    bench.applied(C.FORCE, decision_id=decision.id, path=decision.path, outcome='failed')
    wait_until(lambda: bench.status.queue_entry == gate, 'the next entry')
    assert not bench.queue.held
    assert bench.numbers() == [gate] and ask < gate
    Gate.outcome = 'finished'
    bench.wait_entries()


def test_a_behavior_started_by_hand_goes_first_and_holds_the_queue_if_it_is_told(bench: QueueBench) -> None:
    bench.applied(C.QUEUE_HOLD)
    work = bench.add('Work')
    bench.start('Gate')
    bench.wait_active('/Only')
    bench.release()
    bench.wait_for_text(work, 'a behavior runs')
    Gate.outcome = 'finished'
    bench.wait_entries()
    again = bench.add('Work', not_before=LATER)
    bench.start('Gate', hold_queue=True)
    bench.wait_held("with the start of 'Gate'")
    assert bench.numbers() == [again]


class StartAtEnd(RunReader):
    """Call ``start`` at the end of the run, when the executive can start another one, before further readers read."""

    def __init__(self, bench: ExecutiveBench, start: Callable[[], object]) -> None:
        self._bench = bench
        self._start = start

    def read(self, event: RunEvent) -> None:
        if isinstance(event, BehaviorEnded):
            runs, call = self._bench.executive.runs, self._bench.runtime.call
            runs.readers.remove(self)
            wait_until(lambda: call(lambda: runs.run) is None, 'the end of the run')
            call(self._start)


def test_an_entry_runs_once_although_a_start_comes_at_once_after_its_end(bench: QueueBench) -> None:
    runs, gate = bench.executive.runs, RunRequest(bench.executive.library.entries['Gate'], (), (), 3)
    later = bench.add('Work', not_before=LATER)
    runs.readers.insert(0, StartAtEnd(bench, lambda: runs.start(gate)))
    bench.applied(C.QUEUE_ADD, behavior='Work', autonomy=3, run_id='', queue_options=[QueueOptions(on_failure=HOLD)])
    bench.wait_active('/Only')
    bench.wait_entries(later)
    bench.wait_for_text(later, 'a behavior runs')
    Gate.outcome = 'finished'
    bench.wait_for_text(later, 'not before')
    assert Work.ran == 1


def test_an_interrupted_entry_is_held_although_a_start_comes_with_its_abort(tmp_path: Path) -> None:
    entry = QueueEntry(1, 'Work', queue_options.QueueOptions(on_failure=OnFailure.DROP))
    begin = {'run': 'old', 'behavior': 'Work', 'by': '', 'autonomy': 3, 'arguments': [], 'inputs': [], 'entry': 1}
    journal = Journal(tmp_path / 'onboard_executive.journal', lambda _: None, ManualClock())
    journal.append(queue=QueueState({1: entry}, last_entry=1).since(QueueState()))
    journal.append(begin=begin)
    journal.close()
    bench = QueueBench(*BEHAVIORS, parameters=parameters_of(tmp_path))
    runs, gate = bench.executive.runs, RunRequest(bench.executive.library.entries['Gate'], (), (), 3)

    def abort_and_start() -> None:
        assert runs.interrupted is not None
        runs.abort(runs.interrupted, 'aborted')
        runs.start(gate)

    bench.runtime.call(abort_and_start)
    bench.wait_active('/Only')
    bench.wait_held("entry 1 ended by 'preempted'")
    assert bench.numbers() == [1]
    bench.close()


def test_a_corrupt_journal_holds_the_queue_also_while_an_entry_is_interrupted(tmp_path: Path) -> None:
    file = tmp_path / 'onboard_executive.journal'
    begin = {'run': '1', 'behavior': 'Work', 'by': '', 'autonomy': 3, 'arguments': [], 'inputs': [], 'entry': 1}
    entries = {number: QueueEntry(number, 'Work', queue_options.QueueOptions()) for number in (1, 2)}
    both = QueueState(entries, last_entry=2)
    journal = Journal(file, lambda _: None, ManualClock())
    journal.append(queue=both.since(QueueState()))
    journal.append(begin=begin)
    journal.append(run='1', end='finished')  # the next two lines are lost: entry 1 seems to wait
    journal.append(queue=replace(both, entries={2: entries[2]}).since(both))
    journal.append(begin={**begin, 'run': '2', 'entry': 2})
    journal.close()
    lines = file.read_bytes().split(b'\n')
    file.write_bytes(b'\n'.join([*lines[:3], *(b'?' + line for line in lines[3:5]), *lines[5:]]))
    Work.ran = Work.failures = 0
    bench = QueueBench(*BEHAVIORS, parameters=parameters_of(tmp_path))
    try:
        bench.wait_held('the journal is corrupt')
        bench.applied(C.RESUME_RUN, run_id='2')
        bench.wait_entries(1)  # it has run before
        bench.wait_for_text(1, 'the queue is held')
        assert Work.ran == 1
    finally:
        bench.close()


def test_conditions_of_battery_and_place(bench: QueueBench) -> None:
    node = bench.console.node
    batteries = bench.console.call(
        lambda: node.create_publisher(BatteryState, 'battery_state', qos_profile_sensor_data)
    )
    poses = bench.console.call(lambda: node.create_publisher(PoseStamped, 'pose', qos_profile_sensor_data))

    def send(charge: float, x: float) -> None:
        pose = PoseStamped()
        pose.header.frame_id = 'map'
        pose.pose.position.x, pose.pose.position.y = x, 2.0
        batteries.publish(BatteryState(percentage=charge))
        poses.publish(pose)

    number = bench.add('Work', battery=0.5, place='dock', distance=1.5)
    bench.wait_for_text(number, 'charge of the battery is not known')
    lacking = ((0.4, 1.0, 'battery below 50%'), (float('nan'), 1.0, 'not known'), (55.0, 9.0, 'from dock'))
    for charge, x, text in lacking:

        def seen(charge: float = charge, x: float = x, text: str = text) -> bool:
            send(charge, x)
            return text in bench.queue.entries[0].waits_for

        wait_until(seen, text)
    assert Work.ran == 0

    def done() -> bool:
        send(0.55, 2.0)
        return not bench.numbers()

    wait_until(done, 'the run')
    assert Work.ran == 1
    for options, why in (({'place': 'dok', 'distance': 1.0}, 'did you mean'), ({'window': '25:00-1'}, '22:00-06:00')):
        wrong = [QueueOptions(on_failure=HOLD, **options)]
        assert why in bench.refused(C.QUEUE_ADD, behavior='Work', queue_options=wrong)


def test_a_charge_that_has_arrived_long_ago_while_another_behavior_ran_does_not_count(
    bench: QueueBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conditions, 'OLD_SECONDS', 0.5)
    node, old = bench.console.node, threading.Event()
    batteries = bench.console.call(
        lambda: node.create_publisher(BatteryState, 'battery_state', qos_profile_sensor_data)
    )
    bench.applied(C.QUEUE_HOLD)
    bench.add('Gate')
    number = bench.add('Work', battery=0.5)
    bench.release()
    bench.wait_active('/Only')
    wait_until(batteries.get_subscription_count, 'the subscription')
    batteries.publish(BatteryState(percentage=0.9))
    bench.runtime.call(lambda: bench.runtime.post_in(1.0, old.set))
    assert old.wait(60.0)
    Gate.outcome = 'finished'
    bench.wait_entries(number)
    bench.wait_for_text(number, 'charge of the battery is not known')
    assert Work.ran == 0

    def done() -> bool:
        batteries.publish(BatteryState(percentage=0.9))
        return not bench.numbers()

    wait_until(done, 'the run')


def test_of_two_operators_the_slower_one_is_refused(bench: QueueBench) -> None:
    bench.applied(C.QUEUE_HOLD)
    hold = wait_until(lambda: bench.queue.hold, 'the hold')
    number = bench.add('Work')
    options = [QueueOptions(on_failure=HOLD, count=7)]
    sent = [bench.send(C.QUEUE_EDIT, queue_number=number, queue_options=options, operator_id=who) for who in 'ab']
    codes = sorted(bench.result(one).code for one in sent)
    assert codes == [CommandResult.APPLIED, CommandResult.REFUSED]
    bench.applied(C.STOP)  # holds it again, and whoever has not seen that does not release it
    assert 'another reason' in bench.refused(C.QUEUE_RELEASE, queue_number=hold)
    newest = bench.add('Work')
    bench.applied(C.QUEUE_CLEAR, queue_number=number)
    bench.wait_entries(newest)  # what came later is not lost
    assert f'no entry {number}' in bench.refused(C.QUEUE_REMOVE, queue_number=number)
    bench.applied(C.CLAIM_AUTHORITY, operator_id='a')
    assert 'authority' in bench.refused(C.QUEUE_HOLD, operator_id='b')


def test_the_queue_is_bounded(bench: QueueBench) -> None:
    bench.applied(C.QUEUE_HOLD)
    queue, options = bench.executive._queue, [QueueOptions(on_failure=HOLD)]
    large = [BlackboardEntry(key='k', type='string', text='x' * 900_000)]

    def add(count: int, inputs: list[BlackboardEntry]) -> list[str]:
        refusals = []
        for _ in range(count):
            command = C(behavior='Work', inputs=inputs, autonomy=1, queue_options=options, operator_id='flooder')
            try:
                with queue.changing() as rules:
                    rules.add(queue.new_entry(command))
            except Exception as error:
                refusals.append(str(error))
        return refusals

    refused = bench.runtime.call(lambda: add(10, large))
    assert len(refused) == 10 - QUEUE_SIZE // 900_000
    assert f'at most {QUEUE_SIZE} bytes' in refused[0]
    refused = bench.runtime.call(lambda: add(10_000, []))
    assert len(refused) == 10_000 - (ENTRIES - QUEUE_SIZE // 900_000)
    wait_until(lambda: len(bench.queue.entries) == ENTRIES, 'a full queue')
    bench.applied(C.QUEUE_CLEAR, queue_number=max(bench.numbers()))
    bench.wait_entries()


def test_with_a_full_disk_nothing_is_added_and_nothing_starts_until_it_can_be_written(
    bench: QueueBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.applied(C.QUEUE_HOLD)
    bench.add('Work')
    is_full = threading.Event()

    def filling(real: Callable[[int], None]) -> Callable[[int], None]:
        def sync(descriptor: int) -> None:
            if is_full.is_set():
                raise OSError(errno.ENOSPC, 'No space left on device')
            real(descriptor)

        return sync

    for name in ('fdatasync', 'fsync'):
        monkeypatch.setattr(os, name, filling(getattr(os, name)))
    is_full.set()
    bench.release()
    bench.logged('cannot be written')
    assert 'lost in a crash' in bench.refused(C.QUEUE_ADD, behavior='Work', queue_options=[QueueOptions(on_failure=1)])
    assert Work.ran <= 1  # the release may have been the write that failed
    is_full.clear()
    bench.wait_entries()
    assert Work.ran == 1


def test_a_disk_that_hangs_holds_up_neither_stop_nor_status(bench: QueueBench, monkeypatch: pytest.MonkeyPatch) -> None:
    gate, work = bench.add('Gate'), bench.add('Work')
    bench.wait_active('/Only')
    hangs, real = threading.Event(), os.fdatasync
    answers = threading.Event()

    def slow(descriptor: int) -> None:
        hangs.set()
        answers.wait()
        real(descriptor)

    monkeypatch.setattr(os, 'fdatasync', slow)
    try:
        bench.send(C.QUEUE_MOVE, queue_number=work, queue_before=0)
        wait_until(hangs.is_set, 'the disk')
        sent = bench.send(C.STOP)
        bench.wait_held(f"entry {gate} ended by 'preempted'")  # seen before it is on disk, and applied
    finally:
        answers.set()
    assert bench.result(sent).code == CommandResult.APPLIED
    assert Work.ran == 0


@pytest.mark.parametrize(
    ('given', 'why'),
    [
        ({'inputs': [BlackboardEntry(key='k', type='no_such_msgs/msg/Type', text='{}')]}, 'no_such_msgs'),
        ({'inputs': [BlackboardEntry(key='k', type='int64', text='many')]}, 'many'),
        ({'inputs': [BlackboardEntry(key='k', type='geometry_msgs/msg/PoseStamped', data=b'\xff' * 9)]}, 'PoseStamped'),
        ({'inputs': [BlackboardEntry(key='k', type='int64', text='1')] * 2}, "input 'k' is given twice"),
        ({'arguments': [BehaviorArgument(name='speed', value='fast')]}, "has no parameter 'speed'"),
        ({'arguments': [BehaviorArgument(name='speed', value='1')] * 2}, "'speed' is given twice"),
        ({'queue_options': [QueueOptions(on_failure=HOLD, distance=math.nan)]}, 'distance of an entry is nan'),
        ({'queue_options': [QueueOptions(on_failure=HOLD, battery=math.nan)]}, 'battery of an entry is nan'),
        ({'queue_options': [QueueOptions(on_failure=HOLD, interval=math.nan)]}, 'interval of an entry is nan'),
        ({'queue_options': [QueueOptions(on_failure=77)]}, 'on_failure of an entry is 0'),
        ({'queue_options': []}, 'queue_options'),
        ({'autonomy': 9}, 'autonomy 9'),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else '',
)
def test_what_could_never_start_is_refused_when_it_is_added(bench: QueueBench, given: Any, why: str) -> None:
    fields = {'behavior': 'Work', 'queue_options': [QueueOptions(on_failure=HOLD)], **given}
    assert why in bench.refused(C.QUEUE_ADD, **fields)
    assert bench.numbers() == []
    bench.add('Work')
    bench.wait_entries()
    assert Work.ran == 1


def test_two_consoles_that_reorder_at_once_lose_nothing(bench: QueueBench) -> None:
    bench.applied(C.QUEUE_HOLD)
    numbers = [bench.add('Work') for _ in range(6)]
    sent = []
    for turn in range(20):
        for who in 'ab':
            one, other = numbers[turn % 6], numbers[(turn * 5 + ord(who)) % 6]
            sent.append(bench.send(C.QUEUE_MOVE, queue_number=one, queue_before=other, operator_id=who))
    gone = bench.send(C.QUEUE_REMOVE, queue_number=numbers[3], operator_id='b')
    late = bench.send(C.QUEUE_MOVE, queue_number=numbers[3], queue_before=0, operator_id='a')
    assert {bench.result(one).code for one in [*sent, gone]} == {CommandResult.APPLIED}
    assert 'no entry' in bench.result(late).reason
    wait_until(lambda: len(bench.numbers()) == 5, 'the removal')
    assert sorted(bench.numbers()) == [one for one in numbers if one != numbers[3]]
    bench.release()
    bench.wait_entries()
    assert Work.ran == 5


def test_an_entry_whose_behavior_was_uninstalled_holds_the_queue(tmp_path: Path) -> None:
    Work.ran = Work.failures = 0
    bench = QueueBench(*BEHAVIORS, parameters=parameters_of(tmp_path))
    bench.applied(C.QUEUE_HOLD)
    gone, work = bench.add('Gate'), bench.add('Work')
    bench.close()
    bench = QueueBench(BEHAVIORS[1], parameters=parameters_of(tmp_path))
    try:
        bench.wait_entries(gone, work)
        bench.wait_held('by operator tester')  # a hold outlives the executive
        bench.release()
        bench.wait_held(f'entry {gone} ended before it began')
        assert bench.status.state == ExecutiveStatus.IDLE
        bench.applied(C.QUEUE_REMOVE, queue_number=gone)
        bench.release()
        bench.wait_entries()
        assert Work.ran == 1
    finally:
        bench.close()
