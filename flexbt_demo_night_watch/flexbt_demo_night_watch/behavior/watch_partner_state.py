# SPDX-License-Identifier: BSD-3-Clause
"""A state of the night watch: notice that the other robot is lost."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from rclpy.subscription import Subscription
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.liveness import LivelinessWatch
from flexbt_common.runtime import NodeRuntime
from flexbt_core.state_machine import EventState, UserData
from flexbt_onboard.behaviors import state_services
from flexbt_states.support import checked_topic

from .next_room_state import ROOMS_LEFT, places_in


class WatchPartnerState(EventState):
    """
    Wait until the executive of another robot is gone: by the token that each node holds on NAME/alive.

    -- partner      string      Namespace of the other robot; empty for none, which is never lost
    -- places       string      File of the places, as package/path.yaml: what it says of others is left aside

    #> left_behind  string[]    Rooms that it had still to look at, as it said last

    <= lost                     It was there, and is gone.
    """

    def __init__(self, partner: str, places: str) -> None:
        super().__init__(outcomes=['lost'], output_keys=['left_behind'], desired_rate=None)
        namespace = '/' + partner.strip('/')
        self._executive = checked_topic(self, 'partner', f'{namespace}/{names.ONBOARD_EXECUTIVE}') if partner else ''
        self._topic = f'{namespace}/{ROOMS_LEFT}'
        self._places = places_in(places)
        self._watch: LivelinessWatch | None = None
        self._subscription: Subscription | None = None
        self._lock = threading.Lock()
        self._left: list[str] = []

    def on_start(self) -> None:
        if self._executive:
            runtime = state_services(self).runtime
            runtime.call(lambda: self._join(runtime))

    def execute(self, userdata: UserData) -> str | None:
        if self._watch is None or self._watch.alive is not False:
            return None
        with self._lock:
            userdata.left_behind = list(self._left)
        said = ', '.join(userdata.left_behind) or 'nothing'
        self.log_warn(f'{self._executive} is gone; of its rooms it had left: {said}')
        return 'lost'

    def activity(self) -> Sequence[str]:
        with self._lock:
            return [f'{self._topic}: {", ".join(self._left) or "nothing"}'] if self._executive else []

    def on_stop(self) -> None:
        watch, subscription = self._watch, self._subscription
        self._watch = self._subscription = None
        if watch is not None:
            watch.close()
        if subscription is not None:
            runtime = state_services(self).runtime
            runtime.post(lambda: runtime.node.destroy_subscription(subscription))

    def _join(self, runtime: NodeRuntime) -> None:
        self._watch = LivelinessWatch(runtime, self._executive, self._tell)
        self._subscription = runtime.node.create_subscription(String, self._topic, self._on_message, names.latched())

    def _tell(self, _is_alive: bool) -> None:
        self.wake()

    def _on_message(self, message: Any) -> None:
        with self._lock:
            self._left = [room for room in dict.fromkeys(message.data.split()) if room in self._places]
        state_services(self).changed()
