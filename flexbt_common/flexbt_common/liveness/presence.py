# SPDX-License-Identifier: BSD-3-Clause
"""Who is there at the other end of a link that may be bad, known within some seconds.

A token says a word a second under a name: on one topic for all, neither acknowledged nor sent again. So it costs
little, a lost word is no harm, nothing has to be discovered for one more name, and the middleware may do without its
own messages about liveliness across the link. A process that has died is missed after the lease; one that ends in
order says so. What has to be noticed sooner, between the nodes of a robot, is for
:mod:`flexbt_common.liveness.liveliness`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks

from flexbt_common import names
from flexbt_common.errors import LimitExceededError
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import check_limits
from flexbt_core.clock import Timer
from flexbt_core.values import sendable
from flexbt_msgs.msg import PeerStatus

WORD_SECONDS: Final = 1.0
"""From one word of a token to the next."""

PRESENCE_LEASE_SECONDS: Final = 5.0
"""How long a watcher waits for a word. Of a link that loses 30 % of its packets, one in 400 silences is so long."""


MOST_TOKENS: Final = 1000
"""Tokens that a watcher remembers; of more, those that it has heard before count until they are silent."""


class PresenceToken:
    """Says that ``name`` is there until the runtime is closed. Any number of tokens may have the same name."""

    def __init__(self, runtime: NodeRuntime, name: str) -> None:
        # The time of its making tells it from the other tokens of that name.
        self._word = PeerStatus(name=sendable(name), alive=True, since=runtime.clock.stamp())
        self._runtime = runtime
        runtime.call(self._open)
        runtime.on_close(self._leave)

    def _open(self) -> None:
        node = self._runtime.node
        matched = PublisherEventCallbacks(matched=lambda _event: self._speak())
        self._publisher = node.create_publisher(
            PeerStatus, names.EXECUTIVE_PRESENCE, names.unacknowledged(), event_callbacks=matched
        )
        # Wall time: also while simulated time stands still.
        node.create_timer(WORD_SECONDS, self._speak, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _speak(self) -> None:
        self._publisher.publish(self._word)

    def _leave(self) -> None:
        self._word.alive = False
        self._speak()


class PresenceWatch:
    """Watches who is there. Used on the executor thread only.

    ``present`` are the names under which a token has been heard lately.
    """

    def __init__(self, runtime: NodeRuntime) -> None:
        self.present: frozenset[str] = frozenset()
        self._runtime = runtime
        self._listeners: list[Callable[[], None]] = []
        self._heard: dict[tuple[str, int, int], float] = {}
        self._look: Timer | None = None
        self._subscription = runtime.node.create_subscription(
            PeerStatus,
            names.EXECUTIVE_PRESENCE,
            self._hear,
            names.unacknowledged(),
            event_callbacks=SubscriptionEventCallbacks(matched=self._matched),
        )

    @property
    def tokens(self) -> int:
        """How many tokens have been heard lately."""
        return len(self._heard)

    def add_listener(self, on_change: Callable[[], None]) -> None:
        """Call ``on_change`` after each change of :attr:`present`."""
        self._listeners.append(on_change)

    def _hear(self, word: PeerStatus) -> None:
        try:
            check_limits(word)
        except LimitExceededError as error:
            self._runtime.node.get_logger().error(
                f'{names.EXECUTIVE_PRESENCE}: left aside: {error}', throttle_duration_sec=PRESENCE_LEASE_SECONDS
            )
            return
        token = (word.name, word.since.sec, word.since.nanosec)
        if not word.alive:
            self._heard.pop(token, None)
        elif token in self._heard or len(self._heard) < MOST_TOKENS:
            self._heard[token] = self._runtime.steady.now()
        self._review()

    def _matched(self, event: Any) -> None:
        if event.current_count == 0:
            self._heard.clear()
            self._review()

    def _review(self) -> None:
        now = self._runtime.steady.now()
        self._heard = {token: heard for token, heard in self._heard.items() if now < heard + PRESENCE_LEASE_SECONDS}
        if self._look is None and self._heard:
            first_end = min(self._heard.values()) + PRESENCE_LEASE_SECONDS
            self._look = self._runtime.steady.call_at(first_end, lambda: self._runtime.post(self._look_again))
        present = frozenset(name for name, _, _ in self._heard)
        if present != self.present:
            self.present = present
            for listener in self._listeners:
                listener()

    def _look_again(self) -> None:
        self._look = None
        self._review()
