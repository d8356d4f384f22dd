# SPDX-License-Identifier: BSD-3-Clause
"""A callback that does not return is told by its name, on a clock that the test owns and over the operator link."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import pytest

from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.engine import RunningCallback
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog
from flexbt_onboard.runs.blocked_callback_watchdog import LIMIT, BlockedCallback, BlockedCallbackWatchdog
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, wait_until

_CALLBACKS = ('on_enter', 'execute', 'on_exit', 'halting', 'activity')


class Working(EventState):
    """Calls ``work`` in each of its callbacks, with the name of the callback; done the second time."""

    def __init__(self, work: Callable[[str], None]) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._work = work
        self._count = 0

    def on_enter(self, userdata: Any) -> None:
        self._work('on_enter')

    def execute(self, userdata: Any) -> str | None:
        self._work('execute')
        self._count += 1
        self.wake()
        return 'done' if self._count == 2 else None

    def on_exit(self, userdata: Any) -> None:
        self._work('on_exit')

    def halting(self) -> str | None:
        self._work('halting')
        return None

    def activity(self) -> list[str]:
        self._work('activity')
        return []


def machine_of(work: Callable[[str], None]) -> OperatableStateMachine:
    """One working state, inside another machine."""
    inner, outer = (OperatableStateMachine(outcomes=['done']) for _ in range(2))
    with inner:
        OperatableStateMachine.add('In', Working(work), {'done': 'done'})
    with outer:
        OperatableStateMachine.add('Out', inner, {'done': 'done'})
    return outer


def test_each_callback_that_takes_long_is_told_once_and_no_other_and_when_it_returns() -> None:
    """The callbacks move the clock of the watch themselves, which is as if they took that long."""
    clock, told, returned = ManualClock(), list[BlockedCallback](), list[BlockedCallback]()
    step = 0.1
    machine: MachineRun | None = None

    def work(callback: str) -> None:
        for _ in range(30):
            clock.advance(step)

    def run() -> None:
        nonlocal machine
        machine = MachineRun(define(machine_of(work)), clock, [])
        machine.start()
        while machine.step():
            for leaf in machine.active_states():
                leaf.activity()
        clock.advance(10.0)  # between the callbacks

    def calling() -> RunningCallback | None:
        return machine.calling if machine is not None else None

    def watch() -> BlockedCallbackWatchdog:
        return BlockedCallbackWatchdog(clock, calling, told.append, returned.append)

    with watch():
        run()
        assert sorted(held.callback for held in told) == sorted(_CALLBACKS)
        assert {held.path for held in told} == {'/Out/In'}
        assert all(LIMIT <= held.seconds < LIMIT + 0.6 for held in told)
        assert [held.callback for held in returned] == [held.callback for held in told]
        assert all(2.5 <= held.seconds <= 3.5 for held in returned)
        told.clear()
        run()
        assert not told
    with watch():
        step = 0.03  # so that a callback takes 0.9 s
        run()
    assert not told
    clock.advance(10.0)
    assert clock.next_timer() is None


def test_what_is_held_up_is_known_at_each_moment() -> None:
    clock = ManualClock()
    path = '/A'
    calling: RunningCallback | None = (path, 'execute')
    with BlockedCallbackWatchdog(clock, lambda: calling, lambda _: None, lambda _: None) as watch:
        assert watch.held is None
        clock.advance(LIMIT)
        clock.advance(2.0)
        assert str(watch.held) == 'state /A has not returned from execute() for 3.0 s'
        calling = (path, 'execute')
        assert watch.held is None, 'it is another call'


def test_an_executive_is_late_for_others_while_a_state_does_not_return() -> None:
    """So that whoever drives for it keeps the robot at rest; and not any more when the run was given up."""
    go = threading.Event()
    made = behavior_of(lambda: machine_of(lambda called: None if called != 'execute' else _wait(go)), 'Slow')
    bench = ExecutiveBench(made)
    watch = LivelinessWatch(bench.console, 'onboard_executive', timeout=10 * DEADLINE)
    try:
        wait_until(lambda: watch.alive, 'the executive')
        bench.start('Slow')
        wait_until(lambda: watch.late, 'late')
        assert 'in execute() of /Out/In' in wait_until(
            lambda: watch.problem if 'execute' in watch.problem else '', lambda: watch.problem
        )
        run = bench.executive.runs.run
        assert run is not None
        run.stop('test')

        def given_up() -> bool:
            run.abort('enough')
            return run.has_ended

        wait_until(given_up, 'the end')
        wait_until(lambda: not watch.late, 'not late')
        assert bench.wait_idle() == 'error'
        run.abort('as long as its goals go on')
        bench.start('Slow')
        wait_until(lambda: watch.late, 'late again')
        go.set()
        wait_until(lambda: not watch.late, 'not late again')
        assert bench.wait_idle() == 'done'
        assert sum('its thread is left behind' in line.text for line in bench.logs) == 1
    finally:
        go.set()
        bench.close()


@pytest.mark.parametrize('callback', ['on_enter', 'execute', 'on_exit'])
def test_the_operator_is_told_what_holds_up_the_behavior(callback: str) -> None:
    go = threading.Event()
    bench = ExecutiveBench(
        behavior_of(lambda: machine_of(lambda called: None if called != callback else _wait(go)), 'Slow')
    )
    try:
        bench.start('Slow')
        line = bench.logged(f'state /Out/In has not returned from {callback}() for ')
        assert (line.severity, line.path, line.run_id) == (ExecutiveLog.WARN, '', bench.run_id)  # no word of the state
        stop = bench.send(ExecutiveCommand.STOP)
        go.set()
        line = bench.logged(f'state /Out/In has returned from {callback}() after ')
        assert (line.severity, line.path) == (ExecutiveLog.WARN, '')
        bench.result(stop)
        bench.wait_idle()
    finally:
        go.set()
        bench.close()


def _wait(go: threading.Event) -> None:
    assert go.wait(DEADLINE)
