# SPDX-License-Identifier: BSD-3-Clause
"""The behavior-tree engine: XML to definitions to running trees. Pure Python, without ROS.

::

    registry = builtin_registry()
    registry.register('OpenDoor', OpenDoor)                 # a StatefulAction of one's own
    document = load_xml(text, 'mission.xml', registry)      # TreeLoadError has every error, with line and column
    library = TreeLibrary().stage([document])               # all files or none
    tree = Tree(library, 'Mission', blackboard=board, clock=clock)
    status = tree.tick_once()
"""

from .engine.context import TransitionObserver, TreeContext, UnfinishedWork
from .engine.control_decorator import Control, Decorator
from .engine.coroutine import CoroutineAction
from .engine.leaf import Condition, Halted, StatefulAction, SyncAction
from .engine.node import NodeConfig, TreeNode
from .engine.registry import NodeRegistry
from .engine.simple import (
    SimpleAction,
    SimpleDecorator,
    simple_action,
    simple_condition,
    simple_decorator,
)
from .engine.threaded import ThreadedAction
from .engine.tick_control import TickCommand, TickControl
from .engine.tree import Tree
from .engine.tree_builder import Substitute, SubTreeInstance
from .model.blackboard import EMPTY, Blackboard, Entry
from .model.blackboard_json import JsonObject, JsonTypes, export_blackboard, import_blackboard, show_blackboard
from .model.definition import NodeDefinition, NodeManifest, TreeDefinition, TreeDocument
from .model.errors import (
    BehaviorTreeError,
    BlackboardError,
    ConversionError,
    LoadError,
    NodeExecutionError,
    PortError,
    RegistrationError,
    ScriptError,
    TickAbandoned,
    TreeLoadError,
)
from .model.failure_trace import Reason, Reasons
from .model.library import TreeKey, TreeLibrary
from .model.port_types import PortType
from .model.ports import Port, PortDirection, inout_port, input_port, output_port
from .model.status import NodeKind, NodeStatus
from .nodes.builtin import builtin_registry
from .nodes.loops import Loop
from .observers.hooks import AfterTick, BeforeTick, TickHooks
from .script.compiled_script import ScriptLibrary
from .xml.reader import IncludeResolver, load_xml

__all__ = [
    'EMPTY',
    'AfterTick',
    'BeforeTick',
    'BehaviorTreeError',
    'Blackboard',
    'BlackboardError',
    'Condition',
    'Control',
    'ConversionError',
    'CoroutineAction',
    'Decorator',
    'Entry',
    'Halted',
    'IncludeResolver',
    'JsonObject',
    'JsonTypes',
    'LoadError',
    'Loop',
    'NodeConfig',
    'NodeDefinition',
    'NodeExecutionError',
    'NodeKind',
    'NodeManifest',
    'NodeRegistry',
    'NodeStatus',
    'Port',
    'PortDirection',
    'PortError',
    'PortType',
    'Reason',
    'Reasons',
    'RegistrationError',
    'ScriptError',
    'ScriptLibrary',
    'SimpleAction',
    'SimpleDecorator',
    'StatefulAction',
    'SubTreeInstance',
    'Substitute',
    'SyncAction',
    'ThreadedAction',
    'TickAbandoned',
    'TickCommand',
    'TickControl',
    'TickHooks',
    'TransitionObserver',
    'Tree',
    'TreeContext',
    'TreeDefinition',
    'TreeDocument',
    'TreeKey',
    'TreeLibrary',
    'TreeLoadError',
    'TreeNode',
    'UnfinishedWork',
    'builtin_registry',
    'export_blackboard',
    'import_blackboard',
    'inout_port',
    'input_port',
    'load_xml',
    'output_port',
    'show_blackboard',
    'simple_action',
    'simple_condition',
    'simple_decorator',
]
