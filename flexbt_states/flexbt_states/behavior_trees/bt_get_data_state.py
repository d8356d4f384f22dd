# SPDX-License-Identifier: BSD-3-Clause
"""State that reads from the blackboard of the BT server."""

from __future__ import annotations

from collections.abc import Mapping

from flexbt_common import names
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import UserData
from flexbt_msgs.action import BtGetData
from flexbt_states.errors import StateParameterError
from flexbt_states.support import (
    GoalCall,
    GoalState,
    checked_timeout,
    checked_topic,
    checked_types,
    read_values,
    state_outcome,
)

from .bt_server_use import BtUse


class BtGetDataState(GoalState):
    """
    Read values from a blackboard of the BT server.

    -- bt_topic         string  Name of the action of the BT server
    -- request_id       string  Blackboard key to read; empty when outputs names the keys
    -- request_msg_pkg  string  Package of request_msg_type when that is a bare message name
    -- request_msg_type string  Type of the value
    -- outputs          dict    Further blackboard keys to read, with their types
    -- blackboard       string  Name of the blackboard; empty for the shared one
    -- timeout          float   Seconds within which the values have to be there

    #> data                     The value of request_id; only with a request_id.
    #> KEY                      Each key of outputs: a value of the declared type.

    <= done                     All values were read.
    <= failed                   A value is missing or has another type; the operator is told why. No key is written.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_GET_DATA,
        request_id: str = '',
        request_msg_pkg: str = '',
        request_msg_type: str = '',
        outputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = 5.0,
    ) -> None:
        self._types = checked_types(self, 'outputs', outputs)
        self._userdata_keys = {key: key for key in self._types}
        if request_id:
            if request_id in self._types or 'data' in self._types:
                raise StateParameterError(self, 'outputs', f'names {request_id!r} or "data", which request_id uses')
            self._types[request_id] = self._checked_type('request_msg_type', request_msg_type, request_msg_pkg)
            self._userdata_keys[request_id] = 'data'
        if not self._types:
            raise StateParameterError(self, 'request_id', 'no key to read; give request_id or outputs')
        super().__init__(outcomes=['done', 'failed'], output_keys=list(self._userdata_keys.values()), desired_rate=None)
        self._blackboard = blackboard
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        self._goal = GoalCall(self, BtGetData, checked_topic(self, 'bt_topic', bt_topic))

    @property
    def bt_use(self) -> BtUse:
        return BtUse(blackboard=self._blackboard, reads=self._types)

    def on_enter(self, userdata: UserData) -> None:
        goal = BtGetData.Goal(blackboard=self._blackboard, keys=list(self._types), encoding=BtGetData.Goal.BINARY)
        self._goal.send(goal, timeout=self._timeout)

    def execute(self, userdata: UserData) -> str | None:
        outcome = self._goal.poll()
        if outcome is None:
            return None
        answer, reason = state_outcome(outcome, f'reading {", ".join(map(repr, self._types))}')
        if answer == 'done' and outcome.result is not None:
            try:
                values = read_values(outcome.result.entries, self._types)
            except FlexbtError as error:
                reason = str(error)
            else:
                for key, value in values.items():
                    userdata[self._userdata_keys[key]] = value
                return 'done'
        self.log_error(reason)
        return 'failed'
