# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors for programs: the action ``execute_behavior`` runs one, with parameters and inputs, and gives its outputs.

By it a behavior is a leaf of a behavior tree, or a state of another executive's behavior. Operators see and supervise
such a run as any other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.errors import FlexbtError
from flexbt_common.values import Encoding, to_entry
from flexbt_msgs.action import BtExecute, ExecuteBehavior
from flexbt_onboard.behavior_run import BehaviorRun, RunPhase
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.executive_commands import run_request
from flexbt_onboard.state_machine import ERROR, PREEMPTED

if TYPE_CHECKING:
    from flexbt_onboard.executive import Executive

Result = ExecuteBehavior.Result

_RESULT_SECONDS: Final = 30
"""How long the result of a goal can be asked for again, after an outage of the link."""

_GOAL_SERVICE: Final = f'{names.EXECUTE_BEHAVIOR}/_action/send_goal'


@dataclass(eq=False)
class _Goal:
    """The goal whose behavior runs."""

    handle: ServerGoalHandle
    result: Future
    run: BehaviorRun | None = None
    shown: list[str] = field(default_factory=list)
    had_client: bool = False


class BehaviorActionServer:
    """Serves ExecuteBehavior. Used on the executor thread only.

    A goal is accepted always, and ends as FAILURE with the reason when the behavior cannot be started: the executive
    runs one behavior at a time. The run is stopped when the goal is canceled, and when no client is left that could do
    so.
    """

    def __init__(self, executive: Executive) -> None:
        self._executive = executive
        self._node = executive.runtime.node
        self._goal: _Goal | None = None
        self._server = ActionServer(
            self._node,
            ExecuteBehavior,
            names.EXECUTE_BEHAVIOR,
            execute_callback=self._execute,
            cancel_callback=self._cancel,
            result_timeout=_RESULT_SECONDS,
            **names.deep_action_services(),
        )

    def refresh(self) -> None:
        """Send feedback when other states are active, and look for the client; called with each status."""
        goal = self._goal
        if goal is None or goal.run is None:
            return
        paths = [state.path for state in goal.run.active_states()]
        if paths != goal.shown:
            goal.shown = paths
            goal.handle.publish_feedback(ExecuteBehavior.Feedback(active_states=paths))
        if self._node.count_clients(_GOAL_SERVICE):
            goal.had_client = True
        elif goal.had_client:
            goal.run.stop('the client of the goal is gone')

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        goal = _Goal(handle, Future())
        if handle.is_cancel_requested:  # canceled between acceptance and now
            handle.canceled()
            return Result(code=Result.CANCELED, message='canceled before it began')
        try:
            self._start(goal)
        except CommandRefusedError as error:
            handle.abort()
            return Result(code=Result.FAILURE, message=str(error))
        result = await goal.result
        if self._goal is goal:
            self._goal = None
        if result.code == Result.SUCCESS:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _start(self, goal: _Goal) -> None:
        """Start the behavior of a goal.

        Raises:
            CommandRefusedError: it cannot be started.
        """
        wanted = goal.handle.request
        request = run_request(
            self._executive.library,
            wanted.behavior,
            [(argument.name, argument.value) for argument in wanted.arguments],
            wanted.inputs,
            wanted.autonomy,
            f'action {names.EXECUTE_BEHAVIOR}',
            is_durable=False,  # after a crash, the client does not wait for it any more
        )

        def built(reason: str | None) -> None:
            if reason is not None:
                is_stopped = goal.run is not None and goal.run.phase is RunPhase.STOPPING
                code = Result.CANCELED if is_stopped else Result.FAILURE
                goal.result.set_result(Result(code=code, message=reason))

        def ended(run: BehaviorRun, outcome: str, message: str) -> None:
            goal.result.set_result(_result(run, outcome, message, wanted.output_encoding))

        goal.run = self._executive.start(request, built, ended)
        self._goal = goal

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        goal = self._goal
        if goal is not None and goal.run is not None and goal.handle.goal_id == handle.goal_id:
            goal.run.stop('the goal was canceled')
        return CancelResponse.ACCEPT


def _result(run: BehaviorRun, outcome: str, message: str, encoding: int) -> Any:
    """The result of a run that was built."""
    if outcome == PREEMPTED:
        return Result(code=Result.CANCELED, message=message)
    if outcome == ERROR:
        return Result(code=Result.ERROR, message=message)
    form = Encoding.BINARY if encoding == BtExecute.Goal.BINARY else Encoding.TEXT
    try:
        outputs = [to_entry(key, value, None, form) for key, value in run.outputs.items()]
    except FlexbtError as error:
        return Result(code=Result.ERROR, message=f'it ended with {outcome!r}, but an output cannot be sent: {error}')
    return Result(code=Result.SUCCESS, outcome=outcome, outputs=outputs)
