# SPDX-License-Identifier: BSD-3-Clause
"""The nodes that the executive depends on: whether they are alive, for the operator."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from builtin_interfaces.msg import Time

from flexbt_common import names as table
from flexbt_common.liveliness import LivelinessWatch
from flexbt_common.node_runtime import NodeRuntime
from flexbt_msgs.msg import PeerStatus


@dataclass
class _Peer:
    name: str
    alive: bool | None
    since: Time


class PeersWatch:
    """Watches nodes by name. Used on the executor thread only.

    ``on_change`` is called with a node's name, whether it is alive now, and whether it had been seen before.
    """

    def __init__(
        self, runtime: NodeRuntime, names: Sequence[str], on_change: Callable[[str, bool, bool], None]
    ) -> None:
        self._runtime = runtime
        self._on_change = on_change
        self._peers = [_Peer(_qualified(runtime, name), None, runtime.clock.stamp()) for name in names]
        self._watches = [
            LivelinessWatch(runtime, name, functools.partial(self._changed, peer))
            for name, peer in zip(names, self._peers, strict=True)
        ]

    def statuses(self) -> list[PeerStatus]:
        """What is known of each, in the order of the names; one that was never seen is not alive."""
        return [PeerStatus(name=peer.name, alive=bool(peer.alive), since=peer.since) for peer in self._peers]

    def _changed(self, peer: _Peer, alive: bool) -> None:
        if alive == peer.alive:
            return
        seen_before = peer.alive is not None
        peer.alive, peer.since = alive, self._runtime.clock.stamp()
        self._on_change(peer.name, alive, seen_before)


def _qualified(runtime: NodeRuntime, name: str) -> str:
    """The fully qualified name of a node that is named relative to this one's namespace."""
    topic = table.alive_topic('')
    return str(runtime.node.resolve_topic_name(name + topic)).removesuffix(topic)
