# SPDX-License-Identifier: BSD-3-Clause
"""The queue against a simple model: which entry is next, what follows a run, and what a crash leaves of it."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field, replace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from flexbt_common.values.message_fields import options_message, options_of
from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_msgs.msg import BlackboardEntry
from flexbt_msgs.msg import QueueOptions as QueueOptionsMessage
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.mission_queue import mission_queue
from flexbt_onboard.mission_queue.conditions import check_options, is_within, time_problem
from flexbt_onboard.mission_queue.mission_queue import MissionQueue
from flexbt_onboard.persistence.journal import JournalState, encode_head, encode_line, read_journal
from flexbt_onboard.persistence.queue_entries import Change, EndedRun, QueueEntry, QueueState

MOST = 6
OUTCOMES = ['finished', 'failed', 'odd', 'preempted', 'error', '']
OPTIONS = st.builds(
    QueueOptions,
    priority=st.sampled_from([0, 0, 1, -1]),
    not_before=st.sampled_from([0.0, 0.0, 0.0, 50.0]),
    count=st.integers(1, 3),
    interval=st.sampled_from([0.0, 10.0]),
    on_failure=st.sampled_from([*OnFailure, OnFailure.RETRY][1:]),
    retries=st.integers(0, 2),
    wanted=st.sampled_from([(), (), ('odd',)]),
)


@dataclass
class Known:
    """What the model knows of an entry."""

    number: int
    options: QueueOptions
    left: int
    due: float = 0.0
    revision: int = 0
    failures: int = 0


@dataclass
class Disk:
    """A journal as bytes: what is written is there after a crash, each line as a whole or not at all."""

    lines: list[dict[str, Any]] = field(default_factory=list)

    def write(self, change: Change) -> None:
        self.lines.append(json.loads(json.dumps({'queue': change})))

    def read(self) -> QueueState:
        data = encode_head() + b''.join(encode_line(number, line) for number, line in enumerate(self.lines, 1))
        found = read_journal(data)
        assert not found.corruption
        state = JournalState()
        for line in found.lines:
            state.apply(line)
        anew = JournalState()
        for line in state.lines():
            anew.apply(json.loads(json.dumps(line)))
        assert anew.queue == state.queue  # a file that is rewritten says the same
        return state.queue


class QueueAgainstModel(RuleBasedStateMachine):
    """Two operators, a robot, and crashes. The model is a list that is sorted by hand."""

    def __init__(self) -> None:
        super().__init__()
        self.disk = Disk()
        self.queue = MissionQueue(QueueState(), self.disk.write)
        self.entries: list[Known] = []
        self.last = self.hold = self.last_hold = self.running = 0
        self.now = 1.0
        self.started = 0.0
        self.taken: dict[int, int] = {}

    def place(self, one: Known) -> None:
        """Put an entry behind the others of its priority."""
        self.entries = [other for other in self.entries if other is not one]
        at = sum(other.options.priority >= one.options.priority for other in self.entries)
        self.entries.insert(at, one)

    def holds(self) -> None:
        self.last_hold += 1
        self.hold = self.last_hold

    @rule(options=OPTIONS)
    def add(self, options: QueueOptions) -> None:
        data = BlackboardEntry(key='k', type='string', text='"é"', data=b'\x00\xff')
        entry = QueueEntry(0, 'B', options, (('a', 'b'),), (data,), 1, 'ann', self.now)
        if len(self.entries) >= MOST:
            with pytest.raises(CommandRefusedError, match='entries already'):
                self.queue.add(entry)
            return
        self.last += 1
        assert self.queue.add(entry) == self.last  # numbers are never used again
        self.place(Known(self.last, options, options.count))

    @rule(data=st.data(), options=OPTIONS, is_stale=st.booleans())
    def edit(self, data: st.DataObject, options: QueueOptions, is_stale: bool) -> None:
        known = self.any_entry(data)
        entry = QueueEntry(known.number if known else 99, 'ignored', options, revision=known.revision if known else 0)
        if known is None or is_stale:
            with pytest.raises(CommandRefusedError):
                self.queue.edit(replace(entry, revision=entry.revision + is_stale))
            return
        self.queue.edit(entry)
        is_moved = known.options.priority != options.priority
        if known.options.interval != options.interval:
            known.due = 0.0
        known.options, known.left, known.failures = options, options.count, 0
        known.revision += 1
        if is_moved:
            self.place(known)

    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        known = self.any_entry(data)
        if known is not None:
            self.queue.remove(known.number)
            self.entries.remove(known)
            with pytest.raises(CommandRefusedError):
                self.queue.remove(known.number)

    @rule(data=st.data(), is_last=st.booleans())
    def move(self, data: st.DataObject, is_last: bool) -> None:
        known, other = self.any_entry(data), self.any_entry(data)
        if known is None or other is None:
            return
        if is_last:
            self.queue.move(known.number, 0)
            self.place(known)
        elif known.options.priority != other.options.priority:
            with pytest.raises(CommandRefusedError, match='change the priority'):
                self.queue.move(known.number, other.number)
        elif known is other:
            self.queue.move(known.number, known.number)  # no change
        else:
            self.queue.move(known.number, other.number)
            self.entries.remove(known)
            self.entries.insert(self.entries.index(other), known)

    @rule(behind=st.integers(0, 2))
    def clear(self, behind: int) -> None:
        """Clear what an operator has seen who lags behind."""
        newest = max(0, self.last - behind)
        assert self.queue.clear(newest) == sum(one.number <= newest for one in self.entries)
        self.entries = [one for one in self.entries if one.number > newest]

    @rule()
    def hold_it(self) -> None:
        self.queue.hold('because')
        self.holds()

    @rule(is_stale=st.booleans())
    def release(self, is_stale: bool) -> None:
        if not self.hold or is_stale:
            with pytest.raises(CommandRefusedError):
                self.queue.release(self.hold - is_stale)
            return
        self.queue.release(self.hold)
        self.hold = 0

    @rule(by=st.sampled_from([0.0, 3.0, 20.0, -15.0]))
    def time_passes(self, by: float) -> None:
        """Let time pass, or set the clock back."""
        self.now = max(1.0, self.now + by)

    @rule()
    def take(self) -> None:
        found = self.queue.next(lambda entry: time_problem(entry, self.now))
        may = [one for one in self.entries if self.may_start(one)]
        if self.hold or self.running or not may:
            assert found is None
            return
        assert found is not None
        assert found.number == may[0].number
        self.running = self.queue.running = found.number
        self.started = self.now

    @rule(outcomes=st.lists(st.sampled_from(OUTCOMES[:3]), min_size=2, max_size=6))
    def go_on(self, outcomes: list[str]) -> None:
        """Release the queue, and let some runs begin and end."""
        for outcome in outcomes:
            if self.running:
                self.end_run(outcome)
            if self.hold:
                self.queue.release(self.hold)
                self.hold = 0
            self.take()

    @precondition(lambda self: self.running)
    @rule(
        outcome=st.sampled_from(OUTCOMES), is_forced=st.booleans(), crash=st.sampled_from(['', '', 'before', 'after'])
    )
    def end(self, outcome: str, is_forced: bool, crash: str) -> None:
        """Let the run end."""
        self.end_run(outcome, is_forced, crash)

    def end_run(self, outcome: str, is_forced: bool = False, crash: str = '') -> None:
        """Let the run end; the executive is killed before the queue knows of it, or after it."""
        end, started = EndedRun(self.running, outcome, 'why', is_forced), self.started
        if crash == 'before':  # the line of the end is written with that of the run
            self.disk.write({'ended': list(end)})
            self.open_again()
            assert self.queue.state.ended == end
            started = self.now  # nobody knows any more
        is_held = bool(self.queue.settle(end, self.now, started))
        number, self.running = self.running, 0
        assert is_held == self.follows(number, outcome, is_forced, started)
        if crash == 'after':
            self.open_again()
        assert self.queue.state.ended is None

    def follows(self, number: int, outcome: str, is_forced: bool, started: float) -> bool:
        """Do what the documentation says follows the end of a run; return whether the queue is held."""
        known = next((one for one in self.entries if one.number == number), None)
        is_broken = outcome in ('preempted', 'error')
        is_held = is_broken or is_forced
        if known is not None:
            options = known.options
            is_good = outcome in options.wanted if options.wanted else outcome in ('finished', 'odd')
            if is_broken:
                known.failures = 0
            elif is_good or options.on_failure is OnFailure.CONTINUE:
                known.failures = 0 if is_good else known.failures + 1
                known.left -= 1
                known.revision += 1
                if known.left == 0:
                    self.entries.remove(known)
                elif options.interval:
                    known.due = max(self.now, started + options.interval)
                    self.place(known)
            elif options.on_failure is OnFailure.DROP:
                self.entries.remove(known)
            elif options.on_failure is OnFailure.RETRY and known.failures < options.retries:
                known.failures += 1
            else:
                known.failures = 0
                is_held = True
        is_held = is_held and bool(self.entries)
        if is_held:
            self.holds()
        return is_held

    @rule()
    def crash(self) -> None:
        """Kill the executive while nothing runs, or while an entry runs that is resumed."""
        assert self.disk.read() == self.queue.state
        self.open_again()

    def open_again(self) -> None:
        self.queue = MissionQueue(self.disk.read(), self.disk.write)
        self.queue.running = self.running

    def may_start(self, one: Known) -> bool:
        is_due = self.now >= one.due or one.due - self.now > one.options.interval
        return is_due and self.now >= one.options.not_before

    def any_entry(self, data: st.DataObject) -> Known | None:
        return data.draw(st.sampled_from(self.entries)) if self.entries else None

    @invariant()
    def same(self) -> None:
        state = self.queue.state
        shown = [
            (one.number, one.revision, one.options.count, one.due, one.failures, one.arguments, one.inputs[0].text)
            for one in state.entries.values()
        ]
        assert shown == [
            (one.number, one.revision, one.left, one.due, one.failures, (('a', 'b'),), '"é"') for one in self.entries
        ]
        assert (state.hold, bool(state.held)) == (self.hold, bool(self.hold))


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mission_queue, 'ENTRIES', MOST)


def test_queue_against_model() -> None:
    """Two hundred walks: what is only found in some of them is rare."""
    run_state_machine_as_test(
        QueueAgainstModel, settings=settings(max_examples=200, stateful_step_count=30, deadline=None)
    )


def test_an_edit_of_what_was_seen_before_a_run_gives_that_run_not_again() -> None:
    queue = MissionQueue(QueueState(), Disk().write)
    seen = queue.entry(queue.add(QueueEntry(0, 'Work', QueueOptions(count=3))))
    endless = queue.entry(queue.add(QueueEntry(0, 'Work', QueueOptions(count=0, interval=10.0))))
    for number in (seen.number, endless.number):
        queue.settle(EndedRun(number, 'finished', ''), 1.0)
    with pytest.raises(CommandRefusedError, match='was changed meanwhile'):
        queue.edit(replace(seen, options=replace(seen.options, priority=1)))
    assert queue.entry(seen.number).options == QueueOptions(count=2)
    queue.edit(replace(endless, options=replace(endless.options, priority=1)))


@given(st.integers(0, 1439), st.integers(0, 1439), st.integers(0, 2**31 - 1))
def test_a_window_of_the_day_holds_from_its_begin_to_its_end_whatever_the_clock_jumps_to(
    begin: int, end: int, now: int
) -> None:
    local = time.localtime(now)
    minute = 60 * local.tm_hour + local.tm_min
    window = f'{begin // 60:02}:{begin % 60:02}-{end // 60:02}:{end % 60:02}'
    check_options(QueueOptions(window=window), {})
    expected = begin == end or (minute - begin) % 1440 < (end - begin) % 1440
    assert is_within(window, now) is expected


@given(st.builds(Time, sec=st.integers(-(2**31), 2**31 - 1), nanosec=st.integers(0, 2**32 - 1)))
@example(Time(sec=2**31 - 1, nanosec=999_999_999))
@example(Time(sec=2**31 - 1))
def test_an_earliest_start_is_kept_over_a_restart_and_shown_or_refused(when: Time) -> None:
    options, disk = options_of(QueueOptionsMessage(not_before=when, on_failure=QueueOptionsMessage.HOLD)), Disk()
    try:
        check_options(options, {})
    except CommandRefusedError as error:
        assert 'not_before' in str(error) and not 1 - 2**31 <= when.sec < 2**31 - 5
        return
    MissionQueue(QueueState(), disk.write).add(QueueEntry(0, 'Work', options))
    (entry,) = disk.read().entries.values()
    assert entry.options == options
    assert abs(options_message(entry.options).not_before.sec) < 2**31
