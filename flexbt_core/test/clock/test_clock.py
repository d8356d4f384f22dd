# SPDX-License-Identifier: BSD-3-Clause
"""The manual and the steady clock."""

from __future__ import annotations

import functools
import logging
import math
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.clock.clock import Clock, ManualClock, SteadyClock, TimerQueue, seconds_asleep
from flexbt_core.clock.waiting import CoalescedTimers, WakeEvent
from flexbt_testing.waiting import DEADLINE


def test_manual_clock_calls_in_order_of_time_each_at_its_time() -> None:
    clock = ManualClock(100.0)
    seen: list[tuple[str, float]] = []
    clock.call_at(102.0, lambda: seen.append(('b', clock.now())))
    clock.call_at(101.0, lambda: seen.append(('a', clock.now())))
    clock.call_at(102.0, lambda: seen.append(('c', clock.now())))
    clock.call_at(110.0, lambda: seen.append(('late', clock.now())))
    clock.advance(0.5)
    assert seen == []
    assert clock.next_timer() == 101.0
    clock.advance(4.5)
    assert seen == [('a', 101.0), ('b', 102.0), ('c', 102.0)]
    assert clock.now() == 105.0


def test_manual_clock_callback_may_set_and_cancel_timers() -> None:
    clock = ManualClock()
    seen: list[str] = []
    other = clock.call_at(2.0, lambda: seen.append('cancelled'))

    def first() -> None:
        other.cancel()
        clock.call_at(1.5, lambda: seen.append('nested'))

    clock.call_at(1.0, first)
    clock.advance(3.0)
    assert seen == ['nested']
    assert clock.next_timer() is None


def test_manual_clock_timer_in_the_past_waits_for_the_next_step() -> None:
    clock = ManualClock(5.0)
    seen: list[float] = []
    clock.call_at(1.0, lambda: seen.append(clock.now()))
    assert seen == []
    clock.advance(0.0)
    assert seen == [5.0]


def test_manual_clock_may_be_set_back_but_not_advanced_back() -> None:
    clock = ManualClock(5.0)
    seen: list[float] = []
    clock.call_at(3.5, lambda: seen.append(clock.now()))
    with pytest.raises(ValueError, match='cannot go back'):
        clock.advance(-1.0)
    clock.set(3.0)
    assert clock.now() == 3.0
    assert seen == []
    clock.set(4.0)
    assert seen == [3.5]


@pytest.mark.parametrize('clock', [ManualClock(), SteadyClock()])
def test_nan_is_refused(clock: Clock) -> None:
    with pytest.raises(ValueError, match='NaN'):
        clock.call_at(math.nan, lambda: None)


@given(st.lists(st.floats(0.0, 10.0), max_size=20), st.lists(st.floats(0.0, 3.0), max_size=10))
def test_manual_clock_calls_exactly_what_is_due(timers: list[float], steps: list[float]) -> None:
    clock = ManualClock()
    called: list[float] = []
    for when in timers:
        clock.call_at(when, lambda when=when: called.append(when))  # type: ignore[misc]
    for step in steps:
        clock.advance(step)
    clock.advance(0.0)
    assert called == sorted(when for when in timers if when <= clock.now())


@given(st.lists(st.tuples(st.integers(0, 9), st.booleans()), max_size=400), st.integers(0, 9))
def test_cancelled_timers_go_and_no_other(timers: list[tuple[int, bool]], now: int) -> None:
    """Against a list: some timers are cancelled as soon as they are set, while others wait."""
    queue, waiting, called = TimerQueue(), list[tuple[int, int]](), list[tuple[int, int]]()
    for number, (when, is_cancelled) in enumerate(timers):
        timer = queue.add(when, lambda entry=(when, number): called.append(entry))  # type: ignore[misc]
        if is_cancelled:
            timer.cancel()
        else:
            waiting.append((when, number))
        assert len(queue) <= max(64, 2 * len(waiting) + 1)
    assert queue.earliest() == (min(waiting)[0] if waiting else None)
    while (due := queue.take(now)) is not None:
        due[1]()
    assert called == sorted(entry for entry in waiting if entry[0] <= now)


def test_a_sleep_that_ends_early_leaves_nothing_with_the_clock() -> None:
    clock, wake_event = SteadyClock(), WakeEvent()
    try:
        for _ in range(1000):
            clock.call_at(clock.now(), wake_event.set)
            wake_event.wait(clock, clock.now() + 3600.0)
        assert len(clock._timers) < 100
    finally:
        clock.close()


