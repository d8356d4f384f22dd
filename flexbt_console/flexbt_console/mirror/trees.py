# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees that run on the robot, as its operator sees them: nodes, statuses, and since when each holds."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Final

from .records import Peer

REMEMBERED_TREES: Final = 8
"""Runs of trees that are remembered: those that go on, and the latest that have ended."""

GONE_SECONDS: Final = 60.0
"""Time for which a run is remembered after its server is gone, s."""

BT_SERVER: Final = 'bt_server'
"""Name of the node that runs trees, if a message does not have it (flexbt_common.names)."""

_UNKNOWN: Final = -math.inf


class MirroredStatus(IntEnum):
    """TreeStatus: the status of a node."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


class MirroredNodeKind(IntEnum):
    """TreeNode: the sort of a node."""

    UNKNOWN = 0
    ACTION = 1
    CONDITION = 2
    CONTROL = 3
    DECORATOR = 4
    SUBTREE = 5


@dataclass(frozen=True, slots=True)
class MirroredNode:
    """A node of a tree (TreeNode): ``uid`` from 1, ``parent`` 0 for the root."""

    uid: int
    parent: int
    name: str
    registration: str
    path: str = ''
    kind: MirroredNodeKind = MirroredNodeKind.UNKNOWN


@dataclass(frozen=True, slots=True)
class StatusChange:
    """One transition of one node, at ``stamp`` seconds on the clock of the node that runs the tree."""

    stamp: float
    uid: int
    status: MirroredStatus


@dataclass(frozen=True, slots=True)
class TreeNodes:
    """The nodes of a run of a tree (TreeStructure); ``left_out`` more are not among them."""

    run_id: str
    tree: str
    nodes: Sequence[MirroredNode]
    stamp: float
    structure: int = 1
    left_out: int = 0


@dataclass(frozen=True, slots=True)
class TreeReport:
    """What has happened in a run of a tree since the report before (TreeStatus).

    ``structure`` is the number of its nodes, ``server`` the node that has sent it, '' if unknown.
    """

    run_id: str
    sequence: int
    statuses: Sequence[MirroredStatus]
    changes: Sequence[StatusChange]
    stamp: float
    finished: bool
    paused: bool
    structure: int = 1
    server: str = ''


@dataclass(frozen=True, slots=True)
class MirroredTree:
    """One run of a tree. ``statuses``, ``last`` and ``since`` belong to ``nodes``, one each.

    ``since`` is in seconds on the clock of the node that runs the tree, ``stamp`` the latest time on it that is known.
    ``last`` is how each node ended before: a halted node is IDLE, and what it had come to says why.
    ``structure`` is TreeStructure.number: a run may get other nodes, and has none while those are not known of which
    its statuses tell. ``left_out`` nodes behind these are not known: there are too many.
    ``server`` is the node that runs it, '' if unknown. ``gone_at`` is when that was found to be gone, in seconds on the
    reader's clock: statuses are the last that were heard. ``life`` is the life of the server in which the latest status
    came: the executive that knew of it, and since when the server was alive for that; None when that life is over.
    """

    run_id: str
    tree: str = ''
    nodes: tuple[MirroredNode, ...] = ()
    statuses: tuple[MirroredStatus, ...] = ()
    last: tuple[MirroredStatus, ...] = ()
    since: tuple[float, ...] = ()
    stamp: float = 0.0
    sequence: int = 0
    finished: bool = False
    paused: bool = False
    structure: int = 0
    left_out: int = 0
    server: str = ''
    life: tuple[str, float] | None = field(default=('', _UNKNOWN), compare=False)
    gone_at: float | None = None

    @property
    def is_running(self) -> bool:
        """Return whether it has begun and not ended, and the node that runs it is not gone."""
        return self.sequence > 0 and not self.finished and not self.server_gone

    @property
    def server_gone(self) -> bool:
        """Return whether the node that ran it is gone, and has not reported its end."""
        return self.gone_at is not None

    def children(self, uid: int) -> tuple[MirroredNode, ...]:
        """Return the children of a node, in their order; of 0, the root."""
        return tuple(node for node in self.nodes if node.parent == uid)

    def status(self, uid: int) -> MirroredStatus:
        """Return the status of a node."""
        return self.statuses[uid - 1] if 0 < uid <= len(self.statuses) else MirroredStatus.IDLE

    def last_end(self, uid: int) -> MirroredStatus:
        """Return how a node ended the last time in this run; IDLE when it has not."""
        return self.last[uid - 1] if 0 < uid <= len(self.last) else MirroredStatus.IDLE

    def shown_status(self, uid: int) -> MirroredStatus:
        """Return the status of a node; for an idle one, how it ended before."""
        status = self.status(uid)
        return status if status is not MirroredStatus.IDLE else self.last_end(uid)

    def seconds(self, uid: int) -> float:
        """Return for how long a node has had its status."""
        return max(0.0, self.stamp - self.since[uid - 1]) if 0 < uid <= len(self.since) else 0.0

    @property
    def running_leaves(self) -> tuple[int, ...]:
        """The active leaves, without those below which a tree was made only while that does nothing."""
        if self.server_gone:
            return ()
        running = [node for node in self.nodes if self.status(node.uid) is MirroredStatus.RUNNING]
        parents, busy = {node.parent for node in self.nodes}, {node.parent for node in running}
        return tuple(
            node.uid
            for node in running
            if node.uid not in parents or (node.kind is MirroredNodeKind.ACTION and node.uid not in busy)
        )


class Trees:
    """The runs of trees, put together from structures and statuses that may be late, doubled or lost.

    A server that is killed does not say how its runs end, and the middleware misses it after its lease of 20 s. Its
    executive knows sooner: see :meth:`receive_peers`.
    """

    def __init__(self) -> None:
        self._runs: OrderedDict[str, MirroredTree] = OrderedDict()
        self._executive = ''
        self._peers: dict[str, Peer] = {}
        self._changed: set[str] = set()  # those that came or went since the snapshot before

    def forget_runs(self) -> None:
        """Forget all runs: trees are not received any more."""
        self._runs.clear()

    def receive_peers(self, executive_id: str, peers: Sequence[Peer], now: float) -> None:
        """Process the peers that an executive reports. Runs of a server that is gone, or was replaced by another
        process, end.
        """
        before = self._peers if executive_id == self._executive else {}
        self._executive, self._peers = executive_id, {peer.name: peer for peer in peers if peer.expected}
        self._changed = {name for name, peer in self._peers.items() if peer.since != before.get(name, peer).since}
        for run_id, run in self._runs.items():
            self._runs[run_id] = self._judged(run, now)

    def servers_left(self, there: Collection[str], now: float) -> None:
        """Record that the middleware misses the publishers of trees, except for these nodes."""
        for run_id, run in self._runs.items():
            if run.is_running and (run.server not in there if run.server else not there):
                self._runs[run_id] = replace(run, life=None, gone_at=now)

    def receive_structure(self, new: TreeNodes) -> None:
        """Process the nodes of a run, unless newer ones are known."""
        known = self._runs.get(new.run_id, MirroredTree(new.run_id, stamp=new.stamp))
        if new.structure < known.structure:
            return
        known = _of(known, new.structure, new.nodes)
        known = replace(known, tree=new.tree, nodes=tuple(new.nodes), left_out=new.left_out)
        self._keep(_fitted(known, new.stamp))

    def receive_status(self, report: TreeReport, now: float = 0.0) -> bool:
        """Process a report of a run; return False for one that is not newer than what is known.

        ``now`` is in seconds on the reader's clock.
        """
        stamp = report.stamp
        known = self._runs.get(report.run_id, MirroredTree(report.run_id, stamp=stamp))
        if report.sequence <= known.sequence or report.structure < known.structure:
            return False
        known = _fitted(_of(known, report.structure, ()), stamp, len(report.statuses))
        since, last = list(known.since), list(known.last)
        for change in report.changes:
            if 0 < change.uid <= len(since):
                since[change.uid - 1] = change.stamp
                if change.status in (MirroredStatus.SUCCESS, MirroredStatus.FAILURE, MirroredStatus.SKIPPED):
                    last[change.uid - 1] = change.status
                elif change.status is MirroredStatus.RUNNING:
                    last[change.uid - 1] = MirroredStatus.IDLE
        run = replace(
            known,
            sequence=report.sequence,
            statuses=tuple(report.statuses),
            since=tuple(since),
            last=tuple(last),
            stamp=max(stamp, known.stamp),
            finished=report.finished,
            paused=report.paused,
            server=report.server or known.server,
            life=(self._executive, _UNKNOWN),  # it may be of a process that the executive reports next
            gone_at=None,
        )
        peer = self._peer(run)
        if peer is not None and not peer.alive and not run.finished:  # it is back, unless this was sent before it went
            run = replace(run, life=None if stamp <= peer.since else ('', _UNKNOWN), gone_at=now)
        self._keep(run)
        return True

    def runs(self, now: float = 0.0) -> tuple[MirroredTree, ...]:
        """Return the runs whose nodes are known: running ones first, then the others; the latest of each first."""
        for run_id, run in list(self._runs.items()):
            if run.gone_at is not None and now - run.gone_at > GONE_SECONDS:
                del self._runs[run_id]
        known = [run for run in reversed(self._runs.values()) if run.nodes]
        return tuple(sorted(known, key=lambda run: not run.is_running))

    def _keep(self, run: MirroredTree) -> None:
        self._runs[run.run_id] = run
        while len(self._runs) > REMEMBERED_TREES:
            over = (run_id for run_id, known in self._runs.items() if known.finished or known.server_gone)
            del self._runs[next(over, next(iter(self._runs)))]

    def _peer(self, run: MirroredTree) -> Peer | None:
        """Return what the executive reports about the node that runs it, if it knows that node."""
        if run.server:
            return self._peers.get(run.server)
        return next((peer for name, peer in self._peers.items() if name.rpartition('/')[2] == BT_SERVER), None)

    def _judged(self, run: MirroredTree, now: float) -> MirroredTree:
        """Return the run, updated by what the executive reports about its server."""
        peer = self._peer(run)
        if run.sequence == 0 or run.finished or run.life is None or peer is None:
            return run
        executive, since = run.life
        is_over = False
        if executive == self._executive:  # another one does not know how it was before
            # Whether the latest status was sent before the server came, or went; other clocks say nothing of that.
            is_before = run.stamp < peer.since if peer.alive else run.stamp <= peer.since
            is_over = since != peer.since or not peer.alive
            if since == _UNKNOWN:
                is_over = is_before and peer.name in self._changed
        if is_over:
            return replace(run, life=None, gone_at=now if run.gone_at is None else run.gone_at)
        if peer.alive:
            return replace(run, life=(self._executive, peer.since), gone_at=None)
        return replace(run, gone_at=now if run.gone_at is None else run.gone_at)


def _of(run: MirroredTree, structure: int, nodes: Sequence[MirroredNode]) -> MirroredTree:
    """Return the run when its nodes are those of ``structure``: of others than before it keeps what is known of the
    nodes that both have, which come first."""
    if structure == run.structure:
        return run
    both = zip(run.nodes, nodes, strict=False)
    same = next((at for at, (before, after) in enumerate(both) if before != after), min(len(run.nodes), len(nodes)))
    return replace(
        run,
        structure=structure,
        nodes=(),
        statuses=run.statuses[:same],
        last=run.last[:same],
        since=run.since[:same],
    )


def _fitted(run: MirroredTree, stamp: float, count: int = 0) -> MirroredTree:
    """Return the run with a status and a time for each node, also for nodes about which nothing is known."""
    count = max(count, len(run.nodes))
    missing = count - len(run.statuses)
    if missing <= 0:
        return run
    idle = (MirroredStatus.IDLE,) * missing
    return replace(run, statuses=run.statuses + idle, last=run.last + idle, since=run.since + (stamp,) * missing)
