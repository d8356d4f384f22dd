# SPDX-License-Identifier: BSD-3-Clause
"""States that publish a message, wait for one, or read the newest message of a topic."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Any, ClassVar

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime, qos_misfit
from flexbt_common.values.entries import check_value
from flexbt_common.values.value_types import message_type_name
from flexbt_core.clock.clock import Timer
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_onboard.behaviors.run_context import state_services

from .parameter_checks import checked_message_type, checked_timeout, checked_topic


class MessagePublisher(EventState):
    """A state that publishes on a topic. The publisher is created at the start of the run, so that subscribers are
    discovered in time."""

    is_instant = True

    def __init__(self, topic: str, msg_type: str | type[Any], latched: bool, **interface: Any) -> None:
        """``interface`` has the outcomes and the keys."""
        super().__init__(desired_rate=None, **interface)
        self._topic = checked_topic(self, 'topic', topic)
        self._message_type = checked_message_type(self, 'msg_type', msg_type)
        self._qos = names.transient_local_qos() if latched else QoSProfile(depth=10)
        self._publisher: Publisher | None = None

    def on_start(self) -> None:
        runtime = state_services(self).runtime
        self._publisher = runtime.call(
            lambda: runtime.node.create_publisher(self._message_type, self._topic, self._qos)
        )

    def _publish(self, message: Any) -> None:
        assert self._publisher is not None  # made by on_start
        self._publisher.publish(message)

    def on_stop(self) -> None:
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            runtime = state_services(self).runtime
            runtime.post(lambda: runtime.node.destroy_publisher(publisher))


class PublishOnceState(MessagePublisher):
    """
    Publish one message. The publisher is created at the start of the run, so that subscribers are discovered in time.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- latched      bool        Whether later subscribers get the message too, until the run ends

    ># message                  The message; a value of another type is a fault of the state.

    <= done                     The message was passed to the middleware.
    """

    def __init__(self, topic: str, msg_type: str | type[Any], latched: bool = False) -> None:
        super().__init__(topic, msg_type, latched, outcomes=['done'], input_keys=['message'])

    def execute(self, userdata: UserData) -> str:
        self._publish(check_value(userdata['message'], message_type_name(self._message_type)))
        return 'done'


# State that waits for a message.


class WaitForMessage(EventState):
    """A state that waits for messages of a topic until one leads to an outcome, or until its time is up.

    Of messages that arrive before the state is executed, the last ``depth`` are kept, of a latched topic the newest.
    """

    depth: ClassVar[int] = 1

    def __init__(
        self,
        topic: str,
        msg_type: type[Any],
        timeout: float | None,
        latched: bool,
        best_effort: bool,
        **interface: Any,
    ) -> None:
        """``interface`` has the outcomes other than ``timeout``, and the keys."""
        interface['outcomes'] = [*interface['outcomes'], 'timeout']
        super().__init__(desired_rate=None, **interface)
        self._topic = checked_topic(self, 'topic', topic)
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        qos = names.transient_local_qos() if latched else QoSProfile(depth=self.depth)
        if best_effort:
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        self._subscription = StateSubscription(self, self._topic, msg_type, qos)
        self._deadline: float | None = None
        self._timer: Timer | None = None
        self._has_heard = False

    def _received(self, message: Any, userdata: UserData) -> str | None:
        """Return the outcome for a message; None to wait for another one."""
        raise NotImplementedError

    def on_enter(self, userdata: UserData) -> None:
        self._deadline = self._timer = None
        self._has_heard = False
        if self._timeout is not None:
            steady = state_services(self).runtime.steady
            self._deadline = steady.now() + self._timeout
            self._timer = steady.call_at(self._deadline, self.wake)
        self._subscription.open()

    def execute(self, userdata: UserData) -> str | None:
        while (message := self._subscription.take()) is not None:
            self._has_heard = True
            outcome = self._received(message, userdata)
            if outcome is not None:
                return outcome
        if self._deadline is not None and state_services(self).runtime.steady.now() >= self._deadline:
            what, lack = 'no condition was true for a message', ''
            if not self._has_heard:
                what, lack = 'no message', ''.join(f'. {text}' for text in self._subscription.lack())
            self.log_warn(f'{what} on {self._topic} within {self._timeout:g} s{lack}')
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


class SubscribeOnceState(WaitForMessage):
    """
    Wait for the next message on a topic: one that arrives after the state was entered, or the latched one.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- timeout      float       Seconds (wall time) to wait; None for no limit
    -- latched      bool        Whether to accept an earlier message that its publisher keeps (transient local)
    -- best_effort  bool        Whether to subscribe with best effort, as best-effort publishers (sensors) require

    #> message                  The message.

    <= received                 A message arrived.
    <= timeout                  No message arrived in time.
    """

    def __init__(
        self,
        topic: str,
        msg_type: str | type[Any],
        timeout: float | None = None,
        latched: bool = False,
        best_effort: bool = False,
    ) -> None:
        message_type = checked_message_type(self, 'msg_type', msg_type)
        super().__init__(
            topic, message_type, timeout, latched, best_effort, outcomes=['received'], output_keys=['message']
        )

    def _received(self, message: Any, userdata: UserData) -> str:
        userdata['message'] = message
        return 'received'


# State that reads the newest message of a topic.


class SubscriberState(EventState):
    """
    Read the newest message of a topic since the start of the run. Each message is read only once.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- blocking     bool        Whether to wait if no message is available
    -- clear        bool        Whether to drop a message that arrived before the state was entered

    #> message                  The message.

    <= received                 A message is available.
    <= unavailable              No message is available, and the state does not wait.
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


