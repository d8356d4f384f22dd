# SPDX-License-Identifier: BSD-3-Clause
"""The onboard behavior executive and its diagnostics. It runs one behavior at a time, under an operator's supervision.

Only this module assembles the executive. Each part gets the objects that it needs, and no part gets the whole. Code
runs on the executor thread unless its docstring states another one. Each run has its own thread
(:mod:`flexbt_onboard.runs`), so that the executive answers the operator even if a behavior blocks.
"""

from __future__ import annotations

import functools
import uuid
from pathlib import Path
from typing import Final

from diagnostic_msgs.msg import DiagnosticStatus

from flexbt_common.calls.action_call import ActionLinks
from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.calls.service_call import ServiceLinks
from flexbt_common.files import node_file
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.lifecycle.managed_node import SHUTTING_DOWN, DiagnosticsPublisher, diagnostic_status
from flexbt_common.lifecycle.presence import PresenceWatch
from flexbt_common.runtime.clock_watch import GOES_ON, ClockHealth, clock_health
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.state_machine.engine.events import RunEvent, RunReader
from flexbt_msgs.msg import BehaviorStructure, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.machine_store import MachineStore
from flexbt_onboard.behaviors.run_context import StateServices
from flexbt_onboard.commands.authority import Authority, OperatorNames
from flexbt_onboard.commands.command_ledger import CommandLedger
from flexbt_onboard.commands.command_registry import CommandRegistry
from flexbt_onboard.commands.input_requests import InputRequests
from flexbt_onboard.errors import OnboardError
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.link.event_stream import EventStream
from flexbt_onboard.link.peers import PeersWatch
from flexbt_onboard.link.reporter import Reporter, StorageProblems
from flexbt_onboard.link.robot_state import RobotPlan, RobotPose
from flexbt_onboard.link.tree_debugging import TreeDebuggingLink
from flexbt_onboard.mission_queue.conditions import StartConditions
from flexbt_onboard.mission_queue.queue_runner import QueueRunner
from flexbt_onboard.node.executive_status import ShownStatus, StatusSources
from flexbt_onboard.persistence.event_log import EventLog
from flexbt_onboard.persistence.journal import await_closed
from flexbt_onboard.persistence.run_journal import RunJournal
from flexbt_onboard.runs.behavior_run import BehaviorRun
from flexbt_onboard.runs.motion_stop import MotionStop
from flexbt_onboard.runs.run_events import (
    RunAnnounced,
    RunBuilt,
    RunMoved,
    RunOver,
    RunReady,
    RunRequested,
    RunShown,
    StopAwaited,
    StopRequested,
    ViolationFound,
)
from flexbt_onboard.runs.run_supervisor import OperatorAbsenceWatch, RunSupervisor
from flexbt_onboard.runs.stop_enforcer import StopEnforcer

from .action_servers import BehaviorActionServer, UserdataServer
from .executive_parameters import ExecutiveParameters
from .synthesis_server import SynthesisServer, serve_flexbe
from .synthesizer import SearchSettings, Synthesizer

JOURNAL_SECONDS: Final = 0.3
"""Maximum time that the last status waits for the journal, s."""

SHUTDOWN_SECONDS: Final = 1.2
"""Maximum time that the end of the process waits for a running behavior to halt, s."""


_SHOWN: Final = (RunRequested, RunMoved, RunReady, RunShown, RunOver, ViolationFound, StopRequested, StopAwaited)
"""Events of runs that change the status."""


