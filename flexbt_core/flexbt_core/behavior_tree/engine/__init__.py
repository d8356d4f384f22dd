# SPDX-License-Identifier: BSD-3-Clause
"""Nodes and their bases, building a tree, ticking and halting it."""

from .conditions import Conditions, NodeScript
from .context import Tick, TreeContext, UnfinishedWork
from .control import Control, ControlNode
from .coroutine import CoroutineAction
from .decorator import Decorator, DecoratorNode
from .expanding import ExpandingAction
from .leaf import Condition, Halted, LeafNode, StatefulAction, SyncAction
from .node import NodeConfig, StatusObserver, TreeNode, node_path
from .node_skill import node_skill
from .node_skills import node_skills
from .registry import NodeRegistry
from .simple import SimpleAction, SimpleDecorator, simple_action, simple_condition, simple_decorator
from .threaded import ThreadedAction
from .tick_callbacks import PostTick, PreTick, TickCallbacks
from .tick_control import TickCommand, TickControl
from .ticking import halt_child
from .tree import Tree
from .tree_builder import Substitute, SubTreeInstance

__all__ = [
    'Condition',
    'Conditions',
    'Control',
    'ControlNode',
    'CoroutineAction',
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
    'SimpleAction',
    'SimpleDecorator',
    'StatefulAction',
    'StatusObserver',
    'SubTreeInstance',
    'Substitute',
    'SyncAction',
    'ThreadedAction',
    'Tick',
    'TickCallbacks',
    'TickCommand',
    'TickControl',
    'Tree',
    'TreeContext',
    'TreeNode',
    'UnfinishedWork',
    'halt_child',
    'node_path',
    'node_skill',
    'node_skills',
    'simple_action',
    'simple_condition',
    'simple_decorator',
]
