# SPDX-License-Identifier: BSD-3-Clause
"""Subscriptions for messages of any participant: bounded, with the identity of the writer, or only the latest
message.

rclpy unpacks every message of any size, takes one per turn of the executor, and does not report its writer (7.1 leaves
the publisher's identifier out of its message info, which rcl has). So a flood from one writer drives other messages out
of the queue, and costs as much as useful messages. Here rcl's function takes all pending messages at once, as bytes.
Oversized messages are never unpacked, and the receiver can distinguish the writers before it unpacks anything.
"""

from __future__ import annotations

import ctypes
import functools
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from flexbt_common.errors import LimitExceededError
from flexbt_common.names import node_of
from flexbt_common.values.limits import MESSAGE, check_limits, deserialize
from flexbt_core.clock.rates import SenderRates

from .cyclonedds import WriterGuids
from .fastdds import FAST_DDS, ignore_participant, loaded_function
from .implementation import CYCLONE_DDS, has_participants, implementation
from .rclpy_private import EXECUTOR, is_usable

COMPLAINT_SECONDS: Final = 5.0
"""Minimum time between log lines about unusable messages, s: they may arrive at any rate."""

UNKNOWN_NODE: Final = '_NODE_NAME_UNKNOWN_'
"""Name that rmw reports for the node of an endpoint that it has just discovered."""

UNKNOWN_WRITER: Final = b''
"""Placeholder for a writer that the middleware, or stock rclpy (``FLEXBT_STOCK_RCLPY``), does not report."""

EXCESS_MESSAGES: Final = 500
EXCESS_BYTES: Final = 20_000_000
"""Number of excess messages, or bytes of oversized messages, after which the participants of a process are ignored."""

_PROCESSES: Final = 256
"""Maximum number of processes with such counts: those that were blamed last."""

_TURN_SECONDS: Final = 0.02
"""Time after which the other callbacks of the node get their turn, s."""

_GID_SIZE: Final = 16  # RMW_GID_STORAGE_SIZE
_OK: Final = 0
_NOTHING_TAKEN: Final = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED


@dataclass(frozen=True, slots=True)
class Received:
    """A received message. ``writer`` identifies its publisher in the domain, ``sent`` is the wall time on the sender's
    clock, s (0 if unknown), ``size`` in bytes. ``arrived`` is when the middleware had it, or else when it was taken, ns
    since the epoch.

    ``data`` is the serialized message, or None if it exceeds the receiver's limit.
    """

    data: bytes | None
    size: int
    writer: bytes
    sent: float
    arrived: int = 0

    @property
    def is_oversized(self) -> bool:
        """True if it exceeds the receiver's limit."""
        return self.data is None

    @property
    def participant(self) -> bytes:
        """Identifier of the writer's participant in the domain: of its process or a part of it. UNKNOWN_WRITER with a
        middleware that is not DDS."""
        return guid_prefix_of(self.writer)

    @property
    def process(self) -> bytes:
        """Identifier of the writer's process, whose participants share one allowance: Fast DDS begins their identifiers
        with the vendor, the host and the process. With another DDS, and with DDS security, which changes the
        identifiers, it is that of one participant; with a middleware that is not DDS, that of the writer."""
        return self.writer[:8] if implementation() == FAST_DDS else self.participant or self.writer

    def checked(self, message_type: type[Any]) -> Any:
        """Return the message after a check of the limits of its texts and lists.

        Raises:
            ValueError: these bytes are not such a message, or it is too large.
        """
        message = self.unpack(message_type)
        try:
            check_limits(message)
        except LimitExceededError as error:
            raise ValueError(str(error)) from error
        return message

    def unpack(self, message_type: type[Any]) -> Any:
        """Return the message.

        Raises:
            ValueError: these bytes are not such a message, or it is too large.
        """
        if self.data is None:
            raise ValueError(f'{self.size} bytes are too many')
        try:
            return deserialize(self.data, message_type)
        except Exception as error:  # an error of rclpy, or of a text that is not UTF-8
            raise ValueError(f'these {self.size} bytes are not a {message_type.__name__}: {error}') from error


