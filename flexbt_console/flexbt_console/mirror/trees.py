# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees that run on the robot, as the operator sees them: nodes, their statuses, and the times of those."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Final

from .records import Peer

REMEMBERED_TREES: Final = 8
"""Maximum number of remembered runs of trees: current ones, and the latest that have ended."""

GONE_SECONDS: Final = 60.0
"""Time for which a run is shown after its server is gone, s."""

BT_SERVER: Final = 'bt_server'
"""Name of the node that runs trees (flexbt_common.names); used when a message does not contain the name."""

_UNKNOWN: Final = -math.inf


class MirroredStatus(IntEnum):
    """The status of a node (TreeStatus)."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


class MirroredNodeKind(IntEnum):
    """The kind of a node (TreeNode)."""

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
    """The nodes of a run of a tree (TreeStructure), without ``left_out`` further ones."""

    run_id: str
    tree: str
    nodes: Sequence[MirroredNode]
    stamp: float
    structure: int = 1
    left_out: int = 0


@dataclass(frozen=True, slots=True)
class TreeReport:
    """The changes in a run of a tree since the previous report (TreeStatus).

    ``structure``: number of the TreeStructure that it refers to. ``server``: name of the sending node, '' if unknown.
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
    """One run of a tree. ``statuses``, ``last`` and ``since`` have one element for each of ``nodes``.

    ``last``: how each node ended before. A halted node is IDLE; its last end shows the reason.
    ``since``: time of the latest change of each node, s on the clock of the node that runs the tree.
    ``stamp``: latest known time of that clock, s.
    ``structure``: TreeStructure.number. The nodes of a run may change. ``nodes`` is empty while the statuses refer to
    nodes that have not arrived.
    ``left_out``: number of nodes behind these that are not known, because there are too many.
    ``server``: name of the node that runs the tree, '' if unknown.
    ``gone_at``: time at which that node was found to be gone, s on the reader's clock, or None. The statuses are then
    the last ones received.
    ``life``: the life of the server in which the latest status arrived, as the executive that reported it and the time
    since which that executive saw the server alive. None when that life is over.
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
        """True if the run has begun and not ended, and its server is not gone."""
        return self.sequence > 0 and not self.finished and not self.server_gone

    @property
    def server_gone(self) -> bool:
        """True if the server is gone and has not reported the end of the run."""
        return self.gone_at is not None

    def children(self, uid: int) -> tuple[MirroredNode, ...]:
        """Return the children of a node, in their order; for 0, the root."""
        return tuple(node for node in self.nodes if node.parent == uid)

    def status(self, uid: int) -> MirroredStatus:
        """Return the status of a node."""
        return self.statuses[uid - 1] if 0 < uid <= len(self.statuses) else MirroredStatus.IDLE

    def last_end(self, uid: int) -> MirroredStatus:
        """Return how a node ended the last time in this run; IDLE if it has not ended yet."""
        return self.last[uid - 1] if 0 < uid <= len(self.last) else MirroredStatus.IDLE

    def shown_status(self, uid: int) -> MirroredStatus:
        """Return the status of a node; for an idle node, how it ended before."""
        status = self.status(uid)
        return status if status is not MirroredStatus.IDLE else self.last_end(uid)

    def seconds(self, uid: int) -> float:
        """Return the time for which a node has had its status, s."""
        return max(0.0, self.stamp - self.since[uid - 1]) if 0 < uid <= len(self.since) else 0.0

    @property
    def running_leaves(self) -> tuple[int, ...]:
        """UIDs of the running nodes without children, and of the running actions none of whose children runs."""
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
    """The runs of trees, combined from structures and statuses that may be late, duplicated or lost.

    A server that is killed does not report the end of its runs, and the middleware notices its end only after its lease
    of 20 s. The executive notices sooner: see :meth:`receive_peers`.
    """

    def __init__(self) -> None:
        self._runs: OrderedDict[str, MirroredTree] = OrderedDict()
        self._executive = ''
        self._peers: dict[str, Peer] = {}
        self._changed: set[str] = set()  # peers that appeared or disappeared since the previous snapshot

    def forget_runs(self) -> None:
        """Forget all runs, because trees are no longer received."""
        self._runs.clear()

    def receive_peers(self, executive_id: str, peers: Sequence[Peer], now: float) -> None:
        """Process the peers that an executive reports. End the runs of a server that is gone or was replaced by another
        process.
        """
        before = self._peers if executive_id == self._executive else {}
        self._executive, self._peers = executive_id, {peer.name: peer for peer in peers if peer.expected}
        self._changed = {name for name, peer in self._peers.items() if peer.since != before.get(name, peer).since}
        for run_id, run in self._runs.items():
            self._runs[run_id] = self._judged(run, now)

    def servers_left(self, there: Collection[str], now: float) -> None:
        """Record that, of the publishers of trees, the middleware now sees only those of the nodes ``there``."""
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
        """Process a report of a run; return False if it is not newer than the latest one.

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
            life=(self._executive, _UNKNOWN),  # the executive may report the process only in its next snapshot
            gone_at=None,
        )
        peer = self._peer(run)
        if peer is not None and not peer.alive and not run.finished:  # back, unless this was sent before
            run = replace(run, life=None if stamp <= peer.since else ('', _UNKNOWN), gone_at=now)
        self._keep(run)
        return True

    def runs(self, now: float = 0.0) -> tuple[MirroredTree, ...]:
        """Return the runs whose nodes are known: running ones first, then the others; the latest of each first."""
        known = [
            run
            for run in reversed(self._runs.values())
            if run.nodes and (run.gone_at is None or now - run.gone_at <= GONE_SECONDS)
        ]
        return tuple(sorted(known, key=lambda run: not run.is_running))

    def _keep(self, run: MirroredTree) -> None:
        self._runs[run.run_id] = run
        while len(self._runs) > REMEMBERED_TREES:
            over = (run_id for run_id, known in self._runs.items() if known.finished or known.server_gone)
            del self._runs[next(over, next(iter(self._runs)))]

    def _peer(self, run: MirroredTree) -> Peer | None:
        """Return the server of a run as the executive reports it; None if the executive does not know that node."""
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
        if executive == self._executive:  # another executive does not know the earlier life
            # Only these two times, of the same clock, show whether the latest status was sent before the server
            # appeared or disappeared.
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
    """Return the run for the nodes of ``structure``. If that is a new one, keep only the statuses of the first nodes,
    up to the first that differs."""
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
    """Return the run with a status and a time for each node; nodes without any status are IDLE since ``stamp``."""
    count = max(count, len(run.nodes))
    missing = count - len(run.statuses)
    if missing <= 0:
        return run
    idle = (MirroredStatus.IDLE,) * missing
    return replace(run, statuses=run.statuses + idle, last=run.last + idle, since=run.since + (stamp,) * missing)
