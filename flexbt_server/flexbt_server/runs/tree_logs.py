# SPDX-License-Identifier: BSD-3-Clause
"""The topic ``behavior_tree_log`` of Nav2: the changes of statuses in each round of a tick.

(Nav2 publishes them between two ticks only, and so never those by which a tree ends.) While nobody subscribes, no
message is made.
"""

from __future__ import annotations

import time
from typing import Any, Final

from nav2_msgs.msg import BehaviorTreeLog, BehaviorTreeStatusChange

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_core.behavior_tree import NodeStatus, Tree, log_reader
from flexbt_server.groot2 import LogBuffer

from .run_watchers import RunWatch
from .tree_observer import TreeObserver

MOST_CHANGES: Final = 1000
"""Changes of one message."""

Change = tuple[int, int, int]
"""The uid of a node, and its status before and after."""


class TreeLogs:
    """Publishes the log of every run."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._publisher: Any = runtime.call(
            lambda: runtime.node.create_publisher(BehaviorTreeLog, names.BEHAVIOR_TREE_LOG, 10)
        )

    def open(self, run_id: str, shown: TreeObserver) -> RunWatch:
        """Watches one run."""
        return _TreeLog(self)

    def publish(self, names_of: dict[int, str], changes: list[Change]) -> None:
        """Send changes that have just been, from any thread. A tree runs on, watched or not."""
        if not self._publisher.get_subscription_count():
            return
        now = self._runtime.clock.stamp()
        log = [
            BehaviorTreeStatusChange(
                timestamp=now,
                node_name=names_of[uid],
                uid=uid,
                previous_status=NodeStatus(before).name,
                current_status=NodeStatus(after).name,
            )
            for uid, before, after in changes
        ]
        try:
            for first in range(0, len(log), MOST_CHANGES):
                self._publisher.publish(BehaviorTreeLog(timestamp=now, event_log=log[first : first + MOST_CHANGES]))
        except Exception as error:
            self._runtime.report_fault(error, f'the topic {names.BEHAVIOR_TREE_LOG}')


class _TreeLog:
    """The log of one run."""

    def __init__(self, logs: TreeLogs) -> None:
        self.log = LogBuffer(time.monotonic_ns)
        self._logs = logs

    def started(self, tree: Tree) -> None:
        self._names = {node.uid: node.name for node in tree.nodes}
        self._reader = log_reader(tree.nodes, lambda uid, before, after: (uid, before, after))

    def expanded(self, tree: Tree) -> None:
        self.ticked()
        self.started(tree)

    def ticked(self) -> None:
        marks = self.log.take()
        if marks:
            self._logs.publish(self._names, self._reader.read(marks))

    def ended(self) -> None:
        self.ticked()
