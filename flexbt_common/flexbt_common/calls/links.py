# SPDX-License-Identifier: BSD-3-Clause
"""Connections of a node to servers, shared by all callers, so that each server is discovered once.

The middleware shows the servers of a killed process until the lease of its participant expires: 20 s with our
profiles. Nodes of FlexBT hold a liveliness token (:mod:`flexbt_common.lifecycle`), which shows within a second that
their servers are gone or were replaced by another process. For servers without a token, such as Nav2's own, only the
middleware's view is available.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, Final, Generic, NamedTuple, TypeVar

from rclpy.action.server import RCLError
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.subscription import Subscription

from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, LivelinessWatch, has_liveliness_protocol
from flexbt_common.middleware.received_messages import UNKNOWN_NODE
from flexbt_common.names import alive_topic, node_of
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.runtime.weak_lru_cache import WeakLruCache
from flexbt_common.values.value_types import message_type_name
from flexbt_core.clock.clock import Timer
from flexbt_core.values.text import short_repr

SETTLE_SECONDS: Final = 0.1
"""Delay from the discovery of a server to the first message to it, s, if the server may not have discovered this node
yet and would lose the message."""

NAME_SECONDS: Final = 1.0
"""Time to wait for the name of a server's node, s: it arrives later than the server, and for some servers never."""

MOST_LINKS: Final = 100
"""Maximum number of unused links of one kind that a node keeps."""

WATCH_SECONDS: Final = 0.2
"""Period of the check whether the servers of a call are gone, s."""

_APPEAR_PERIOD: Final = 0.05
"""Period of the check whether a server has appeared, s."""

_MOST_NODES: Final = 100
"""Maximum number of watched nodes for the calls of one node: their names come from other processes."""


class ServerEnd(NamedTuple):
    """One server of a name: its node, or '' while that is unknown, and the writer of its answers."""

    node: str
    writer: bytes


class ServerNodes:
    """The nodes with liveliness tokens whose servers a node calls. For the executor thread.

    ``timeout`` is the time for which a node may be late before it counts as gone, s of wall time.
    """

    def __init__(self, runtime: Runtime, timeout: float) -> None:
        self._runtime = runtime
        self._timeout = timeout
        self._watches: dict[str, LivelinessWatch] = {}
        self._can_watch = has_liveliness_protocol()

    def watch(self, node: str) -> LivelinessWatch | None:
        """Return the watch of a node; None while it holds no token."""
        watch = self._watches.get(node)
        if watch is None and node and self._can_add() and self._runtime.node.count_publishers(alive_topic(node)):
            watch = self._watches[node] = LivelinessWatch(self._runtime, node, timeout=self._timeout)
        return watch

    def _can_add(self) -> bool:
        if not self._can_watch:
            return False
        if len(self._watches) == _MOST_NODES:
            for node, watch in tuple(self._watches.items()):
                if watch.alive is False:
                    watch.close()
                    del self._watches[node]
        return len(self._watches) < _MOST_NODES


class Servers:
    """The servers of a name at one moment, and their state since then. Executor thread only."""

    def __init__(self, nodes: ServerNodes, ends: frozenset[ServerEnd]) -> None:
        self.ends = ends
        self._nodes = nodes

    @property
    def are_gone(self) -> bool:
        """True if servers exist and all are known to be gone: ended, replaced, or late for too long."""
        return bool(self.ends) and all(self.is_gone(end) for end in self.ends)

    @property
    def are_alive(self) -> bool:
        """True if servers exist, and all show that they are alive."""
        watches = [(self._nodes.watch(end.node), end.writer) for end in self.ends]
        return bool(watches) and all(
            watch is not None and watch.alive and not watch.late and not watch.is_gone(writer)
            for watch, writer in watches
        )

    @property
    def are_late(self) -> bool:
        """True if the node of a server is late: the server may only hang."""
        return any(watch.late for watch in self._watches())

    @property
    def are_silent(self) -> bool:
        """True if a server is late or gone but not known to have ended: it may return."""
        return any(self.is_silent(end) for end in self.ends)

    def is_gone(self, end: ServerEnd) -> bool:
        """Return whether this server is known to be gone."""
        watch = self._nodes.watch(end.node)
        return watch is not None and watch.is_gone(end.writer)

    def is_silent(self, end: ServerEnd) -> bool:
        """Return whether this server is silent but not known to have ended."""
        watch = self._nodes.watch(end.node)
        return watch is not None and watch.silent and not watch.has_ended(end.writer)

    def _watches(self) -> list[LivelinessWatch]:
        watches = (self._nodes.watch(end.node) for end in self.ends)
        return [watch for watch in watches if watch is not None]


