# SPDX-License-Identifier: BSD-3-Clause
"""Publishers, subscriptions and their QoS events: stand-ins for those of rclpy's compiled module.

The rules are those of DDS 1.4, 2.2.3: what fits together, what a late subscription gets, how long a message lives, and
when a publisher counts as alive. A message is copied once when it is published, and once for each reader that takes it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from types import SimpleNamespace
from typing import Any, Final

from .copying import copied, most_bytes
from .graph import DOMAIN, REAL, Entity, Node, RCLError, check_support, type_name
from .scheduler import SCHEDULER, SECOND, Alarm

INFINITE: Final = 1_000_000_000_000_000_000
"""Durations from here on count as infinite, ns."""

_MOST_KEPT: Final = 100_000
_LARGEST_DEPTH: Final = 2**31 - 1
_RELIABLE: Final = 1
_BEST_EFFORT: Final = 2
_TRANSIENT_LOCAL: Final = 1
_VOLATILE: Final = 2
_KEEP_ALL: Final = 2
_AUTOMATIC: Final = 1
_MANUAL_BY_TOPIC: Final = 3
_SYSTEM_DEFAULT: Final = 0
_BEST_AVAILABLE: Final = {'reliability': 4, 'durability': 4, 'liveliness': 5}
_BEST_DURATION: Final = REAL.RMW_QOS_DEADLINE_BEST_AVAILABLE
_POLICY: Final = REAL.rmw_qos_policy_kind_t
PublisherEvent: Final = REAL.rcl_publisher_event_type_t
SubscriptionEvent: Final = REAL.rcl_subscription_event_type_t
_OFFERED_DEADLINE_MISSED: Final = PublisherEvent.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED
_REQUESTED_DEADLINE_MISSED: Final = SubscriptionEvent.RCL_SUBSCRIPTION_REQUESTED_DEADLINE_MISSED


_OF_PUBLISHER: Final = "publisher's context"


class Qos:
    """A QoS profile in plain numbers; durations in ns, 0 for the default."""

    def __init__(self, profile: Any) -> None:
        given = profile.to_dict()
        self.given = given
        self.reliability = int(given['reliability'])
        self.durability = int(given['durability'])
        self.liveliness = int(given['liveliness'])
        self.deadline = _finite(given['deadline'])
        self.lifespan = _finite(given['lifespan'])
        self.lease = _finite(given['liveliness_lease_duration'])
        depth, keeps_all = int(given['depth']), int(given['history']) == _KEEP_ALL
        if depth > _LARGEST_DEPTH and not keeps_all:  # a negative one, too, as C has it
            raise RCLError('failed to set history depth since the requested queue size exceeds the DDS type')
        self.depth = _MOST_KEPT if keeps_all else max(1, min(depth, _MOST_KEPT))

    @classmethod
    def of(cls, profile: Any, is_publisher: bool, others: Sequence[Qos]) -> Qos:
        """Return a profile without what leaves the choice to others.

        What the system chooses is as in Fast DDS. What is best depends on the other side as it is now: a publisher
        offers all that a subscription may ask for, a subscription asks for what all publishers offer.
        """
        from rclpy.duration import Duration

        qos = cls(profile)
        meets = any if is_publisher else all
        for name, by_system, least, best, is_best in (
            ('reliability', (_BEST_EFFORT, _RELIABLE), _BEST_EFFORT, _RELIABLE, is_publisher),
            ('durability', (_VOLATILE, _TRANSIENT_LOCAL), _VOLATILE, _TRANSIENT_LOCAL, is_publisher),
            ('liveliness', (_AUTOMATIC, _AUTOMATIC), _AUTOMATIC, _MANUAL_BY_TOPIC, False),
        ):
            if getattr(qos, name) == _SYSTEM_DEFAULT:
                qos._choose(name, by_system[is_publisher])
            elif getattr(qos, name) == _BEST_AVAILABLE[name]:
                is_met = is_best or meets(getattr(one, name) == best for one in others)
                qos._choose(name, best if is_met else least)
        for name, attribute in (('deadline', 'deadline'), ('liveliness_lease_duration', 'lease')):
            if qos.given[name].nanoseconds == _BEST_DURATION:
                found = [getattr(one, attribute) or INFINITE for one in others] or [INFINITE]
                chosen = min(found) if is_publisher else max(found)
                setattr(qos, attribute, chosen if chosen < INFINITE else 0)
                qos.given = {**qos.given, name: Duration(nanoseconds=getattr(qos, attribute))}
        return qos

    def _choose(self, name: str, value: int) -> None:
        setattr(self, name, value)
        self.given = {**self.given, name: value}

    def misfit(self, requested: Qos) -> Any:
        """Return the kind of policy by which this offer does not meet a request, None if it does.

        Of several it is the one that DDS lists last.
        """
        if self.reliability == _BEST_EFFORT and requested.reliability == _RELIABLE:
            return _POLICY.RMW_QOS_POLICY_RELIABILITY
        if requested.liveliness == _MANUAL_BY_TOPIC and self.liveliness != _MANUAL_BY_TOPIC:
            return _POLICY.RMW_QOS_POLICY_LIVELINESS
        if requested.lease and not 0 < self.lease <= requested.lease:
            return _POLICY.RMW_QOS_POLICY_LIVELINESS
        if requested.deadline and not 0 < self.deadline <= requested.deadline:
            return _POLICY.RMW_QOS_POLICY_DEADLINE
        if self.durability == _VOLATILE and requested.durability == _TRANSIENT_LOCAL:
            return _POLICY.RMW_QOS_POLICY_DURABILITY
        return None


def _finite(duration: Any) -> int:
    nanoseconds = int(duration.nanoseconds)
    return nanoseconds if nanoseconds < INFINITE else 0


class Topic:
    """The endpoints of a topic."""

    def __init__(self) -> None:
        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []
        self.readers: list[Callable[[Any], object]] = []
        """Functions of the test that get each message when it is published, and do not change it."""


class Sample:
    """A published message: as an object, as bytes, or as both, once somebody has asked."""

    __slots__ = ('_data', '_lifespan', '_message', '_sent', 'gid', 'number', 'stamp', 'type')

    def __init__(self, message: Any, data: bytes | None, publisher: Publisher) -> None:
        self._message, self._data = message, data
        self.type, self.gid, self.number = publisher.type, publisher.gid, publisher.sent
        self.stamp = SCHEDULER.wall
        self._sent, self._lifespan = SCHEDULER.now, publisher.qos.lifespan

    @property
    def is_dead(self) -> bool:
        """True if its publisher does not send it any more."""
        return self.is_older(self._lifespan)

    def is_older(self, lifespan: int) -> bool:
        """Return whether it was published so long ago, ns; 0 for never."""
        return 0 < lifespan <= SCHEDULER.now - self._sent

    def message(self) -> Any:
        """Return a new message. Raises what deserialization raises."""
        return copied(self.shared_message())

    def shared_message(self) -> Any:
        """Return the message, which must not be changed."""
        if self._message is None:
            self._message = REAL.rclpy_deserialize(self._data, self.type)
        return self._message

    def most_bytes(self) -> int:
        """Return a number of bytes that :meth:`data` does not exceed."""
        return most_bytes(self._message) if self._data is None else len(self._data)

    def data(self) -> bytes:
        """Return the serialized message."""
        if self._data is None:
            self._data = REAL.rclpy_serialize(self._message, self.type)
        return self._data


class Endpoint(Entity):
    """A publisher or a subscription."""

    def __init__(self, node: Node, message_type: Any, topic: str, profile: Any) -> None:
        super().__init__()
        check_support(message_type)
        self.node, self.process, self.type = node, node.process, message_type
        node.context.check(f'Failed to create {type(self).__name__.lower()}')
        self.name = node.resolved(topic)
        self.topic = DOMAIN.topics.setdefault((node.domain, self.name), Topic())
        for other in (*self.topic.publishers, *self.topic.subscriptions):
            if other.node.context is node.context and other.type is not message_type:
                raise RCLError(f'{self.name} has the type {type_name(other.type)} in this context')
        is_publisher = isinstance(self, Publisher)
        others: list[Any] = self.topic.subscriptions if is_publisher else self.topic.publishers
        self.qos = Qos.of(profile, is_publisher, [other.qos for other in others])
        self._deadline: Alarm | None = None
        self.gid = node.context.gid()
        self.matches: list[Any] = []
        self.events: dict[Any, EventHandle] = {}
        self.counts: dict[str, int] = {}

    def get_logger_name(self) -> str:
        return self.node.logger_name()

    def get_topic_name(self) -> str:
        return self.name

    def tell(self, event: Any, **changes: int | Any) -> None:
        """Add these changes to the counts of an event, and tell its handler, now or when it is made."""
        for name, change in changes.items():
            key = f'{event.name}.{name}'
            self.counts[key] = self.counts.get(key, 0) + change if isinstance(change, int) else change
        if (handle := self.events.get(event)) is not None:
            handle.put(changes)

    def is_ready(self) -> bool:
        return False

    def meet_deadline(self) -> None:
        """Count its deadline from now on. It has one once a message was sent, or has arrived."""
        if self._deadline is not None:
            self._deadline.cancel()
        if self.qos.deadline:
            self._deadline = SCHEDULER.call_at(SCHEDULER.now + self.qos.deadline, self._miss_deadline)

    def _miss_deadline(self) -> None:
        if self.is_ended or not self.process.is_alive:
            return
        is_publisher = isinstance(self, Publisher)
        self.tell(_OFFERED_DEADLINE_MISSED if is_publisher else _REQUESTED_DEADLINE_MISSED, total_count=1)
        self.meet_deadline()


class EventHandle(Entity):
    """Stand-in for rcl's event of a publisher or subscription."""

    def __init__(self, parent: Endpoint, event_type: Any) -> None:
        super().__init__()
        self._parent = parent
        self._event = event_type
        self._changes: dict[str, Any] = {}
        parent.events[event_type] = self
        prefix = f'{event_type.name}.'
        earlier = {key.removeprefix(prefix): count for key, count in parent.counts.items() if key.startswith(prefix)}
        if any(earlier.values()):
            self.put(earlier)

    def put(self, changes: dict[str, Any]) -> None:
        """Add changes since the last :meth:`take_event`."""
        for name, change in changes.items():
            is_number = isinstance(change, int)
            self._changes[name] = self._changes.get(name, 0) + change if is_number else change
        self.notify()

    def is_ready(self) -> bool:
        return bool(self._changes)

    def take_event(self) -> Any:
        """Return the status: totals, and changes since the last one."""
        changes, self._changes = self._changes, {}
        status: dict[str, Any] = {}
        for name, change in changes.items():
            total = self._parent.counts[f'{self._event.name}.{name}']
            status |= {name: total, f'{name}_change': change} if isinstance(change, int) else {name: change}
        return SimpleNamespace(**status) if status else None

    def _destroy(self) -> None:
        self._parent.events.pop(self._event, None)


