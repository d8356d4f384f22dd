# SPDX-License-Identifier: BSD-3-Clause
"""State that runs a behavior of another executive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_common.values.entries import to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, Autonomy, no_level
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_msgs.action import BtExecute, ExecuteBehavior
from flexbt_msgs.msg import BehaviorArgument

from .errors import StateParameterError
from .goal_call import GoalState, read_values
from .parameter_checks import checked_mapping, checked_outcomes, checked_text, checked_types


class ExecuteBehaviorState(GoalState):
    """
    Run a behavior on another executive until it ends.

    -- behavior     string      Name of the behavior
    -- outcomes     string[]    Outcomes of the behavior by which this state can be left
    -- topic        string      Name of the action of the other executive
    -- arguments    dict        Values of the behavior's parameters
    -- inputs       dict        Input userdata of the behavior, with types
    -- outputs      dict        Output userdata of the behavior, with types
    -- autonomy     int         Autonomy level at the start of the behavior
    -- timeout      float       Seconds on the node's clock after which the behavior is stopped; None for no limit

    ># KEY                      Each key of inputs: a value of the declared type.
    #> KEY                      Each key of outputs: a value of the declared type.

    <= OUTCOME                  The behavior ended by that outcome, and its outputs are available.
    <= canceled                 The behavior was stopped by another client.
    <= failed                   It could not start, had another outcome, or took too long; the reason is logged.
    """

    def __init__(
        self,
        behavior: str,
        outcomes: Iterable[str] = ('finished',),
        topic: str = names.EXECUTE_BEHAVIOR,
        arguments: Mapping[str, str] | None = None,
        inputs: Mapping[str, str] | None = None,
        outputs: Mapping[str, str] | None = None,
        autonomy: int = Autonomy.Full,
        timeout: float | None = None,
    ) -> None:
        self._inputs = checked_types(self, 'inputs', inputs)
        self._outputs = checked_types(self, 'outputs', outputs)
        self._ends = checked_outcomes(self, 'outcomes', outcomes)
        super().__init__(
            ExecuteBehavior,
            topic,
            timeout,
            not_paused=lambda: ('pause it at its own executive',),
            outcomes=list(dict.fromkeys([*self._ends, 'canceled', 'failed'])),
            input_keys=list(self._inputs),
            output_keys=list(self._outputs),
        )
        self._behavior = checked_text(self, 'behavior', behavior)
        self._arguments = [
            BehaviorArgument(
                name=checked_text(self, 'arguments', name), value=checked_text(self, f'arguments[{name!r}]', value)
            )
            for name, value in checked_mapping(self, 'arguments', arguments).items()
        ]
        if not isinstance(autonomy, int) or autonomy not in AUTONOMY_NAMES:
            raise StateParameterError(self, 'autonomy', no_level(autonomy))
        self._autonomy = int(autonomy)
        self._activity: Sequence[str] = ()

    def _make_goal(self, userdata: UserData) -> Any:
        return ExecuteBehavior.Goal(
            behavior=self._behavior,
            arguments=self._arguments,
            inputs=[to_entry(key, userdata[key], type) for key, type in self._inputs.items()],
            autonomy=self._autonomy,
            output_encoding=BtExecute.Goal.BINARY,
        )

    def _send(self, goal: Any) -> None:
        self._activity = ()
        self._goal.send(goal, timeout=self._timeout, clock=self.clock, on_feedback=self._on_feedback)

    def _what(self) -> str:
        return f'behavior {self._behavior!r}'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        what, result = self._what(), ended.result
        if result is not None and result.code == ExecuteBehavior.Result.CANCELED:
            self.log_warn(f'{what}: canceled: {result.message}')
            return 'canceled'
        if ended.status is not GoalStatus.SUCCEEDED or result is None:
            reason = result.message if result is not None else ''
            self.log_error(f'{what}: {reason or ended.reason}')
            return 'failed'
        if result.code != ExecuteBehavior.Result.SUCCESS or result.outcome not in self._ends:
            self.log_error(f'{what} ended with {result.outcome!r}, which is none of {", ".join(self._ends)}')
            return 'failed'
        try:
            values = read_values(result.outputs, self._outputs)
        except FlexbtError as error:
            self.log_error(f'{what} ended with {result.outcome!r}, but its outputs are not as declared: {error}')
            return 'failed'
        for key, value in values.items():
            userdata[key] = value
        return str(result.outcome)

    def activity(self) -> Sequence[str]:
        return self._activity if self._goal.goal_id else ()

    def _on_feedback(self, feedback: Any) -> None:
        self._activity = tuple(feedback.active_states)
        self._goal.services.changed()
