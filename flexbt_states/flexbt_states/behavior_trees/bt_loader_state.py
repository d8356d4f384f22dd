# SPDX-License-Identifier: BSD-3-Clause
"""State that loads behavior trees into the BT server."""

from __future__ import annotations

from collections.abc import Sequence

from flexbt_common import names
from flexbt_common.calls import GoalOutcome
from flexbt_core.state_machine import UserData
from flexbt_msgs.action import BtLoad
from flexbt_msgs.msg import BtLoadReport
from flexbt_states.errors import StateParameterError
from flexbt_states.support import GoalCall, GoalState, checked_file, checked_timeout, checked_topic, state_outcome

from .bt_server_use import BtUse


class BtLoaderState(GoalState):
    """
    Load behavior trees into the BT server: all of them, or none.

    -- bt_topic     string      Name of the action of the BT server
    -- filepaths    string[]    XML files, as package/relative/path.xml or absolute
    -- timeout      float       Seconds within which they have to be loaded
    -- xml          string      XML text to load in addition; empty for none

    <= done                     Everything is loaded.
    <= failed                   Something was refused, nothing was loaded; the operator is told file, line and reason.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_LOADER,
        filepaths: Sequence[str] = (),
        timeout: float | None = 5.0,
        xml: str = '',
    ) -> None:
        super().__init__(outcomes=['done', 'failed'], desired_rate=None)
        if isinstance(filepaths, str):
            raise StateParameterError(self, 'filepaths', f'{filepaths!r} is a string, not a list of files')
        if not filepaths and not xml:
            raise StateParameterError(self, 'filepaths', 'the list is empty; name at least one XML file')
        self._files = [checked_file(self, 'filepaths', name) for name in filepaths]
        self._xml = xml
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        self._goal = GoalCall(self, BtLoad, checked_topic(self, 'bt_topic', bt_topic))

    @property
    def bt_use(self) -> BtUse:
        return BtUse(files=tuple(self._files), xml=self._xml)

    def on_enter(self, userdata: UserData) -> None:
        self._goal.send(BtLoad.Goal(files=self._files, xml=self._xml), timeout=self._timeout)

    def execute(self, userdata: UserData) -> str | None:
        outcome = self._goal.poll()
        if outcome is None:
            return None
        answer, reason = state_outcome(outcome, f'loading {", ".join(self._files) or "XML text"}')
        if answer == 'done':
            return 'done'
        self.log_error('\n'.join([reason, *_refusals(outcome)]))
        return 'failed'


def _refusals(outcome: GoalOutcome) -> list[str]:
    """Every reason why a file was refused, a line each."""
    reports = outcome.result.reports if outcome.result is not None else []
    return [
        f'{error.file}:{error.line}:{error.column}: {f"{error.node}: " if error.node else ""}{error.message}'
        for report in reports
        if report.code == BtLoadReport.REFUSED
        for error in report.errors
    ]