class Publisher(Endpoint):
    """Stand-in for rcl's publisher."""

    def __init__(self, node: Node, message_type: Any, topic: str, profile: Any) -> None:
        super().__init__(node, message_type, topic, profile)
        is_latched = self.qos.durability == _TRANSIENT_LOCAL
        self.kept: deque[Sample] | None = deque(maxlen=self.qos.depth) if is_latched else None
        self.sent = 0
        self._is_manual = self.qos.liveliness == _MANUAL_BY_TOPIC and bool(self.qos.lease)
        self.shown: dict[Subscription, bool] = {}
        """The subscriptions that have heard an assertion since their match, and whether it still holds."""
        self._leases: list[Alarm] = []
        if self.qos.lease and not self._is_manual:
            self.process.watchers.append(self._follow_process)
        self.topic.publishers.append(self)
        for subscription in tuple(self.topic.subscriptions):
            _discover(self, subscription)

    def publish(self, message: Any) -> None:
        self.node.context.check('Failed to publish', _OF_PUBLISHER)
        self.sent += 1
        self.meet_deadline()
        if self.matches or self.kept is not None or self.topic.readers or DOMAIN.on_message is not None:
            self._send(Sample(copied(message), None, self))
        else:
            self._renew()

    def publish_raw(self, data: bytes) -> None:
        self.node.context.check('Failed to publish', _OF_PUBLISHER)
        self.sent += 1
        self.meet_deadline()
        self._send(Sample(None, data, self))

    def _send(self, sample: Sample) -> None:
        if self.kept is not None:
            self.kept.append(sample)
        self._renew()
        if DOMAIN.on_message is not None:
            DOMAIN.on_message(self.process, self.name, sample)
        for read in self.topic.readers:
            read(sample.shared_message())
        for subscription in tuple(self.matches):
            self.send_to(subscription, sample)

    def send_to(self, subscription: Subscription, sample: Sample) -> None:
        """Send a sample to one subscription."""
        DOMAIN.transfer(
            self.process,
            subscription.process,
            _is_reliable(self, subscription),
            subscription.last_arrivals,
            self.pointer,
            lambda: subscription.arrive(sample),
        )

    def get_subscription_count(self) -> int:
        self.node.context.check('failed to get subscription count', _OF_PUBLISHER)
        return len(self.matches)

    def wait_for_all_acked(self, timeout: Any) -> bool:
        """Return True: a message that has been sent has arrived, or is on its way and cannot be lost."""
        self.node.context.check('Failed to wait for all acknowledgements', _OF_PUBLISHER)
        return True

    def assert_liveliness(self) -> None:
        self.node.context.check('Failed to assert liveliness on the Publisher', _OF_PUBLISHER)
        self._renew()

    def _renew(self) -> None:
        """Count as alive from now on until the lease ends."""
        if self._is_manual:
            self._regain()
            self._begin_leases()

    def _follow_process(self, runs: bool) -> None:
        """Lose the lease that the middleware renews by itself, as long as the process runs."""
        if runs:
            self._cancel_leases()
            self._regain()
        else:
            self._begin_leases()

    def _begin_leases(self) -> None:
        """Begin the own lease, and that of each subscription, which may be longer."""
        self._cancel_leases()
        self._leases.append(SCHEDULER.call_at(SCHEDULER.now + self.qos.lease, self._lose))
        for subscription in self.shown:
            lose = partial(self._lose_for, subscription)
            self._leases.append(SCHEDULER.call_at(SCHEDULER.now + subscription.qos.lease, lose))

    def _cancel_leases(self) -> None:
        while self._leases:
            self._leases.pop().cancel()

    def _regain(self) -> None:
        for subscription in self.matches:
            is_shown = self.shown.get(subscription)
            if subscription.qos.lease and not is_shown:
                self.shown[subscription] = True
                subscription.count_alive(1, 0 if is_shown is None else -1)

    def _lose(self) -> None:
        self.tell(PublisherEvent.RCL_PUBLISHER_LIVELINESS_LOST, total_count=1)

    def _lose_for(self, subscription: Subscription) -> None:
        if self.shown.get(subscription):
            self.shown[subscription] = False
            subscription.count_alive(-1, 1)

    def show_itself(self) -> None:
        """Show new subscriptions that it is alive, if the middleware asserts that by itself."""
        if self.qos.lease and not self._is_manual and self.process.works:
            self._regain()

    def _destroy(self) -> None:
        if self in self.topic.publishers:
            self.topic.publishers.remove(self)
        self._cancel_leases()
        if self._follow_process in self.process.watchers:
            self.process.watchers.remove(self._follow_process)
        for subscription in self.matches:
            _part(self, subscription)
        self.matches = []