class ServerLink:
    """The connection of a node to the server ``name``. Executor thread only."""

    kind: ClassVar[str]
    """Kind of the server in texts for people."""

    asks_silent: ClassVar[bool] = False
    """True if requests are sent even to a server that hangs for too long: it handles them when it continues."""

    entities: tuple[Any, ...]
    """rclpy's clients and subscriptions, for the executor thread; destroyed when nothing holds the link any more."""

    def __init__(
        self, runtime: Runtime, server_type: type[Any], name: str, nodes: ServerNodes, answer_topic: str
    ) -> None:
        """``answer_topic``: DDS name of a topic on which the server answers."""
        self.runtime = runtime
        self.server_type = server_type
        self.name = name
        self._nodes = nodes
        self._answer_topic = answer_topic
        self._seen: dict[bytes, float] = {}  # visible writers, and when they appeared
        self._ready = Servers(nodes, frozenset())  # at the last look at the graph, if available

    def __str__(self) -> str:
        return f'{self.kind} {self.name!r} ({message_type_name(self.server_type)})'

    def is_shown(self) -> bool:
        """Return whether the middleware shows a server of this name and type."""
        raise NotImplementedError

    def is_ready(self) -> bool:
        """Return whether a server is available now that is not known to be gone.

        If another server of this name is gone, a new one counts only after it has had time to discover this node, and
        a little later if the name of its node is unknown.
        """
        if not self.is_shown():
            self._seen.clear()
            self._ready = Servers(self._nodes, frozenset())
            return False
        if self._ready.are_alive:
            return True  # a look at all endpoints of the graph takes longer
        ends = self._ends()
        if not ends:
            return True  # a middleware with other endpoint names
        now = self.runtime.steady.now()
        self._seen = {end.writer: self._seen.get(end.writer, now) for end in ends}
        servers = Servers(self._nodes, ends)
        gone = {end for end in ends if self._is_out(servers, end)}
        settling = SETTLE_SECONDS if gone else 0.0
        is_ready = any(now - self._seen[end.writer] >= (settling if end.node else NAME_SECONDS) for end in ends - gone)
        self._ready = Servers(self._nodes, ends if is_ready else frozenset())
        return is_ready

    def is_gone(self) -> bool:
        """Return whether the servers of this name are all known to be gone."""
        return Servers(self._nodes, self._ends()).are_gone

    def servers(self) -> Servers:
        """Return the servers that exist now and are not known to be gone."""
        servers = Servers(self._nodes, self._ends())
        return Servers(self._nodes, frozenset(end for end in servers.ends if not self._is_out(servers, end)))

    def _is_out(self, servers: Servers, end: ServerEnd) -> bool:
        return servers.is_gone(end) and not (self.asks_silent and servers.is_silent(end))

    def _ends(self) -> frozenset[ServerEnd]:
        endpoints = self.runtime.node.get_publishers_info_by_topic(self._answer_topic, no_mangle=True)
        return frozenset(ServerEnd(_node_of(one), bytes(one.endpoint_gid)) for one in endpoints)


def _node_of(endpoint: Any) -> str:
    return '' if endpoint.node_name == UNKNOWN_NODE else node_of(endpoint)


LinkT = TypeVar('LinkT', bound=ServerLink)


