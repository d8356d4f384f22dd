# SPDX-License-Identifier: BSD-3-Clause
"""Actions for programs: ``execute_behavior`` runs a behavior, ``get_userdata`` reads the userdata of the run.

With ``execute_behavior``, a behavior can be a leaf of a behavior tree, or a state of a behavior of another executive.
Operators see and supervise these runs like any other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.middleware.implementation import has_participants
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.entries import Encoding, to_entry
from flexbt_common.values.message_fields import time_message
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.engine.events import CommandDecided, RunEvent, RunReader
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.definition import ERROR, PREEMPTED
from flexbt_core.values.text import short_repr
from flexbt_msgs.action import BtExecute, ExecuteBehavior, GetUserdata
from flexbt_msgs.msg import BlackboardEntry, UserdataScope
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.run_building import run_request
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.runs.behavior_run import BehaviorRun
from flexbt_onboard.runs.run_events import BehaviorEnded, RunOver, RunRefused, StatusSent
from flexbt_onboard.runs.run_supervisor import RunSupervisor

ExecuteBehaviorResult = ExecuteBehavior.Result

_GOAL_SERVICE: Final = f'{names.EXECUTE_BEHAVIOR}/_action/send_goal'

DISCOVERY_SECONDS: Final = 5.0
"""Time after a goal in which its client may be discovered, s: the middleware may deliver the goal earlier."""


LOOK_SECONDS: Final = 0.5
"""Minimum time between two looks for the clients of a goal, s: each goes through all endpoints of the domain."""


@dataclass(eq=False)
class _Goal:
    """The goal whose behavior is running. Its client is one of ``clients``, which were found until ``found_by``."""

    served: ServedGoal
    run: BehaviorRun
    found_by: float
    shown: list[str] = field(default_factory=list)
    clients: set[bytes] = field(default_factory=set)
    look_at: float = 0.0
    """Time of the next look for its clients."""


class BehaviorActionServer(RunReader):
    """The server of ExecuteBehavior. Used on the executor thread, except :meth:`read`, which ignores other events.

    It accepts every goal. A goal whose behavior cannot start ends as FAILURE with the reason, for example because the
    executive runs another behavior. The run is stopped when the goal is canceled, and when its client is gone, or all
    that were there with it.
    """

    def __init__(
        self, runtime: Runtime, library: BehaviorLibrary, runs: RunSupervisor, admission: GoalAdmission
    ) -> None:
        """``admission`` decides whether the server takes goals at all."""
        self._library = library
        self._runs = runs
        self._runtime = runtime
        self._node = runtime.node
        self._goal: _Goal | None = None
        self._server = GoalServer(
            runtime,
            ExecuteBehavior,
            names.EXECUTE_BEHAVIOR,
            self._serve,
            self._cancel,
            refused=_refused_behavior,
            admission=admission,
        )

    def read(self, event: RunEvent) -> None:
        match event:
            case RunOver(end):
                self._ended(end)
            case StatusSent():
                self._refresh()

    def _refresh(self) -> None:
        """Send feedback if the active states have changed, and stop the run if the client is gone."""
        goal = self._goal
        if goal is None:
            return
        paths = [leaf.path for leaf in goal.run.snapshot.active]
        if paths != goal.shown:
            goal.shown = paths
            goal.served.publish_feedback(ExecuteBehavior.Feedback(active_states=paths))
        now = self._runtime.steady.now()
        if now < goal.look_at:
            return
        goal.look_at = now + LOOK_SECONDS
        there = self._clients()
        if goal.clients and goal.clients.isdisjoint(there):
            goal.run.stop('the client of the goal is gone')
        elif now < goal.found_by:
            goal.clients |= there

    def _clients(self) -> set[bytes]:
        """Return the identifiers of the clients, or one for all of them with a middleware that is not DDS."""
        if not has_participants():
            return {b''} if self._node.count_clients(_GOAL_SERVICE) else set()
        requests = f'rq{self._node.resolve_service_name(_GOAL_SERVICE)}Request'
        ends = self._node.get_publishers_info_by_topic(requests, no_mangle=True)
        return {bytes(end.endpoint_gid) for end in ends}

    def _serve(self, served: ServedGoal) -> None:
        wanted = served.request
        try:
            request = run_request(
                self._library,
                wanted.behavior,
                [(argument.name, argument.value) for argument in wanted.arguments],
                wanted.inputs,
                wanted.autonomy,
                f'action {names.EXECUTE_BEHAVIOR}',
                is_durable=False,  # after a crash, the client no longer waits for the result
            )
            self._goal = _Goal(served, self._runs.start(request), self._runtime.steady.now() + DISCOVERY_SECONDS)
        except CommandRefusedError as error:
            served.abort(_refused_behavior(str(error)))

    def _finish(self, goal: _Goal, result: Any) -> None:
        self._goal = None
        if result.code == ExecuteBehaviorResult.SUCCESS:
            goal.served.succeed(result)
        else:
            goal.served.canceled(result)  # whatever result the canceled run had

    def _ended(self, end: BehaviorEnded | RunRefused) -> None:
        goal = self._goal
        if goal is None:
            return
        if isinstance(end, BehaviorEnded):
            self._finish(goal, _result(end, goal.served.request.output_encoding))
            return
        is_stopped = goal.run.snapshot.is_stopping
        code = ExecuteBehaviorResult.CANCELED if is_stopped else ExecuteBehaviorResult.FAILURE
        self._finish(goal, ExecuteBehaviorResult(code=code, message=end.message))

    def _cancel(self, served: ServedGoal) -> None:
        goal = self._goal
        if goal is not None and goal.served is served:
            goal.run.stop('the goal was canceled')


def _result(end: BehaviorEnded, encoding: int) -> Any:
    """Return the result of a run that was built."""
    if end.outcome == PREEMPTED:
        return ExecuteBehaviorResult(code=ExecuteBehaviorResult.CANCELED, message=end.message)
    if end.outcome == ERROR:
        return ExecuteBehaviorResult(code=ExecuteBehaviorResult.ERROR, message=end.message)
    form = Encoding.BINARY if encoding == BtExecute.Goal.BINARY else Encoding.TEXT
    try:
        outputs = [to_entry(key, value, None, form) for key, value in end.outputs.items()]
    except FlexbtError as error:
        return ExecuteBehaviorResult(
            code=ExecuteBehaviorResult.ERROR,
            message=f'it ended with {end.outcome!r}, but an output cannot be sent: {error}',
        )
    return ExecuteBehaviorResult(code=ExecuteBehaviorResult.SUCCESS, outcome=end.outcome, outputs=outputs)


def _refused_behavior(why: str) -> Any:
    return ExecuteBehaviorResult(code=ExecuteBehaviorResult.FAILURE, message=why)


# The action ``get_userdata`` returns the values that states of the run pass to each other, for debugging.

GetUserdataResult = GetUserdata.Result


@dataclass(eq=False)
class _UserdataGoal:
    """A goal that waits for the next step of the run. The object serves as the id of its command."""

    served: ServedGoal
    result: Any


class UserdataServer(RunReader):
    """The server of GetUserdata. Used on the executor thread. The thread of the run collects the values."""

    reads = (CommandDecided,)

    def __init__(self, runtime: Runtime, runs: RunSupervisor) -> None:
        self._runtime = runtime
        self._runs = runs
        GoalServer(runtime, GetUserdata, names.GET_USERDATA, self._serve, _cancel, refused=_refused_userdata)

    def read(self, event: RunEvent) -> None:
        if isinstance(event, CommandDecided) and isinstance(event.command_id, _UserdataGoal):
            goal = event.command_id
            if event.refusal is not None:
                goal.result.code, goal.result.message = GetUserdataResult.FAILURE, event.refusal
            self._runtime.post(partial(self._finish, goal))

    def _serve(self, served: ServedGoal) -> None:
        run = self._runs.run
        if run is None:
            served.abort(_refused_userdata('no behavior is running'))
        else:
            goal = _UserdataGoal(served, GetUserdataResult(code=GetUserdataResult.SUCCESS, run_id=run.run_id))
            run.command(goal, _fill, goal.result, served.request)

    def _finish(self, goal: _UserdataGoal) -> None:
        if goal.result.code == GetUserdataResult.SUCCESS:
            goal.served.succeed(goal.result)
        else:
            goal.served.abort(goal.result)


def _refused_userdata(why: str) -> Any:
    return GetUserdataResult(code=GetUserdataResult.FAILURE, message=why)


def _cancel(goal: ServedGoal) -> None:
    goal.canceled(
        GetUserdataResult(
            code=GetUserdataResult.CANCELED, message='canceled before the states of the run came to their next step'
        )
    )


def _fill(run: MachineRun, result: Any, request: Any) -> None:
    """Write the requested userdata into the result, as a command that the machine applies between two steps."""
    userdata, writers = run.userdata_of_machines(), run.writers_of_machines()
    encoding = Encoding.BINARY if request.encoding == GetUserdata.Goal.BINARY else Encoding.TEXT
    chosen = {path: values for path, values in userdata.items() if request.path in ('', path)}
    found = {key for values in chosen.values() for key in values}
    missing = [key for key in request.keys if key not in found]
    if not chosen:
        active = ', '.join(userdata)
        result.code, result.message = (
            GetUserdataResult.FAILURE,
            f'{request.path!r} is not an active machine; these are: {active}',
        )
    elif missing:
        who = f'machine {request.path} has no' if request.path else 'no active machine has a'
        names_of_keys = ', '.join(sorted(found)) or 'none'
        result.code = GetUserdataResult.FAILURE
        result.message = f'{who} value for {", ".join(map(repr, missing))}; there are: {names_of_keys}'
    for path, values in chosen.items():
        keys = [key for key in sorted(values) if not request.keys or key in request.keys]
        if keys:
            entries = [_entry(key, values[key], encoding) for key in keys]
            written = [writers[path].get(key, ('', 0.0)) for key in keys]
            scope = UserdataScope(path=path, entries=entries, writers=[writer for writer, _ in written])
            scope.written = [time_message(max(0.0, when)) for _, when in written]
            result.scopes.append(scope)


def _entry(key: str, value: Any, encoding: Encoding) -> BlackboardEntry:
    try:
        return to_entry(key, value, None, encoding)
    except Exception:  # the value has no ROS type, or its code raises
        return BlackboardEntry(key=key, text=short_repr(value))
