# SPDX-License-Identifier: BSD-3-Clause
"""An executive in a process of its own, to be killed: its behavior counts confirmations in its userdata.

Usage: durable_process.py JOURNAL_DIRECTORY [KILL_AT]

With KILL_AT it kills itself at the write of the journal of this number: before the disk has it, or after it if the
number is negative.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.node.executive import open_executive
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_testing.nodes.executive_bench import behavior_of, entry_of
from flexbt_testing.state_machines.bench import Add, Ask
from flexbt_testing.waiting import wait_until


class Tell(EventState):
    """Tells the operator what was counted."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], input_keys=['count'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        self.log_info(f'counted {userdata["count"]}')
        return 'done'


class Spoil(EventState):
    """Puts something into the userdata that cannot be written."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], output_keys=['handle'], desired_rate=None)

    def on_enter(self, userdata: UserData) -> None:
        userdata['handle'] = object()


def counting() -> OperatableStateMachine:
    """Ask and counts, in a machine inside."""
    inner = OperatableStateMachine(outcomes=['out'], io_keys=['count'])
    with inner:
        OperatableStateMachine.add('Ask', Ask(), {'again': 'Add', 'out': 'out'}, autonomy={'again': Autonomy.Full})
        OperatableStateMachine.add('Add', Add(), {'done': 'Ask'})
    machine = OperatableStateMachine(outcomes=['finished'], output_keys=['count'])
    machine.userdata.count = 0
    with machine:
        OperatableStateMachine.add('Inner', inner, {'out': 'Tell'})
        OperatableStateMachine.add('Tell', Tell(), {'done': 'finished'})
    return machine


def spoiling() -> OperatableStateMachine:
    """Wait for ever, with something in the userdata that cannot be written."""
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Spoil', Spoil(), {'done': 'finished'})
    return machine


class Stuck(EventState):
    """Never returns."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        threading.Event().wait()
        return 'done'


def sticking() -> OperatableStateMachine:
    """Cannot be stopped."""
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Stuck', Stuck(), {'done': 'finished'})
    return machine


class Crash(EventState):
    """Ends the process the first time that it is started."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)

    def on_start(self) -> None:
        directory = Path(sys.argv[1])
        told, journal = directory / 'has_crashed', directory / 'onboard_executive.journal'
        if not told.exists():
            # A crash before the disk has the start forgets the run: nobody was told of it yet.
            wait_until(lambda: b'"begin"' in journal.read_bytes(), 'the start is on the disk')
            told.touch()
            os.kill(os.getpid(), signal.SIGKILL)


def crashing() -> OperatableStateMachine:
    """Do not get to its first state before a crash."""
    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Crash', Crash(), {'done': 'finished'})
    return machine


class Mark(EventState):
    """Writes into a file that it ran."""

    def __init__(self, name: str) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._mark = name

    def execute(self, userdata: UserData) -> str:
        with Path(sys.argv[1], 'marks').open('a') as file:
            file.write(f'{self._mark}\n')
        return 'done'


def marking(name: str, outcome: str) -> OperatableStateMachine:
    """Mark that it ran, and end."""
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        OperatableStateMachine.add('Mark', Mark(name), {'done': outcome})
    return machine


def kill_at(number: int) -> None:
    """Kill this process at a write of the journal; see the module."""
    real, count = os.fdatasync, 0

    def sync(descriptor: Any) -> None:
        nonlocal count
        count += 1
        if count == number:
            os.kill(os.getpid(), signal.SIGKILL)
        real(descriptor)
        if count == -number:
            os.kill(os.getpid(), signal.SIGKILL)

    os.fdatasync = sync  # type: ignore[assignment]


def setup(runtime: NodeRuntime) -> Any:
    """Make the executive."""
    machines = {'Test': counting, 'Changed': counting, 'Spoil': spoiling, 'Crash': crashing, 'Stuck': sticking}
    for name, outcome in (('A', 'finished'), ('B', 'failed'), ('C', 'finished')):
        machines[name] = functools.partial(marking, name, outcome)
    if len(sys.argv) > 2:
        kill_at(int(sys.argv[2]))
    library = BehaviorLibrary(entry_of(behavior_of(make, name)) for name, make in machines.items())
    parameters = ExecutiveParameters(peers=(), journal_directory=sys.argv[1], event_log_directory=sys.argv[1])
    return open_executive(runtime, parameters, library)


if __name__ == '__main__':
    sys.exit(run_node('onboard_executive', setup, []))
