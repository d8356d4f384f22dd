# SPDX-License-Identifier: BSD-3-Clause
"""Nodes and their bases, building a tree, ticking and halting it."""

from .conditions import Conditions, NodeScript
from .context import Tick, TreeContext, UnfinishedWork
from .control import Control, ControlNode
from .decorator import Decorator, DecoratorNode
from .derived_classes import kept_by_class
from .expanding import ExpandingAction
from .leaf import Condition, Halted, LeafNode, StatefulAction, SyncAction
from .node import NO_PORTS, NodeConfig, StatusObserver, TreeNode, node_path
from .registry import NodeRegistry, declared_id
from .tick_callbacks import PostTick, PreTick, TickCallbacks
from .tick_control import TickCommand, TickControl
from .ticking import halt_child
from .tree import Tree
from .tree_builder import Substitute, SubTreeInstance

__all__ = [
    'NO_PORTS',
    'Condition',
    'Conditions',
    'Control',
    'ControlNode',
    'Decorator',
    'DecoratorNode',
    'ExpandingAction',
    'Halted',
    'LeafNode',
    'NodeConfig',
    'NodeRegistry',
    'NodeScript',
    'PostTick',
    'PreTick',
    'StatefulAction',
    'StatusObserver',
    'SubTreeInstance',
    'Substitute',
    'SyncAction',
    'Tick',
    'TickCallbacks',
    'TickCommand',
    'TickControl',
    'Tree',
    'TreeContext',
    'TreeNode',
    'UnfinishedWork',
    'declared_id',
    'halt_child',
    'kept_by_class',
    'node_path',
]
