# SPDX-License-Identifier: BSD-3-Clause
"""States that run a behavior tree, with or without a goal from the userdata, and pause it while they are paused."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome
from flexbt_common.calls.service_call import ServiceCall, ServiceLink, ServiceOutcome
from flexbt_common.lifecycle.liveliness import ProcessIdentity
from flexbt_common.values.entries import check_value, to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Progress, Severity
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_msgs.action import BtExecute
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.behaviors.run_context import StateServices

from .errors import StateParameterError
from .goal_call import BtUse, GoalState, read_values, state_outcome
from .parameter_checks import checked_text, checked_tree, checked_types


class TreeState(GoalState):
    """The base class of states that run a tree on the BT server until it ends.

    ``inputs`` and ``outputs`` map blackboard keys to types, ``writes`` has all keys written before the first tick.
    ``userdata_keys`` maps outputs to their userdata keys where the names differ.
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
            BtExecute,
            bt_topic,
            timeout,
            parameter='bt_topic',
            not_paused=self._not_paused,
            outcomes=['done', 'canceled', 'failed'],
            input_keys=[*input_keys, *inputs],
            output_keys=list(self._userdata_keys.values()),
        )
        self.bt_use = BtUse(
            tree=checked_tree(self, 'bt_file', bt_file),
            blackboard=checked_text(self, 'blackboard', blackboard),
            writes=inputs if writes is None else writes,
            reads=outputs,
        )
        prefix, slash, _ = self._topic.rpartition('/')
        self._control_topic = f'{prefix}{slash}{names.CONTROL_TREE}'
        self._control: ServiceLink | None = None
        self._pause: TreePause | None = None
        self._activity: Sequence[str] = ()
        self._not_ended: Sequence[str] = ()
        self._progress = Progress()

    def on_start(self) -> None:
        super().on_start()
        self._control_link()

    def _goals(self, userdata: UserData) -> tuple[Sequence[Any], Sequence[tuple[str, Any, str]]]:
        """Return the goal poses, and further inputs as (key, value, type)."""
        return (), ()

    def _make_goal(self, userdata: UserData) -> Any:
        poses, more = self._goals(userdata)
        inputs = [(key, userdata[key], type) for key, type in self._inputs.items()]
        return BtExecute.Goal(
            behavior_tree=self.bt_use.tree,
            goals=list(poses),
            inputs=[to_entry(key, value, type) for key, value, type in (*inputs, *more)],
            outputs=list(self.bt_use.reads),
            output_encoding=BtExecute.Goal.BINARY,
            blackboard=self.bt_use.blackboard,
            owner=self._goal.services.node_name,
            owner_process=str(ProcessIdentity.own()),
        )

    def _send(self, goal: Any) -> None:
        """Send the goal. The timeout counts on the state's clock."""
        self._activity = self._not_ended = ()
        self._progress = Progress()
        self._goal.send(goal, timeout=self._timeout, clock=self.clock, on_feedback=self._on_feedback)
        self._pause = TreePause(self, self._goal.services, self._control_link(), self._goal.goal_id)

    def on_pause(self) -> None:
        if self._pause is not None:
            self._pause.set(True)

    def on_resume(self, userdata: UserData) -> None:
        if self._pause is not None:
            self._pause.set(False)

    def _what(self) -> str:
        return f'behavior tree {self.bt_use.tree!r}' if self.bt_use.tree else 'the default behavior tree'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        what, result = self._what(), ended.result
        answer, reason = state_outcome(ended, what)
        if answer != 'done':
            if result is not None and result.failed_node:
                reason += f' (node {result.failed_node})'
                reason += ''.join(f'; so {step}' for step in result.reasons[1:])
            self.log(Severity.WARN if answer == 'canceled' else Severity.ERROR, reason)
        reads = self.bt_use.reads
        sent = result.outputs if result is not None else ()
        if answer != 'done':  # the next state may read the outputs that exist
            existing = {entry.key for entry in sent}
            reads = {key: type for key, type in reads.items() if key in existing}
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
                self._pause.end()  # not earlier: a tree that is being canceled must not move again
            if (result := self._goal.last_result) is not None:
                self._warn_of(result.not_ended)  # no feedback follows that would report it
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
            self._control = self._goal.services.services.link(ControlTree, self._control_topic)
        return self._control

    def _not_paused(self) -> Sequence[str]:
        return () if self._pause is None else (*self._not_ended, *self._pause.not_paused())

    def _warn_of(self, not_ended: Sequence[str]) -> None:
        host = self.bound_to  # None if the run has ended meanwhile, on its thread
        if host is not None:
            for line in self._goal.services.goals.untold(self._topic, not_ended):
                host.log(Severity.WARN, line)

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
        if pause is None or not pause.wanted:  # else the status reports it
            self._warn_of(not_ended)
        if (nodes, not_ended) != (self._activity, self._not_ended):
            self._activity, self._not_ended = nodes, not_ended
            self._goal.services.changed()


