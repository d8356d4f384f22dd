# SPDX-License-Identifier: BSD-3-Clause
"""Hooks: code that is called before or after the ticks of a node, and may replace what they give.

A tree without hooks pays nothing for them. With the first hook, the parents of all nodes are given other callables to
tick their children by; with the last one gone they get the plain ones back. Each takes effect when the next tick of the
tree begins; in between, a hook that is set or removed counts at once, also for the rest of a tick that another hook
holds up::

    tree.hooks.set_before(node, lambda node: NodeStatus.SUCCESS)     # the node succeeds without being ticked
    tree.hooks.set_after(node, lambda node, status: print(node.path, status) or status)
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeStatus

if TYPE_CHECKING:
    from flexbt_core.behavior_tree.engine.context import TreeContext
    from flexbt_core.behavior_tree.engine.node import Execute, TreeNode

BeforeTick = Callable[['TreeNode'], NodeStatus]
"""Called after the pre-conditions of a node. SUCCESS or FAILURE replaces its tick; with anything else it is ticked."""

AfterTick = Callable[['TreeNode', NodeStatus], NodeStatus]
"""Called with what a node gives, after its post-conditions. SUCCESS or FAILURE replaces it, anything else does not."""


class TickHooks:
    """The hooks of one tree: :attr:`Tree.hooks`. May be used from any thread; a hook runs on the ticking thread.

    When a hook replaces what a node gives that is RUNNING, the node is halted first: whatever it does must not go on
    while its parent takes it for done. What a hook raises is an error of the node; ``TickAbandoned`` ends the tick.
    """

    def __init__(self, context: TreeContext, nodes: Sequence[TreeNode]) -> None:
        self._context = context
        self._nodes = nodes
        self._before: dict[TreeNode, BeforeTick] = {}
        self._after: dict[TreeNode, AfterTick] = {}
        self.replaced: set[TreeNode] = set()
        """Nodes whose last result a hook has given."""
        self._lock = threading.Lock()
        self._released = False
        self.on_release: Callable[[], None] | None = None
        """Called, from any thread, by :meth:`release`: a hook that waits for something has to look now."""

    def set_before(self, node: TreeNode, hook: BeforeTick | None) -> None:
        """Calls ``hook`` before each tick of the node, unless its last result still stands; None: no hook."""
        self._set(self._before, node, hook)

    def set_after(self, node: TreeNode, hook: AfterTick | None) -> None:
        """Calls ``hook`` after each tick of the node, whatever it gave; None: no hook."""
        self._set(self._after, node, hook)

    def clear(self) -> None:
        """Removes all hooks."""
        with self._lock:
            self._before.clear()
            self._after.clear()
            self._switch()

    def release(self) -> None:
        """The host wants to stop the tree: what hooks wait for is not to be waited for any more. From any thread."""
        self._released = True
        on_release = self.on_release
        if on_release is not None:
            on_release()

    @property
    def released(self) -> bool:
        """Whether the host wants to stop the tree. A hook that waits raises TickAbandoned then."""
        return self._released

    def _set(self, hooks: dict[TreeNode, Any], node: TreeNode, hook: Any) -> None:
        with self._lock:
            if hook is None:
                hooks.pop(node, None)
            else:
                hooks[node] = hook
            self._switch()

    def _switch(self) -> None:
        """Says whether the callables of nodes are to have hooks, and has them fetched anew when that is news."""
        used = bool(self._before or self._after)
        if used is not (self._context.hooks is not None):
            self._context.hooks = self if used else None
            self._context.exchanged.extend(self._nodes)

    # -- while the callables are fetched ------------------------------------------------------------------------------

    def around(self, node: TreeNode, execute: Execute) -> Execute:
        """``execute`` with the hooks of the node; without the one before, if that comes after pre-conditions."""
        begin = execute if hasattr(node, '_conditions') else self.before(node, execute)
        hooks = self._after

        def execute_and_ask() -> NodeStatus:
            self.replaced.discard(node)
            status = begin()
            hook = hooks.get(node)
            if hook is not None:
                given = _opinion(node, lambda: hook(node, status))
                if given is not None and given is not status:
                    return self._complete(node, given)
            return status

        return execute_and_ask

    def before(self, node: TreeNode, execute: Execute) -> Execute:
        """``execute`` with the hook before it."""
        hooks = self._before

        def ask_and_execute() -> NodeStatus:
            hook = hooks.get(node)
            if hook is not None and (node.status is IDLE or node.status is RUNNING):
                given = _opinion(node, lambda: hook(node))
                if given is not None:
                    return self._complete(node, given)
            return execute()

        return ask_and_execute

    def _complete(self, node: TreeNode, result: NodeStatus) -> NodeStatus:
        if node.status is RUNNING:
            node.halt()
        node.status = result
        self.replaced.add(node)
        return result


def _opinion(node: TreeNode, hook: Callable[[], NodeStatus]) -> NodeStatus | None:
    """The result that a hook wants the node to have."""
    try:
        given = hook()
    except NodeExecutionError:
        raise
    except BaseException as error:
        raise node.fault(error) from error
    return given if given is SUCCESS or given is FAILURE else None
