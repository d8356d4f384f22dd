# SPDX-License-Identifier: BSD-3-Clause
"""The enforcement of stops, on a manual clock: when the robot is held, when a run is given up, what operators read."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import pytest

from flexbt_core.clock.clock import ManualClock, Timer
from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.runs.stop_enforcer import HALT_SECONDS, MOTION_SECONDS, StopEnforcer


class Robot:
    """The other ways to stop a robot, and what a test says of the goals that go on."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.prepared = self.dropped = 0
        self.going_on: dict[tuple[str, bytes], str] = {}
        self.is_holding = False

    def prepare(self) -> None:
        self.prepared += 1

    def drop_cancels(self) -> None:
        self.dropped += 1

    def cancel_others(self) -> None:
        self.calls.append('cancel others')

    def hold(self) -> None:
        self.calls.append('hold')
        self.is_holding = True

    def release(self) -> None:
        self.is_holding = False


class Run:
    """A run that is being stopped."""

    def __init__(self) -> None:
        self.has_ended = self.has_goals = False
        self.shown: list[float] = []
        self.aborted: list[str] = []

    def abort(self, why: str) -> None:
        self.aborted.append(why)

    def show_not_stopped(self, seconds: float) -> None:
        self.shown.append(seconds)


class Bench:
    """An enforcer with its surroundings."""

    def __init__(self) -> None:
        self.steady = ManualClock()
        self.robot = Robot()
        self.lines: list[str] = []
        self.enforcer = StopEnforcer(cast(Any, self), cast(Any, self.robot), 1.8, cast(Any, self))

    def post_in(self, seconds: float, fn: Callable[[], object]) -> Timer:
        return self.steady.call_at(self.steady.now() + seconds, lambda: (fn(), None)[1])

    def holds(self) -> bool:
        """Return whether the robot is held."""
        return self.robot.is_holding

    def log(self, severity: int, text: str) -> None:
        assert severity == ExecutiveLog.WARN
        self.lines.append(text)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_stop_that_is_meant_for_no_run_holds_the_robot_for_a_while(bench: Bench) -> None:
    bench.enforcer.halt_robot(is_running=False)
    bench.steady.advance(HALT_SECONDS - 0.1)
    assert bench.holds()
    bench.steady.advance(0.2)
    assert not bench.holds()
    assert bench.steady.next_timer() is None


def test_the_robot_is_held_as_long_as_something_goes_on_which_operators_read_once(bench: Bench) -> None:
    bench.robot.going_on = {('/spin', b'1'): '/spin', ('/wait', b'2'): '/wait'}
    bench.enforcer.halt_robot(is_running=False)
    bench.steady.advance(HALT_SECONDS + 10.0)
    assert bench.holds()
    told = (
        'the robot is kept at rest until the next start: {} continued after the stop. Restart the node if it does not '
        'end the goal; a node that was killed is taken for running for up to 30 s: wait, or start the next run'
    )
    assert bench.lines == [told.format('/spin, /wait')]
    bench.robot.going_on = {('/wait', b'2'): '/wait'}
    bench.steady.advance(0.5)
    assert bench.lines[1:] == [told.format('/wait')]
    bench.enforcer.begins()
    bench.enforcer.halt_robot(is_running=False)
    bench.steady.advance(HALT_SECONDS)
    assert bench.lines[2:] == [told.format('/wait')], 'it is told again for another stop'
    bench.robot.going_on = {}
    bench.steady.advance(0.4)
    assert bench.holds()
    bench.steady.advance(0.1)
    assert not bench.holds()
    assert bench.lines[3:] == ['/wait has ended: the robot is not kept at rest any more']


def test_servers_are_discovered_at_the_start_of_a_run_at_its_stop_and_when_that_is_wanted(bench: Bench) -> None:
    for act, prepared, dropped in (
        (bench.enforcer.prepare, 1, 0),
        (bench.enforcer.begins, 2, 1),
        (lambda: bench.enforcer.stopping(cast(Any, Run())), 3, 1),
    ):
        act()
        assert (bench.robot.prepared, bench.robot.dropped) == (prepared, dropped)


def test_a_stop_of_a_run_cancels_what_others_have_begun(bench: Bench) -> None:
    bench.enforcer.halt_robot(is_running=True)
    assert bench.robot.calls == ['cancel others'] and not bench.holds()


@pytest.mark.parametrize('left', ['goals', 'hold'])
def test_a_second_stop_belongs_to_the_run_that_has_not_stopped_yet(bench: Bench, left: str) -> None:
    run = Run()
    run.has_ended = True
    run.has_goals = left == 'goals'
    bench.enforcer.stopping(cast(Any, run))
    bench.robot.is_holding = left == 'hold'
    bench.enforcer.halt_robot(is_running=False)
    assert bench.robot.calls == ['cancel others']


def test_a_stop_after_a_run_that_has_stopped_holds_the_robot(bench: Bench) -> None:
    run = Run()
    run.has_ended = True
    bench.enforcer.stopping(cast(Any, run))
    bench.enforcer.halt_robot(is_running=False)
    assert bench.robot.calls == ['hold']


def test_a_run_that_stops_at_once_is_not_held_up(bench: Bench) -> None:
    run = Run()
    bench.enforcer.stopping(cast(Any, run))
    run.has_ended = True
    bench.steady.advance(10.0)
    assert bench.robot.calls == [] and not bench.lines and bench.steady.next_timer() is None


def test_a_run_that_does_not_stop_is_held_shown_and_given_up(bench: Bench) -> None:
    run = Run()
    bench.enforcer.stopping(cast(Any, run))
    bench.steady.advance(MOTION_SECONDS - 0.1)
    assert not bench.holds()
    bench.steady.advance(1.5)
    assert bench.holds() and run.shown == [0.3, 0.8, 1.3] and not run.aborted
    bench.steady.advance(0.2)
    assert run.shown[3:] == [1.8] and run.aborted == ['aborted 1.8 s after the stop']
    run.has_ended = run.has_goals = True
    bench.steady.advance(5.0)
    assert bench.holds()
    run.has_goals = False
    bench.steady.advance(1.0)
    assert not bench.holds() and bench.steady.next_timer() is None
    later = Run()
    bench.enforcer.stopping(cast(Any, later))
    bench.steady.advance(MOTION_SECONDS)
    assert later.shown == [pytest.approx(MOTION_SECONDS)] and not later.aborted


def test_the_next_run_begins_with_a_free_robot(bench: Bench) -> None:
    bench.enforcer.halt_robot(is_running=False)
    bench.enforcer.begins()
    assert not bench.holds() and bench.steady.next_timer() is None
    bench.enforcer.stopping(cast(Any, Run()))
    bench.enforcer.begins()
    bench.steady.advance(10.0)
    assert not bench.holds()
