# SPDX-License-Identifier: BSD-3-Clause
"""The observer of a run, and which watchers the parameters ask for. Without watchers a run pays nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from flexbt_core.behavior_tree.engine.observers import Log
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_server.groot2.log_file import TeeLog


class TreeObserver(Protocol):
    """Hears of a run, on the thread of the run; of the end of one that is aborted, on another."""

    def started(self, tree: Tree) -> None:
        """The nodes exist; the first tick is next."""

    def expanded(self, tree: Tree) -> None:
        """Leave have had trees made below them: the nodes are others, and so are uids, from the next mark on."""

    @property
    def log(self) -> Log | None:
        """Where the tree is to log changes of statuses, if anywhere."""

    def ticked(self) -> None:
        """A round of a tick is over."""

    def paused(self, is_paused: bool) -> None:
        """The tree is not ticked from now on, or is again."""

    def ended(self) -> None:
        """Nothing follows."""


# Who watches a run beside the clients of the server: what its parameters ask for. If nothing, it costs nothing.


class RunWatch(Protocol):
    """Watches one run, on its thread."""

    @property
    def log(self) -> Log:
        """Where the tree is to log changes of statuses; always the same."""

    def started(self, tree: Tree) -> None:
        """The nodes exist; the first tick is next."""

    def expanded(self, tree: Tree) -> None:
        """The nodes are others from the next mark on."""

    def ticked(self) -> None:
        """A round of a tick is over."""

    def ended(self) -> None:
        """Nothing follows."""


class RunWatcher(Protocol):
    """A part of the server that watches every run."""

    def open(self, run_id: str, shown: TreeObserver) -> RunWatch:
        """Begin to watch a run. ``shown`` is what the clients of the server see of it, such as that it is paused."""


def watched_by(stream: TreeObserver, run_id: str, watchers: Sequence[RunWatcher]) -> TreeObserver:
    """Return the observer that stands for the stream of a run and for all who watch it."""
    return _Observers(stream, [watcher.open(run_id, stream) for watcher in watchers]) if watchers else stream


class _Observers:
    def __init__(self, stream: TreeObserver, watches: Sequence[RunWatch]) -> None:
        self._stream = stream
        self._watches = watches
        logs = [watch.log for watch in watches]
        if stream.log is not None:
            logs.append(stream.log)
        self.log: Log | None = TeeLog(logs) if len(logs) > 1 else logs[0]

    def started(self, tree: Tree) -> None:
        self._stream.started(tree)
        for watch in self._watches:
            watch.started(tree)

    def expanded(self, tree: Tree) -> None:
        self._stream.expanded(tree)
        for watch in self._watches:
            watch.expanded(tree)

    def ticked(self) -> None:
        self._stream.ticked()
        for watch in self._watches:
            watch.ticked()

    def paused(self, is_paused: bool) -> None:
        self._stream.paused(is_paused)

    def ended(self) -> None:
        for watch in self._watches:
            watch.ended()
        self._stream.ended()
