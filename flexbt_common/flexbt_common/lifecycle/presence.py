# SPDX-License-Identifier: BSD-3-Clause
"""Presence of participants across an unreliable link, detected within a few seconds.

A token publishes one message a second with its name, on one shared topic, best effort. So it costs little, a lost
message does no harm, another name needs no discovery, and the middleware needs no liveliness messages across the link.
Watchers miss a dead process after the lease; a process that ends normally announces it. Between the nodes of a robot,
which must notice a loss sooner, use :mod:`flexbt_common.lifecycle.liveliness`.
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from builtin_interfaces.msg import Time
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

from flexbt_common import names
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_core.clock.rates import SenderRates
from flexbt_core.values.text import one_line, sanitize_for_message
from flexbt_msgs.msg import PeerStatus

WORD_SECONDS: Final = 1.0
"""Time from one message of a token to the next, s."""

PRESENCE_LEASE_SECONDS: Final = 5.0
"""Time that a watcher waits for a message, s. If a link loses 30 % of its packets, one silence in 400 is longer."""


WORD_BYTES: Final = 4000
"""Maximum size of a message, bytes; longer ones are dropped."""

WORD_RATE: Final = 50.0
WORD_BURST: Final = 100
"""Maximum rate of received messages of one participant: per second, and at once."""

WORD_DEPTH: Final = 200
"""Maximum number of queued messages: a flood on the topic must not drop the messages of the others."""

TOKENS_OF_PARTICIPANT: Final = 16
MOST_TOKENS: Final = 512
"""Maximum number of tokens of one participant, and of all together, that are tracked at a time."""


class PresenceToken:
    """A token that announces ``name`` until it or the runtime is closed. Any number of tokens may have the same name.

    ``namespace`` is that of the robot that receives it, by default the node's own.
    """

    def __init__(self, runtime: Runtime, name: str, namespace: str = '') -> None:
        self._topic = names.of_robot(namespace, names.EXECUTIVE_PRESENCE)
        # The time of its creation distinguishes it from other tokens of that name. Simulated time may stand still.
        seconds, nanoseconds = divmod(time.time_ns(), 10**9)
        since = Time(sec=seconds, nanosec=nanoseconds)
        self._word = PeerStatus(name=sanitize_for_message(name), alive=True, since=since)
        self._runtime = runtime
        runtime.call(self._open)
        runtime.on_close(self._leave)

    def close(self) -> None:
        """Announce the end and stop publishing. On the executor thread."""
        self._runtime.cancel_on_close(self._leave)
        self._leave()
        self._runtime.node.destroy_publisher(self._publisher)

    def _open(self) -> None:
        node = self._runtime.node
        matched = PublisherEventCallbacks(matched=lambda _event: self._speak())
        self._publisher = node.create_publisher(
            PeerStatus, self._topic, names.best_effort_qos(), event_callbacks=matched
        )
        self._go_on()

    def _go_on(self) -> None:
        if self._word.alive:
            self._runtime.call_near(self._runtime.steady.now() + WORD_SECONDS, WORD_SECONDS / 10.0, self._go_on)
            self._speak()

    def _speak(self) -> None:
        self._publisher.publish(self._word)

    def _leave(self) -> None:
        self._word.alive = False
        self._speak()


class _Token(NamedTuple):
    participant: bytes
    name: str
    sec: int
    nanosec: int


class PresenceWatch:
    """A watch on the tokens of others. Used on the executor thread only.

    ``present`` are the names of the tokens that have sent recently. At most :data:`MOST_TOKENS` are tracked for one
    participant, and in all.
    """

    def __init__(self, runtime: Runtime, on_ignored: Callable[[str], object] | None = None) -> None:
        """``on_ignored``: see :class:`ReceivedMessages`."""
        self.present: frozenset[str] = frozenset()
        self._runtime = runtime
        self._listeners: list[Callable[[], None]] = []
        self._heard: dict[_Token, float] = {}
        self._ended: OrderedDict[bytes, None] = OrderedDict()  # participants whose tokens have ended
        self._look: Timer | None = None
        self._messages = ReceivedMessages(
            runtime.node,
            PeerStatus,
            names.EXECUTIVE_PRESENCE,
            names.best_effort_qos(WORD_DEPTH),
            self._on_message,
            limit=WORD_BYTES,
            event_callbacks=SubscriptionEventCallbacks(matched=self._matched),
            on_ignored=on_ignored,
            rates=SenderRates(WORD_RATE, WORD_BURST, runtime.steady.now),
        )

    @property
    def tokens(self) -> int:
        """Number of tokens that have sent recently."""
        return len(self._heard)

    def add_listener(self, on_change: Callable[[], None]) -> None:
        """Call ``on_change`` after each change of :attr:`present`."""
        self._listeners.append(on_change)

    def has_gone(self, participant: bytes) -> bool:
        """Return whether a participant has held tokens, and all have ended or were silent for the lease."""
        return participant in self._ended

    def _on_message(self, received: Received) -> None:
        try:
            word = received.checked(PeerStatus)
        except ValueError as error:
            self._runtime.node.get_logger().error(
                f'{names.EXECUTIVE_PRESENCE}: ignored: {one_line(str(error))}',
                throttle_duration_sec=PRESENCE_LEASE_SECONDS,
            )
            return
        token = _Token(received.participant, word.name, word.since.sec, word.since.nanosec)
        if not word.alive:
            if token in self._heard:
                self._heard[token] = -math.inf
        elif token in self._heard or self._has_room(token.participant):
            self._heard[token] = self._runtime.steady.now()
            self._ended.pop(token.participant, None)
        self._review()

    def _has_room(self, participant: bytes) -> bool:
        of_participant = sum(token.participant == participant for token in self._heard)
        limit = MOST_TOKENS if participant == UNKNOWN_WRITER else TOKENS_OF_PARTICIPANT
        return of_participant < limit and len(self._heard) < MOST_TOKENS

    def _matched(self, event: Any) -> None:
        if event.current_count == 0:
            self._heard = dict.fromkeys(self._heard, -math.inf)
            self._review()

    def _review(self) -> None:
        now = self._runtime.steady.now()
        before = {token.participant for token in self._heard}
        self._heard = {token: heard for token, heard in self._heard.items() if now < heard + PRESENCE_LEASE_SECONDS}
        for participant in before - {token.participant for token in self._heard}:
            self._note_end(participant)
        if self._look is None and self._heard:
            first_end = min(self._heard.values()) + PRESENCE_LEASE_SECONDS
            self._look = self._runtime.post_at(first_end, self._look_again)
        present = frozenset(token.name for token in self._heard)
        if present != self.present:
            self.present = present
            for listener in self._listeners:
                listener()

    def _note_end(self, participant: bytes) -> None:
        self._ended[participant] = None
        while len(self._ended) > MOST_TOKENS:
            self._ended.popitem(last=False)

    def _look_again(self) -> None:
        self._look = None
        self._review()