class Subscription(Endpoint):
    """Stand-in for rcl's subscription. As with other middleware, a content filter (since Kilted) has no effect."""

    def __init__(self, node: Node, message_type: Any, topic: str, profile: Any, _filter: Any = None) -> None:
        super().__init__(node, message_type, topic, profile)
        self._queue: deque[tuple[Sample, int]] = deque(maxlen=self.qos.depth)
        self.last_arrivals: dict[Any, int] = {}
        self.topic.subscriptions.append(self)
        for publisher in tuple(self.topic.publishers):
            _discover(publisher, self)

    def arrive(self, sample: Sample) -> None:
        """Put a sample into the queue, where it may replace the oldest one."""
        if not self.is_ended and self.process.is_alive and not sample.is_dead:
            self.meet_deadline()
            self._queue.append((sample, SCHEDULER.wall))
            self.notify()

    def is_ready(self) -> bool:
        return bool(self._queue)

    @property
    def newest_time(self) -> int:
        """Time in the newest message of /clock that waits, ns."""
        time = self._queue[-1][0].shared_message().clock
        return int(time.sec * SECOND + time.nanosec)

    def take_sample(self) -> tuple[Sample, int] | None:
        """Return the oldest sample, and when it arrived (wall time, ns); None if there is none.

        As in Fast DDS, the own lifespan decides what is too old in the queue, and that of the publisher what it sends.
        """
        while self._queue:
            sample, arrived = self._queue.popleft()
            if not sample.is_older(self.qos.lifespan):
                return sample, arrived
        return None

    def take_message(self, message_type: Any, raw: bool) -> Any:
        taken = self.take_sample()
        if taken is None:
            return None
        sample, arrived = taken
        info = {
            'source_timestamp': sample.stamp,
            'received_timestamp': arrived,
            'publication_sequence_number': sample.number,
            'reception_sequence_number': None,
        }
        with suppress(REAL.RMWError):  # bytes that are no message are dropped
            return (sample.data() if raw else sample.message()), info
        return None

    def is_cft_enabled(self) -> bool:
        return False

    def set_content_filter(self, *_: Any) -> None:
        raise RCLError('a world in one process has no content filters')

    get_content_filter = set_content_filter

    def get_publisher_count(self) -> int:
        return len(self.matches)

    def count_alive(self, alive: int, not_alive: int) -> None:
        """Tell that publishers have become alive or not."""
        self.tell(SubscriptionEvent.RCL_SUBSCRIPTION_LIVELINESS_CHANGED, alive_count=alive, not_alive_count=not_alive)

    def _destroy(self) -> None:
        if self in self.topic.subscriptions:
            self.topic.subscriptions.remove(self)
        for publisher in self.matches:
            publisher.matches.remove(self)
            publisher.shown.pop(self, None)
            publisher.tell(PublisherEvent.RCL_PUBLISHER_MATCHED, current_count=-1, total_count=0)
        self.matches = []


