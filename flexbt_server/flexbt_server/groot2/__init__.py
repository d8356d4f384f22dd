# SPDX-License-Identifier: BSD-3-Clause
"""What Groot2 understands: its protocol for running trees, the XML that describes them, and log files (``.btlog``).

Nothing here needs ROS. A program of one's own shows a tree to Groot2 by::

    with Groot2Server(1667) as groot2:
        with groot2.watch(tree):
            tree.tick_while_running(wait)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .log_buffer import LogBuffer, TeeLog
from .log_file import SUFFIX, Log, LogError, LoggedNode, LogWriter, Transition, read_log
from .tree_document import models_document

if TYPE_CHECKING:
    from .server import Groot2Server
    from .watched_tree import WatchedTree

__all__ = [
    'SUFFIX',
    'Groot2Server',
    'Log',
    'LogBuffer',
    'LogError',
    'LogWriter',
    'LoggedNode',
    'TeeLog',
    'Transition',
    'WatchedTree',
    'models_document',
    'read_log',
]


def __getattr__(name: str) -> Any:
    """Who serves Groot2 needs pyzmq and msgpack, who reads its files does not."""
    if name == 'Groot2Server':
        from .server import Groot2Server

        return Groot2Server
    if name == 'WatchedTree':
        from .watched_tree import WatchedTree

        return WatchedTree
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
