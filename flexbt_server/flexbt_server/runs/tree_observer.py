# SPDX-License-Identifier: BSD-3-Clause
"""Who hears of a run while it goes on."""

from __future__ import annotations

from typing import Protocol

from flexbt_core.behavior_tree import Log, Tree


class TreeObserver(Protocol):
    """Hears of a run, on the thread of the run; of the end of one that is aborted, on another."""

    def started(self, tree: Tree) -> None:
        """The nodes exist; the first tick is next."""

    def expanded(self, tree: Tree) -> None:
        """Leaves have had trees made below them: the nodes are others, and so are uids, from the next mark on."""

    @property
    def log(self) -> Log | None:
        """Where the tree is to log changes of statuses, if anywhere."""

    def ticked(self) -> None:
        """A round of a tick is over."""

    def paused(self, is_paused: bool) -> None:
        """The tree is not ticked from now on, or is again."""

    def ended(self) -> None:
        """Nothing follows."""
