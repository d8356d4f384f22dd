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

from flexbt_core.behavior_tree.bases import (
    CoroutineAction,
    SimpleAction,
    SimpleDecorator,
    ThreadedAction,
    simple_action,
    simple_condition,
    simple_decorator,
)
from flexbt_core.behavior_tree.engine import (
    Condition,
    Control,
    Decorator,
    ExpandingAction,
    Halted,
    NodeConfig,
    NodeRegistry,
    PostTick,
    PreTick,
    StatefulAction,
    StatusObserver,
    Substitute,
    SubTreeInstance,
    SyncAction,
    TickCallbacks,
    TickCommand,
    TickControl,
    Tree,
    TreeContext,
    TreeNode,
    UnfinishedWork,
)
from flexbt_core.behavior_tree.model import (
    EMPTY,
    BehaviorTreeError,
    Blackboard,
    BlackboardError,
    Choice,
    ConversionError,
    Entry,
    Example,
    Exchanged,
    FailureStep,
    FailureTrace,
    InOrder,
    JsonObject,
    JsonTypes,
    LoadError,
    NodeDefinition,
    NodeExecutionError,
    NodeKind,
    NodeManifest,
    NodeStatus,
    OneOf,
    Outcomes,
    Port,
    PortDirection,
    PortError,
    PortType,
    Possible,
    Recovered,
    RegistrationError,
    Repeated,
    Results,
    ScriptError,
    TickAbandoned,
    TimeLimit,
    TreeDefinition,
    TreeDocument,
    TreeKey,
    TreeLibrary,
    TreeLoadError,
    WithDefault,
    export_blackboard,
    import_blackboard,
    inout_port,
    input_port,
    output_port,
    show_blackboard,
)
from flexbt_core.behavior_tree.node_skills import node_skill, node_skills
from flexbt_core.behavior_tree.nodes import Loop, builtin_registry
from flexbt_core.behavior_tree.script import ScriptLibrary
from flexbt_core.behavior_tree.status_log import Log, LogReader, StatusLog, log_reader
from flexbt_core.behavior_tree.xml import IncludeResolver, load_xml

__all__ = [
    'EMPTY',
    'BehaviorTreeError',
    'Blackboard',
    'BlackboardError',
    'Choice',
    'Condition',
    'Control',
    'ConversionError',
    'CoroutineAction',
    'Decorator',
    'Entry',
    'Example',
    'Exchanged',
    'ExpandingAction',
    'FailureStep',
    'FailureTrace',
    'Halted',
    'InOrder',
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
    'OneOf',
    'Outcomes',
    'Port',
    'PortDirection',
    'PortError',
    'PortType',
    'Possible',
    'PostTick',
    'PreTick',
    'Recovered',
    'RegistrationError',
    'Repeated',
    'Results',
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
    'TimeLimit',
    'Tree',
    'TreeContext',
    'TreeDefinition',
    'TreeDocument',
    'TreeKey',
    'TreeLibrary',
    'TreeLoadError',
    'TreeNode',
    'UnfinishedWork',
    'WithDefault',
    'builtin_registry',
    'export_blackboard',
    'import_blackboard',
    'inout_port',
    'input_port',
    'load_xml',
    'log_reader',
    'node_skill',
    'node_skills',
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
