# SPDX-License-Identifier: BSD-3-Clause
"""Machines whose transitions are measured: by hfsm_transitions.py, and beside FlexBE."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Final

from flexbt_core.clock.clock import SteadyClock
from flexbt_core.monitors.machine_monitor import MachineMonitor
from flexbt_core.monitors.properties import Violation
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.events import (
    CommandDecided,
    DecisionAsked,
    DecisionClosed,
    Faulted,
    RunEvent,
    RunReader,
    StateEntered,
    StateLeft,
)
from flexbt_core.state_machine.engine.operator_commands import confirm
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy, Decision
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData

DEPTH: Final = 4
CHAIN: Final = 500
"""Transitions of a state between two waits."""

PER_SAMPLE: Final = 2000
"""Transitions of a state in one sample."""


class Reader(RunReader):
    """A reader of what an executive shows, that expects no fault."""

    reads = (StateEntered, StateLeft, DecisionAsked, DecisionClosed, CommandDecided, Faulted)

    def read(self, event: RunEvent) -> None:
        assert not isinstance(event, Faulted), event


class Pass(EventState):
    """Ends at once, but waits for a wake-up each time that ``patience`` visits, of all such states, are over."""

    def __init__(self, visits: list[int], patience: int) -> None:
        super().__init__(outcomes=['done', 'failed'], input_keys=['a'], output_keys=['b'], desired_rate=None)
        self._visits = visits
        self._patience = patience
        self._waits = False

    def on_enter(self, userdata: UserData) -> None:
        self._visits[0] += 1
        self._waits = self._visits[0] % self._patience == 0

    def execute(self, userdata: UserData) -> str | None:
        if self._waits:
            self._waits = False
            return None
        return 'done'

    def on_exit(self, userdata: UserData) -> None:
        pass


def ring(depth: int, visits: list[int], patience: int) -> OperatableStateMachine:
    """Two states that take turns, with the machines around them."""
    machine = OperatableStateMachine(outcomes=['ended'], io_keys=['a', 'b'])
    with machine:
        if depth > 1:
            OperatableStateMachine.add('Inner', ring(depth - 1, visits, patience), {'ended': 'ended'})
        else:
            for label, target in (('One', 'Two'), ('Two', 'One')):
                OperatableStateMachine.add(
                    label,
                    Pass(visits, patience),
                    {'done': target, 'failed': 'ended'},
                    autonomy={'done': Autonomy.Low, 'failed': Autonomy.Off},
                )
    return machine


def nested(depth: int, visits: list[int], patience: int) -> OperatableStateMachine:
    """Return a state in machines, of which the outermost but one is entered again whenever it has ended."""
    machine = OperatableStateMachine(outcomes=['ended'], io_keys=['a', 'b'])
    with machine:
        for label in ('One', 'Two')[: 2 if depth == DEPTH else 1]:
            inner = nested(depth - 1, visits, patience) if depth > 1 else Pass(visits, patience)
            ways = {'ended': 'ended'} if depth > 1 else {'done': 'ended', 'failed': 'ended'}
            if depth == DEPTH:
                ways = {'ended': 'Two' if label == 'One' else 'One'}
            OperatableStateMachine.add(label, inner, ways, autonomy=dict.fromkeys(ways, Autonomy.Low))
    return machine


SHAPES: Final[dict[str, Callable[[list[int], int], OperatableStateMachine]]] = {
    'flat': lambda visits, patience: ring(1, visits, patience),
    '4 levels deep': lambda visits, patience: ring(DEPTH, visits, patience),
    'through 4 levels': lambda visits, patience: nested(DEPTH, visits, patience),
}
WAYS: Final = ('chained', 'woken', 'confirmed')


class Subject:
    """A machine that runs for ever, in steps of so many transitions of a state."""

    def __init__(self, shape: str, way: str, is_monitored: bool = False) -> None:
        self._visits = [0]
        self._way = way
        # A chain stays below the number that the engine takes for a livelock, machines that end counted.
        patience = 1 if way == 'woken' else CHAIN // DEPTH
        machine = SHAPES[shape](self._visits, patience if way != 'confirmed' else sys.maxsize)
        level = Autonomy.Low if way == 'confirmed' else Autonomy.Full
        found = list[Violation]()
        self._run = MachineRun(define(machine), SteadyClock(), [Reader()], autonomy=level, userdata={'a': 1, 'b': 2})
        if is_monitored:
            self._run.add_reader(MachineMonitor(self._run, found.append))
        self._run.start()
        self._run.step()

    def sample(self) -> float:
        """Microseconds of a transition of a state."""
        visits, run = self._visits, self._run
        first = visits[0]
        began = time.thread_time()
        if self._way == 'confirmed':
            while visits[0] < first + PER_SAMPLE:
                decision: Decision = run.decisions[0]
                run.command('', confirm, decision.id)
                run.step()
        else:
            while visits[0] < first + PER_SAMPLE:
                run.active_states()[0].state.wake()
                run.step()
        return (time.thread_time() - began) / (visits[0] - first) * 1e6
