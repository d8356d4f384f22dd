# SPDX-License-Identifier: BSD-3-Clause
"""How nodes are ticked and halted from outside: what executeTick() and haltNode() are in BehaviorTree.CPP."""

from __future__ import annotations

from flexbt_core.behavior_tree.model import IDLE, RUNNING

from .context import Tick
from .node import TreeNode


def tick_function(node: TreeNode) -> Tick:
    """The callable by which a parent, or the tree, ticks ``node``.

    From the inside to the outside, as in BehaviorTree.CPP: the tick itself, the pre-tick callback, the post-conditions,
    the pre-conditions, the post-tick callback. A node that has none of them is ticked by its ``execute``.
    """
    callbacks = node.context.callbacks
    conditions = node.conditions
    tick: Tick = node.execute
    if callbacks is not None:
        tick = callbacks.before(node, tick)
    if conditions is not None:
        tick = conditions.around(tick)
    if callbacks is not None:
        tick = callbacks.after(node, tick)
    return tick


def halt_child(child: TreeNode) -> None:
    """Halts the child when it is RUNNING, and sets it to IDLE in any case."""
    status = child.status
    if status is not IDLE:
        if status is RUNNING:
            child.halt_node()
        child.status = IDLE
