# SPDX-License-Identifier: BSD-3-Clause
"""The nodes that the executive depends on: whether they are alive, late, ready; for the operator and for a start."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from builtin_interfaces.msg import Time

from flexbt_common import names as table
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.msg import ExecutiveLog, PeerStatus
from flexbt_onboard.link.reporter import Reporter

LATE_SECONDS: Final = 2.0
"""Time for which a node may be late before it is reported, s. On a busy computer all are late for a moment; the status
shows it."""


@dataclass
class _Peer:
    name: str
    since: Time
    alive: bool | None = None
    ready: bool = False
    told_ready: bool = False
    tell_late: Timer | None = None
    gone_at: float = 0.0
    watch: LivelinessWatch = field(init=False)


class PeersWatch:
    """A watch over nodes by name. Used on the executor thread, except where noted.

    It reports to the operators when a node appears or disappears, and when it becomes ready or unready (not if it was
    late meanwhile). It reports once why a node is late, after LATE_SECONDS. ``timeout``: maximum lateness of a node,
    s of wall time.
    """

    def __init__(
        self, runtime: Runtime, names: Sequence[str], report: Reporter, timeout: float, *, are_expected: bool = True
    ) -> None:
        """``are_expected``: a node that has not been seen yet counts as a fault."""
        self._runtime = runtime
        self._are_expected = are_expected
        self._report = report
        self._listeners: list[Callable[[], None]] = []
        self._peers = [_Peer(_qualified(runtime, name), runtime.clock.stamp()) for name in names]
        # On the executor thread, so that nothing is reported before all of them are watched.
        runtime.call(lambda: self._watch(timeout))

    def _watch(self, timeout: float) -> None:
        for peer in self._peers:
            peer.watch = LivelinessWatch(
                self._runtime,
                peer.name,
                functools.partial(self._alive_changed, peer),
                functools.partial(self._ready_changed, peer),
                functools.partial(self._late_changed, peer),
                timeout,
            )

    def add_listener(self, changed: Callable[[], None]) -> None:
        """Call ``changed`` when :meth:`statuses` or :meth:`unready` have changed."""
        self._listeners.append(changed)

    def statuses(self) -> list[PeerStatus]:
        """Return the status of each node, in the order of the names. A node that was never seen is not alive."""
        return [
            PeerStatus(
                name=peer.name,
                alive=bool(peer.alive),
                late=peer.watch.late,
                age=peer.watch.age,
                ready=peer.ready,
                expected=self._are_expected or peer.alive is not None,
                problem=sanitize_for_message(peer.watch.problem) or self._absence(peer),
                since=peer.since,
            )
            for peer in self._peers
        ]

    def gone(self) -> list[str]:
        """Return the names of the nodes that were alive and have disappeared."""
        return [peer.name for peer in self._peers if peer.alive is False]

    def has_ended(self, writer: bytes) -> bool:
        """Return whether the writer belongs to a watched node whose process has certainly ended."""
        return any(peer.watch.has_ended(writer) for peer in self._peers)

    def _absence(self, peer: _Peer) -> str:
        if peer.alive is None:
            return 'it was not seen yet; start it'
        if peer.alive:
            return ''
        seconds = self._runtime.steady.now() - peer.gone_at
        return f'its process ended, or is out of reach, since {seconds:.0f} s; restart it'

    def unready(self) -> list[str]:
        """Return the names of the nodes that are alive but not ready: starting, or late. From any thread."""
        return [peer.name for peer in self._peers if peer.alive and not peer.ready]

    def starting(self) -> list[str]:
        """Return the names of the nodes that are alive, not ready yet, and not late: their servers may appear at any
        moment. From any thread."""
        return [peer.name for peer in self._peers if peer.alive and not peer.ready and not peer.watch.late]

    def _alive_changed(self, peer: _Peer, alive: bool) -> None:
        if alive == peer.alive:
            return
        again = '' if peer.alive is None else ' again'
        peer.alive, peer.since = alive, self._runtime.clock.stamp()
        peer.gone_at = self._runtime.steady.now()
        peer.told_ready = peer.told_ready and alive
        if alive:
            self._log(ExecutiveLog.INFO, f'{peer.name} is alive{again}')
        else:
            self._log(ExecutiveLog.ERROR, f'{peer.name} is not alive any more')
        self._tell_change()

    def _late_changed(self, peer: _Peer, late: bool) -> None:
        if peer.tell_late is not None:
            peer.tell_late.cancel()
            peer.tell_late = None
        if late:
            peer.tell_late = self._runtime.post_in(LATE_SECONDS, functools.partial(self._tell_late, peer))
        self._tell_change()

    def _tell_late(self, peer: _Peer) -> None:
        if peer.watch.late:
            self._log(ExecutiveLog.WARN, f'{peer.name} is late: {peer.watch.problem}')

    def _ready_changed(self, peer: _Peer, ready: bool) -> None:
        peer.ready = ready
        if ready or (peer.watch.alive and not peer.watch.late):  # late or gone: already reported
            if ready and not peer.told_ready:
                self._log(ExecutiveLog.INFO, f'{peer.name} is ready')
            elif peer.told_ready and not ready:
                self._log(ExecutiveLog.WARN, f'{peer.name} is alive, but not ready any more')
            peer.told_ready = ready
        self._tell_change()

    def _log(self, severity: int, text: str) -> None:
        self._report.log(severity, text, run_id=self._report.run_id)

    def _tell_change(self) -> None:
        for changed in self._listeners:
            changed()


def _qualified(runtime: Runtime, name: str) -> str:
    """Return the fully qualified name of a node that is named relative to this one's namespace."""
    topic = table.alive_topic('')
    return str(runtime.node.resolve_topic_name(name + topic)).removesuffix(topic)
