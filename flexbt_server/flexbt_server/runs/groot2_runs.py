# SPDX-License-Identifier: BSD-3-Clause
"""Shows the runs of the server to Groot2; see :class:`flexbt_server.groot2.Groot2Server`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from flexbt_common.runtime import NodeRuntime
from flexbt_core.behavior_tree import JsonTypes, Tree
from flexbt_server.errors import ServerParameterError
from flexbt_server.groot2 import LogBuffer

from .run_watchers import RunWatch
from .tree_observer import TreeObserver

if TYPE_CHECKING:
    from flexbt_server.groot2 import Groot2Server, WatchedTree


class Groot2Runs:
    """Opens the port, and closes it with the node."""

    def __init__(self, runtime: NodeRuntime, port: int, address: str, only: str, types: JsonTypes) -> None:
        """``only``: the ID of the tree that is shown, '' for the newest; ``types`` of what is on blackboards.

        Raises:
            ServerParameterError: the port cannot be opened.
        """
        try:
            # Only who wants it needs pyzmq.
            from flexbt_server.groot2 import Groot2Server
        except ImportError as error:
            raise ServerParameterError(
                f"parameter 'groot2_port': {error.name} is missing; install python3-zmq and python3-msgpack"
            ) from error
        try:
            self._server = Groot2Server(port, address, only=only, types=types)
        except OSError as error:
            raise ServerParameterError(f"parameter 'groot2_port': {error.strerror}") from error
        runtime.on_close(self._server.close)

    def open(self, run_id: str, shown: TreeObserver) -> RunWatch:
        """Watches one run."""
        return _Groot2Run(self._server, shown)


class _Groot2Run:
    def __init__(self, server: Groot2Server, shown: TreeObserver) -> None:
        self.log = LogBuffer(time.perf_counter_ns)
        self._server = server
        self._shown = shown
        self._watched: WatchedTree | None = None

    def started(self, tree: Tree) -> None:
        self._watched = self._server.add(tree, self.log, self._shown.paused)

    def expanded(self, tree: Tree) -> None:
        if self._watched is not None:
            self._watched = self._server.expanded(self._watched, self._shown.paused)

    def ticked(self) -> None:
        if self._watched is not None:
            self._watched.settle()
        else:
            self.log.take()

    def ended(self) -> None:
        if self._watched is not None:
            self._server.remove(self._watched)
