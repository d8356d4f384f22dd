# SPDX-License-Identifier: BSD-3-Clause
"""Runs of trees, and who watches them."""

from .groot2_runs import Groot2Runs
from .run_logs import RunLogs
from .run_outcome import RunOutcome
from .run_watchers import RunWatcher, watched_by
from .tree_logs import TreeLogs
from .tree_run import TreeRun
from .tree_stream import NoStream, TreeStream, tree_structure

__all__ = [
    'Groot2Runs',
    'NoStream',
    'RunLogs',
    'RunOutcome',
    'RunWatcher',
    'TreeLogs',
    'TreeRun',
    'TreeStream',
    'tree_structure',
    'watched_by',
]
