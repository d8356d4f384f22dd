# SPDX-License-Identifier: BSD-3-Clause
"""Whether another node's process is alive, known within a fraction of a second, at no cost while nothing happens.

A node holds a token: a publisher on ``<name>/alive`` with automatic liveliness. The name is that of the node, or of
what it stands for; several nodes may hold the same, which is alive while one of them is. The middleware of its
process asserts it, without waking Python, and tells the watchers when it stops: at once when the node ends in order,
after the lease when the process is killed. (A participant's own lease, on which the action clients'
``server_is_ready`` depends, is seconds.)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Empty

from flexbt_common.clock import Timer
from flexbt_common.names import alive_topic
from flexbt_common.node_runtime import NodeRuntime

LEASE_SECONDS: Final = 0.5
"""A watcher notices after this time that the middleware, which asserts each two thirds of it, no longer does."""

GRACE_SECONDS: Final = 0.25
"""A loss is told only when it lasts this long: on a busy machine an assertion may be late, and what a death causes
cannot be taken back."""


def _qos() -> QoSProfile:
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
        liveliness=LivelinessPolicy.AUTOMATIC,
        liveliness_lease_duration=Duration(nanoseconds=int(LEASE_SECONDS * 1e9)),
    )


class LivelinessToken:
    """Says that this process is alive, until the runtime is closed; under the name of the node, or another ``name``."""

    def __init__(self, runtime: NodeRuntime, name: str = '') -> None:
        self._runtime = runtime
        topic = alive_topic(name or runtime.node.get_fully_qualified_name())
        self._publisher = runtime.call(lambda: runtime.node.create_publisher(Empty, topic, _qos()))


class LivelinessWatch:
    """Watches the token of the node ``node_name`` (relative to this node's namespace, or fully qualified).

    ``on_change`` is called on the executor thread with the new value of :attr:`alive`.
    """

    def __init__(self, runtime: NodeRuntime, node_name: str, on_change: Callable[[bool], None]) -> None:
        self.node_name = node_name
        self._runtime = runtime
        self._on_change = on_change
        self._alive: bool | None = None
        self._loss: Timer | None = None
        self._subscription: Any = None
        runtime.call(self._open)

    def _open(self) -> None:
        # On the executor thread, so that no event comes before there is the subscription.
        self._subscription = self._runtime.node.create_subscription(
            Empty,
            alive_topic(self.node_name),
            lambda _message: None,
            _qos(),
            event_callbacks=SubscriptionEventCallbacks(liveliness=self._liveliness_changed, matched=self._matched),
        )

    @property
    def alive(self) -> bool | None:
        """True while the node is alive, False since it stopped, None while it has never been seen."""
        return self._alive

    def close(self) -> None:
        """Stop watching; ``on_change`` is not called any more. From any thread."""
        self._runtime.post(self._close)

    def _close(self) -> None:
        self._forget_loss()
        if self._subscription is not None:
            self._runtime.node.destroy_subscription(self._subscription)
            self._subscription = None

    def _matched(self, event: Any) -> None:
        # Without this, a node that is killed before its token has been asserted once would never be missed.
        if event.current_count_change > 0 and not self._alive:
            self._tell(True)
            self._expect_assertion(LEASE_SECONDS + GRACE_SECONDS)

    def _liveliness_changed(self, event: Any) -> None:
        self._forget_loss()
        if event.alive_count > 0:
            self._tell(True)
        elif self._alive:
            self._expect_assertion(GRACE_SECONDS)

    def _expect_assertion(self, seconds: float) -> None:
        steady = self._runtime.steady
        self._loss = steady.call_at(steady.now() + seconds, lambda: self._runtime.post(self._tell_loss))

    def _tell_loss(self) -> None:
        if self._loss is not None:
            self._loss = None
            self._tell(False)

    def _forget_loss(self) -> None:
        if self._loss is not None:
            self._loss.cancel()
            self._loss = None

    def _tell(self, alive: bool) -> None:
        if self._subscription is not None and alive is not self._alive:
            self._alive = alive
            self._on_change(alive)
