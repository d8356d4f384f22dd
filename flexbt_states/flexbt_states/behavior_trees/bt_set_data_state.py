# SPDX-License-Identifier: BSD-3-Clause
"""State that writes to the blackboard of the BT server."""

from __future__ import annotations

from collections.abc import Mapping

from flexbt_common import names
from flexbt_common.values import to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import UserData
from flexbt_msgs.action import BtSetData
from flexbt_states.errors import StateParameterError
from flexbt_states.support import (
    GoalCall,
    GoalState,
    checked_timeout,
    checked_topic,
    checked_types,
    state_outcome,
)

from .bt_server_use import BtUse


class BtSetDataState(GoalState):
    """
    Write values to a blackboard of the BT server: all of them, or none.

    -- bt_topic         string  Name of the action of the BT server
    -- goal_id          string  Blackboard key to write; empty when inputs names the keys
    -- goal_msg_type    string  Type of the value
    -- inputs           dict    Further blackboard keys to write, with their types
    -- blackboard       string  Name of the blackboard; empty for the shared one
    -- timeout          float   Seconds within which the values have to be written

    ># goal                     The value for goal_id; only with a goal_id.
    ># KEY                      Each key of inputs: a value of the declared type.

    <= done                     All values were written.
    <= failed                   A value was refused and none was written; the operator is told why.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_SET_DATA,
        goal_id: str = '',
        goal_msg_type: str = '',
        inputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = 5.0,
    ) -> None:
        self._types = checked_types(self, 'inputs', inputs)
        self._userdata_keys = {key: key for key in self._types}
        if goal_id:
            if goal_id in self._types or 'goal' in self._types:
                raise StateParameterError(self, 'inputs', f'names {goal_id!r} or "goal", which goal_id uses')
            self._types[goal_id] = self._checked_type('goal_msg_type', goal_msg_type)
            self._userdata_keys[goal_id] = 'goal'
        if not self._types:
            raise StateParameterError(self, 'goal_id', 'no key to write; give goal_id or inputs')
        super().__init__(outcomes=['done', 'failed'], input_keys=list(self._userdata_keys.values()), desired_rate=None)
        self._blackboard = blackboard
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        self._refusal = ''
        self._goal = GoalCall(self, BtSetData, checked_topic(self, 'bt_topic', bt_topic))

    @property
    def bt_use(self) -> BtUse:
        return BtUse(blackboard=self._blackboard, writes=self._types)

    def on_enter(self, userdata: UserData) -> None:
        self._refusal = ''
        try:
            entries = [to_entry(key, userdata[self._userdata_keys[key]], type) for key, type in self._types.items()]
        except FlexbtError as error:
            self._refusal = str(error)
            return
        self._goal.send(BtSetData.Goal(blackboard=self._blackboard, entries=entries), timeout=self._timeout)

    def execute(self, userdata: UserData) -> str | None:
        what = f'writing {", ".join(map(repr, self._types))}'
        if self._refusal:
            self.log_error(f'{what}: {self._refusal}')
            return 'failed'
        outcome = self._goal.poll()
        if outcome is None:
            return None
        answer, reason = state_outcome(outcome, what)
        if answer == 'done':
            return 'done'
        self.log_error(reason)
        return 'failed'
