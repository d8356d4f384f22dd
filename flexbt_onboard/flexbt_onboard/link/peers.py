# SPDX-License-Identifier: BSD-3-Clause
"""The nodes that the executive depends on: whether they are alive, late, ready; for the operator and for a start."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from builtin_interfaces.msg import Time

from flexbt_common import names as table
from flexbt_common.liveness import LivelinessWatch
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer
from flexbt_core.values import sendable
from flexbt_msgs.msg import PeerStatus

LATE_SECONDS: Final = 2.0
"""A node that is late for so long is told of. On a busy computer all are late for a moment; the status shows it."""


@dataclass
class _Peer:
    name: str
    since: Time
    alive: bool | None = None
    ready: bool = False
    told_ready: bool = False
    tell_late: Timer | None = None
    gone_at: float = 0.0


class PeersWatch:
    """Watches nodes by name. Used on the executor thread, except where it says otherwise.

    ``on_change`` is called with a node's name, whether it is alive now, and whether it had been seen before;
    ``on_ready`` with a node's name when it has become ready, or is not any more, and whether that is a change:
    it is none when it was late meanwhile; ``on_late`` with a node's name and '' when it is late, or is not any more,
    and with the reason once in a spell of LATE_SECONDS. ``timeout``: how long one may be late, s of wall time.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        names: Sequence[str],
        on_change: Callable[[str, bool, bool], None],
        on_ready: Callable[[str, bool, bool], None],
        on_late: Callable[[str, str], None],
        timeout: float,
    ) -> None:
        self._runtime = runtime
        self._on_change = on_change
        self._on_ready = on_ready
        self._on_late = on_late
        self._peers = [_Peer(_qualified(runtime, name), runtime.clock.stamp()) for name in names]
        # On the executor thread, so that nothing is told before all of them are there.
        self._watches = runtime.call(lambda: self._watch(timeout))

    def _watch(self, timeout: float) -> list[LivelinessWatch]:
        return [
            LivelinessWatch(
                self._runtime,
                peer.name,
                functools.partial(self._changed, peer),
                functools.partial(self._ready_changed, peer),
                functools.partial(self._late_changed, peer),
                timeout,
            )
            for peer in self._peers
        ]

    def statuses(self) -> list[PeerStatus]:
        """What is known of each, in the order of the names; one that was never seen is not alive."""
        return [
            PeerStatus(
                name=peer.name,
                alive=bool(peer.alive),
                late=watch.late,
                age=watch.age,
                ready=peer.ready,
                problem=sendable(watch.problem) or self._absence(peer),
                since=peer.since,
            )
            for peer, watch in zip(self._peers, self._watches, strict=True)
        ]

    def gone(self) -> list[str]:
        """The names of those that were alive, and are not any more."""
        return [peer.name for peer in self._peers if peer.alive is False]

    def late(self) -> bool:
        """Whether one of them is late."""
        return any(watch.late for watch in self._watches)

    def silent(self) -> bool:
        """Whether one of them is not heard, and is not known to have ended."""
        return any(watch.silent for watch in self._watches)

    def has_ended(self, writer: bytes) -> bool:
        """Whether this is a writer of one of them whose process has ended for certain."""
        return any(watch.has_ended(writer) for watch in self._watches)

    def _absence(self, peer: _Peer) -> str:
        if peer.alive is None:
            return 'it was not seen yet; start it'
        if peer.alive:
            return ''
        seconds = self._runtime.steady.now() - peer.gone_at
        return f'its process ended, or is out of reach, since {seconds:.0f} s; restart it'

    def unready(self) -> list[str]:
        """The names of those that are alive, and not ready: they are starting, or late. From any thread."""
        return [peer.name for peer in self._peers if peer.alive and not peer.ready]

    def _changed(self, peer: _Peer, alive: bool) -> None:
        if alive == peer.alive:
            return
        seen_before = peer.alive is not None
        peer.alive, peer.since = alive, self._runtime.clock.stamp()
        peer.gone_at = self._runtime.steady.now()
        peer.told_ready = peer.told_ready and alive
        self._on_change(peer.name, alive, seen_before)

    def _late_changed(self, peer: _Peer, late: bool) -> None:
        if peer.tell_late is not None:
            peer.tell_late.cancel()
            peer.tell_late = None
        if late:
            steady = self._runtime.steady
            told = functools.partial(self._runtime.post, functools.partial(self._tell_late, peer))
            peer.tell_late = steady.call_at(steady.now() + LATE_SECONDS, told)
        self._on_late(peer.name, '')

    def _tell_late(self, peer: _Peer) -> None:
        watch = self._watch_of(peer)
        if watch.late:
            self._on_late(peer.name, watch.problem)

    def _ready_changed(self, peer: _Peer, ready: bool) -> None:
        peer.ready = ready
        watch = self._watch_of(peer)
        if ready or (watch.alive and not watch.late):  # that it is late or gone is told already
            has_changed, peer.told_ready = ready != peer.told_ready, ready
            self._on_ready(peer.name, ready, has_changed)

    def _watch_of(self, peer: _Peer) -> LivelinessWatch:
        return self._watches[self._peers.index(peer)]


def _qualified(runtime: NodeRuntime, name: str) -> str:
    """The fully qualified name of a node that is named relative to this one's namespace."""
    topic = table.alive_topic('')
    return str(runtime.node.resolve_topic_name(name + topic)).removesuffix(topic)
