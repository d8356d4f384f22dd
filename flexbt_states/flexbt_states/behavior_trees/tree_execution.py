# SPDX-License-Identifier: BSD-3-Clause
"""The run of a behavior tree on behalf of a state: what the states that execute trees have in common."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from flexbt_common import names
from flexbt_common.calls import ServiceLink
from flexbt_common.values import to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import EventState, Progress, Severity, UserData
from flexbt_msgs.action import BtExecute
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.behaviors import state_services
from flexbt_states.support import GoalCall, read_values, state_outcome

from .bt_server_use import BtUse
from .tree_pause import TreePause


class TreeExecution:
    """Runs one tree at a time on the BT server and gives the state its outcome.

    ``outputs`` are the wanted blackboard keys with their types, ``output_keys`` the userdata keys that they are
    written to where the names differ.
    """

    def __init__(
        self,
        state: EventState,
        topic: str,
        tree: str,
        outputs: Mapping[str, str],
        output_keys: Mapping[str, str],
        blackboard: str,
        timeout: float | None,
    ) -> None:
        self._state = state
        self._topic = topic
        self._tree = tree
        self._outputs = dict(outputs)
        self._output_keys = dict(output_keys)
        self._blackboard = blackboard
        self._timeout = timeout
        state.skill = state.skill.within(timeout)
        prefix, slash, _ = topic.rpartition('/')
        self._control_topic = f'{prefix}{slash}{names.CONTROL_TREE}'
        self._control: ServiceLink | None = None
        self._pause: TreePause | None = None
        self._goal = GoalCall(state, BtExecute, topic, self._not_paused)
        self._activity: Sequence[str] = ()
        self._not_ended: Sequence[str] = ()
        self._progress = Progress()
        self._refusal = ''
        self._changed: Callable[[], None] | None = None

    def use(self, inputs: Mapping[str, str]) -> BtUse:
        """What it wants of the server, with the types of its inputs."""
        return BtUse(tree=self._tree, blackboard=self._blackboard, writes=inputs, reads=self._outputs)

    def prepare(self) -> None:
        """Look for the server already."""
        self._goal.prepare()
        if self._control is None:
            self._control = state_services(self._state).services.link(ControlTree, self._control_topic)

    def start(self, goals: Sequence[Any], inputs: Iterable[tuple[str, Any, str]]) -> None:
        """Send the goal with goal poses and typed inputs (key, value, type); time counts on the state's clock."""
        self._activity = self._not_ended = ()
        self._progress = Progress()
        self._refusal = ''
        try:
            entries = [to_entry(key, value, type) for key, value, type in inputs]
        except FlexbtError as error:
            self.refuse(str(error))
            return
        self.prepare()
        assert self._control is not None
        services = state_services(self._state)
        self._changed = services.changed
        goal = BtExecute.Goal(
            behavior_tree=self._tree,
            goals=list(goals),
            inputs=entries,
            outputs=list(self._outputs),
            output_encoding=BtExecute.Goal.BINARY,
            blackboard=self._blackboard,
            owner=services.node_name,
        )
        self._goal.send(goal, timeout=self._timeout, clock=self._state.clock, on_feedback=self._on_feedback)
        self._pause = TreePause(self._state, self._control, self._goal.goal_id)

    def set_paused(self, paused: bool) -> None:
        """The state is paused, or goes on: so is the tree."""
        if self._pause is not None:
            self._pause.set(paused)

    def refuse(self, reason: str) -> None:
        """Do not run the tree: what it would run on is not acceptable."""
        self._refusal = reason

    def outcome(self, userdata: UserData) -> str | None:
        """Outcome of the state, or None while the tree runs. Writes the outputs when the tree has succeeded."""
        what = f'behavior tree {self._tree!r}' if self._tree else 'the default behavior tree'
        if self._refusal:
            self._state.log_error(f'{what}: {self._refusal}')
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
            self._state.log(Severity.WARN if answer == 'canceled' else Severity.ERROR, reason)
            return answer
        assert result is not None
        try:
            if result.missing_outputs:
                raise FlexbtError(f'the tree did not write {", ".join(map(repr, result.missing_outputs))}')
            values = read_values(result.outputs, self._outputs)
        except FlexbtError as error:
            self._state.log_error(f'{what} succeeded, but its outputs are not as declared: {error}')
            return 'failed'
        for key, value in values.items():
            userdata[self._output_keys.get(key, key)] = value
        return 'done'

    def leave(self) -> None:
        """Cancel the tree when it still runs."""
        self._goal.leave()

    def halting(self) -> str | None:
        """What has not halted yet, None when nothing. After :meth:`leave`."""
        halting = self._goal.halting()
        if halting is None and self._pause is not None:
            if self._goal.is_over:
                self._pause.end()  # not before: a tree that is being canceled is not to move once more
            if (result := self._goal.last_result) is not None:
                self._warn_of(result.not_ended)  # no feedback tells it any more
            self._pause = None
        return halting

    def activity(self) -> Sequence[str]:
        """Paths of the tree's nodes that are running; none when the tree has ended, or was lost."""
        return self._activity if self._goal.goal_id else ()

    def progress(self) -> Progress | None:
        """How far the robot has come, as the tree tells; None when it has ended, or was lost."""
        goal_id = self._goal.goal_id
        if not goal_id:
            return None
        return self._progress if self._progress.tree_run_id else Progress(goal_id)

    def _not_paused(self) -> Sequence[str]:
        return () if self._pause is None else (*self._not_ended, *self._pause.not_paused())

    def _warn_of(self, not_ended: Sequence[str]) -> None:
        for line in state_services(self._state).goals.untold(self._topic, not_ended):
            self._state.log_warn(line)

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
        if pause is None or not pause.wanted:  # else the status says it
            self._warn_of(not_ended)
        if (nodes, not_ended) != (self._activity, self._not_ended):
            self._activity, self._not_ended = nodes, not_ended
            if self._changed is not None:
                self._changed()