def test_steady_clock_calls_on_time_and_in_order() -> None:
    clock = SteadyClock()
    try:
        done = threading.Event()
        seen: list[tuple[str, float]] = []
        start = clock.now()

        def last() -> None:
            seen.append(('late', clock.now()))
            done.set()

        clock.call_at(math.inf, done.set)
        clock.call_at(start + 0.06, last)
        clock.call_at(start + 0.02, lambda: seen.append(('early', clock.now())))
        assert done.wait(DEADLINE)
        assert [name for name, _ in seen] == ['early', 'late']
        assert seen[0][1] >= start + 0.02
        assert seen[1][1] >= start + 0.06
    finally:
        clock.close()


def test_steady_clock_earlier_timer_interrupts_the_wait_for_a_later_one() -> None:
    clock = SteadyClock()
    try:
        done = threading.Event()
        clock.call_at(clock.now() + 3600.0, lambda: None)
        clock.call_at(clock.now() + 0.01, done.set)
        assert done.wait(DEADLINE)
    finally:
        clock.close()


@pytest.mark.parametrize('kind', [RuntimeError, MemoryError, SystemExit])
def test_steady_clock_survives_a_callback_that_raises(
    caplog: pytest.LogCaptureFixture, kind: type[BaseException]
) -> None:
    clock = SteadyClock()
    try:
        done = threading.Event()

        def faulty() -> None:
            raise kind('deliberate')

        with caplog.at_level(logging.ERROR):
            clock.call_at(clock.now(), faulty)
            clock.call_at(clock.now(), done.set)
            assert done.wait(DEADLINE)
        assert 'deliberate' in caplog.text
    finally:
        clock.close()


def test_steady_clock_calls_nothing_after_cancel_or_close() -> None:
    clock = SteadyClock()
    seen: list[str] = []
    done = threading.Event()
    timer = clock.call_at(clock.now() + 0.02, lambda: seen.append('cancelled'))
    timer.cancel()
    clock.call_at(clock.now() + 0.03, done.set)
    assert done.wait(DEADLINE)
    clock.call_at(clock.now() + 0.02, lambda: seen.append('closed'))
    clock.close()
    clock.close()
    clock.call_at(clock.now(), lambda: seen.append('after close'))
    assert not any(thread.name == 'steady_clock' and thread.is_alive() for thread in threading.enumerate())
    assert seen == []


def test_steady_clock_may_be_closed_from_a_callback() -> None:
    clock = SteadyClock()
    done = threading.Event()

    def end() -> None:
        clock.close()
        done.set()

    clock.call_at(clock.now(), end)
    assert done.wait(DEADLINE)


def test_steady_clock_needs_no_thread_before_the_first_timer() -> None:
    before = threading.active_count()
    clock = SteadyClock()
    assert abs(clock.now() - time.monotonic()) < 1.0
    assert threading.active_count() == before
    clock.close()


def test_steady_clock_begins_its_thread_later_when_none_was_left(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    clock, called = SteadyClock(), threading.Event()
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, 'start', fail)
        with pytest.raises(RuntimeError):
            clock.call_at(clock.now(), lambda: None)
    clock.call_at(clock.now(), called.set)
    assert called.wait(DEADLINE)
    clock.close()


def test_what_lies_between_the_looks_at_two_clocks_is_no_sleep_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever compares it with the wall's clock would take what is missing for a clock that was set."""
    asleep, now, pauses = 3600.0, 1000.0, iter((0.0, 0.3, 0.2, 0.0, 0.0, 0.0))

    def monotonic() -> float:
        nonlocal now
        now += next(pauses)  # another process runs before the look
        return now

    monkeypatch.setattr(time, 'monotonic', monotonic)
    monkeypatch.setattr(time, 'clock_gettime', lambda _: now + asleep)
    assert seconds_asleep() == pytest.approx(asleep, abs=0.001)


@given(
    timers=st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 3.0)), max_size=8),
    awake=st.lists(st.floats(0.0, 15.0), max_size=20),
)
def test_coalesced_timers_are_called_in_their_time_and_wake_a_thread_only_at_its_end(
    timers: list[tuple[float, float]], awake: list[float]
) -> None:
    queue, called = CoalescedTimers(), list[int]()
    for number, (when, tolerance) in enumerate(timers):
        queue.add(when, tolerance, functools.partial(called.append, number))
    others = sorted(awake)
    while (now := min([queue.latest, *others])) < math.inf:
        others = [one for one in others if one > now]
        for callback in queue.take_due(now):
            callback()
        assert sorted(called) == [n for n, (when, tolerance) in enumerate(timers) if when - tolerance <= now]
        assert all(when + tolerance >= now for n, (when, tolerance) in enumerate(timers) if n not in called)
    assert len(called) == len(timers)
