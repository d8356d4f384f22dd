# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that publish one message, or read the newest message of a topic."""

from __future__ import annotations

from typing import Any

from rclpy.qos import QoSProfile
from std_msgs.msg import Bool, Empty, String

from flexbt_common.values.entries import check_value
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_flexbe.api.event_state import EventState
from flexbt_flexbe.api.topic_proxies import ProxyPublisher, ProxySubscriberCached
from flexbt_onboard.behaviors.run_context import state_services


class _PublisherState(EventState):
    """The base class of states that publish a message when they are entered."""

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

    ># value                    A bool; a value of another type is a fault of the state.

    <= done                     The message was handed to the middleware.
    """

    def __init__(self, topic: str) -> None:
        super().__init__(topic, Bool, ('value',))

    def on_enter(self, userdata: UserData) -> None:
        self._publisher.publish(self._topic, Bool(data=check_value(userdata['value'], 'bool')))


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

    ># value                    Value to publish; converted to text if it is not a string.

    <= done                     The message was handed to the middleware.
    """

    def __init__(self, topic: str) -> None:
        super().__init__(topic, String, ('value',))

    def on_enter(self, userdata: UserData) -> None:
        self._publisher.publish(self._topic, String(data=str(userdata['value'])))


# FlexBE's state that reads the newest message of a topic.


class SubscriberState(EventState):
    """
    Read the newest message of a topic.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, or the class; empty to use its publishers' type on entry
    -- blocking     bool        Whether to wait if no message is available
    -- clear        bool        Whether to drop a message that arrived before the state was entered
    -- qos          QoSProfile  Quality of service; None for FlexBE's default

    #> message                  The message; None without one.

    <= received                 A message is available.
    <= unavailable              The type is unknown without a publisher, or no message arrived and it does not wait.
    """

    runs_while_blocked = False  # it would wait for another message than the one that it has received

    def __init__(
        self,
        topic: str,
        msg_type: str | type[Any] = '',
        blocking: bool = True,
        clear: bool = False,
        qos: QoSProfile | int | None = None,
    ) -> None:
        super().__init__(outcomes=['received', 'unavailable'], output_keys=['message'], desired_rate=None)
        self._topic = topic
        self._blocking = blocking
        self._clear = clear
        self._qos = qos
        self._subscriber = ProxySubscriberCached()
        if msg_type:
            self._subscriber.subscribe(topic, msg_type, qos=qos, inst_id=id(self))

    def on_enter(self, userdata: UserData) -> None:
        if not self._subscriber.is_available(self._topic):
            published = self._published_type()
            if published is not None:
                self._subscriber.subscribe(self._topic, published, qos=self._qos, inst_id=id(self))
        elif self._clear:
            self._subscriber.remove_last_msg(self._topic)

    def execute(self, userdata: UserData) -> str | None:
        message = self._subscriber.get_last_msg(self._topic)
        if message is not None:
            self._subscriber.remove_last_msg(self._topic)
            userdata['message'] = message
            return 'received'
        if self._blocking and self._subscriber.is_available(self._topic):
            return None
        userdata['message'] = None
        return 'unavailable'

    def _published_type(self) -> str | None:
        """Return the type of the topic's publishers that discovery knows."""
        runtime = state_services(self).runtime
        topics = dict(runtime.call(runtime.node.get_topic_names_and_types))
        types = topics.get(runtime.node.resolve_topic_name(self._topic), ())
        return types[0] if types else None