# The newest messages of a topic, for a state.


class StateSubscription:
    """A subscription that keeps the newest messages since :meth:`open`, as many as its queue, and wakes the state for
    each.

    Call its methods on the thread of the state; it opens and closes on the executor thread, in the order of the calls.
    """

    def __init__(self, state: EventState, topic: str, message_type: type[Any], qos: QoSProfile) -> None:
        self._state = state
        self._topic = topic
        self._message_type = message_type
        self._qos = qos
        self._lock = threading.Lock()
        self._unread: deque[Any] = deque(maxlen=qos.depth)
        self._error: Exception | None = None
        self._visit = 0
        self._is_open = False
        self._subscription: Subscription | None = None  # executor thread only

    def open(self) -> None:
        """Subscribe; does nothing if it is open."""
        if self._is_open:
            return
        self._is_open = True
        visit, runtime = self._begin_visit(), state_services(self._state).runtime
        runtime.post(lambda: self._subscribe(runtime, visit))

    def close(self) -> None:
        """Unsubscribe, and drop the messages."""
        if not self._is_open:
            return
        self._is_open = False
        self._begin_visit()
        runtime = state_services(self._state).runtime
        runtime.post(lambda: self._unsubscribe(runtime))

    def take(self) -> Any | None:
        """Return the oldest message that is kept, once; None if no message is available.

        Raises what prevented the subscription, such as TopicTypeError.
        """
        with self._lock:
            error, self._error = self._error, None
            message = self._unread.popleft() if self._unread else None
        if error is not None:
            raise error
        return message

    def lack(self) -> list[str]:
        """Return why no message arrives, for the operator; empty if no problem is known."""
        runtime = state_services(self._state).runtime
        text = '' if self._unread else qos_misfit(runtime, runtime.node.resolve_topic_name(self._topic))
        return [text] if text else []

    def _begin_visit(self) -> int:
        """Drop what was received, and ignore what an earlier subscription still receives; return the new number."""
        with self._lock:
            self._unread.clear()
            self._error = None
            self._visit += 1
            return self._visit

    def _subscribe(self, runtime: Runtime, visit: int) -> None:
        def receive(message: Any) -> None:
            with self._lock:
                if visit != self._visit:
                    return
                self._unread.append(message)
            self._state.wake()

        try:
            self._subscription = runtime.node.create_subscription(self._message_type, self._topic, receive, self._qos)
        except Exception as error:  # for the state, which would wait forever
            with self._lock:
                if visit == self._visit:
                    self._error = error
            self._state.wake()

    def _unsubscribe(self, runtime: Runtime) -> None:
        if self._subscription is not None:
            runtime.node.destroy_subscription(self._subscription)
            self._subscription = None
