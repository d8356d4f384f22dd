# SPDX-License-Identifier: BSD-3-Clause
"""A part of a node that has an end of its own: what a managed node makes when it is configured."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

from rclpy.action import ActionClient, ActionServer

from flexbt_common.names import CLOCK
from flexbt_common.runtime import CALL_SECONDS, NodeRuntime

T = TypeVar('T')


class NodeScope(NodeRuntime):
    """A runtime within another one: same node, executor and clocks; it ends before the other, and another may follow.

    All that has been made on the node since the scope began goes when it ends, so nobody has to keep account of it:
    what it registered with :meth:`on_close` is called, what it posted is dropped, and every entity is destroyed.
    Scopes of one node follow each other; they do not overlap.
    """

    def __init__(self, host: NodeRuntime) -> None:
        # Not what the base makes: that is the host's.
        self._host = host
        self.node = host.node
        self.default_context = host.default_context
        self.name = host.name
        self.nodes = host.nodes
        self.simulated_time = host.simulated_time
        self.clock = host.clock
        self.steady = host.steady
        self.health = host.health
        self._closed = threading.Event()
        self._on_close = []
        self._on_fault = []
        self._thread = host._thread
        self._lock = threading.RLock()
        self._before = host.call(self._entities)
        host.on_fault(self._tell_fault)

    @property
    def on_executor_thread(self) -> bool:
        """Whether the caller is on the executor thread."""
        return self._host.on_executor_thread

    def post(self, fn: Callable[[], object]) -> None:
        """As that of the host; dropped when the scope has ended meanwhile."""
        self._host.post(lambda: None if self.closed else fn())

    def call(self, fn: Callable[[], T], timeout: float = CALL_SECONDS) -> T:
        """As that of the host.

        Raises:
            TimeoutError: as that of the host.
            RuntimeError: the scope has ended.
        """

        def run() -> T:
            if self.closed:
                raise RuntimeError(f'this part of node {self.name} has ended; nothing can be run for it')
            return fn()

        return self._host.call(run, timeout)

    def once(self, key: Hashable, make: Callable[[NodeRuntime], T]) -> T:
        """As that of the host, for whom it is made: it stays when the scope has ended."""
        before = self._entities()
        made = self._host.once(key, make)
        new = {entity: destroy for entity, destroy in self._entities().items() if entity not in before}
        # Of what was made before, some may have been forgotten.
        self._before = {entity: destroy for entity, destroy in self._before.items() if entity in before} | new
        return made

    def forget(self, key: Hashable) -> None:
        """As that of the host."""
        self._host.forget(key)

    def abort(self, problem: str) -> None:
        """As that of the host."""
        self._host.abort(problem)

    def report_fault(self, error: BaseException, where: str = 'a callback') -> None:
        """As that of the host. Never raises."""
        self._host.report_fault(error, where)

    def fail(self, why: str) -> None:
        """As that of the host."""
        self._host.fail(why)

    def close(self) -> None:
        """End the scope. May be called twice, not from the executor thread."""
        self.close_components()
        if not self.closed:
            self._host.call(self._end)

    def _tell_fault(self, error: BaseException) -> None:
        for observer in self._on_fault:
            observer(error)

    def _end(self) -> None:
        self._closed.set()
        self._host._on_fault.remove(self._tell_fault)
        for entity, destroy in self._entities().items():
            if entity not in self._before:
                destroy(entity)

    def _entities(self) -> dict[Any, Callable[[Any], object]]:
        """What there is on the node, and how each is destroyed.

        Event handlers go with their topic. The node's own subscription to the simulated time is none of ours.
        """
        node: Any = self.node
        actions = [waitable for waitable in node.waitables if isinstance(waitable, ActionServer | ActionClient)]
        topics = [subscription for subscription in node.subscriptions if subscription.topic_name != CLOCK]
        return {
            **dict.fromkeys(actions, _destroy_action),
            **dict.fromkeys(topics, node.destroy_subscription),
            **dict.fromkeys(node.publishers, node.destroy_publisher),
            **dict.fromkeys(node.clients, node.destroy_client),
            **dict.fromkeys(node.services, node.destroy_service),
            **dict.fromkeys(node.timers, node.destroy_timer),
            **dict.fromkeys(node.guards, node.destroy_guard_condition),
        }


def _destroy_action(action: ActionServer | ActionClient) -> None:
    action.destroy()
