# SPDX-License-Identifier: BSD-3-Clause
"""Whether another node's process is alive, known within a fraction of a second, at no cost to those who watch; and
whether it is ready.

A node holds a token: a publisher on ``<name>/alive``, which it asserts some times a second. The name is that of the
node, or of what it stands for; several nodes may hold the same, which is alive while one of them is. The middleware of
a watcher takes the assertions, without waking Python, and tells when they stop: at once when the node ends in order,
after the lease when the process is killed, or when its interpreter hangs. (A participant's own lease, on which the
action clients' ``server_is_ready`` depends, is seconds.)

Alive is not ready: a process lives for seconds before the last of its actions and services exists. The message on the
token's topic says whether the node is ready, and whoever comes later gets it too. A node that has said nothing is not.

The token is asserted by hand, because that is between itself and its watchers. What DDS asserts automatically goes to
every process of the domain: among 12 robots it was half of what an idle executive had to do, and it grows with each.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool

from flexbt_common.names import alive_topic
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer

LEASE_SECONDS: Final = 0.5
"""A watcher notices after this time that the token is not asserted any more."""

ASSERT_SECONDS: Final = 0.15
"""From one assertion to the next."""

GRACE_SECONDS: Final = 0.25
"""A loss is told only when it lasts this long: on a busy machine an assertion may be late, and what a death causes
cannot be taken back."""

START_SECONDS: Final = 5.0
"""In this time of its own life, a process waits for the first assertion of a token: when it takes the place of one that
was killed, the middleware of the others does not reach it for up to 2.5 s (measured; Fast DDS over shared memory)."""

STARTED: Final = time.monotonic()
"""When this process was new: this module is loaded then."""


def _qos() -> QoSProfile:
    _check_profile()
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(nanoseconds=int(LEASE_SECONDS * 1e9)),
    )


def _check_profile() -> None:
    """Fast DDS would end the process without a word.

    Raises:
        RuntimeError: the profile in use turns the protocol off by which liveliness is told.
    """
    file = Path(os.environ.get('FASTRTPS_DEFAULT_PROFILES_FILE', ''))
    if file.is_file() and '<use_WriterLivelinessProtocol>false<' in file.read_text(errors='replace'):
        raise RuntimeError(
            f'{file} turns the liveliness protocol off, which the nodes of a robot need; '
            'set FASTRTPS_DEFAULT_PROFILES_FILE to another profile (radio_robot.xml beside radio_console.xml)'
        )


class LivelinessToken:
    """Says that this process is alive, as long as it has the node; under the name of the node, or another ``name``.

    Whatever part of a node wants a token: it is one for the whole node, and stays when that part has ended.
    """

    def __init__(self, runtime: NodeRuntime, name: str = '') -> None:
        topic = alive_topic(name or runtime.node.get_fully_qualified_name())
        self._held = runtime.call(lambda: runtime.once(('token', topic), lambda runtime: _HeldToken(runtime, topic)))

    def set_ready(self, is_ready: bool) -> None:
        """Say whether all that others need of the node exists and works. From any thread."""
        self._held.publish(is_ready)


class _HeldToken:
    def __init__(self, runtime: NodeRuntime, topic: str) -> None:
        self._runtime = runtime
        self._publisher = runtime.node.create_publisher(Bool, topic, _qos())
        self.publish(False)  # also for those who have not missed the process whose place this one takes
        self._assert()

    def publish(self, is_ready: bool) -> None:
        with contextlib.suppress(InvalidHandle):  # the node is gone
            self._publisher.publish(Bool(data=is_ready))

    def _assert(self) -> None:
        """On the clock's thread, which no callback of the node holds up. It ends with the runtime."""
        try:
            self._publisher.assert_liveliness()
        except InvalidHandle:  # the node is gone
            return
        steady = self._runtime.steady
        steady.call_at(steady.now() + ASSERT_SECONDS, self._assert)