# State that runs a behavior tree.


class BtExecuteState(TreeState):
    """
    Run a behavior tree on the BT server until it ends.

    When the tree fails or is canceled, the state returns the keys that exist on the blackboard. On a shared blackboard
    these include values left by earlier trees.

    -- bt_topic     string      Name of the action of the BT server
    -- bt_file      string      Tree identifier, or package/relative/path.xml; empty for the server's default tree
    -- inputs       dict        Blackboard keys to write before the first tick, with their types
    -- outputs      dict        Blackboard keys to read at the end, with their types
    -- blackboard   string      Name of the blackboard to run on; empty for the shared one
    -- timeout      float       Seconds on the node's clock after which the tree is canceled; None for no limit

    ># KEY                      Each key of inputs: a value of the declared type.
    #> KEY                      Each key of outputs: a value of the declared type.

    <= done                     The tree succeeded, and its outputs are available.
    <= canceled                 The tree was canceled by another client, or replaced by another goal.
    <= failed                   The tree failed, could not run, or took too long; the reason is logged.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_EXECUTOR,
        bt_file: str = '',
        inputs: Mapping[str, str] | None = None,
        outputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = None,
    ) -> None:
        written, read = checked_types(self, 'inputs', inputs), checked_types(self, 'outputs', outputs)
        super().__init__(bt_topic, bt_file, written, read, blackboard, timeout)


# State that runs a behavior tree with a goal from the userdata.

_POSE: Final = 'geometry_msgs/msg/PoseStamped'


class BtExecuteGoalState(TreeState):
    """
    Run a behavior tree with a goal on the BT server until it ends.

    With the goal_id "goal", a pose goes to the blackboard key "goal" and a list of several to "goals", as Nav2's
    trees expect. With another goal_id, a value of any type goes to that key; "goals" is always a list.

    When the tree fails or is canceled, the state returns the keys that exist on the blackboard. On a shared blackboard
    these include values left by earlier trees.

    -- bt_topic         string  Name of the action of the BT server
    -- bt_file          string  Tree identifier, or package/relative/path.xml; empty for the server's default tree
    -- goal_id          string  Blackboard key of the goal
    -- goal_msg_type    string  Type of the goal; for poses, a list of them is accepted too
    -- request_id       string  Blackboard key to read at the end; empty for none
    -- request_msg_pkg  string  Package of request_msg_type when that is a bare message name
    -- request_msg_type string  Type of the requested value
    -- inputs           dict    Further blackboard keys to write before the first tick, with their types
    -- outputs          dict    Further blackboard keys to read at the end, with their types
    -- blackboard       string  Name of the blackboard to run on; empty for the shared one
    -- timeout          float   Seconds on the node's clock after which the tree is canceled; None for no limit

    ># goal                     The goal.
    ># KEY                      Each key of inputs: a value of the declared type.
    #> data                     The requested value; only with a request_id.
    #> KEY                      Each key of outputs: a value of the declared type.

    <= done                     The tree succeeded, and its outputs are available.
    <= canceled                 The tree was canceled by another client, or replaced by another goal.
    <= failed                   The tree failed, could not run, or took too long; the reason is logged.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_EXECUTOR,
        bt_file: str = '',
        goal_id: str = 'goal',
        goal_msg_type: str = _POSE,
        request_id: str = '',
        request_msg_pkg: str = '',
        request_msg_type: str = '',
        inputs: Mapping[str, str] | None = None,
        outputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = None,
    ) -> None:
        if not checked_text(self, 'goal_id', goal_id):
            raise StateParameterError(self, 'goal_id', 'the key is empty')
        self._goal_id = goal_id
        self._goal_type = self._checked_type('goal_msg_type', goal_msg_type)
        written = checked_types(self, 'inputs', inputs)
        self._refuse_reserved('inputs', written, 'goal')
        if goal_id in written:
            raise StateParameterError(self, 'goal_id', f'{goal_id!r} is one of inputs as well')
        read = checked_types(self, 'outputs', outputs)
        if checked_text(self, 'request_id', request_id):
            self._refuse_reserved('outputs', read, 'data')
            if request_id in read:
                raise StateParameterError(self, 'request_id', f'{request_id!r} is one of outputs as well')
            read[request_id] = self._checked_type('request_msg_type', request_msg_type, request_msg_pkg)
        # A list of poses for the key "goal" goes to "goals".
        is_list = goal_id == 'goals' and not self._goal_type.endswith('[]')
        super().__init__(
            bt_topic,
            bt_file,
            written,
            read,
            blackboard,
            timeout,
            input_keys=['goal'],
            writes={**written, goal_id: f'{self._goal_type}[]' if is_list else self._goal_type},
            userdata_keys={request_id: 'data'} if request_id else {},
        )

    def _goals(self, userdata: UserData) -> tuple[Sequence[Any], Sequence[tuple[str, Any, str]]]:
        goal = userdata['goal']
        if self._goal_type.removesuffix('[]') != _POSE:
            return (), [(self._goal_id, goal, self._goal_type)]
        poses = _poses(goal)
        if self._goal_id == 'goal':
            return poses, ()
        if isinstance(goal, list | tuple) or self._goal_id == 'goals' or self._goal_type.endswith('[]'):
            return (), [(self._goal_id, poses, f'{_POSE}[]')]
        return (), [(self._goal_id, poses[0], _POSE)]

    def _refuse_reserved(self, parameter: str, keys: Mapping[str, str], name: str) -> None:
        if name in keys:
            raise StateParameterError(self, parameter, f'the key {name!r} is used by the state itself')