class ServerLinks(Generic[LinkT]):
    """The links of one node, one for each type and name. From any thread.

    A link exists as long as something holds it, such as an active call. This object also holds the most recently
    requested links. Their number is limited, since the names of servers may come from other processes. The executor of
    the runtime destroys the remaining entities of its node when it ends.
    """

    link_class: ClassVar[type[Any]]

    def __init__(self, runtime: Runtime, peer_timeout: float = PEER_TIMEOUT) -> None:
        """``peer_timeout``: time for which a server's node may be late before it counts as gone, s of wall time."""
        self._runtime = runtime
        self._peer_timeout = peer_timeout
        self._links: WeakLruCache[tuple[Any, str], LinkT] = WeakLruCache(MOST_LINKS)

    def link(self, server_type: Any, name: str) -> LinkT:
        """Return the link to the server ``name``, created on first use.

        Raises:
            ValueError: no server can have that name, or this process uses the name with another type.
        """
        key = server_type, name
        known = self._links.used(key)
        return known if known is not None else self._runtime.call(lambda: self._links.get(key, lambda: self._new(*key)))

    def _new(self, server_type: Any, name: str) -> LinkT:
        timeout = self._peer_timeout
        nodes = self._runtime.shared((ServerNodes, timeout), lambda: ServerNodes(self._runtime, timeout))
        try:
            link: LinkT = self.link_class(self._runtime, server_type, name, nodes)
        except (RCLError, NameValidationException) as error:
            what = f'{self.link_class.kind} {short_repr(name)} ({message_type_name(server_type)})'
            raise ValueError(f'{what} cannot be called: {error}') from error
        destroy = partial(_destroy, self._runtime.node, link.entities)
        weakref.finalize(link, self._runtime.post, destroy).atexit = False
        return link


def _destroy(node: Node, entities: tuple[Any, ...]) -> None:
    """Destroy the entities of a link, on the executor thread."""
    for entity in entities:
        if isinstance(entity, Subscription):
            node.destroy_subscription(entity)
        else:
            node.destroy_client(entity)


OutcomeT = TypeVar('OutcomeT')


class ServerCall(Generic[LinkT, OutcomeT]):
    """A request to a server, sent once it is available, with exactly one outcome. Thread-safe."""

    def __init__(self, link: LinkT, on_done: Callable[[OutcomeT], None], server_timeout: float) -> None:
        """``on_done`` is called on the executor thread; ``server_timeout``: for the server to appear, s."""
        self._link = link
        self._runtime = link.runtime
        self._on_done = on_done
        self._server_timeout = server_timeout
        self._outcome: OutcomeT | None = None
        self._timers: dict[str, Timer] = {}
        self._servers: Servers | None = None
        self._runtime.post(lambda: self._wait_for_server(self._runtime.steady.now() + server_timeout))

    @property
    def done(self) -> bool:
        """True if the outcome is known."""
        return self._outcome is not None

    @property
    def outcome(self) -> OutcomeT | None:
        """The outcome; None until it is known."""
        return self._outcome

    # -------------------------------------------------- everything below runs on the executor thread

    def _send(self) -> None:
        """Send the request: the server is available."""
        raise NotImplementedError

    def _not_there(self, why: str) -> None:
        """End the call: no server has appeared."""
        raise NotImplementedError

    def _wait_for_server(self, deadline: float) -> None:
        if self.done:
            return
        if self._link.is_ready():
            self._servers = self._link.servers()
            self._send()
        elif self._runtime.steady.now() >= deadline:
            self._not_there(f'no {self._link} appeared within {self._server_timeout:g} s; is its node running?')
        else:
            self._after('appear', _APPEAR_PERIOD, lambda: self._wait_for_server(deadline))

    def _end(self, outcome: OutcomeT) -> None:
        self._outcome = outcome
        for timer in self._timers.values():
            timer.cancel()
        self._timers.clear()
        self._guarded(lambda: self._on_done(outcome))

    def _guarded(self, callback: Callable[[], None]) -> None:
        try:
            callback()
        except Exception as error:
            self._runtime.report_fault(error, f'a callback of the call of {self._link}')

    def _after(self, purpose: str, seconds: float, fn: Callable[[], None]) -> None:
        self._timers[purpose] = self._runtime.post_in(seconds, fn)

    def _drop(self, purpose: str) -> None:
        timer = self._timers.pop(purpose, None)
        if timer is not None:
            timer.cancel()