class Executive(RunReader):
    """The executive on one node. Made by :func:`open_executive`.

    ``library`` has the behaviors, ``runs`` supervises their runs, and ``presence`` watches the connected consoles.
    """

    def __init__(
        self, runtime: Runtime, parameters: ExecutiveParameters, library: BehaviorLibrary, refusal: str = ''
    ) -> None:
        """Call on the executor thread. ``refusal`` is the reason why no behavior can start before activation."""
        self.library = library
        self._runtime = runtime
        self._id = uuid.uuid4().hex
        self._admission = GoalAdmission('the executive', refusal)
        link = self._link = ConsoleLink(runtime, self._id, parameters.heartbeat_period)
        self._plan = RobotPlan(runtime, parameters.plan_topic)
        self._planned_run = ''
        self._status = status = ShownStatus(runtime, link, self._plan, parameters.heartbeat_period)
        self._token = LivelinessToken(runtime)
        self._problems = StorageProblems(link.log, self._storage_changed)
        # Before all parts that may ask for a status, since opening the journal may raise.
        self._journal = RunJournal(
            self._file(parameters.journal_directory, '.journal'),
            self._problems.of('journal', ExecutiveLog.ERROR),
            runtime.steady,
        )
        self._report = report = self._open_report(parameters)
        report.event('executive', state='started', executive=self._id)
        runtime.on_close(self._journal.close)
        self._clock = self._watch_clock()
        self.presence = presence = PresenceWatch(runtime, functools.partial(link.log, ExecutiveLog.WARN))
        pose = RobotPose(runtime, parameters.pose_topic, parameters.frames)
        peers = PeersWatch(
            runtime, parameters.peers, report, parameters.peer_timeout, are_expected=parameters.expects_peers
        )

        self.runs = runs = self._open_runs(parameters, peers, pose)
        peers.add_listener(runs.nodes_changed)
        peers.add_listener(status.changed)
        authority = Authority(runtime, presence, parameters.authority_timeout, report, status)
        self._input_requests = InputRequests(runtime, self._admission, report, status)
        operator_names = OperatorNames(link, presence, report)
        trees = TreeDebuggingLink(runtime, ServiceLinks(runtime, parameters.peer_timeout), peers, status.changed)
        queue = self._queue = self._open_queue(parameters, pose, peers)
        registry = CommandRegistry(
            self._id, library, runs, operator_names, authority, self._input_requests, trees, queue, report
        )
        ledger = CommandLedger(runtime, registry, self._journal, report, status)
        registry.decided = ledger.read
        link.listen(ledger.receive)
        actions = BehaviorActionServer(runtime, library, runs, self._admission)
        runs.readers += (self, ledger, actions, UserdataServer(runtime, runs), queue)
        store = MachineStore(self._file(parameters.machine_directory, ''))
        settings = SearchSettings(parameters.capability_directories, parameters.synthesis_memory)
        synthesizer = Synthesizer(
            runtime, library, store, report, lambda: runs.behaviors_in_use() | queue.behaviors, link, settings
        )
        SynthesisServer(runtime, synthesizer, self._admission, presence)
        serve_flexbe(runtime, synthesizer, self._admission)

        status.begin(
            StatusSources(
                self._journal,
                self._admission,
                self._problems,
                self._clock,
                peers,
                pose,
                runs,
                authority,
                self._input_requests,
                ledger,
                trees,
                queue,
            )
        )
        ExecutiveDiagnostics(runtime, status, self._problems)
        runtime.on_fault(self._report_fault)
        misfits = runtime.node.qos_misfits
        misfits.on_found(functools.partial(report.log, ExecutiveLog.WARN))
        runtime.on_close(lambda: misfits.on_found(None))
        link.publish_places(parameters.places)
        self._announce()

    def _file(self, directory: str, suffix: str) -> Path | None:
        return node_file(directory, self._runtime.node.get_fully_qualified_name(), suffix)

    def _open_report(self, parameters: ExecutiveParameters) -> Reporter:
        runtime = self._runtime
        event_log = EventLog(
            self._file(parameters.event_log_directory, '.jsonl'),
            runtime.clock,
            runtime.steady,
            self._problems.of('event log', ExecutiveLog.WARN),
            parameters.event_log_size,
            parameters.event_log_files,
        )
        runtime.on_close(event_log.close)
        return Reporter(self._link.log, event_log, EventStream(runtime, self._id))

    def _watch_clock(self) -> ClockHealth:
        clock = clock_health(self._runtime)
        clock.report = self._report_clock
        clock.add_listener(self._status.changed)
        self._runtime.on_close(self._leave_clock)
        return clock

    def _open_runs(self, parameters: ExecutiveParameters, peers: PeersWatch, pose: RobotPose) -> RunSupervisor:
        runtime, report = self._runtime, self._report
        services = StateServices(
            runtime=runtime,
            actions=ActionLinks(runtime, parameters.peer_timeout),
            services=ServiceLinks(runtime, parameters.peer_timeout),
            node_name=runtime.node.get_fully_qualified_name(),
            unready=peers.unready,
            starting=peers.starting,
        )
        motion_stop = MotionStop(runtime, services.services, pose, parameters, peers)
        return RunSupervisor(
            runtime,
            services,
            self._admission,
            self._journal,
            report,
            OperatorAbsenceWatch(runtime, self.presence, report),
            StopEnforcer(runtime, motion_stop, parameters.stop_timeout, report),
            parameters.autonomy,
            parameters.monitoring,
        )

    def _open_queue(self, parameters: ExecutiveParameters, pose: RobotPose, peers: PeersWatch) -> QueueRunner:
        conditions = StartConditions(
            self._runtime, parameters.places, parameters.battery_topic, pose.latest, lambda: pose.problem(peers.gone())
        )
        return QueueRunner(
            self._runtime,
            self.library,
            self.runs,
            self._admission,
            self._journal,
            self._report,
            conditions,
            lambda: self._problems.texts.get('journal', ''),
            self._status.changed,
        )

    def read(self, event: RunEvent) -> None:
        """Update the status after an event of a run."""
        match event:
            case RunBuilt(structure=structure) | RunMoved(switched=RunBuilt(structure=structure)):
                self._runtime.post(functools.partial(self._publish_structure, structure))
                self._status.changed()
            case RunAnnounced():
                self._runtime.post(self._status.flush)
                self._status.changed()
            case _ if isinstance(event, _SHOWN):
                self._status.changed()

    def activate(self) -> None:
        """Allow starting behaviors from now on. Do not call on the executor thread."""
        self._runtime.call(self._activate)

    def deactivate(self, why: str, refusal: str, within: float) -> None:
        """Refuse to start behaviors, stop the run and wait for its end. Do not call on the executor thread.

        ``why`` is the reason for the stop of the run. It and ``refusal`` are predicates, such as "is shutting down".
        ``within`` is in seconds of wall time.

        Raises:
            OnboardError: the behavior did not halt in this time.
        """
        told = f'the executive {why}'
        run = self._runtime.call(lambda: self._stop(told, refusal))
        is_at_rest = run is None or run.join(within)
        self._journal.sync(JOURNAL_SECONDS)  # so that the last status shows the end of the run
        self._runtime.call(lambda: self._withdraw(told))
        if run is not None and not is_at_rest:
            behavior = run.snapshot.behavior
            raise OnboardError(f'behavior {behavior!r} had not halted {within:g} s after the stop; leaving it')

    def close(self) -> None:
        """Stop the run, and wait a limited time for its end. On the closing thread, while callbacks still run."""
        # Ends a state that loops over rclpy.ok(). Not at once, since states that exit normally may need the context.
        self._runtime.post_in(SHUTDOWN_SECONDS / 2, self._runtime.default_context.shut_down)
        try:
            self.deactivate(SHUTTING_DOWN, SHUTTING_DOWN, SHUTDOWN_SECONDS)
        except OnboardError as error:
            self._report.log(ExecutiveLog.ERROR, str(error), run_id=self.runs.shown.run_id)
            self._runtime.fail('it did not end in order')
        self._journal.set_next_autonomy(None)  # the parameter applies to the next start
        self._report.event('executive', state='ended', executive=self._id)

    def _announce(self) -> None:
        """Publish the behaviors, and log problems of the journal, broken behaviors and an interrupted run."""
        if self._journal.corruption:
            self._report.log(ExecutiveLog.ERROR, self._journal.corruption)
        if self._journal.torn:
            self._report.log(ExecutiveLog.WARN, self._journal.torn)
        self._link.publish(self.library.to_message())
        for entry in self.library.entries.values():
            if entry.error:
                text = f'behavior {entry.name!r} of {entry.package} is broken: {entry.error}'
                self._report.log(ExecutiveLog.WARN, text)
        interrupted = self.runs.interrupted
        if interrupted is not None:
            self._report.log(
                ExecutiveLog.WARN,
                f'behavior {interrupted.behavior!r} was interrupted by the end of the executive in '
                f'{", ".join(interrupted.active) or "its beginning"}; an operator has to resume or abort it',
                run_id=interrupted.run_id,
            )
        self._status.changed()

    def _activate(self) -> None:
        if self._admission.refusal:
            self._admission.open()
            self._report.log(ExecutiveLog.INFO, 'the executive is active')
            self._status.changed()
            self._queue.consider()

    def _stop(self, why: str, refusal: str) -> BehaviorRun | None:
        self._admission.close(refusal)
        self._report.log(ExecutiveLog.INFO, self._admission.refusal)
        self._status.changed()
        return self.runs.stop(why)

    def _withdraw(self, why: str) -> None:
        self._input_requests.close(why)
        self._status.flush()

    def _storage_changed(self) -> None:
        """Update readiness and status after a problem of a file has begun or ended. From any thread."""
        self._token.set_ready(not self._problems.texts.get('journal'), 'journal')
        self._status.changed()

    def _publish_structure(self, structure: BehaviorStructure) -> None:
        if structure.run_id != self._planned_run:  # not when a run switches to another behavior
            self._planned_run = structure.run_id
            self._plan.clear()
        self._status.show(lambda: self._link.publish(structure))
        run = self.runs.run
        if run is not None and run.run_id == structure.run_id and not run.snapshot.is_announced:
            run.announce()

    def _report_fault(self, error: BaseException) -> None:
        text = f'fault in the executive, which continues: {type(error).__name__}: {error}'
        self._report.log(ExecutiveLog.ERROR, text)

    def _report_clock(self, problem: str) -> None:
        self._report.log(ExecutiveLog.WARN if problem else ExecutiveLog.INFO, problem or GOES_ON)

    def _leave_clock(self) -> None:
        self._clock.report = self._clock.log
        self._clock.remove_listener(self._status.changed)


