# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees that run on the robot, as its operator sees them: nodes, statuses, and since when each holds."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

REMEMBERED_TREES: Final = 8
"""Runs of trees that are remembered: those that go on, and the latest that have ended."""


class NodeStatus(IntEnum):
    """TreeStatus: the status of a node."""

    IDLE = 0
    RUNNING = 1
    SUCCESS = 2
    FAILURE = 3
    SKIPPED = 4


class NodeKind(IntEnum):
    """TreeNode: the sort of a node."""

    UNKNOWN = 0
    ACTION = 1
    CONDITION = 2
    CONTROL = 3
    DECORATOR = 4
    SUBTREE = 5


@dataclass(frozen=True, slots=True)
class TreeNode:
    """A node of a tree (TreeNode): ``uid`` from 1, ``parent`` 0 for the root."""

    uid: int
    parent: int
    name: str
    registration: str
    path: str = ''
    kind: NodeKind = NodeKind.UNKNOWN


@dataclass(frozen=True, slots=True)
class StatusChange:
    """One transition of one node, at ``stamp`` seconds on the clock of the node that runs the tree."""

    stamp: float
    uid: int
    status: NodeStatus


@dataclass(frozen=True, slots=True)
class TreeRun:
    """One run of a tree. ``statuses``, ``last`` and ``since`` belong to ``nodes``, one each.

    ``since`` is in seconds on the clock of the node that runs the tree, ``stamp`` the latest time on it that is known.
    ``last`` is how each node ended before: a halted node is IDLE, and what it had come to says why.
    ``structure`` is TreeStructure.number: a run may get other nodes, and has none while those are not known of which
    its statuses tell. ``left_out`` nodes behind these are not known: there are too many.
    """

    run_id: str
    tree: str = ''
    nodes: tuple[TreeNode, ...] = ()
    statuses: tuple[NodeStatus, ...] = ()
    last: tuple[NodeStatus, ...] = ()
    since: tuple[float, ...] = ()
    stamp: float = 0.0
    sequence: int = 0
    finished: bool = False
    paused: bool = False
    structure: int = 0
    left_out: int = 0

    @property
    def is_running(self) -> bool:
        """Whether it has begun and not ended."""
        return self.sequence > 0 and not self.finished

    def children(self, uid: int) -> tuple[TreeNode, ...]:
        """The children of a node, in their order; of 0, the root."""
        return tuple(node for node in self.nodes if node.parent == uid)

    def status(self, uid: int) -> NodeStatus:
        """The status of a node."""
        return self.statuses[uid - 1] if 0 < uid <= len(self.statuses) else NodeStatus.IDLE

    def last_end(self, uid: int) -> NodeStatus:
        """How a node ended the last time in this run; IDLE when it has not."""
        return self.last[uid - 1] if 0 < uid <= len(self.last) else NodeStatus.IDLE

    def shown_status(self, uid: int) -> NodeStatus:
        """The status of a node; of one that is idle, how it ended before."""
        status = self.status(uid)
        return status if status is not NodeStatus.IDLE else self.last_end(uid)

    def seconds(self, uid: int) -> float:
        """How long a node has had its status."""
        return max(0.0, self.stamp - self.since[uid - 1]) if 0 < uid <= len(self.since) else 0.0

    @property
    def running_leaves(self) -> tuple[int, ...]:
        """The leaves that act now; one below which a tree was made only while that does nothing."""
        running = [node for node in self.nodes if self.status(node.uid) is NodeStatus.RUNNING]
        parents, busy = {node.parent for node in self.nodes}, {node.parent for node in running}
        return tuple(
            node.uid
            for node in running
            if node.uid not in parents or (node.kind is NodeKind.ACTION and node.uid not in busy)
        )


class Trees:
    """The runs of trees, put together from structures and statuses that may be late, doubled or lost."""

    def __init__(self) -> None:
        self._runs: OrderedDict[str, TreeRun] = OrderedDict()

    def receive_structure(
        self, run_id: str, tree: str, nodes: Sequence[TreeNode], stamp: float, structure: int = 1, left_out: int = 0
    ) -> None:
        """Take the nodes of a run, unless it has others by now; ``left_out`` more are not among them."""
        known = self._runs.get(run_id, TreeRun(run_id, stamp=stamp))
        if structure < known.structure:
            return
        known = _of(known, structure, nodes)
        self._keep(_fitted(replace(known, tree=tree, nodes=tuple(nodes), left_out=left_out), stamp))

    def receive_status(
        self,
        run_id: str,
        sequence: int,
        statuses: Sequence[NodeStatus],
        changes: Sequence[StatusChange],
        stamp: float,
        *,
        finished: bool,
        paused: bool,
        structure: int = 1,
    ) -> bool:
        """Take what has happened since the message before; False for one that is not newer than what is known."""
        known = self._runs.get(run_id, TreeRun(run_id, stamp=stamp))
        if sequence <= known.sequence or structure < known.structure:
            return False
        known = _fitted(_of(known, structure, ()), stamp, len(statuses))
        since, last = list(known.since), list(known.last)
        for change in changes:
            if 0 < change.uid <= len(since):
                since[change.uid - 1] = change.stamp
                if change.status in (NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.SKIPPED):
                    last[change.uid - 1] = change.status
                elif change.status is NodeStatus.RUNNING:
                    last[change.uid - 1] = NodeStatus.IDLE
        self._keep(
            replace(
                known,
                sequence=sequence,
                statuses=tuple(statuses),
                since=tuple(since),
                last=tuple(last),
                stamp=max(stamp, known.stamp),
                finished=finished,
                paused=paused,
            )
        )
        return True

    def runs(self) -> tuple[TreeRun, ...]:
        """The runs whose nodes are known: those that go on first, then the others; the latest of each first."""
        known = [run for run in reversed(self._runs.values()) if run.nodes]
        return tuple(sorted(known, key=lambda run: not run.is_running))

    def _keep(self, run: TreeRun) -> None:
        self._runs[run.run_id] = run
        while len(self._runs) > REMEMBERED_TREES:
            ended = next((run_id for run_id, known in self._runs.items() if known.finished), next(iter(self._runs)))
            del self._runs[ended]


def _of(run: TreeRun, structure: int, nodes: Sequence[TreeNode]) -> TreeRun:
    """The run when its nodes are those of ``structure``: of others than before it keeps what is known of the nodes that
    both have, which come first."""
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


def _fitted(run: TreeRun, stamp: float, count: int = 0) -> TreeRun:
    """With a status and a time for each node, also for those that nothing is known of."""
    count = max(count, len(run.nodes))
    missing = count - len(run.statuses)
    if missing <= 0:
        return run
    idle = (NodeStatus.IDLE,) * missing
    return replace(run, statuses=run.statuses + idle, last=run.last + idle, since=run.since + (stamp,) * missing)
