# SPDX-License-Identifier: BSD-3-Clause
"""An executive for tests of the console: the contract of the operator link on real topics, with a small behavior.

In the behavior ``Drive``, AskGoal asks for a pose. Accept suggests ``done``, which requires High autonomy; its outcome
``failed`` ends the run. Driving continues until an outcome is forced. After ``rounds`` rounds the run ends with
``finished``.
"""

from __future__ import annotations

import random
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry
from flexbt_msgs.msg import (
    ActiveState,
    BehaviorList,
    BehaviorManifest,
    BehaviorParameter,
    BehaviorStructure,
    CommandResult,
    ExecutiveCommand,
    ExecutiveLog,
    ExecutiveStatus,
    PeerStatus,
    PendingDecision,
    PlaceList,
    StateStructure,
)

POSE = 'geometry_msgs/msg/PoseStamped'
OUTCOMES = {
    'AskGoal': {'done': '/Accept', 'canceled': '=failed'},
    'Accept': {'done': '/Driving', 'canceled': '/AskGoal', 'failed': '=failed'},
    'Driving': {'done': '/AskGoal', 'failed': '=failed'},
}
REQUIRED = {'done': 2}


@dataclass
class Faults:
    """The faults of a link: the shares of lost and duplicated messages, and swallowed commands."""

    seed: int = 0
    lose_commands: float = 0.0
    lose_status: float = 0.0
    double: float = 0.0
    swallow_commands: bool = False
    commands: random.Random = field(init=False)
    statuses: random.Random = field(init=False)

    def __post_init__(self) -> None:
        # One for each direction: what becomes of the commands does not depend on how many statuses were sent meanwhile.
        self.commands, self.statuses = random.Random(self.seed), random.Random(self.seed)

    def copies(self, draw: random.Random, share_lost: float) -> int:
        """Return how many copies of a message arrive."""
        if draw.random() < share_lost:
            return 0
        return 2 if draw.random() < self.double else 1