def open_executive(
    runtime: Runtime, parameters: ExecutiveParameters, library: BehaviorLibrary | None = None, refusal: str = ''
) -> Executive:
    """Make an executive on a runtime, which closes it at the end. ``library`` defaults to the installed behaviors."""
    runtime.default_context.open()
    found = BehaviorLibrary.discover() if library is None else library
    # Waiting here delays nothing else. Opening the journal would wait too, but on the executor thread.
    await_closed(node_file(parameters.journal_directory, runtime.node.get_fully_qualified_name(), '.journal'))
    executive = runtime.call(lambda: Executive(runtime, parameters, found, refusal))
    runtime.on_close(executive.close)
    return executive


# The diagnostics of the executive on ``/diagnostics``.

_STATES: Final = {
    getattr(ExecutiveStatus, name): name.lower()
    for name in ('IDLE', 'STARTING', 'RUNNING', 'PAUSED', 'STOPPING', 'INTERRUPTED')
}


class ExecutiveDiagnostics:
    """The diagnostics of the behavior, of the nodes that the executive depends on, and of the files that it writes."""

    def __init__(self, runtime: Runtime, status: ShownStatus, problems: StorageProblems) -> None:
        self._runtime = runtime
        self._status = status
        self._problems = problems
        DiagnosticsPublisher(runtime, self._entries)

    def _entries(self) -> list[DiagnosticStatus]:
        status = self._status.message
        return [self._behavior(status), self._peers(status), self._storage()]

    def _behavior(self, status: ExecutiveStatus) -> DiagnosticStatus:
        state = _STATES.get(status.state, 'unknown')
        what = f'{status.behavior} ended: {status.outcome}' if status.outcome else status.behavior
        level, message = DiagnosticStatus.OK, ' '.join(filter(None, [state, what]))
        if status.state == ExecutiveStatus.IDLE and status.outcome == 'error':
            level, message = DiagnosticStatus.ERROR, f'{message}: {status.message}'
        elif status.state == ExecutiveStatus.INTERRUPTED:
            level = DiagnosticStatus.WARN
        elif status.state == ExecutiveStatus.STOPPING and status.message:
            level, message = DiagnosticStatus.ERROR, f'{message}: {status.message}'
        elif status.decisions:
            level = DiagnosticStatus.WARN
            message += f'; waits for the operator: {", ".join(one.path for one in status.decisions)}'
        if status.tree_holds and level != DiagnosticStatus.ERROR:
            level = DiagnosticStatus.WARN
            message += (
                f'; held: {", ".join(f"tree {one.behavior_tree} {one.path}".rstrip() for one in status.tree_holds)}'
            )
        values = {
            'run': status.run_id,
            'active states': ', '.join(one.path for one in status.active_states),
            'decisions': str(len(status.decisions)),
            'autonomy': str(status.autonomy),
            'authority': status.authority,
        }
        return diagnostic_status(self._runtime, 'behavior', level, message, values)

    def _peers(self, status: ExecutiveStatus) -> DiagnosticStatus:
        gone = [one.name for one in status.peers if one.expected and not one.alive]
        unready = [one.name for one in status.peers if one.alive and not one.ready]
        level, message = DiagnosticStatus.OK, 'all ready'
        if gone:
            level, message = DiagnosticStatus.ERROR, f'not alive: {", ".join(gone)}'
        elif unready:
            level, message = DiagnosticStatus.WARN, f'not ready: {", ".join(unready)}'
        return diagnostic_status(
            self._runtime,
            'nodes',
            level,
            message,
            {one.name: 'not alive' if not one.alive else 'ready' if one.ready else 'not ready' for one in status.peers},
        )

    def _storage(self) -> DiagnosticStatus:
        wrong = {name: text for name, text in self._problems.texts.items() if text}
        level = DiagnosticStatus.WARN if wrong else DiagnosticStatus.OK
        return diagnostic_status(
            self._runtime, 'event log and journal', level, '; '.join(wrong.values()) or 'written', wrong
        )
