# SPDX-License-Identifier: BSD-3-Clause
"""A state of the night watch: have a door opened."""

from __future__ import annotations

from std_srvs.srv import SetBool

from flexbt_common.calls import ServiceCall
from flexbt_core.skills import Outcome, Predicate, Skill
from flexbt_core.state_machine import EventState, UserData
from flexbt_onboard.behaviors import state_services

RESPONSE_SECONDS = 5.0
"""Within these, s of wall time, the doors' controller has to answer."""


class OpenDoorState(EventState):
    """
    Have the door of a room opened, and wait until it is. The controller of the doors has a service for each of them,
    SERVICES/ROOM_door (std_srvs/SetBool).

    -- services     string      What comes before the name of the door
    -- seconds      float       How long the door takes to open, on the node's clock

    ># room         string      The room

    <= open                     The door is open.
    <= jammed                   It does not move, or nobody answers for it; the operator is told why.
    """

    skill = Skill.of(
        parameters={'room': 'room'},
        outcomes={'open': Outcome.of('completed', 'door_open(room)'), 'jammed': 'failed'},
        predicates=[Predicate('door_open', {'room': 'room'})],
    )

    def __init__(self, services: str = '/simulator/doors', seconds: float = 2.5) -> None:
        super().__init__(outcomes=['open', 'jammed'], input_keys=['room'], desired_rate=None)
        self._services = services
        self._seconds = seconds
        self._call: ServiceCall | None = None
        self._open_at: float | None = None

    def on_enter(self, userdata: UserData) -> None:
        self._open_at = None
        link = state_services(self).services.link(SetBool, f'{self._services}/{userdata.room}_door')
        self._call = ServiceCall(
            link,
            SetBool.Request(data=True),
            on_done=lambda _outcome: self.wake(),
            server_timeout=RESPONSE_SECONDS,
            response_timeout=RESPONSE_SECONDS,
        )

    def execute(self, userdata: UserData) -> str | None:
        if self._open_at is None:
            assert self._call is not None
            outcome = self._call.outcome
            if outcome is None:
                return None
            if outcome.response is None or not outcome.response.success:
                why = outcome.reason if outcome.response is None else outcome.response.message
                self.log_warn(f'the door of the {userdata.room} does not open: {why}')
                return 'jammed'
            self._open_at = self.clock.now() + self._seconds
        if self.clock.now() >= self._open_at:
            return 'open'
        self.wake_at(self._open_at)
        return None

    def on_exit(self, userdata: UserData) -> None:
        if self._call is not None and not self._call.done:
            self._call.cancel()
