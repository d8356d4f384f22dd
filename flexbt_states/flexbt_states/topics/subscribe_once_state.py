# SPDX-License-Identifier: BSD-3-Clause
"""State that waits for a message."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from flexbt_common import names
from flexbt_core.clock import Timer
from flexbt_core.state_machine import EventState, UserData
from flexbt_onboard.behaviors import state_services
from flexbt_states.support import checked_message_type, checked_timeout, checked_topic

from .topic_subscription import StateSubscription


class SubscribeOnceState(EventState):
    """
    Wait for the next message on a topic: one that comes after the state was entered, or the latched one.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- timeout      float       Seconds (wall time) to wait; None for no limit
    -- latched      bool        Whether a message that was published before counts, where its sender keeps it
    -- best_effort  bool        Whether its senders are of best effort, as those of sensors are: none else hears them

    #> message                  The message.

    <= received                 A message has come.
    <= timeout                  None has come in time.
    """

    def __init__(
        self,
        topic: str,
        msg_type: str | type[Any],
        timeout: float | None = None,
        latched: bool = False,
        best_effort: bool = False,
    ) -> None:
        super().__init__(outcomes=['received', 'timeout'], output_keys=['message'], desired_rate=None)
        self._topic = checked_topic(self, 'topic', topic)
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        message_type = checked_message_type(self, 'msg_type', msg_type)
        qos = names.latched() if latched else QoSProfile(depth=1)
        if best_effort:
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        self._subscription = StateSubscription(self, self._topic, message_type, qos)
        self._deadline: float | None = None
        self._timer: Timer | None = None

    def on_enter(self, userdata: UserData) -> None:
        self._deadline = self._timer = None
        if self._timeout is not None:
            steady = state_services(self).runtime.steady
            self._deadline = steady.now() + self._timeout
            self._timer = steady.call_at(self._deadline, self.wake)
        self._subscription.open()

    def execute(self, userdata: UserData) -> str | None:
        message = self._subscription.take()
        if message is not None:
            userdata['message'] = message
            return 'received'
        if self._deadline is not None and state_services(self).runtime.steady.now() >= self._deadline:
            lack = ''.join(f'. {text}' for text in self._subscription.lack())
            self.log_warn(f'no message on {self._topic} within {self._timeout:g} s{lack}')
            return 'timeout'
        return None

    def activity(self) -> Sequence[str]:
        return self._subscription.lack()

    def not_paused(self) -> Sequence[str]:
        return ['time-out: it counts wall time'] if self._deadline is not None else []

    def on_exit(self, userdata: UserData) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._subscription.close()
