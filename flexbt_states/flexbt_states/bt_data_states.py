# SPDX-License-Identifier: BSD-3-Clause
"""States that load behavior trees into the BT server, and read or write its blackboards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome
from flexbt_common.values.entries import to_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_msgs.action import BtGetData, BtLoad, BtSetData
from flexbt_msgs.msg import BtLoadReport

from .errors import StateParameterError
from .goal_call import BtUse, GoalState, read_values, state_outcome
from .parameter_checks import checked_file, checked_list, checked_text, checked_types


class BtLoaderState(GoalState):
    """
    Load behavior trees into the BT server: all of them, or none.

    -- bt_topic     string      Name of the action of the BT server
    -- filepaths    string[]    XML files, as package/relative/path.xml or absolute
    -- timeout      float       Seconds until loading must be done
    -- xml          string      Additional XML text to load; empty for none

    <= done                     Everything is loaded.
    <= failed                   A file or tree was refused, and nothing was loaded; file, line and reason are logged.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_LOADER,
        filepaths: Sequence[str] = (),
        timeout: float | None = 5.0,
        xml: str = '',
    ) -> None:
        super().__init__(BtLoad, bt_topic, timeout, parameter='bt_topic', outcomes=['done', 'failed'])
        files = checked_list(self, 'filepaths', filepaths, 'files')
        if not files and not xml:
            raise StateParameterError(self, 'filepaths', 'the list is empty; name at least one XML file')
        self._files = [checked_file(self, 'filepaths', name) for name in files]
        self._xml = checked_text(self, 'xml', xml)

    @property
    def bt_use(self) -> BtUse:
        return BtUse(files=tuple(self._files), xml=self._xml)

    def _make_goal(self, userdata: UserData) -> Any:
        return BtLoad.Goal(files=self._files, xml=self._xml)

    def _what(self) -> str:
        return f'loading {", ".join(self._files) or "XML text"}'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        answer, reason = state_outcome(ended, self._what())
        if answer == 'done':
            return 'done'
        self.log_error('\n'.join([reason, *_refusals(ended)]))
        return 'failed'


def _refusals(outcome: GoalOutcome) -> list[str]:
    """Return the reasons why files were refused, one line each."""
    reports = outcome.result.reports if outcome.result is not None else []
    return [
        f'{error.file}:{error.line}:{error.column}: {f"{error.node}: " if error.node else ""}{error.message}'
        for report in reports
        if report.code == BtLoadReport.REFUSED
        for error in report.errors
    ]


# States that read from the blackboard of the BT server, or write to it.


class BtGetDataState(GoalState):
    """
    Read values from a blackboard of the BT server.

    -- bt_topic         string  Name of the action of the BT server
    -- request_id       string  Blackboard key to read; empty when outputs names the keys
    -- request_msg_pkg  string  Package of request_msg_type when that is a bare message name
    -- request_msg_type string  Type of the value
    -- outputs          dict    Further blackboard keys to read, with their types
    -- blackboard       string  Name of the blackboard; empty for the shared one
    -- timeout          float   Seconds until the values must be available

    #> data                     The value of request_id; only with a request_id.
    #> KEY                      Each key of outputs: a value of the declared type.

    <= done                     All values were read.
    <= failed                   A value is missing or has another type; the reason is logged. No key is written.
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
        if checked_text(self, 'request_id', request_id):
            if request_id in self._types or 'data' in self._types:
                raise StateParameterError(self, 'outputs', f'names {request_id!r} or "data", which request_id uses')
            self._types[request_id] = self._checked_type('request_msg_type', request_msg_type, request_msg_pkg)
            self._userdata_keys[request_id] = 'data'
        if not self._types:
            raise StateParameterError(self, 'request_id', 'no key to read; give request_id or outputs')
        keys = list(self._userdata_keys.values())
        super().__init__(
            BtGetData, bt_topic, timeout, parameter='bt_topic', outcomes=['done', 'failed'], output_keys=keys
        )
        self._blackboard = checked_text(self, 'blackboard', blackboard)

    @property
    def bt_use(self) -> BtUse:
        return BtUse(blackboard=self._blackboard, reads=self._types)

    def _make_goal(self, userdata: UserData) -> Any:
        return BtGetData.Goal(blackboard=self._blackboard, keys=list(self._types), encoding=BtGetData.Goal.BINARY)

    def _what(self) -> str:
        return f'reading {", ".join(map(repr, self._types))}'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        answer, reason = state_outcome(ended, self._what())
        if answer == 'done' and ended.result is not None:
            try:
                values = read_values(ended.result.entries, self._types)
            except FlexbtError as error:
                reason = str(error)
            else:
                for key, value in values.items():
                    userdata[self._userdata_keys[key]] = value
                return 'done'
        self.log_error(reason)
        return 'failed'


class BtSetDataState(GoalState):
    """
    Write values to a blackboard of the BT server: all of them, or none.

    -- bt_topic         string  Name of the action of the BT server
    -- goal_id          string  Blackboard key to write; empty when inputs names the keys
    -- goal_msg_type    string  Type of the value
    -- inputs           dict    Further blackboard keys to write, with their types
    -- blackboard       string  Name of the blackboard; empty for the shared one
    -- timeout          float   Seconds until the values must be written

    ># goal                     The value for goal_id; only with a goal_id.
    ># KEY                      Each key of inputs: a value of the declared type.

    <= done                     All values were written.
    <= failed                   A value was refused and none was written; the reason is logged.
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
        if checked_text(self, 'goal_id', goal_id):
            if goal_id in self._types or 'goal' in self._types:
                raise StateParameterError(self, 'inputs', f'names {goal_id!r} or "goal", which goal_id uses')
            self._types[goal_id] = self._checked_type('goal_msg_type', goal_msg_type)
            self._userdata_keys[goal_id] = 'goal'
        if not self._types:
            raise StateParameterError(self, 'goal_id', 'no key to write; give goal_id or inputs')
        keys = list(self._userdata_keys.values())
        super().__init__(
            BtSetData, bt_topic, timeout, parameter='bt_topic', outcomes=['done', 'failed'], input_keys=keys
        )
        self._blackboard = checked_text(self, 'blackboard', blackboard)

    @property
    def bt_use(self) -> BtUse:
        return BtUse(blackboard=self._blackboard, writes=self._types)

    def _make_goal(self, userdata: UserData) -> Any:
        entries = [to_entry(key, userdata[self._userdata_keys[key]], type) for key, type in self._types.items()]
        return BtSetData.Goal(blackboard=self._blackboard, entries=entries)

    def _what(self) -> str:
        return f'writing {", ".join(map(repr, self._types))}'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        answer, reason = state_outcome(ended, self._what())
        if answer != 'done':
            self.log_error(reason)
            return 'failed'
        return 'done'