def read_topic(node: Node, name: str, read: Callable[[Any], object]) -> None:
    """Call a function with all messages of a topic, as if a node had no part in it: :attr:`Topic.readers`."""
    DOMAIN.topics.setdefault((node.domain, node.resolved(name)), Topic()).readers.append(read)


def _is_reliable(publisher: Publisher, subscription: Subscription) -> bool:
    """Return whether lost messages are sent again, and those that were sent before the two have matched."""
    return publisher.qos.reliability == _RELIABLE == subscription.qos.reliability


def _discover(publisher: Publisher, subscription: Subscription) -> None:
    """Match the two, after the delay of discovery between their processes."""
    delay = DOMAIN.discovery(publisher.process, subscription.process) if DOMAIN.discovery else 0
    if delay:
        SCHEDULER.call_at(SCHEDULER.now + delay, lambda: _match(publisher, subscription))
    else:
        _match(publisher, subscription)


def _match(publisher: Publisher, subscription: Subscription) -> None:
    if publisher.is_ended or subscription.is_ended:
        return
    if publisher.type is not subscription.type:
        publisher.tell(PublisherEvent.RCL_PUBLISHER_INCOMPATIBLE_TYPE, total_count=1)
        subscription.tell(SubscriptionEvent.RCL_SUBSCRIPTION_INCOMPATIBLE_TYPE, total_count=1)
        return
    if (policy := publisher.qos.misfit(subscription.qos)) is not None:
        changes = {'total_count': 1, 'last_policy_kind': policy}
        publisher.tell(PublisherEvent.RCL_PUBLISHER_OFFERED_INCOMPATIBLE_QOS, **changes)
        subscription.tell(SubscriptionEvent.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS, **changes)
        return
    publisher.matches.append(subscription)
    subscription.matches.append(publisher)
    publisher.tell(PublisherEvent.RCL_PUBLISHER_MATCHED, current_count=1, total_count=1)
    subscription.tell(SubscriptionEvent.RCL_SUBSCRIPTION_MATCHED, current_count=1, total_count=1)
    publisher.show_itself()
    is_owed = subscription.qos.durability == _TRANSIENT_LOCAL and _is_reliable(publisher, subscription)
    if publisher.kept is not None and is_owed and publisher.process.is_alive:
        for sample in list(publisher.kept)[-subscription.qos.depth :]:
            publisher.send_to(subscription, sample)


def _part(publisher: Publisher, subscription: Subscription) -> None:
    """Tell a subscription that a publisher has ended."""
    subscription.matches.remove(publisher)
    subscription.last_arrivals.pop(publisher.pointer, None)
    is_shown = publisher.shown.pop(subscription, None)
    if is_shown is not None:
        subscription.count_alive(-int(is_shown), -int(not is_shown))
    subscription.tell(SubscriptionEvent.RCL_SUBSCRIPTION_MATCHED, current_count=-1, total_count=0)
