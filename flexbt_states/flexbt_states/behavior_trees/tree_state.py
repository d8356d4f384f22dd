# SPDX-License-Identifier: BSD-3-Clause
"""A state that runs a behavior tree: what the states that execute trees have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from flexbt_common import names
from flexbt_common.calls import ServiceLink
from flexbt_common.values import to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import Progress, Severity, UserData
from flexbt_msgs.action import BtExecute
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.behaviors import state_services
from flexbt_states.support import (
    GoalCall,
    GoalState,
    checked_timeout,
    checked_topic,
    checked_tree,
    read_values,
    state_outcome,
)

from .bt_server_use import BtUse
from .tree_pause import TreePause


class TreeState(GoalState):
    """Runs a tree on the BT server until it ends; what is left to a state of its own is to call :meth:`_run_tree`.

    ``inputs`` and ``outputs`` are blackboard keys with their types, ``writes`` all that is written before the first
    tick. ``userdata_keys`` are the userdata keys of those outputs that have another name there.
    """

    def __init__(
        self,
        bt_topic: str,
        bt_file: str,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        blackboard: str,
        timeout: float | None,
        *,
        input_keys: Sequence[str] = (),
        writes: Mapping[str, str] | None = None,
        userdata_keys: Mapping[str, str] | None = None,
    ) -> None:
        self._inputs = inputs
        self._userdata_keys = {key: key for key in outputs} | dict(userdata_keys or {})
        super().__init__(
            outcomes=['done', 'canceled', 'failed'],
            input_keys=[*input_keys, *inputs],
            output_keys=list(self._userdata_keys.values()),
            desired_rate=None,
        )
        self._topic = checked_topic(self, 'bt_topic', bt_topic)
        self.bt_use = BtUse(
            tree=checked_tree(self, 'bt_file', bt_file),
            blackboard=blackboard,
            writes=inputs if writes is None else writes,
            reads=outputs,
        )
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        prefix, slash, _ = self._topic.rpartition('/')
        self._control_topic = f'{prefix}{slash}{names.CONTROL_TREE}'
        self._control: ServiceLink | None = None
        self._pause: TreePause | None = None
        self._goal = GoalCall(self, BtExecute, self._topic, self._not_paused)
        self._activity: Sequence[str] = ()
        self._not_ended: Sequence[str] = ()
        self._progress = Progress()
        self._refusal = ''
        self._changed: Callable[[], None] | None = None

    def on_start(self) -> None:
        super().on_start()
        self._control_link()

    def _run_tree(
        self, userdata: UserData, goals: Sequence[Any] = (), goal_input: tuple[str, Any, str] | None = None
    ) -> None:
        """Send the goal with goal poses and, beside the inputs, an input that is a goal (key, value, type).

        Time counts on the state's clock.
        """
        inputs = [(key, userdata[key], type) for key, type in self._inputs.items()]
        if goal_input is not None:
            inputs.append(goal_input)
        self._activity = self._not_ended = ()
        self._progress = Progress()
        self._refusal = ''
        try:
            entries = [to_entry(key, value, type) for key, value, type in inputs]
        except FlexbtError as error:
            self._refusal = str(error)
            return
        services = state_services(self)
        self._changed = services.changed
        goal = BtExecute.Goal(
            behavior_tree=self.bt_use.tree,
            goals=list(goals),
            inputs=entries,
            outputs=list(self.bt_use.reads),
            output_encoding=BtExecute.Goal.BINARY,
            blackboard=self.bt_use.blackboard,
            owner=services.node_name,
        )
        self._goal.send(goal, timeout=self._timeout, clock=self.clock, on_feedback=self._on_feedback)
        self._pause = TreePause(self, self._control_link(), self._goal.goal_id)

    def on_pause(self) -> None:
        if self._pause is not None:
            self._pause.set(True)

    def on_resume(self, userdata: UserData) -> None:
        if self._pause is not None:
            self._pause.set(False)

    def execute(self, userdata: UserData) -> str | None:
        what = f'behavior tree {self.bt_use.tree!r}' if self.bt_use.tree else 'the default behavior tree'
        if self._refusal:
            self.log_error(f'{what}: {self._refusal}')
            return 'failed'
        ended = self._goal.poll()
        if ended is None:
            return None
        answer, reason = state_outcome(ended, what)
        result = ended.result
        if answer != 'done':
            if result is not None and result.failed_node:
                reason += f' (node {result.failed_node})'
                reason += ''.join(f'; so {step}' for step in result.reasons[1:])
            self.log(Severity.WARN if answer == 'canceled' else Severity.ERROR, reason)
        reads = self.bt_use.reads
        sent = result.outputs if result is not None else ()
        if answer != 'done':  # what follows may look at what is there by then
            there = {entry.key for entry in sent}
            reads = {key: type for key, type in reads.items() if key in there}
        elif result is not None and result.missing_outputs:
            self.log_error(f'{what} succeeded, but it did not write {", ".join(map(repr, result.missing_outputs))}')
            return 'failed'
        try:
            values = read_values(sent, reads)
        except FlexbtError as error:
            self.log_error(f'{what} ended, but its outputs are not as declared: {error}')
            return 'failed' if answer == 'done' else answer
        for key, value in values.items():
            userdata[self._userdata_keys[key]] = value
        return answer

    def halting(self) -> str | None:
        halting = super().halting()
        if halting is None and self._pause is not None:
            if self._goal.is_over:
                self._pause.end()  # not before: a tree that is being canceled is not to move once more
            if (result := self._goal.last_result) is not None:
                self._warn_of(result.not_ended)  # no feedback tells it any more
            self._pause = None
        return halting

    def activity(self) -> Sequence[str]:
        return self._activity if self._goal.goal_id else ()

    def progress(self) -> Progress | None:
        goal_id = self._goal.goal_id
        if not goal_id:
            return None
        return self._progress if self._progress.tree_run_id else Progress(goal_id)

    def _control_link(self) -> ServiceLink:
        if self._control is None:
            self._control = state_services(self).services.link(ControlTree, self._control_topic)
        return self._control

    def _not_paused(self) -> Sequence[str]:
        return () if self._pause is None else (*self._not_ended, *self._pause.not_paused())

    def _warn_of(self, not_ended: Sequence[str]) -> None:
        for line in state_services(self).goals.untold(self._topic, not_ended):
            self.log_warn(line)

    def _on_feedback(self, feedback: Any) -> None:
        if (pause := self._pause) is not None:
            pause.run_seen()
        self._progress = Progress(
            tree_run_id=feedback.run_id,
            distance=feedback.distance_remaining,
            time=feedback.time_remaining,
            poses=feedback.poses_remaining,
            recoveries=feedback.number_of_recoveries,
            goal=feedback.goal if feedback.goal.header.frame_id else None,
        )
        nodes, not_ended = tuple(feedback.active_nodes), tuple(feedback.not_ended)
        if feedback.clock_problem:
            nodes += (f'{self._topic}: {feedback.clock_problem}',)
        if pause is None or not pause.wanted:  # else the status says it
            self._warn_of(not_ended)
        if (nodes, not_ended) != (self._activity, self._not_ended):
            self._activity, self._not_ended = nodes, not_ended
            if self._changed is not None:
                self._changed()
