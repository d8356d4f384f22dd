# SPDX-License-Identifier: BSD-3-Clause
"""Publishes what happens in running trees: the structure once per run, then every status transition in order.

Transitions are collected and sent in batches, the first of a quiet time at once; the last ones are sent before the
result of the run. Each batch has the status of every node as well, so that a subscriber may join at any time.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any, Final

from flexbt_common import names
from flexbt_common.clock import Clock, Timer
from flexbt_common.node_runtime import NodeRuntime
from flexbt_msgs import msg
from flexbt_server.behavior_tree import NodeStatus, Tree, TreeNode
from flexbt_server.behavior_tree.node import ControlNode, DecoratorNode

BATCH_SECONDS: Final = 0.05
"""Least time between two messages of a run, wall time."""

RUNS_KEPT: Final = 16
"""Messages that a late subscriber gets; one run has one structure and its newest statuses."""


class TreeStream:
    """The two publishers, shared by all runs of a server."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        node = runtime.node
        qos = names.latched(RUNS_KEPT)
        self._structure = node.create_publisher(msg.TreeStructure, names.TREE_STRUCTURE, qos)
        self._status = node.create_publisher(msg.TreeStatus, names.TREE_STATUS, qos)

    def open(self, run_id: str, blackboard: str) -> RunStream:
        """The stream of one run."""
        return RunStream(self, self._runtime.steady, run_id, blackboard)

    def now(self) -> Any:
        """Stamp of a message."""
        return self._runtime.node.get_clock().now().to_msg()

    def publish_structure(self, message: msg.TreeStructure) -> None:
        """Send the structure of a run."""
        self._structure.publish(message)

    def publish_status(self, message: msg.TreeStatus) -> None:
        """Send a batch of a run."""
        self._status.publish(message)


class RunStream:
    """Observes one run (:class:`flexbt_server.tree_run.TreeObserver`)."""

    def __init__(self, stream: TreeStream, clock: Clock, run_id: str, blackboard: str) -> None:
        self._stream = stream
        self._clock = clock
        self._run_id = run_id
        self._blackboard = blackboard
        self._statuses: list[int] = []
        self._changes: list[msg.TreeStatusChange] = []
        self._sequence = 0
        self._next = 0.0
        self._timer: Timer | None = None
        self._paused = False
        self._lock = threading.Lock()

    def started(self, tree: Tree) -> None:
        self._statuses = [int(node.status) for node in tree.nodes]
        parents = _parents(tree.nodes)
        self._stream.publish_structure(
            msg.TreeStructure(
                stamp=self._stream.now(),
                run_id=self._run_id,
                behavior_tree=tree.key.id,
                blackboard=self._blackboard,
                nodes=[
                    msg.TreeNode(
                        uid=node.uid,
                        parent=parents.get(node.uid, 0),
                        name=node.name,
                        registration=node.id,
                        path=node.path,
                    )
                    for node in tree.nodes
                ],
            )
        )

    def changed(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        change = msg.TreeStatusChange(
            stamp=self._stream.now(), uid=node.uid, previous_status=int(before), status=int(after)
        )
        with self._lock:
            self._changes.append(change)
            self._statuses[node.uid - 1] = int(after)

    def ticked(self) -> None:
        with self._lock:
            if not self._changes or self._timer is not None:
                return
            now = self._clock.now()
            if now < self._next:
                self._timer = self._clock.call_at(self._next, self._flush)
                return
        self._flush()

    def paused(self, is_paused: bool) -> None:
        self._paused = is_paused
        self._flush(always=True)

    def ended(self) -> None:
        self._flush(always=True, finished=True)

    def _flush(self, always: bool = False, finished: bool = False) -> None:
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            changes, self._changes = self._changes, []
            if not changes and not always:
                return
            self._sequence += 1
            self._next = self._clock.now() + BATCH_SECONDS
            self._stream.publish_status(
                msg.TreeStatus(
                    stamp=self._stream.now(),
                    run_id=self._run_id,
                    sequence=self._sequence,
                    finished=finished,
                    paused=self._paused and not finished,
                    statuses=list(self._statuses),
                    changes=changes,
                )
            )


def _parents(nodes: Sequence[TreeNode]) -> dict[int, int]:
    parents: dict[int, int] = {}
    for node in nodes:
        if isinstance(node, ControlNode):
            parents.update((child.uid, node.uid) for child in node.children)
        elif isinstance(node, DecoratorNode):
            parents[node.child.uid] = node.uid
    return parents