def _poses(goal: Any) -> list[Any]:
    """Return the goal poses: a single one, or a list of at least one."""
    if not isinstance(goal, list | tuple):
        return [check_value(goal, _POSE)]
    if not goal:
        raise FlexbtError('the list of goal poses is empty')
    return list(check_value(list(goal), f'{_POSE}[]'))


# Pausing of the tree while the state that runs it is paused.

_RESPONSE_SECONDS: Final = 10.0
"""Time limit for the answer to a pause, s: the server answers after the current tick."""

_PATIENCE_SECONDS: Final = 0.5
"""Time after which a tree counts as not paused if the pause is unconfirmed, s."""


class TreePause:
    """A client that pauses and resumes the run of one goal on the BT server, one request at a time.

    If the server does not know the run yet, the request is repeated when feedback arrives. :meth:`not_paused` returns
    the leaves that the server reports as still working. Callable from any thread.
    """

    def __init__(self, state: EventState, services: StateServices, link: ServiceLink, run_id: str) -> None:
        self._state = state
        self._services = services
        self._link = link
        self._run_id = run_id
        self._lock = threading.Lock()
        self._is_known = self._is_over = False
        self._wanted = False
        self._is: bool | None = False  # None after a request without an answer: it may yet have an effect
        self._wanted_at = 0.0
        self._goes_on: Sequence[str] = ()
        self._call: ServiceCall | None = None

    def set(self, paused: bool) -> None:
        """Pause or resume the tree."""
        with self._lock:
            self._wanted = paused
            self._wanted_at = self._services.runtime.steady.now()
            self._agree()

    def end(self) -> None:
        """Resume the tree after its goal has ended: another client may use the tree next."""
        with self._lock:
            self._wanted = False
            self._is_known = self._is_over = True
            self._agree()

    @property
    def wanted(self) -> bool:
        """True if the tree should be paused."""
        return self._wanted

    def not_paused(self) -> Sequence[str]:
        """Return why the tree, or which of its leaves, still runs although paused; empty if all of it is paused."""
        with self._lock:
            waits = self._wanted and not self._is
            goes_on, wanted_at = self._goes_on, self._wanted_at
        if waits and self._services.runtime.steady.now() - wanted_at > _PATIENCE_SECONDS:
            return (f'{self._link.name} has not confirmed the pause of the tree',)
        return goes_on

    def run_seen(self) -> None:
        """Repeat an unanswered pause request: the run now exists and knows its goal."""
        if self._wanted is not self._is:
            with self._lock:
                self._is_known = True
                self._agree()

    def _agree(self) -> None:
        if self._call is not None or self._wanted is self._is:
            return
        wanted, is_known = self._wanted, self._is_known
        command = ControlTree.Request.PAUSE if wanted else ControlTree.Request.RESUME
        self._call = ServiceCall(
            self._link,
            ControlTree.Request(command=command, run_id=self._run_id, owner=self._services.node_name),
            on_done=lambda outcome: self._answered(wanted, is_known, outcome),
            response_timeout=_RESPONSE_SECONDS,
        )

    def _answered(self, wanted: bool, was_known: bool, outcome: ServiceOutcome) -> None:
        reason = outcome.reason if outcome.response is None else str(outcome.response.message)
        with self._lock:
            self._call = None
            if was_known or not reason:
                self._is = wanted
                self._goes_on = _what_goes_on(outcome) if wanted else ()
            elif outcome.response is None:
                self._is = None
            if was_known or self._is_known or not reason or self._wanted is not wanted:
                self._agree()  # if the run is unknown, run_seen repeats the request
            is_over = self._is_over  # then a refusal is normal: the run may not exist any more
        if is_over:
            return
        self._services.changed()
        host = self._state.bound_to  # None if the run has ended meanwhile
        if host is not None and reason and was_known and not wanted:
            host.log(Severity.WARN, f'the tree was not resumed: {reason}')


def _what_goes_on(outcome: ServiceOutcome) -> Sequence[str]:
    """Return what still runs in a tree that was requested to pause, from the answer."""
    if outcome.response is None:
        return (f'the tree was not paused: {outcome.reason}',)
    if outcome.response.message:
        return (f'the tree was not paused: {outcome.response.message}',)
    return tuple(outcome.response.not_paused)
