# SPDX-License-Identifier: BSD-3-Clause
"""The behavior-tree engine: XML to definitions to running trees. Pure Python, without ROS.

::

    registry = builtin_registry()
    registry.register('OpenDoor', OpenDoor)                 # a StatefulAction of one's own
    document = load_xml(text, 'mission.xml', registry)      # TreeLoadError has every error, with line and column
    library = TreeLibrary().stage([document])               # all files or none
    tree = Tree(library, 'Mission', blackboard=board, clock=clock)
    status = tree.tick_once()

What only makes it faster is in ``acceleration``, which may be left out: FLEXBT_ACCELERATION=0 does it.
"""

import os

from .engine.context import TreeContext, UnfinishedWork
from .engine.control import Control
from .engine.coroutine import CoroutineAction
from .engine.decorator import Decorator
from .engine.leaf import Condition, Halted, StatefulAction, SyncAction
from .engine.node import NodeConfig, StatusObserver, TreeNode
from .engine.registry import NodeRegistry
from .engine.simple import (
    SimpleAction,
    SimpleDecorator,
    simple_action,
    simple_condition,
    simple_decorator,
)
from .engine.threaded import ThreadedAction
from .engine.tick_callbacks import PostTick, PreTick, TickCallbacks
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
from .observers.status_log import Log, LogReader, StatusLog, log_reader
from .script.compiled_script import ScriptLibrary
from .xml.reader import IncludeResolver, load_xml

__all__ = [
    'EMPTY',
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
    'Log',
    'LogReader',
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
    'PostTick',
    'PreTick',
    'Reason',
    'Reasons',
    'RegistrationError',
    'ScriptError',
    'ScriptLibrary',
    'SimpleAction',
    'SimpleDecorator',
    'StatefulAction',
    'StatusLog',
    'StatusObserver',
    'SubTreeInstance',
    'Substitute',
    'SyncAction',
    'ThreadedAction',
    'TickAbandoned',
    'TickCallbacks',
    'TickCommand',
    'TickControl',
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
    'log_reader',
    'output_port',
    'show_blackboard',
    'simple_action',
    'simple_condition',
    'simple_decorator',
]

if os.environ.get('FLEXBT_ACCELERATION', '1') != '0':
    try:
        from .acceleration import install
    except ModuleNotFoundError as error:
        if error.name != f'{__name__}.acceleration':
            raise
    else:
        install()
