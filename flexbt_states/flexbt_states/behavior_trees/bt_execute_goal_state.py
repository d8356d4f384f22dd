# SPDX-License-Identifier: BSD-3-Clause
"""State that runs a behavior tree with a goal from the userdata."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from flexbt_common import names
from flexbt_common.values import check_value
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import UserData
from flexbt_states.errors import StateParameterError
from flexbt_states.support import checked_types

from .tree_state import TreeState

_POSE: Final = 'geometry_msgs/msg/PoseStamped'


class BtExecuteGoalState(TreeState):
    """
    Give a behavior tree a goal, and run it on the BT server until it ends.

    With the goal_id "goal", a pose goes to the blackboard key "goal" and a list of several to "goals", as Nav2's
    trees expect. With another goal_id, a value of any type goes to that key; "goals" is always a list.

    When the tree fails or is canceled, those keys are given that are on the blackboard: on one that trees share, also
    what a tree before has left there.

    -- bt_topic         string  Name of the action of the BT server
    -- bt_file          string  Tree identifier, or package/relative/path.xml; empty for the server's default tree
    -- goal_id          string  Blackboard key of the goal
    -- goal_msg_type    string  Type of the goal; for poses, a list of them is accepted as well
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

    <= done                     The tree succeeded, and its outputs are there.
    <= canceled                 The tree was canceled by somebody else, or replaced by another goal.
    <= failed                   The tree failed, could not run, or took too long; the operator is told why.
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
        if not goal_id:
            raise StateParameterError(self, 'goal_id', 'the key is empty')
        self._goal_id = goal_id
        self._goal_type = self._checked_type('goal_msg_type', goal_msg_type)
        written = checked_types(self, 'inputs', inputs)
        self._refuse_reserved('inputs', written, 'goal')
        read = checked_types(self, 'outputs', outputs)
        if request_id:
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

    def on_enter(self, userdata: UserData) -> None:
        goal = userdata['goal']
        if self._goal_type.removesuffix('[]') != _POSE:
            self._run_tree(userdata, goal_input=(self._goal_id, goal, self._goal_type))
            return
        is_list = isinstance(goal, list | tuple) or self._goal_id == 'goals' or self._goal_type.endswith('[]')
        try:
            poses = _poses(goal)
        except FlexbtError as error:
            self._refusal = str(error)
            return
        if self._goal_id == 'goal':
            self._run_tree(userdata, poses)
        elif is_list:
            self._run_tree(userdata, goal_input=(self._goal_id, poses, f'{_POSE}[]'))
        else:
            self._run_tree(userdata, goal_input=(self._goal_id, poses[0], _POSE))

    def _refuse_reserved(self, parameter: str, keys: Mapping[str, str], name: str) -> None:
        if name in keys:
            raise StateParameterError(self, parameter, f'the key {name!r} is used by the state itself')


def _poses(goal: Any) -> list[Any]:
    """The goal poses: one, or a list of at least one."""
    if not isinstance(goal, list | tuple):
        return [check_value(goal, _POSE)]
    if not goal:
        raise FlexbtError('the list of goal poses is empty')
    return list(check_value(list(goal), f'{_POSE}[]'))