class ScriptedExecutive:
    """A scripted executive. It runs on the executor thread of its runtime; tests call it through :meth:`do`."""

    def __init__(self, runtime: NodeRuntime, *, heartbeat: float = 0.25, faults: Faults | None = None) -> None:
        self.faults = faults or Faults()
        self.applied: list[Any] = []
        self.received: list[Any] = []
        self.values: list[Any] = []
        self.status = ExecutiveStatus(
            executive_id=uuid.uuid4().hex, state=ExecutiveStatus.IDLE, heartbeat_period=heartbeat
        )
        self._runtime = runtime
        self._numbers = 0
        self._log_sequence = 0
        self._rounds = 1
        runtime.call(self._join)

    def do(self, fn: Callable[[], Any]) -> Any:
        """Run a function on the executor thread and return its result."""
        return self._runtime.call(fn)

    def log(self, text: str, severity: int = ExecutiveLog.INFO, path: str = '') -> None:
        """Send the operator a log line."""
        self._log_sequence += 1
        self._log.publish(
            ExecutiveLog(
                sequence=self._log_sequence,
                executive_id=self.status.executive_id,
                severity=severity,
                text=text,
                path=path,
            )
        )

    def publish(self) -> None:
        """Publish the status with the next number."""
        self.status.sequence += 1
        for _ in range(self.faults.copies(self.faults.statuses, self.faults.lose_status)):
            self._status.publish(self.status)

    def enter(self, label: str) -> None:
        """Make a state the active one, with its request to the operator."""
        self._numbers += 1
        status = self.status
        status.active_states = [ActiveState(path='/' + label, activity=[f'busy with {label}'])]
        decision = PendingDecision(id=f'd{self._numbers}', path='/' + label, required_autonomy=-1)
        if label == 'AskGoal':
            decision.kind, decision.input_type, decision.prompt = PendingDecision.INPUT, POSE, 'Where to?'
            status.decisions = [decision]
        elif label == 'Accept' and REQUIRED['done'] >= status.autonomy:
            decision.kind, decision.outcome = PendingDecision.TRANSITION, 'done'
            decision.outcomes, decision.required_autonomy = list(OUTCOMES['Accept']), REQUIRED['done']
            status.decisions = [decision]
        else:
            status.decisions = []
        self.log(f'entered {label}', path='/' + label)
        if label == 'Accept' and not status.decisions:
            self.leave('done')

    def leave(self, outcome: str) -> None:
        """Follow a transition of the active state."""
        label = self.status.active_states[0].path.strip('/')
        target = OUTCOMES[label][outcome]
        if label == 'Driving' and outcome == 'done':
            self._rounds -= 1
            target = '=finished' if self._rounds == 0 else target
        if target.startswith('='):
            self.end(target[1:])
        else:
            self.enter(target.strip('/'))

    def end(self, outcome: str, message: str = '') -> None:
        """End the run."""
        status = self.status
        status.state, status.outcome, status.message = ExecutiveStatus.IDLE, outcome, message
        status.active_states, status.decisions = [], []

    def _join(self) -> None:
        node = self._runtime.node
        self._status = node.create_publisher(ExecutiveStatus, names.EXECUTIVE_STATUS, names.transient_local_qos())
        self._structure = node.create_publisher(
            BehaviorStructure, names.EXECUTIVE_STRUCTURE, names.transient_local_qos()
        )
        self._behaviors = node.create_publisher(BehaviorList, names.EXECUTIVE_BEHAVIORS, names.transient_local_qos())
        self._places = node.create_publisher(PlaceList, names.PLACES, names.transient_local_qos())
        self._places.publish(PlaceList())
        self._log = node.create_publisher(ExecutiveLog, names.EXECUTIVE_LOG, names.transient_local_qos(names.LOG_DEPTH))
        node.create_subscription(ExecutiveCommand, names.EXECUTIVE_COMMAND, self._on_command, names.command_qos())
        self.status.peers = [
            PeerStatus(name='/bt_server', alive=True, ready=True),
            PeerStatus(name='/navigation', alive=False),
        ]
        self.status.robot_pose.header.frame_id = 'map'
        self.status.robot_pose.pose.position.x = 1.5
        parameters = [
            BehaviorParameter(name='rounds', type='int', default_value='1'),
            BehaviorParameter(name='speed', type='string', default_value='slow', choices=['slow', 'fast']),
        ]
        self._behaviors.publish(
            BehaviorList(
                executive_id=self.status.executive_id,
                behaviors=[
                    BehaviorManifest(name='Broken', package='demo', error='no such tree'),
                    BehaviorManifest(name='Drive', package='demo', description='drive', parameters=parameters),
                ],
            )
        )
        self.publish()
        node.create_timer(self.status.heartbeat_period, self.publish)

    def _on_command(self, command: Any) -> None:
        for _ in range(self.faults.copies(self.faults.commands, self.faults.lose_commands)):
            self._take(command)

    def _take(self, command: Any) -> None:
        self.received.append(command)
        if self.faults.swallow_commands or command.executive_id not in ('', self.status.executive_id):
            return
        known = next((r for r in self.status.results if r.command_id == command.id), None)
        if known is None:
            reason = self._apply(command)
            code = CommandResult.REFUSED if reason else CommandResult.APPLIED
            results = [*self.status.results, CommandResult(command_id=command.id, code=code, reason=reason)]
            self.status.results = results[-32:]
            if not reason:
                self.applied.append(command)
        self.publish()

    def _apply(self, command: Any) -> str:
        status = self.status
        kind = command.kind
        if kind == ExecutiveCommand.AUTONOMY:
            status.autonomy = command.autonomy
            return ''
        if kind == ExecutiveCommand.START:
            return self._start(command)
        if kind == ExecutiveCommand.NOTE:
            self.log(f'{command.operator_id} notes: {command.text}')
            return ''
        if status.state != ExecutiveStatus.RUNNING:
            return 'nothing runs'
        if kind == ExecutiveCommand.STOP:
            self.end('preempted', f'stopped by {command.operator_id}')
            return ''
        if command.run_id != status.run_id:
            return f'run {command.run_id!r} is over'
        if kind == ExecutiveCommand.FORCE:
            if command.path != status.active_states[0].path:
                return f'{command.path} is not active'
            if command.decision_id and command.decision_id not in [d.id for d in status.decisions]:
                return f'decision {command.decision_id} is not pending'
            self.leave(command.outcome)
            return ''
        return self._decide(command)

    def _start(self, command: Any) -> str:
        status = self.status
        if status.state != ExecutiveStatus.IDLE:
            return f'{status.behavior} runs'
        arguments = {argument.name: argument.value for argument in command.arguments}
        self._rounds = int(arguments.get('rounds', '1'))
        status.run_id, status.behavior = uuid.uuid4().hex[:8], command.behavior
        status.state, status.outcome, status.message = ExecutiveStatus.RUNNING, '', ''
        status.autonomy = command.autonomy
        self.values += [from_entry(entry) for entry in command.inputs]
        self._structure.publish(structure(status.run_id))
        self.enter('AskGoal')
        return ''

    def _decide(self, command: Any) -> str:
        decision = next((d for d in self.status.decisions if d.id == command.decision_id), None)
        if decision is None:
            return f'decision {command.decision_id!r} is not pending'
        if command.kind == ExecutiveCommand.CONFIRM:
            self.leave(decision.outcome)
        elif command.kind == ExecutiveCommand.DECLINE:
            self.leave('canceled')
        else:
            self.values.append(from_entry(command.inputs[0]))
            self.leave('done')
        return ''


def structure(run_id: str) -> BehaviorStructure:
    """Return the state machine of the behavior."""
    states = [
        StateStructure(
            path='/',
            kind=StateStructure.MACHINE,
            type='OperatableStateMachine',
            children=list(OUTCOMES),
            outcomes=['finished', 'failed'],
        )
    ]
    states += [
        StateStructure(
            path='/' + label,
            kind=StateStructure.STATE,
            type=label + 'State',
            outcomes=list(transitions),
            targets=list(transitions.values()),
            autonomy=[REQUIRED.get(outcome, 0) for outcome in transitions],
        )
        for label, transitions in OUTCOMES.items()
    ]
    return BehaviorStructure(run_id=run_id, behavior='Drive', states=states)
