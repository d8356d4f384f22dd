# SPDX-License-Identifier: BSD-3-Clause
"""Whatever a mission does, and whatever the link loses, the operator sees what is, once a status has arrived again.

The machine is explored at random; its statuses are those of the executive, and the mirror is that of the console.
"""

from __future__ import annotations

from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest
from builtin_interfaces.msg import Time

from flexbt_console.link.messages import record_of
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import ExecutiveState
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_formal.exploration.machine_system import MachineBounds, MachineSystem, Operator
from flexbt_formal.exploration.model import EnvironmentChoices
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_onboard.behaviors.run_context import RunGoals
from flexbt_onboard.node.executive_status import status_of
from flexbt_onboard.runs.run_events import RunMoved
from flexbt_onboard.runs.run_snapshot import RunStatus
from flexbt_onboard.runs.run_supervisor import LastRun
from flexbt_testing.seeded_missions import _model, seeded_machine

RUN = '0123456789abcdef'
NOBODY = cast(Any, SimpleNamespace(holder='', requests=[]))


class Robot:
    """A machine whose steps are taken at random, and what its executive says of it."""

    def __init__(self, chance: Random) -> None:
        self.chance = chance
        machine = seeded_machine(chance.randrange(1000)).machine
        assert machine is not None
        self.system = MachineSystem(define(machine), _model, MachineBounds(Operator.ALL, forces=2, faults=1))
        self.run = self.system.run
        clock: Any = SimpleNamespace(now=self.system.clock.now, stamp=lambda: Time(sec=1000))
        self._status = RunStatus(RUN, 'Test', 1, clock, RunGoals())
        self._status.publish(is_announced=True, has_begun=True)
        self._sent = 0

    def step(self) -> bool:
        """Whatever can happen next; whether anything could."""
        labels = self.system.labels()
        if labels:
            self.system.step(self.chance.choice(labels), EnvironmentChoices())
        return bool(labels)

    def status(self) -> Any:
        """As the executive sends it, as the console receives it."""
        self._status.read(RunMoved(self.run))
        self._status.publish(is_stopping=self.run.is_ending)
        ended = self.run.outcome
        shown = self._status.snapshot if ended is None else LastRun(1, RUN, 'Test', ended)
        status = status_of(shown, [], [], [], ExecutiveStatus().robot_pose, '', NOBODY, [], '')
        self._sent += 1
        status.executive_id, status.sequence = 'robot', self._sent
        return record_of(status)


def seen(mirror: Mirror) -> tuple[object, ...]:
    """Return what the operator sees."""
    snapshot = mirror.view().snapshot
    assert snapshot is not None
    if snapshot.state is ExecutiveState.IDLE:
        return snapshot.outcome, [], [], False
    active = [(one.path, one.paused) for one in snapshot.active_states]
    asked = sorted((one.path, one.outcome, one.id.rpartition('-')[2]) for one in snapshot.decisions)
    return None, active, asked, snapshot.state is ExecutiveState.PAUSED


def true(robot: Robot) -> tuple[object, ...]:
    """Return what is so."""
    run = robot.run
    if run.outcome is not None:
        return run.outcome, [], [], False
    rests = [run.is_paused and not leaf.is_entered and leaf.halting() is None for leaf in run.active_states()]
    active = [(leaf.path, leaf.is_paused or rest) for leaf, rest in zip(run.active_states(), rests, strict=True)]
    active += [(path, True) for path in run.coming() if run.is_paused]  # they are entered when the run is resumed
    asked = sorted((one.path, one.outcome, one.id) for one in run.decisions)
    return None, active, asked, run.is_paused and not run.is_ending


@pytest.mark.parametrize('seed', range(40))
def test_the_mirror_agrees_whenever_a_status_has_arrived(seed: int) -> None:
    chance = Random(seed)
    robot, mirror = Robot(chance), Mirror(ManualClock())
    late: list[Any] = []
    for _ in range(60):
        if not robot.step():
            break
        status = robot.status()
        if chance.random() < 0.4:
            late.append(status)  # lost, or it comes later than what was sent after it
            continue
        for old in chance.sample(late, min(len(late), 3)):
            if chance.random() < 0.5:
                mirror.receive_snapshot(old)
        mirror.receive_snapshot(status)
        for old in late:
            assert not mirror.receive_snapshot(old)
        assert seen(mirror) == true(robot)
    mirror.receive_snapshot(robot.status())
    assert seen(mirror) == true(robot)
