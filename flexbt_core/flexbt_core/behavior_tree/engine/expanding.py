# SPDX-License-Identifier: BSD-3-Clause
"""The base of actions below which a tree is made while they run, such as that of a plan."""

from __future__ import annotations

from typing import NamedTuple

from flexbt_core.behavior_tree.model import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    Blackboard,
    NodeExecutionError,
    NodeStatus,
    PortError,
    TreeKey,
    TreeLibrary,
)

from .context import Tick
from .leaf import StatefulAction
from .node import NodeConfig, TreeNode
from .ticking import halt_child, tick_function


class Expansion(NamedTuple):
    """The tree that is to be below a node, and the blackboard of its nodes."""

    library: TreeLibrary
    key: TreeKey
    blackboard: Blackboard


class ExpandingAction(StatefulAction):
    """An action that has a tree made while it runs. ::

        def on_start(self):
            return self.expand(library, 'Way', Blackboard(self.blackboard))

        def on_running(self):
            return self.tick_tree()

    The nodes of that tree are nodes of the running tree, as those of a sub-tree: ticked, halted, paused and resumed
    with it, and seen by whoever observes it (:meth:`Tree.observe`). A tree takes the place of the one before.
    """

    __slots__ = ('_error', '_root', '_tick')

    goes_on = ''

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._root: TreeNode | None = None
        self._tick: Tick | None = None
        self._error: Exception | None = None

    def expand(self, library: TreeLibrary, tree_id: str, blackboard: Blackboard) -> NodeStatus:
        """Asks for a tree, which is there when this node is ticked next, at once; RUNNING.

        Raises LookupError when the library has no such tree.
        """
        key = library.find(tree_id)
        if key is None:
            raise LookupError(f'there is no tree [{tree_id}] to be made below [{self.path}]')
        self._halt_tree()
        self.context.expansions[self] = Expansion(library, key, blackboard)
        self.wake()
        return RUNNING

    def tick_tree(self) -> NodeStatus:
        """Ticks the tree; RUNNING as long as it is not there.

        Raises what has kept the tree from being made: TreeLoadError where it does not fit its blackboard.
        """
        if self._error is not None:
            raise self._error
        if self._tick is None or self in self.context.expansions:
            return RUNNING
        try:
            status = self._tick()
        except PortError as error:
            raise NodeExecutionError(error.node_path, error.node_id, error, error.uid) from error
        root = self._root
        if root is not None and (root.status is SUCCESS or root.status is FAILURE):
            root.status = IDLE
        return status

    def adopt(self, root: TreeNode | None, error: Exception | None = None) -> None:
        """The tree is there; or why it is not."""
        self._root = root
        self._error = error
        self.fetch_ticks()

    def fetch_ticks(self) -> None:
        """Fetches the callable by which the root of the tree is ticked, which may have been exchanged."""
        self._tick = None if self._root is None else tick_function(self._root)

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        return () if self._root is None else (self._root,)

    def halt(self) -> None:
        super().halt()
        self._halt_tree()

    def _halt_tree(self) -> None:
        self.context.expansions.pop(self, None)
        if self._root is not None:
            halt_child(self._root)
