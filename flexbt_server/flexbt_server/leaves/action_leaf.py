# SPDX-License-Identifier: BSD-3-Clause
"""A leaf whose work is the goal of an action server.

The leaf never blocks. It is RUNNING from sending to result. Every wait has a deadline, and the leaf notices when the
server dies. Halting cancels the goal, even before its acceptance, and the tree counts as halted only when the server
has confirmed the cancel. The leaf sends no goal while a halted goal of the same tree, or a goal of another tree with
the same actuator or server, is still ending: two goals would move one robot. A server may ignore a cancel, so the leaf
repeats it until the goal has ended or the server is gone. The leaf fails if the wait for halted work exceeds its limit.

A pause of the tree cancels the goal. When the tree resumes, the leaf sends the goal, or its remainder, again. A goal
that ended before its cancel took effect keeps its result. The leaf fails if the goal does not end in time after that.

Deliberate differences from Nav2's BtActionNode: a goal that another client canceled is a FAILURE, not a SUCCESS; a
goal that was accepted too late is canceled; the leaf writes the error code whenever it fails; and it waits for the end
of a canceled goal, where Nav2 logs an error and continues.
"""

from __future__ import annotations

import math
import threading
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from flexbt_common.calls.action_call import ActionCall, ActionServerLink, GoalOutcome, GoalStatus
from flexbt_core.behavior_tree.engine.context import UnfinishedWork
from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.errors import PortError
from flexbt_core.behavior_tree.model.ports import STRING, UINT16, UNSIGNED, Port, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import Clock, Timer

from .leaf_services import EndingGoal, ServerNode

SERVER_PORTS: Final[dict[str, Port]] = {
    'server_name': input_port(STRING, optional=True, description="name of the server, if not the node's default"),
    'server_timeout': input_port(
        UNSIGNED, optional=True, description="wait for the server and its answer, ms; the BT server's by default"
    ),
}
"""Ports of every leaf that calls a server."""

ACTION_PORTS: Final[dict[str, Port]] = {
    **SERVER_PORTS,
    'error_code_id': output_port(UINT16, description='error code of the result; 0 for none'),
    'error_msg': output_port(STRING, description='why it failed, for a person'),
}
"""Ports of every action leaf."""


BASE: Final = 'base'
"""The resource of leaves that drive the robot: only one of them runs at a time."""

_REST_SECONDS: Final = 0.5
"""Time beyond the cancel timeout of a goal that the tree may need to halt before the next goal is sent, s."""


class _LeafGoal:
    """One goal. Once canceled, it is unfinished work of the tree until the server confirms its end."""

    def __init__(
        self, leaf: ActionLeaf, link: ActionServerLink, goal: Any, appear_timeout: float, accept_timeout: float
    ) -> None:
        self._leaf = leaf
        self._name = leaf.action_name
        self._ending: tuple[EndingGoal, UnfinishedWork] | None = None
        self._lock = threading.Lock()
        self._ended = False
        self._outcome: GoalOutcome | None = None
        self.message = goal
        self.feedback: Any = None
        self._call = ActionCall(
            link,
            goal,
            on_done=self._on_done,
            on_feedback=self._on_feedback,
            server_timeout=appear_timeout,
            accept_timeout=accept_timeout,
        )

    @property
    def outcome(self) -> GoalOutcome | None:
        """Outcome of the goal; None while it has not ended."""
        return self._outcome

    @property
    def canceled(self) -> bool:
        """True if this leaf has canceled the goal."""
        return self._call.cancel_requested

    def cancel(self) -> None:
        """Cancel the goal without waiting for its end. From any thread; a second call has no effect."""
        leaf = self._leaf
        with self._lock:
            if self._ended or self._ending is not None:
                return
            ending = leaf.host.ending.add(self._name, leaf.skill.resources)
            self._ending = ending, leaf.context.add_unfinished(ending.description)
        self._call.cancel(None)

    def _on_feedback(self, feedback: Any) -> None:
        self.feedback = feedback

    def _on_done(self, outcome: GoalOutcome) -> None:
        with self._lock:
            self._ended = True
            self._outcome = outcome
            ending = self._ending
        if ending is None:
            self._leaf.wake()
            return
        goal, unfinished = ending
        self._leaf.host.ending.remove(goal)
        unfinished.done()


_CODES: Final = {
    GoalStatus.REJECTED: 'GOAL_REJECTED',
    GoalStatus.NO_SERVER: 'SEND_GOAL_FAILURE',
    GoalStatus.TIMEOUT: 'SEND_GOAL_FAILURE',
}
"""Error codes of goals that never ran, if the type of the result has them, as in Nav2's branch main."""


