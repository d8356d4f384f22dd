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

from .blackboard import EMPTY, Blackboard, Entry
from .blackboard_json import JsonObject, JsonTypes, export_blackboard, import_blackboard, show_blackboard
from .context import TransitionObserver, TreeContext, UnfinishedWork
from .coroutine import CoroutineAction
from .definition import NodeDefinition, TreeDefinition, TreeDocument
from .errors import (
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
from .hooks import AfterTick, BeforeTick, TickHooks
from .inner_nodes import Control, Decorator
from .instantiation import Substitute, SubTreeInstance
from .leaves import Condition, Halted, StatefulAction, SyncAction
from .library import TreeKey, TreeLibrary
from .loops import Loop
from .node import NodeConfig, TreeNode
from .port_types import PortType
from .ports import Port, PortDirection, inout_port, input_port, output_port
from .reasons import Reason, Reasons
from .registry import NodeManifest, NodeRegistry, builtin_registry
from .script import ScriptLibrary
from .simple import SimpleAction, SimpleDecorator, simple_action, simple_condition, simple_decorator
from .status import NodeKind, NodeStatus
from .threaded import ThreadedAction
from .tick_control import TickCommand, TickControl
from .tree import Tree
from .xml_reader import IncludeResolver, load_xml

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
