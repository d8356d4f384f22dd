# SPDX-License-Identifier: BSD-3-Clause
"""States by which an operator's confirmations are counted in the userdata."""

from __future__ import annotations

from flexbt_core.state_machine import EventState, UserData


class Ask(EventState):
    """Wants to be left."""

    def __init__(self) -> None:
        super().__init__(outcomes=['again', 'out'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        return 'again'


class Add(EventState):
    """Counts."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], io_keys=['count'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        userdata['count'] += 1
        return 'done'
