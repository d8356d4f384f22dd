# SPDX-License-Identifier: BSD-3-Clause
"""Whether the threads of a process answer: what is told of it, in which order."""

from __future__ import annotations

import threading
from collections.abc import Callable

from flexbt_common.runtime.health import (
    HANG_SECONDS,
    LATE_SECONDS,
    OUT_OF_REACH_SECONDS,
    PERIOD,
    SETTLE_SECONDS,
    Hang,
    Health,
)
from flexbt_core.clock.clock import ManualClock


def test_an_answer_that_comes_while_lateness_is_told_is_told_after_it() -> None:
    """Otherwise the process would be late for others for ever."""
    clock = ManualClock()
    health = Health(clock)
    told: list[str] = []
    answers: list[Callable[[], None]] = []
    answering: list[threading.Thread] = []

    def tell(problem: str) -> None:
        if problem:  # the thread answers just now, and has time to be told before this is
            answering.append(threading.Thread(target=answers[-1]))
            answering[0].start()
            answering[0].join(0.5)
        told.append(problem)

    health.on_late(tell)
    health.register('the loop', answers.append)
    health.on_beat(lambda: None)
    while not told:
        clock.advance(PERIOD)
        assert clock.now() < LATE_SECONDS + 3 * PERIOD
    answering[0].join(60.0)
    assert [bool(problem) for problem in told] == [True, False]


class StoppedClock(ManualClock):
    """Its time may go on while nothing is called, as when the process is stopped."""

    stopped = 0.0

    def now(self) -> float:
        return super().now() + self.stopped


def test_a_stop_of_the_whole_process_is_told_before_a_thread_goes_on_and_once() -> None:
    """What is done first otherwise, a goal that a tree sends, is done for somebody who has given it up."""
    clock = StoppedClock()
    health = Health(clock)
    told: list[Hang] = []
    health.on_hang(told.append)
    health.on_beat(lambda: None)
    with health.loop('the tree') as loop:
        with loop.resting():
            clock.stopped = OUT_OF_REACH_SECONDS
        assert [hang.was_out_of_reach for hang in told] == [True]
        assert told[0].seconds >= OUT_OF_REACH_SECONDS
        with loop.resting():
            clock.advance(OUT_OF_REACH_SECONDS)
    assert len(told) == 1


def test_a_clock_that_hangs_is_no_stop_of_the_process() -> None:
    clock = StoppedClock()
    health = Health(clock)
    told: list[Hang] = []
    health.on_hang(told.append)
    health.on_beat(lambda: None)
    for _ in range(10):
        clock.stopped += OUT_OF_REACH_SECONDS / 2.0
        health.check_pause()
    assert not told
    clock.advance(2.0 * PERIOD)
    assert [hang.was_out_of_reach for hang in told] == [False]


def test_nobody_goes_on_while_the_stop_of_the_process_is_told() -> None:
    clock = StoppedClock()
    health = Health(clock)
    order: list[str] = []

    def go_on() -> None:
        health.check_pause()
        order.append('continues')

    second = threading.Thread(target=go_on)

    def tell(_: Hang) -> None:
        second.start()
        second.join(0.2)
        order.append('told')

    health.on_hang(tell)
    health.on_beat(lambda: None)
    clock.stopped = OUT_OF_REACH_SECONDS
    health.check_pause()
    second.join(60.0)
    assert order == ['told', 'continues']


def test_after_a_hang_what_has_waited_comes_before_the_process_is_called_alive() -> None:
    """Otherwise what a cancel ends goes on until the cancel was handled: a robot would move once more."""
    clock = StoppedClock()
    health = Health(clock)
    beats: list[float] = []
    answers: list[Callable[[], None]] = []
    hangs = False

    def ping(answer: Callable[[], None]) -> None:
        if hangs:
            answers.append(answer)
        else:
            answer()

    health.register('the executor', ping)
    health.on_beat(lambda: beats.append(clock.now()))
    clock.advance(PERIOD)
    hangs = True
    clock.advance(HANG_SECONDS + 2.0 * PERIOD)
    hangs, back = False, clock.now()
    answers.pop()()
    clock.advance(SETTLE_SECONDS + 2.0 * PERIOD)
    assert SETTLE_SECONDS <= min(beat for beat in beats if beat >= back) - back < SETTLE_SECONDS + 2.0 * PERIOD

    count = len(beats)
    clock.stopped = OUT_OF_REACH_SECONDS
    health.check_pause()
    clock.advance(1.5 * PERIOD)  # all have been asked, and have answered
    assert len(beats) == count
