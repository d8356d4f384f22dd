# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors for programs: the action ``execute_behavior`` runs one, with parameters and inputs, and gives its outputs.

By it a behavior is a leaf of a behavior tree, or a state of another executive's behavior. Operators see and supervise
such a run as any other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import Encoding, to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import ERROR, PREEMPTED
from flexbt_msgs.action import BtExecute, ExecuteBehavior
from flexbt_onboard.behaviors import BehaviorLibrary, run_request
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.runs import BehaviorRun, RunEnd, RunSupervisor

Result = ExecuteBehavior.Result

_GOAL_SERVICE: Final = f'{names.EXECUTE_BEHAVIOR}/_action/send_goal'


@dataclass(eq=False)
class _Goal:
    """The goal whose behavior runs."""

    served: ServedGoal
    run: BehaviorRun | None = None
    shown: list[str] = field(default_factory=list)
    had_client: bool = False


class BehaviorActionServer:
    """Serves ExecuteBehavior. Used on the executor thread only.

    A goal is accepted always, and ends as FAILURE with the reason when the behavior cannot be started: the executive
    runs one behavior at a time. The run is stopped when the goal is canceled, and when no client is left that could do
    so.
    """

    def __init__(
        self, runtime: NodeRuntime, library: BehaviorLibrary, runs: RunSupervisor, admission: GoalAdmission
    ) -> None:
        """``admission``: whether goals are taken at all."""
        self._library = library
        self._runs = runs
        self._node = runtime.node
        self._goal: _Goal | None = None
        self._server = GoalServer(
            runtime,
            ExecuteBehavior,
            names.EXECUTE_BEHAVIOR,
            self._serve,
            self._cancel,
            refused=_refused,
            admission=admission,
        )

    def refresh(self) -> None:
        """Send feedback when other states are active, and look for the client; called with each status."""
        goal = self._goal
        if goal is None or goal.run is None:
            return
        paths = [leaf.path for leaf in goal.run.snapshot.active]
        if paths != goal.shown:
            goal.shown = paths
            goal.served.publish_feedback(ExecuteBehavior.Feedback(active_states=paths))
        if self._node.count_clients(_GOAL_SERVICE):
            goal.had_client = True
        elif goal.had_client:
            goal.run.stop('the client of the goal is gone')

    def _serve(self, served: ServedGoal) -> None:
        goal = _Goal(served)
        try:
            self._start(goal)
        except CommandRefusedError as error:
            served.abort(_refused(str(error)))

    def _finish(self, goal: _Goal, result: Any) -> None:
        if self._goal is goal:
            self._goal = None
        if result.code == Result.SUCCESS:
            goal.served.succeed(result)
        else:
            goal.served.canceled(result)  # whatever it was that the canceled run came to

    def _start(self, goal: _Goal) -> None:
        """Start the behavior of a goal.

        Raises:
            CommandRefusedError: it cannot be started.
        """
        wanted = goal.served.request
        request = run_request(
            self._library,
            wanted.behavior,
            [(argument.name, argument.value) for argument in wanted.arguments],
            wanted.inputs,
            wanted.autonomy,
            f'action {names.EXECUTE_BEHAVIOR}',
            is_durable=False,  # after a crash, the client does not wait for it any more
        )

        def built(reason: str | None) -> None:
            if reason is not None:
                is_stopped = goal.run is not None and goal.run.snapshot.is_stopping
                code = Result.CANCELED if is_stopped else Result.FAILURE
                self._finish(goal, Result(code=code, message=reason))

        def ended(end: RunEnd) -> None:
            self._finish(goal, _result(end, wanted.output_encoding))

        goal.run = self._runs.start(request, built, ended)
        self._goal = goal

    def _cancel(self, served: ServedGoal) -> None:
        goal = self._goal
        if goal is not None and goal.run is not None and goal.served is served:
            goal.run.stop('the goal was canceled')


def _result(end: RunEnd, encoding: int) -> Any:
    """The result of a run that was built."""
    if end.outcome == PREEMPTED:
        return Result(code=Result.CANCELED, message=end.message)
    if end.outcome == ERROR:
        return Result(code=Result.ERROR, message=end.message)
    form = Encoding.BINARY if encoding == BtExecute.Goal.BINARY else Encoding.TEXT
    try:
        outputs = [to_entry(key, value, None, form) for key, value in end.outputs.items()]
    except FlexbtError as error:
        return Result(
            code=Result.ERROR, message=f'it ended with {end.outcome!r}, but an output cannot be sent: {error}'
        )
    return Result(code=Result.SUCCESS, outcome=end.outcome, outputs=outputs)


def _refused(why: str) -> Any:
    return Result(code=Result.FAILURE, message=why)
