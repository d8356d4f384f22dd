# SPDX-License-Identifier: BSD-3-Clause
"""Whether somebody at the other end of a link that may be bad is there, known within some seconds.

A presence token says a word a second, which the middleware neither acknowledges nor sends again, to those who watch for
it. So it costs little, a lost word is no harm, and the middleware may do without its own messages about liveliness
across the link. A process that has died is missed after the lease; one that ends in order, at once. For what has to be
noticed sooner, between the nodes of a robot, there is :mod:`flexbt_common.liveliness`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Empty

from flexbt_common.clock import Timer
from flexbt_common.names import alive_topic
from flexbt_common.node_runtime import NodeRuntime

WORD_SECONDS: Final = 1.0
"""From one word of a token to the next."""

LEASE_SECONDS: Final = 5.0
"""How long a watcher waits for a word. Of a link that loses 30 % of its packets, one in 400 silences is so long."""


def _qos() -> QoSProfile:
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class PresenceToken:
    """Says under a ``name`` that this node is there, until its runtime is closed. Any number may hold the same name."""

    def __init__(self, runtime: NodeRuntime, name: str) -> None:
        def open_token() -> None:
            publisher = runtime.node.create_publisher(Empty, alive_topic(name), _qos())
            # Wall time: also while simulated time stands still.
            clock = Clock(clock_type=ClockType.STEADY_TIME)
            runtime.node.create_timer(WORD_SECONDS, lambda: publisher.publish(Empty()), clock=clock)

        runtime.call(open_token)


class PresenceWatch:
    """Watches whether anybody holds a token of that name.

    ``on_change`` is called on the executor thread with the new value of :attr:`alive`.
    """

    def __init__(self, runtime: NodeRuntime, name: str, on_change: Callable[[bool], None]) -> None:
        self._runtime = runtime
        self._on_change = on_change
        self._alive: bool | None = None
        self._heard = 0.0
        self._look: Timer | None = None
        self._subscription: Any = None
        runtime.call(lambda: self._open(alive_topic(name)))

    @property
    def alive(self) -> bool | None:
        """True while somebody is there, False since nobody is, None while nobody has ever been there."""
        return self._alive

    def close(self) -> None:
        """Stop watching; ``on_change`` is not called any more. From any thread."""
        self._runtime.post(self._close)

    def _open(self, topic: str) -> None:
        # On the executor thread, so that no event comes before there is the subscription.
        self._subscription = self._runtime.node.create_subscription(
            Empty,
            topic,
            lambda _word: self._hear(),
            _qos(),
            event_callbacks=SubscriptionEventCallbacks(matched=self._matched),
        )

    def _close(self) -> None:
        self._forget_look()
        if self._subscription is not None:
            self._runtime.node.destroy_subscription(self._subscription)
            self._subscription = None

    def _matched(self, event: Any) -> None:
        if event.current_count == 0:
            self._forget_look()
            self._tell(False)
        elif event.current_count_change > 0:
            self._hear()

    def _hear(self) -> None:
        self._heard = self._runtime.steady.now()
        if self._look is None and self._subscription is not None:
            self._look_after_lease()
        self._tell(True)

    def _look_after_lease(self) -> None:
        self._look = self._runtime.steady.call_at(
            self._heard + LEASE_SECONDS, lambda: self._runtime.post(self._lease_is_over)
        )

    def _lease_is_over(self) -> None:
        if self._look is None:
            return  # it was forgotten while this was on its way
        self._look = None
        if self._runtime.steady.now() < self._heard + LEASE_SECONDS:
            self._look_after_lease()
        else:
            self._tell(False)

    def _forget_look(self) -> None:
        if self._look is not None:
            self._look.cancel()
            self._look = None

    def _tell(self, alive: bool) -> None:
        if self._subscription is not None and alive is not self._alive:
            self._alive = alive
            self._on_change(alive)
