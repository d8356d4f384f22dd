# SPDX-License-Identifier: BSD-3-Clause
"""The node types of BehaviorTree.CPP."""

from __future__ import annotations

from flexbt_core.behavior_tree.engine import NodeRegistry, TreeNode
from flexbt_core.behavior_tree.script import ScriptLibrary

from . import (
    actions,
    conditionals,
    decorators,
    entry_updates,
    loops,
    parallel,
    reactive,
    script_nodes,
    sequences,
    switch,
    timing,
    try_catch,
)

# The node types of BehaviorTree.CPP 4 that this engine has, under their names there.
_BUILTIN: tuple[type[TreeNode], ...] = (
    sequences.Sequence,
    sequences.AsyncSequence,
    sequences.SequenceWithMemory,
    sequences.Fallback,
    sequences.AsyncFallback,
    reactive.ReactiveSequence,
    reactive.ReactiveFallback,
    parallel.Parallel,
    parallel.ParallelAll,
    conditionals.IfThenElse,
    conditionals.WhileDoElse,
    switch.Switch2,
    switch.Switch3,
    switch.Switch4,
    switch.Switch5,
    switch.Switch6,
    try_catch.TryCatch,
    decorators.Inverter,
    decorators.ForceSuccess,
    decorators.ForceFailure,
    decorators.Repeat,
    decorators.RetryUntilSuccessful,
    decorators.KeepRunningUntilFailure,
    decorators.RunOnce,
    decorators.SubTree,
    loops.LoopInt,
    loops.LoopBool,
    loops.LoopDouble,
    loops.LoopString,
    entry_updates.SkipUnlessUpdated,
    entry_updates.WaitValueUpdate,
    entry_updates.WasEntryUpdated,
    script_nodes.Script,
    script_nodes.ScriptCondition,
    script_nodes.Precondition,
    timing.Timeout,
    timing.Delay,
    timing.Sleep,
    actions.AlwaysSuccess,
    actions.AlwaysFailure,
    actions.SetBlackboard,
    actions.UnsetBlackboard,
)


def builtin_registry(scripts: ScriptLibrary | None = None) -> NodeRegistry:
    """A new registry with the node types of BehaviorTree.CPP."""
    registry = NodeRegistry(scripts)
    for node_class in _BUILTIN:
        registry.register(node_class.__name__, node_class)
    return registry