class ReceivedMessages:
    """A subscription to all messages of a topic. Create it on the executor thread, where ``on_message`` gets them.

    Messages of more than ``limit`` bytes arrive without their data. A process that keeps sending them, or messages that
    the receiver blames it for, is ignored if the middleware supports that. ``on_ignored`` gets a line about it; by
    default the node logs it. While ``is_awaited`` returns False, messages stay in the queue of the middleware; stock
    rclpy delivers them anyway. Messages of a process beyond its ``rates`` are dropped.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        qos: QoSProfile,
        on_message: Callable[[Received], object],
        limit: int,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        on_ignored: Callable[[str], object] | None = None,
        is_awaited: Callable[[], bool] | None = None,
        rates: SenderRates | None = None,
    ) -> None:
        self._node = node
        self._rates = rates
        self._topic = topic
        self._on_message = on_message
        self._limit = limit
        self._is_awaited = is_awaited
        self._depth = qos.depth
        # By process: number of excess messages, and bytes of oversized ones.
        self._excess: OrderedDict[bytes, tuple[int, int]] = OrderedDict()
        self._on_ignored = on_ignored if on_ignored is not None else node.get_logger().error
        self._taker = _Taker.make()
        self.subscription = node.create_subscription(
            message_type, topic, self._callback(), qos, event_callbacks=event_callbacks, raw=True
        )

    def _callback(self) -> Callable[[bytes, Mapping[str, int]], None]:
        def callback(data: bytes, info: Mapping[str, int]) -> None:
            """For the executor of rclpy, which has taken the message."""
            size = len(data)
            sent = info['source_timestamp'] * 1e-9
            arrived = info['received_timestamp'] or time.time_ns()
            self._receive(Received(data if size <= self._limit else None, size, UNKNOWN_WRITER, sent, arrived))

        if self._taker is not None:
            callback.take_all = self._take_all  # type: ignore[attr-defined]  # see rclpy_private.ExtendedExecutor
        if self._is_awaited is not None:
            callback.is_awaited = self._is_awaited  # type: ignore[attr-defined]  # see node_executor.NodeExecutor
        return callback

    def take(self) -> None:
        """Take all pending messages, on the executor thread. Stock rclpy takes them in its own turns."""
        if self._taker is not None:
            for _ in range(self._depth):
                if not self._take_next():
                    return

    def _take_all(self, _subscription: Subscription) -> None:
        until = time.monotonic() + _TURN_SECONDS
        while time.monotonic() < until and self._take_next():
            pass

    def _take_next(self) -> bool:
        """Take the next message, and return whether one was available."""
        assert self._taker is not None
        received = self._taker.take(self.subscription, self._limit)
        if received is None:
            return False
        if received.is_oversized:
            self.blame(received)
        self._receive(received)
        return True

    def _receive(self, received: Received) -> None:
        if self._rates is None or self._rates.allows(received.process):
            self._on_message(received)
        else:
            self.blame(received)

    def blame(self, received: Received) -> None:
        """Count a message as excess of its sender. A sender that continues is ignored."""
        participant = received.participant
        before = self._excess.pop(received.process, (0, 0))
        count, size = before[0] + 1, before[1] + (received.size if received.is_oversized else 0)
        self._excess[received.process] = count, size
        if len(self._excess) > _PROCESSES:
            self._excess.popitem(last=False)
        if participant == UNKNOWN_WRITER or (count < EXCESS_MESSAGES and size < EXCESS_BYTES):
            return
        is_told = before[0] >= EXCESS_MESSAGES or before[1] >= EXCESS_BYTES  # the process is already reported
        # Looked for once, and while it is not ignored: the graph takes longer than all else here.
        who = '' if is_told else writer_name(self._node, self._topic, participant)
        if ignore_participant(self._node, participant) and not is_told:
            self._on_ignored(
                f'{who or "a node that is gone"} floods {self._topic} ({count} messages too many, {size / 1e6:.0f} MB '
                'too large); nothing more is heard of its process until this one is started again'
            )


def guid_prefix_of(writer: bytes) -> bytes:
    """Return the participant that a writer belongs to: the first 12 bytes of a GUID (DDSI-RTPS 8.2.4.1). Return
    UNKNOWN_WRITER with a middleware that is not DDS."""
    return writer[:12] if has_participants() else UNKNOWN_WRITER


def writer_name(node: Node, topic: str, writer: bytes) -> str:
    """Return the name of the node that a writer on a topic belongs to, for people; '' if it is unknown or not in the
    graph."""
    endpoint = endpoint_of(node.get_publishers_info_by_topic(node.resolve_topic_name(topic)), writer)
    if endpoint is None:
        return ''
    return 'a node that has just come' if endpoint.node_name == UNKNOWN_NODE else node_of(endpoint)


def endpoint_of(endpoints: Iterable[Any], writer: bytes) -> Any | None:
    """Return the first endpoint of a writer, or of a participant; None if there is none."""
    known = endpoints if writer != UNKNOWN_WRITER else ()
    return next((one for one in known if bytes(one.endpoint_gid).startswith(writer)), None)


def reports_writers() -> bool:
    """Return whether messages in this process have their writers."""
    return is_usable(EXECUTOR) and _Taker.make() is not None


class _Gid(ctypes.Structure):
    """rmw_gid_t"""

    _fields_ = (('implementation', ctypes.c_char_p), ('data', ctypes.c_uint8 * _GID_SIZE))


class _MessageInfo(ctypes.Structure):
    """rmw_message_info_t"""

    _fields_ = (
        ('source_timestamp', ctypes.c_int64),
        ('received_timestamp', ctypes.c_int64),
        ('publication_sequence_number', ctypes.c_uint64),
        ('reception_sequence_number', ctypes.c_uint64),
        ('publisher_gid', _Gid),
        ('from_intra_process', ctypes.c_bool),
    )


class _Allocator(ctypes.Structure):
    """rcutils_allocator_t"""

    _fields_ = tuple(
        (name, ctypes.c_void_p) for name in ('allocate', 'deallocate', 'reallocate', 'zero_allocate', 'state')
    )


class _Bytes(ctypes.Structure):
    """rcutils_uint8_array_t"""

    _fields_ = (
        ('buffer', ctypes.c_void_p),
        ('length', ctypes.c_size_t),
        ('capacity', ctypes.c_size_t),
        ('allocator', _Allocator),
    )


class _Taker:
    """A reader that calls functions of rcl and rcutils (ROS 2 Jazzy). The structures above are from their headers."""

    def __init__(self) -> None:
        pointer = ctypes.POINTER
        short = functools.partial(loaded_function, is_short=True)
        self._take = short(
            'librcl.so', 'rcl_take_serialized_message', ctypes.c_int,
            ctypes.c_void_p, pointer(_Bytes), pointer(_MessageInfo), ctypes.c_void_p,
        )  # fmt: skip
        self._init = short(
            'librcutils.so', 'rcutils_uint8_array_init', ctypes.c_int,
            pointer(_Bytes), ctypes.c_size_t, pointer(_Allocator),
        )  # fmt: skip
        self._free = short('librcutils.so', 'rcutils_uint8_array_fini', ctypes.c_int, pointer(_Bytes))
        self._forget_error = short('librcutils.so', 'rcutils_reset_error', None)
        self._allocator = short('librcutils.so', 'rcutils_get_default_allocator', _Allocator)()
        self._guids = WriterGuids() if implementation() == CYCLONE_DDS else None

    @classmethod
    def make(cls) -> _Taker | None:
        """Return a taker, or None with another version of rcl."""
        try:
            return cls()
        except (OSError, AttributeError):
            return None

    def take(self, subscription: Subscription, limit: int) -> Received | None:
        """Return the next message, or None if no message can be taken."""
        taken, info = _Bytes(), _MessageInfo()
        if self._init(ctypes.byref(taken), 0, ctypes.byref(self._allocator)) != _OK:
            self._forget_error()
            return None
        try:
            with subscription.handle:
                code = self._take(subscription.handle.pointer, ctypes.byref(taken), ctypes.byref(info), None)
            if code != _OK:
                if code != _NOTHING_TAKEN:
                    self._forget_error()
                return None
            data = ctypes.string_at(taken.buffer, taken.length) if taken.length <= limit else None
            writer = bytes(info.publisher_gid.data)
            if self._guids is not None:
                writer = self._guids.guid(subscription, writer)
            arrived = info.received_timestamp or time.time_ns()
            return Received(data, taken.length, writer, info.source_timestamp * 1e-9, arrived)
        finally:
            self._free(ctypes.byref(taken))


# The newest message of a topic, for readers that need it far more rarely than it arrives.

MOST_BYTES: Final[Mapping[type[Any], int]] = {PoseStamped: 2_000}
"""Size limit for types whose messages are forwarded repeatedly, bytes; other types have the general limit."""


class LatestMessage:
    """The newest message of a topic, kept as bytes and deserialized on request.

    Create and close it on the executor thread. While ``is_awaited()``, by default never, the executor takes each
    message and calls ``on_message``; otherwise messages stay in the middleware until one is requested. Messages larger
    than MOST_BYTES are dropped, and so are bytes that are not such a message.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        qos: QoSProfile | int,
        on_message: Callable[[], object] = lambda: None,
        is_awaited: Callable[[], bool] = lambda: False,
    ) -> None:
        self._type = message_type
        self._on_message = on_message
        self._is_awaited = is_awaited
        self._newest: bytes | None = None
        self._made: tuple[bytes, Any] | None = None
        self._node = node
        self._most = MOST_BYTES.get(message_type, MESSAGE)
        self._lock = threading.Lock()
        self._takes = is_usable(EXECUTOR)  # otherwise rclpy's executor takes every message
        self._subscription = node.create_subscription(message_type, topic, self._callback(), qos, raw=True)

    @property
    def message(self) -> Any | None:
        """Newest message, the same object until a newer one arrives; None before the first. From any thread."""
        if self._takes:
            self._take_all(self._subscription)
        with self._lock:  # two threads must not make two objects of one message
            newest, made = self._newest, self._made
            if newest is None:
                return None
            if made is None or made[0] is not newest:
                made = self._made = (newest, self._deserialized(newest, None if made is None else made[1]))
            return made[1]

    def _deserialized(self, data: bytes, before: Any | None) -> Any | None:
        """Return the message of these bytes, or the one before if they are none."""
        try:
            return deserialize(data, self._type)
        except Exception as error:  # an error of rclpy
            self._node.get_logger().error(
                f'{self._subscription.topic_name}: {len(data)} bytes that are not a {self._type.__name__} are ignored; '
                f'is their sender built from other definitions? {error}',
                throttle_duration_sec=COMPLAINT_SECONDS,
            )
            return before

    def close(self) -> None:
        """Close the subscription."""
        self._node.destroy_subscription(self._subscription)

    def _callback(self) -> Callable[[bytes], None]:
        def callback(data: bytes) -> None:
            """For the executor of rclpy, which has taken the message."""
            self._keep(data)
            if self._is_awaited():
                self._on_message()

        callback.take_all = self._take_all  # type: ignore[attr-defined]  # see rclpy_private.ExtendedExecutor
        callback.is_awaited = self._is_awaited  # type: ignore[attr-defined]  # see node_executor.NodeExecutor
        return callback

    def _take_all(self, subscription: Subscription) -> None:
        has_come = False
        with self._lock:  # the last message taken must be the newest
            try:
                with subscription.handle:
                    while (taken := subscription.handle.take_message(self._type, True)) is not None:
                        self._keep(taken[0])
                        has_come = True
            except InvalidHandle:
                return  # closed
        if has_come and self._is_awaited():
            self._on_message()

    def _keep(self, data: bytes) -> None:
        if len(data) <= self._most:
            self._newest = data
            return
        self._node.get_logger().error(
            f'{self._subscription.topic_name}: a message of {len(data)} bytes is ignored; at most {self._most} '
            'are allowed',
            throttle_duration_sec=COMPLAINT_SECONDS,
        )
