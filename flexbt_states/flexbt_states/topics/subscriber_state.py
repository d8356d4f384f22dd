# SPDX-License-Identifier: BSD-3-Clause
"""State that takes the newest message of a topic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.qos import QoSProfile

from flexbt_core.state_machine import EventState, UserData
from flexbt_states.support import checked_message_type, checked_topic

from .topic_subscription import StateSubscription


class SubscriberState(EventState):
    """
    Take the newest message of a topic that came since the start of the run and was not taken before.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- blocking     bool        Whether to wait for a message when there is none
    -- clear        bool        Whether a message that came before the state was entered is dropped

    #> message                  The message.

    <= received                 There is a message.
    <= unavailable              There is none, and the state does not wait for one.
    """

    def __init__(self, topic: str, msg_type: str | type[Any], blocking: bool = True, clear: bool = False) -> None:
        super().__init__(outcomes=['received', 'unavailable'], output_keys=['message'], desired_rate=None)
        self._blocking = blocking
        self._clear = clear
        self._subscription = StateSubscription(
            self,
            checked_topic(self, 'topic', topic),
            checked_message_type(self, 'msg_type', msg_type),
            QoSProfile(depth=1),
        )

    def on_start(self) -> None:
        self._subscription.open()

    def on_enter(self, userdata: UserData) -> None:
        if self._clear:
            self._subscription.take()

    def execute(self, userdata: UserData) -> str | None:
        message = self._subscription.take()
        if message is not None:
            userdata['message'] = message
            return 'received'
        return None if self._blocking else 'unavailable'

    def activity(self) -> Sequence[str]:
        return self._subscription.lack()

    def on_stop(self) -> None:
        self._subscription.close()