class LivelinessWatch:
    """Watches the token of the node ``node_name`` (relative to this node's namespace, or fully qualified).

    ``on_change`` is called on the executor thread with the new value of :attr:`alive`, ``on_ready`` with that of
    :attr:`ready`.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        node_name: str,
        on_change: Callable[[bool], None],
        on_ready: Callable[[bool], None] = lambda _is_ready: None,
    ) -> None:
        self.node_name = node_name
        self._runtime = runtime
        self._on_change = on_change
        self._on_ready = on_ready
        self._told: bool | None = None
        self._told_ready = False
        # On the executor thread, so that no event comes before all is there that it needs.
        runtime.call(self._open)
        runtime.on_close(self.close)

    def _open(self) -> None:
        topic = self._runtime.node.resolve_topic_name(alive_topic(self.node_name))
        token = self._token = self._runtime.once(('liveliness', topic), lambda runtime: _SeenToken(runtime, topic))
        token.listeners.append(self._tell)
        if token.alive:
            self._runtime.post(lambda: self._tell() if token.alive and self._tell in token.listeners else None)

    @property
    def alive(self) -> bool | None:
        """True while the node is alive, False since it stopped, None while it has never been seen."""
        return self._token.alive

    @property
    def ready(self) -> bool:
        """Whether the node is alive, and has said that it is ready."""
        return self._token.ready

    def close(self) -> None:
        """Stop watching; ``on_change`` is not called any more. From any thread."""
        self._runtime.post(self._close)

    def _close(self) -> None:
        if self._tell in self._token.listeners:
            self._token.listeners.remove(self._tell)

    def _tell(self) -> None:
        alive, ready = self._token.alive, self._token.ready
        if alive is not None and alive is not self._told:
            self._told = alive
            self._on_change(alive)
        if ready is not self._told_ready:
            self._told_ready = ready
            self._on_ready(ready)


class _SeenToken:
    """A token as its watchers on one node see it.

    There is one subscription for all of them, which stays as long as the node: to a later one Fast DDS does not tell
    that the token is asserted already, and its counts are wrong from then on.
    """

    def __init__(self, runtime: NodeRuntime, topic: str) -> None:
        self.alive: bool | None = None
        self.listeners: list[Callable[[], None]] = []
        self._says_ready = False
        self._is_stale = False  # said before the loss; still true if it is the same node that comes back
        self._runtime = runtime
        self._loss: Timer | None = None
        runtime.node.create_subscription(
            Bool,
            topic,
            self._hear,
            _qos(),
            event_callbacks=SubscriptionEventCallbacks(liveliness=self._liveliness_changed, matched=self._matched),
        )

    @property
    def ready(self) -> bool:
        return self.alive is True and self._says_ready

    def _hear(self, message: Bool) -> None:
        self._says_ready, self._is_stale = message.data, False
        self._inform()

    def _matched(self, event: Any) -> None:
        if event.current_count_change > 0 and self._is_stale:
            self._says_ready = self._is_stale = False
        # Without this, a node that is killed before its token has been asserted once would never be missed.
        if event.current_count_change > 0 and not self.alive:
            self._tell(True)
            start_left = STARTED + START_SECONDS - time.monotonic()
            self._expect_assertion(max(LEASE_SECONDS + GRACE_SECONDS, start_left))

    def _liveliness_changed(self, event: Any) -> None:
        self._forget_loss()
        if event.alive_count > 0:
            self._tell(True)
        elif self.alive:
            self._expect_assertion(GRACE_SECONDS)

    def _expect_assertion(self, seconds: float) -> None:
        steady = self._runtime.steady
        self._loss = steady.call_at(steady.now() + seconds, lambda: self._runtime.post(self._tell_loss))

    def _tell_loss(self) -> None:
        if self._loss is not None:
            self._loss = None
            self._is_stale = True
            self._tell(False)

    def _forget_loss(self) -> None:
        if self._loss is not None:
            self._loss.cancel()
            self._loss = None

    def _tell(self, alive: bool) -> None:
        self.alive = alive
        self._inform()

    def _inform(self) -> None:
        for listener in list(self.listeners):
            listener()
