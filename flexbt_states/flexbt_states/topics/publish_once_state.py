# SPDX-License-Identifier: BSD-3-Clause
"""State that publishes a message."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.values import check_value, message_type_name
from flexbt_core.state_machine import EventState, UserData
from flexbt_onboard.behaviors import state_services
from flexbt_states.support import checked_message_type, checked_topic


class PublishOnceState(EventState):
    """
    Publish one message. The publisher exists from the start of the run, so that subscribers are known by then.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- latched      bool        Whether later subscribers shall get the message as long as the run lasts

    ># message                  The message; a value of another type is a fault of the state.

    <= done                     The message was handed to the middleware.
    """

    is_instant = True

    def __init__(self, topic: str, msg_type: str | type[Any], latched: bool = False) -> None:
        super().__init__(outcomes=['done'], input_keys=['message'], desired_rate=None)
        self._topic = checked_topic(self, 'topic', topic)
        self._message_type = checked_message_type(self, 'msg_type', msg_type)
        self._qos = names.latched() if latched else QoSProfile(depth=10)
        self._publisher: Publisher | None = None

    def on_start(self) -> None:
        runtime = state_services(self).runtime
        self._publisher = runtime.call(
            lambda: runtime.node.create_publisher(self._message_type, self._topic, self._qos)
        )

    def execute(self, userdata: UserData) -> str:
        assert self._publisher is not None
        message = check_value(userdata['message'], message_type_name(self._message_type))
        self._publisher.publish(message)
        return 'done'

    def on_stop(self) -> None:
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            runtime = state_services(self).runtime
            runtime.post(lambda: runtime.node.destroy_publisher(publisher))
