# SPDX-License-Identifier: BSD-3-Clause
"""A bench for testing states: they run in a real machine on a real thread, with scripted action servers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.events import CommandDecided, Faulted, Logged, RunEvent, RunReader
from flexbt_core.state_machine.engine.operator_commands import confirm, force
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import BehaviorStructure, ExecutiveLog
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.behaviors.run_context import StateServices
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.runs.behavior_run import BehaviorRun
from flexbt_onboard.runs.run_events import (
    BehaviorEnded,
    RunAnnounced,
    RunBuilt,
    RunMoved,
    RunReady,
    RunRefused,
    RunShown,
    StopAwaited,
    StopRequested,
)
from flexbt_onboard.runs.run_snapshot import ActiveLeaf, RunDecision, RunSnapshot
from flexbt_testing.waiting import DEADLINE, wait_until

from .scripted_action_server import GoalScript, ScriptedActionServer


class Run(RunReader):
    """A run of a behavior, and a record of it."""

    def __init__(
        self, entry: BehaviorEntry, services: StateServices, autonomy: int, arguments: Sequence[tuple[str, str]] = ()
    ) -> None:
        self.lines: list[tuple[int, str, str]] = []
        self.structure: BehaviorStructure | None = None
        self.refusal: str | None = None
        self.outcome: str | None = None
        self.message = ''
        self.outputs: Mapping[str, Any] = {}
        self.told: list[RunSnapshot] = []
        """Snapshot of the run at each reported change."""
        self.answers: list[str | None] = []
        """Answers to commands: None, or the reason for a refusal."""
        request = RunRequest(entry, arguments, (), autonomy)
        self.behavior_run = BehaviorRun(request, 'run', services, RunReader(), [self])
        self.behavior_run.start()

    def read(self, event: RunEvent) -> None:
        match event:
            case Logged(severity, path, text):
                self._say(severity.value, path, text)
            case Faulted(path, text):
                self._say(ExecutiveLog.ERROR, path, text)
            case CommandDecided():
                self.answers.append(event.refusal)
            case RunBuilt():
                self.structure = event.structure
                self.behavior_run.announce()
            case RunRefused():
                self.refusal = event.message
            case BehaviorEnded():
                self.message, self.outputs, self.outcome = event.message, event.outputs, event.outcome
            case RunMoved() | RunShown() | RunReady() | RunAnnounced() | StopRequested() | StopAwaited():
                self.told.append(self.behavior_run.snapshot)

    def _say(self, severity: int, path: str, text: str) -> None:
        self.lines.append((severity, path, text))
        if severity >= ExecutiveLog.WARN:  # for the report of a failed test
            print(f'{path or "the run"}: {text}', file=sys.stderr)

    def active(self) -> Sequence[ActiveLeaf]:
        """Return the active states. Each call asks them for their activity again."""
        self.behavior_run.ask_activities()
        return self.behavior_run.snapshot.active

    def decisions(self) -> Sequence[RunDecision]:
        """Return the decisions that wait for the operator."""
        return self.behavior_run.snapshot.decisions

    def confirm(self, decision_id: str) -> str | None:
        """Confirm a decision; return the reason if it is refused."""
        try:
            return self.answer_to(confirm, self.behavior_run.decision_number(decision_id))
        except CommandRefusedError as error:
            return str(error)

    def force(self, path: str, outcome: str, decision_id: str = '') -> str | None:
        """Leave a state by an outcome; return the reason if it is refused."""
        number = self.behavior_run.decision_number(decision_id) if decision_id else ''
        return self.answer_to(force, path, outcome, number)

    def answer_to(self, command: Callable[..., str | None], *arguments: Any) -> str | None:
        """Send the machine a command; return the reason if it is refused."""
        before = len(self.answers)
        self.behavior_run.command(None, command, *arguments)
        wait_until(lambda: len(self.answers) > before, 'answer')
        return self.answers[before]

    def wait(self) -> str:
        """Wait until the run has ended, and return the outcome."""
        wait_until(
            lambda: self.outcome is not None or self.refusal is not None,
            lambda: f'end of the run, in {", ".join(one.path for one in self.active())}; said: {self.lines}',
        )
        assert self.refusal is None, self.refusal
        assert self.outcome is not None
        return self.outcome

    def stop(self) -> str:
        """Stop the run and wait for it."""
        self.behavior_run.stop('test')
        return self.wait()

    def errors(self) -> str:
        """Return the warnings and errors that were reported to the operator."""
        return '\n'.join(text for severity, _, text in self.lines if severity >= ExecutiveLog.WARN)


class StateBench:
    """A context manager that makes servers and runs states, and ends all of them on exit."""

    def __init__(self) -> None:
        self.runtime = NodeRuntime('bench_executive', args=())
        self.services = StateServices.of(self.runtime)
        self.closing: list[Callable[[], object]] = []
        """Functions that close further objects at the end."""
        self._servers: list[NodeRuntime] = []
        self._runs: list[Run] = []

    def __enter__(self) -> StateBench:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def serve(
        self, action_type: Any, name: str, script: GoalScript | None = None, **options: Any
    ) -> ScriptedActionServer:
        """Start an action server that appears to ROS as in a separate process."""
        runtime = NodeRuntime('scripted_server', args=())
        self._servers.append(runtime)
        server = ScriptedActionServer(runtime, action_type, name, script, **options)
        link = self.services.actions.link(action_type, name)
        wait_until(lambda: self.runtime.call(link.is_ready), f'{name} discovered')
        return server

    def run_state(
        self,
        make: Callable[[], EventState],
        userdata: Mapping[str, Any] | None = None,
        *,
        outputs: Sequence[str] = (),
        read: dict[str, Any] | None = None,
        autonomy: int = 3,
        required: int = -1,
    ) -> Run:
        """Run one state. Each of its outcomes is an outcome of the run, and requires the level ``required`` of
        autonomy.

        ``userdata`` is its input. At the end, those of the keys ``outputs`` that have a value are copied to ``read``.
        """

        def machine() -> OperatableStateMachine:
            state = make()
            root = OperatableStateMachine(outcomes=list(state.outcomes))
            levels = dict.fromkeys(state.outcomes, required)
            for key, value in (userdata or {}).items():
                root.userdata[key] = value
            with root:
                if not outputs:
                    OperatableStateMachine.add('State', state, {name: name for name in state.outcomes}, levels)
                    return root
                taken = {name: f'Read_{name}' for name in state.outcomes}
                OperatableStateMachine.add('State', state, taken, levels)
                for name, label in taken.items():
                    OperatableStateMachine.add(label, _Reader(outputs, {} if read is None else read), {'read': name})
            return root

        return self.run(machine, autonomy)

    def run(self, machine: Callable[[], OperatableStateMachine], autonomy: int = 3) -> Run:
        """Run a machine."""

        class Bench(Behavior):
            manifest = BehaviorManifest('Bench')

            def create(self) -> OperatableStateMachine:
                return machine()

        return self.run_behavior(BehaviorEntry('Bench', 'test', Bench.manifest, (), Bench), autonomy=autonomy)

    def run_behavior(self, entry: BehaviorEntry, *arguments: tuple[str, str], autonomy: int = 3) -> Run:
        """Run a behavior, with parameters as an operator writes them."""
        run = Run(entry, self.services, autonomy, arguments)
        self._runs.append(run)
        return run

    def close(self) -> None:
        """End runs and servers."""
        for run in self._runs:
            run.behavior_run.stop('end of the test')
            run.behavior_run.join(DEADLINE)
        for server in self._servers:
            server.close()
        for close in self.closing:
            close()
        self.runtime.close()


class _Reader(EventState):
    """A state that copies userdata keys for the test."""

    def __init__(self, keys: Sequence[str], read: dict[str, Any]) -> None:
        super().__init__(outcomes=['read'], input_keys=list(keys), desired_rate=None)
        self._keys = keys
        self._read = read

    def execute(self, userdata: Any) -> str:
        self._read.update({key: userdata[key] for key in self._keys if key in userdata})
        return 'read'
