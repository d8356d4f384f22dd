# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that publish one message."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Bool, Empty, String

from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState
from flexbt_flexbe.proxy import ProxyPublisher


class _PublisherState(EventState):
    """What they have in common: a message is published when the state is entered."""

    is_instant = True

    def __init__(self, topic: str, message_type: type[Any], input_keys: tuple[str, ...]) -> None:
        super().__init__(outcomes=['done'], input_keys=input_keys, desired_rate=None)
        self._topic = topic
        self._publisher = ProxyPublisher({topic: message_type})

    def execute(self, userdata: UserData) -> str:
        return 'done'


class PublisherBoolState(_PublisherState):
    """
    Publish a std_msgs/msg/Bool.

    -- topic        string      Name of the topic

    ># value                    A bool.

    <= done                     The message was handed to the middleware.
    """

    def __init__(self, topic: str) -> None:
        super().__init__(topic, Bool, ('value',))

    def on_enter(self, userdata: UserData) -> None:
        self._publisher.publish(self._topic, Bool(data=userdata['value']))


class PublisherEmptyState(_PublisherState):
    """
    Publish a std_msgs/msg/Empty.

    -- topic        string      Name of the topic

    <= done                     The message was handed to the middleware.
    """

    def __init__(self, topic: str) -> None:
        super().__init__(topic, Empty, ())

    def on_enter(self, userdata: UserData) -> None:
        self._publisher.publish(self._topic, Empty())


class PublisherStringState(_PublisherState):
    """
    Publish a std_msgs/msg/String.

    -- topic        string      Name of the topic

    ># value                    What to publish; its text when it is no string.

    <= done                     The message was handed to the middleware.
    """

    def __init__(self, topic: str) -> None:
        super().__init__(topic, String, ('value',))

    def on_enter(self, userdata: UserData) -> None:
        self._publisher.publish(self._topic, String(data=str(userdata['value'])))