def error_code_of(result_type: Any, outcome: GoalOutcome) -> int:
    """Return the error code of a failed goal: that of its result, that of the missing result, or UNKNOWN.

    0 if the type has no codes, and for a canceled goal, as in Nav2, since no recovery helps after a cancel.
    """
    code = int(getattr(outcome.result, 'error_code', 0))
    if code or outcome.status is GoalStatus.CANCELED:
        return code
    return int(getattr(result_type, _CODES.get(outcome.status, ''), getattr(result_type, 'UNKNOWN', 0)))


def error_name_of(result: Any) -> str:
    """Return the name of the constant for the error code of a result, or ''. Nav2's servers often report only this."""
    code = getattr(result, 'error_code', 0)
    return next((name for name in dir(result) if code and name.isupper() and getattr(result, name) == code), '')


class ActionLeaf(ServerNode, StatefulAction):
    """Base of leaves that send a goal. A subclass defines the action, and how ports map to the goal.

    ``action_type`` is the type of the action, ``default_server`` its name if the tree does not set ``server_name``.
    ``ports`` of a subclass must contain :data:`ACTION_PORTS`.
    """

    __slots__ = ('_alarm', '_goal', '_rest_by', '_superseded', '_waiting')

    action_type: ClassVar[type[Any]]
    default_server: ClassVar[str] = ''
    ports: ClassVar[Mapping[str, Port]] = ACTION_PORTS
    goes_on = ''
    acts_later = True
    cancels_on_pause: ClassVar[bool] = True
    """True if a pause of the tree cancels the goal. Otherwise ``goes_on`` is the reason why the goal continues, or ''
    if it moves nothing."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._goal: _LeafGoal | None = None
        self._superseded: list[_LeafGoal] = []
        self._waiting = False
        self._rest_by = math.inf
        self._alarm: Timer | None = None

    # -- hooks for subclasses ----------------------------------------------------------------------------------------

    @abstractmethod
    def make_goal(self) -> Any:
        """Return the goal, from the input ports. PortError and ValueError become the reason of a FAILURE."""

    def on_feedback(self, feedback: Any) -> None:
        """Write the output ports from the latest feedback. Called at each tick after the first feedback, also before
        the end is handled. PortError and ValueError become the reason of a FAILURE."""

    def newer_goal(self, feedback: Any) -> Any | None:
        """Return a goal to replace the present one, or None. Called at each tick, with the latest feedback."""
        return None

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        """Return the goal to send when the tree resumes after a pause, which canceled ``goal``.

        ``feedback`` is the latest feedback of that goal, or None.
        """
        return goal

    def on_success(self, result: Any) -> NodeStatus:
        """Write the output ports after the goal has succeeded, and return the status of the leaf."""
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> NodeStatus | None:
        """Write the output ports after the goal has not succeeded.

        Return the status of the leaf, or None for FAILURE with the reason.
        """
        return None

    # -- mechanics ---------------------------------------------------------------------------------------------------

    @property
    def action_name(self) -> str:
        """Name of the action in the tree, or ``default_server``."""
        return str(self.get_input_or('server_name', '') or self.default_server)

    @property
    def sent_goal(self) -> Any:
        """The goal that was sent last; None before the first."""
        return None if self._goal is None else self._goal.message

    def on_start(self) -> NodeStatus:
        self._goal = None
        self._superseded = []
        self._begin_to_wait()
        return self.on_running()

    def on_running(self) -> NodeStatus:
        if self._waiting:
            return self._send_at_rest()
        goal = self._goal
        assert goal is not None  # sent when the waiting ended
        outcome = goal.outcome
        if goal.feedback is not None:
            try:
                self.on_feedback(goal.feedback)
            except (PortError, ValueError) as error:
                self._cancel_all()
                return self._unmade(error)
        if goal.canceled and (outcome is None or outcome.status is GoalStatus.CANCELED):  # for a pause
            if self._is_held:
                return NodeStatus.RUNNING
            if outcome is None:
                if self._may_wait():
                    return NodeStatus.RUNNING
                self._cancel_all()
                return self._failed('the goal was canceled for a pause, and has not ended: its server ignores that')
            self._begin_to_wait()
            return self._send_at_rest()
        if outcome is not None:
            return self._ended(outcome)
        try:
            newer = self.newer_goal(goal.feedback)
        except (PortError, ValueError) as error:
            self._cancel_all()
            return self._unmade(error)
        if newer is not None:
            self._superseded = [older for older in self._superseded if older.outcome is None] + [goal]
            self._send(newer)
        return NodeStatus.RUNNING

    def _begin_to_wait(self) -> None:
        self._waiting = True
        self._limit_wait()

    def _limit_wait(self) -> None:
        self._drop_alarm()
        self._rest_by = self._steady.now() + self.host.cancel_timeout + _REST_SECONDS

    def _may_wait(self) -> bool:
        """Return whether time is left, and arrange a tick for when it is over."""
        if self._steady.now() >= self._rest_by:
            return False
        if self._alarm is None and self._rest_by != math.inf:
            self._alarm = self._steady.call_at(self._rest_by, self.wake)
        return True

    def _send_at_rest(self) -> NodeStatus:
        """Send the goal, or the rest of the goal that a pause has canceled, once nothing else is ending."""
        if self._is_held:
            return NodeStatus.RUNNING
        ending = self.host.ending
        ending.wait(self.wake)  # before the check, so that no end is missed
        others = ending.in_the_way_of(self.action_name, self.skill.resources)
        unfinished = tuple(dict.fromkeys((*self.context.unfinished, *others)))
        if unfinished and self._may_wait():
            return NodeStatus.RUNNING
        self._stop_waiting()
        if unfinished:
            return self._failed(
                f'the goal was not sent, because of what continues after a halt: {", ".join(unfinished)}'
            )
        older = self._goal
        try:
            if older is None:
                message = self.make_goal()
            else:
                message = self.newer_goal(older.feedback) or self.resumed_goal(older.message, older.feedback)
        except (PortError, ValueError) as error:
            return self._unmade(error)
        self._send(message)
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        self._cancel_all()

    def on_resume(self) -> None:
        if self._waiting or (self._goal is not None and self._goal.canceled):
            self._limit_wait()

    def on_pause(self) -> str:
        if self.cancels_on_pause:
            self.abandon()
        return self.goes_on

    def abandon(self) -> None:
        for goal in (*self._superseded, self._goal):
            if goal is not None:
                goal.cancel()

    @property
    def _is_held(self) -> bool:
        return self.context.paused and self.cancels_on_pause

    @property
    def _steady(self) -> Clock:
        return self.host.runtime.steady

    def _stop_waiting(self) -> None:
        self._waiting = False
        self._rest_by = math.inf
        self.host.ending.stop_waiting(self.wake)
        self._drop_alarm()

    def _drop_alarm(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None

    def _send(self, goal: Any) -> None:
        host = self.host
        milliseconds = self.get_input_or('server_timeout', None)
        timeout = host.server_timeout if milliseconds is None else milliseconds / 1000.0
        link = host.actions.link(self.action_type, self.action_name)
        self.acts()
        self._goal = _LeafGoal(self, link, goal, host.appear_timeout(timeout, link), timeout)

    def _cancel_all(self) -> None:
        self._stop_waiting()
        self.abandon()
        self._goal = None
        self._superseded = []

    def _ended(self, outcome: GoalOutcome) -> NodeStatus:
        if outcome.status is GoalStatus.SUCCEEDED:
            self._goal = None
            self._cancel_all()
            self._output_error('')
            ended = self.on_success(outcome.result)
            if ended is NodeStatus.FAILURE:
                self.set_output('error_msg', self._reason)
            return ended
        self._cancel_all()
        code = error_code_of(self.action_type.Result, outcome)
        text = getattr(outcome.result, 'error_msg', '') or getattr(outcome.result, 'message', '')
        reason = text or ': '.join(filter(None, (outcome.reason, error_name_of(outcome.result))))
        if outcome.status is GoalStatus.CANCELED:
            reason = 'the goal was canceled by somebody else'
        status = self.on_failure(outcome)
        failed = self._failed(reason or outcome.status.name, code)
        return failed if status is None else status

    def _unmade(self, error: PortError | ValueError) -> NodeStatus:
        """Return FAILURE for a goal that cannot be made, without the error code of an earlier one."""
        self._output_error(str(error))
        return self.fail(str(error))

    def _output_error(self, text: str, code: int = 0) -> None:
        self.set_output('error_code_id', code)
        self.set_output('error_msg', text)

    def _failed(self, reason: str, code: int = 0) -> NodeStatus:
        self._output_error(reason, code)
        shown = f' (error code {code})' if code else ''
        return self.fail(f'{self.action_name}: {reason}{shown}')
