# SPDX-License-Identifier: BSD-3-Clause
"""Pacing: the schedule on a clock that stands still until it is set, and the waiting on the real one."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_sim.world import ANSWER_SECONDS, IDLE_FACTOR, MAX_LAG, Pacer, Schedule
from flexbt_testing.waiting import uncontended_time

DEADLINE = 60.0
pieces = st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=50)


@given(st.floats(1e-3, 1000.0), pieces)
def test_a_world_that_keeps_up_is_exactly_on_time(factor: float, simulated: list[float]) -> None:
    """However the time is cut in pieces: what one wait is too long, the next is shorter."""
    now = 100.0
    schedule = Schedule(factor, now)
    for piece in simulated:
        due = schedule.advance(piece, now)
        now = max(now, due) + 0.9 * MAX_LAG * (piece / 1000.0)  # woken up a little late
    assert due == pytest.approx(100.0 + sum(simulated) / factor)


@given(st.floats(0.1, 1000.0), pieces, st.lists(st.floats(0.0, 1.0), min_size=50, max_size=50))
def test_a_lag_is_made_good_up_to_its_limit_and_never_by_more(
    factor: float, simulated: list[float], delays: list[float]
) -> None:
    now = 0.0
    schedule = Schedule(factor, now)
    for piece, delay in zip(simulated, delays, strict=False):
        before = schedule.due
        due = schedule.advance(piece, now)
        if now - before - piece / factor > MAX_LAG + 1e-9:
            assert due == now  # the loss is given up
        else:
            assert due == pytest.approx(before + piece / factor)
            assert due >= now - MAX_LAG - 1e-9
        now = max(now, due) + delay


def test_as_fast_as_possible_has_its_own_pace_while_nobody_drives() -> None:
    assert Schedule(0.0, 7.0).advance(1.0, 7.0) == 7.0 + 1.0 / IDLE_FACTOR


@pytest.mark.parametrize('factor', [1e-300, 5e-324])
def test_a_world_that_stands_still_is_due_some_day_or_never(factor: float) -> None:
    assert Schedule(factor, 0.0).advance(0.03, 0.0) > 1e200


@pytest.mark.parametrize('factor', [-1.0, -1e-300, math.nan, math.inf, -math.inf])
def test_other_factors_are_refused_and_change_nothing(factor: float) -> None:
    with pytest.raises(ValueError, match='speed factor'):
        Pacer(factor)
    pacer = Pacer(3.0)
    with pytest.raises(ValueError, match='speed factor'):
        pacer.factor = factor
    assert pacer.factor == 3.0


def test_waiting_takes_the_time_that_the_factor_says() -> None:
    """Not less; how much more is the machine's business."""
    began = time.monotonic()
    pacer = Pacer(10.0)
    for _ in range(100):
        pacer.wait(0.03)
    assert time.monotonic() - began >= 0.3 - 1e-6


def while_waiting(pacer: Pacer, wait: Callable[[], None], do: Callable[[], None]) -> float:
    """Do something while a thread waits; how long that waited, s."""
    took: list[float] = []

    def work() -> None:
        began = time.monotonic()
        wait()
        took.append(time.monotonic() - began)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    do()
    thread.join(DEADLINE)
    assert not thread.is_alive()
    return took[0]


def test_stop_ends_all_waiting() -> None:
    pacer = Pacer(1e-6)
    while_waiting(pacer, lambda: pacer.wait(1.0), pacer.stop)
    pacer.wait(1e9)
    pacer.wait_for_answer(0)
    assert pacer.stopped


@pytest.mark.parametrize('factor', [1e-6, 1e-320])
def test_a_new_factor_ends_what_was_long_at_the_old_one(factor: float) -> None:
    pacer = Pacer(factor)

    def change() -> None:
        pacer.factor = 1000.0

    while_waiting(pacer, lambda: pacer.wait(1.0), change)
    pacer.wait(1.0)


def test_an_answer_is_waited_for_but_not_long() -> None:
    pacer = Pacer(0.0)
    began = time.monotonic()
    pacer.wait_for_answer(pacer.commands)
    assert time.monotonic() - began >= ANSWER_SECONDS - 0.001
    pacer.command_received()
    assert pacer.commands == 1
    began = uncontended_time()
    for _ in range(100):
        pacer.wait_for_answer(0)  # has come already
    assert uncontended_time() - began < 100 * ANSWER_SECONDS / 2


def test_the_time_spent_waiting_for_an_answer_is_not_made_good() -> None:
    """After a driver that took long the world does not rush."""
    pacer = Pacer(1.0)
    for _ in range(5):
        began = time.monotonic()
        pacer.wait_for_answer(pacer.commands)
    pacer.wait(0.05)
    assert time.monotonic() - began >= ANSWER_SECONDS + 0.05 - 0.002
