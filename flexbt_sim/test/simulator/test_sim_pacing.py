# SPDX-License-Identifier: BSD-3-Clause
"""Pacing: the schedule on a clock that stands still until it is set, and the waiting on the real one."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_sim.world.pacing import ANSWER_SECONDS, IDLE_FACTOR, MAX_LAG, STALL_SECONDS, Drivers, Pacer, Schedule
from flexbt_testing.waiting import DEADLINE, uncontended_time

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


def test_as_fast_as_possible_never_rushes_past_those_who_are_about_to_act() -> None:
    """A computer that was busy for 0.15 s would make good 7.5 s of the world in no time."""
    assert Schedule(0.0, 7.0).advance(1.0, 7.15) == 7.15


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
        pacer.wait(3, 0.03, 0.0)
    assert time.monotonic() - began >= 0.3 - 1e-6


def while_waiting(pacer: Pacer, wait: Callable[[], None], do: Callable[[], object]) -> float:
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
    for pacer in (Pacer(1e-6), paused()):
        while_waiting(pacer, partial(pass_time, pacer), pacer.stop)
        pacer.wait(1, 1e9, 1e9)
        assert pacer.stopped and pacer.begin(3) == (0, False)


def paused() -> Pacer:
    pacer = Pacer(1.0)
    pacer.pause()
    return pacer


def pass_time(pacer: Pacer, simulated: float = 1.0) -> None:
    """As the world does, once."""
    steps, _ = pacer.begin(3)
    if steps:
        pacer.wait(steps, simulated, simulated)


@pytest.mark.parametrize('factor', [1e-6, 1e-320])
def test_a_new_factor_ends_what_was_long_at_the_old_one(factor: float) -> None:
    pacer = Pacer(factor)

    def change() -> None:
        pacer.factor = 1000.0

    while_waiting(pacer, partial(pass_time, pacer), change)
    pass_time(pacer)


def test_a_pause_ends_a_long_wait_so_that_steps_can_be_made() -> None:
    pacer = Pacer(1e-6)
    while_waiting(pacer, partial(pacer.wait, 1, 1.0, 1.0), pacer.pause)


# -- as fast as possible ---------------------------------------------------------------------------------------------


def drive(pacer: Pacer, now: float, *, is_stopping: bool = False) -> None:
    """Return a command that the robot follows for 0.5 s."""
    pacer.command_received('robot', now, now + 0.5, is_stopping=is_stopping)


def test_an_answer_is_waited_for_but_not_long() -> None:
    pacer = Pacer(0.0)
    drive(pacer, 1.0)
    began = time.monotonic()
    pacer.wait(3, 0.03, 1.03)
    assert time.monotonic() - began >= ANSWER_SECONDS - 0.001
    began = uncontended_time()
    for tick in range(100):
        drive(pacer, 1.03 + 0.03 * tick)
        pacer.wait(3, 0.03, 1.03 + 0.03 * tick)  # it has come already
    assert uncontended_time() - began < 100 * ANSWER_SECONDS / 2


def test_who_drives_may_be_held_up_once_and_does_not_make_the_world_slow() -> None:
    pacer = Pacer(0.0)
    drive(pacer, 1.0)
    began = time.monotonic()
    pacer.wait(3, 0.03, 1.03)
    assert time.monotonic() - began >= STALL_SECONDS - 0.001
    began = uncontended_time()
    for tick in range(2, 7):
        pacer.wait(3, 0.03, 1.0 + 0.03 * tick)
    assert uncontended_time() - began < STALL_SECONDS


def test_who_was_told_to_stand_is_not_waited_for_any_longer() -> None:
    pacer = Pacer(0.0)
    drive(pacer, 1.0, is_stopping=True)
    began = uncontended_time()
    pacer.wait(3, 0.03, 1.03)
    assert uncontended_time() - began < STALL_SECONDS - ANSWER_SECONDS


def test_a_driver_that_answers_every_other_time_is_waited_for_every_other_time() -> None:
    drivers = Drivers()
    for tick in range(0, 40, 2):
        drivers.commanded('robot', 0.03 * tick, 0.03 * tick + 0.5, is_stopping=False)
        assert not drivers.due(0.03 * tick)
        if tick > 2:
            assert not drivers.due(0.03 * (tick + 1))
            assert drivers.due(0.03 * (tick + 2)) == ['robot']


def test_nobody_is_waited_for_who_drives_no_more() -> None:
    drivers = Drivers()
    drivers.commanded('robot', 1.0, 1.5, is_stopping=False)
    drivers.commanded('other', 1.0, 1.5, is_stopping=True)
    assert drivers.due(1.1) == ['robot', 'other']
    for robot in ('robot', 'other'):
        drivers.did_not_answer(robot)
    assert drivers.due(1.13) == ['robot']  # the other one was to stand
    assert drivers.acting(1.4) and not drivers.acting(1.5)
    assert drivers.due(1.4) == []
    drivers.commanded('robot', 2.0, 2.5, is_stopping=False)
    drivers.forget('robot')
    assert not drivers.acting(2.1)


def test_while_somebody_computes_time_passes_as_on_a_robot() -> None:
    """And no longer than that: who has done is not waited for."""
    began = time.monotonic()
    pacer = Pacer(0.0)  # from now on
    pacer.set_computing('planner', True)
    pass_time(pacer, 0.3)
    assert time.monotonic() - began >= 0.3 - 1e-3
    took = while_waiting(pacer, partial(pass_time, pacer, 1000.0), lambda: pacer.set_computing('planner', False))
    assert took < DEADLINE


def test_until_it_is_known_who_acts_time_passes_as_on_a_robot() -> None:
    """What has arrived may be a command that was not handled yet."""
    posted: list[Callable[[], object]] = []
    began = time.monotonic()
    pacer = Pacer(0.0, posted.append)
    for _ in range(3):
        pass_time(pacer, 0.1)
    assert time.monotonic() - began >= 0.3 - 1e-3
    (handled,) = posted
    assert while_waiting(pacer, partial(pass_time, pacer, 20.0), handled) < 20.0


# -- standing still --------------------------------------------------------------------------------------------------


def test_while_it_stands_still_steps_are_made_as_many_as_asked_for() -> None:
    pacer = paused()
    told: list[tuple[int, bool]] = []

    def on_stepped(left: int, is_over: bool) -> None:
        told.append((left, is_over))

    assert pacer.step(5, on_stepped, 100)
    assert not pacer.step(1, on_stepped, 100)  # others are being made
    for made in (3, 2):
        assert pacer.begin(3) == (made, True)
        pacer.wait(made, 0.01, 0.0)
    assert told == [(2, False), (0, True)]
    assert pacer.step(2, on_stepped, 1)
    assert pacer.begin(3) == (1, True)  # a piece
    pacer.wait(1, 0.01, 0.0)
    pacer.cancel_steps()
    assert told[2:] == [(1, False), (1, True)]
    assert pacer.step(4, on_stepped, 100)
    pacer.play()
    assert told[4:] == [(4, True)]
    assert pacer.begin(3) == (3, False)
    assert not pacer.step(1, on_stepped, 1)  # it does not stand still


def test_steps_that_were_begun_before_are_none_of_those_that_are_asked_for() -> None:
    """Neither those of a time that went on, nor those of a request that was canceled."""
    told: list[tuple[int, bool]] = []

    def on_stepped(left: int, is_over: bool) -> None:
        told.append((left, is_over))

    pacer = Pacer(1.0)
    for begun in ((3, False), (3, True)):
        assert pacer.begin(3) == begun
        pacer.pause()
        pacer.cancel_steps()
        told.clear()
        assert pacer.step(5, on_stepped, 100)
        pacer.wait(2, 0.0, 0.0)
        assert told == []
    assert pacer.begin(100) == (5, True)
    pacer.wait(5, 0.0, 0.0)
    assert told == [(0, True)]


def test_the_wait_of_a_pause_is_not_made_good() -> None:
    """After it the world does not rush."""
    pacer = paused()
    played: list[float] = []

    def play() -> None:
        played.append(time.monotonic())
        pacer.play()

    threading.Timer(0.1, play).start()
    pacer.begin(3)
    pass_time(pacer, 0.05)
    assert time.monotonic() - played[0] >= 0.05 - 0.002
