# SPDX-License-Identifier: BSD-3-Clause
# The public names of flexbt_core, and the modules that define them. ``__init__.py`` reads this file, too.

# Behavior trees: base classes of nodes, and running trees
from .behavior_tree.engine.asynchronous_actions import (
    CoroutineAction as CoroutineAction,
    ThreadedAction as ThreadedAction,
)
from .behavior_tree.engine.context import (
    TreeContext as TreeContext,
    UnfinishedWork as UnfinishedWork,
)
from .behavior_tree.engine.function_nodes import (
    SimpleAction as SimpleAction,
    SimpleDecorator as SimpleDecorator,
    simple_action as simple_action,
    simple_condition as simple_condition,
    simple_decorator as simple_decorator,
)
from .behavior_tree.engine.leaf import (
    Condition as Condition,
    ExpandingAction as ExpandingAction,
    Halted as Halted,
    StatefulAction as StatefulAction,
    SyncAction as SyncAction,
)
from .behavior_tree.engine.node import (
    NodeConfig as NodeConfig,
    StatusObserver as StatusObserver,
    TreeNode as TreeNode,
)
from .behavior_tree.engine.observers import (
    Log as Log,
    LogReader as LogReader,
    PostTick as PostTick,
    PreTick as PreTick,
    StatusLog as StatusLog,
    TickCallbacks as TickCallbacks,
)
from .behavior_tree.engine.parents import (
    Control as Control,
    Decorator as Decorator,
)
from .behavior_tree.engine.registry import (
    NodeRegistry as NodeRegistry,
    node_skill as node_skill,
    node_skills as node_skills,
)
from .behavior_tree.engine.tick_control import (
    TickCommand as TickCommand,
    TickControl as TickControl,
)
from .behavior_tree.engine.tree import (
    Tree as Tree,
)
from .behavior_tree.engine.tree_builder import (
    Substitute as Substitute,
    SubTreeInstance as SubTreeInstance,
)

# Behavior trees: definitions, ports, blackboard and errors
from .behavior_tree.model.blackboard import (
    EMPTY as EMPTY,
    Blackboard as Blackboard,
    Entry as Entry,
)
from .behavior_tree.model.blackboard_json import (
    JsonObject as JsonObject,
    JsonTypes as JsonTypes,
    export_blackboard as export_blackboard,
    import_blackboard as import_blackboard,
    show_blackboard as show_blackboard,
)
from .behavior_tree.model.definition import (
    NodeDefinition as NodeDefinition,
    NodeManifest as NodeManifest,
    TreeDefinition as TreeDefinition,
    TreeDocument as TreeDocument,
    TreeKey as TreeKey,
    TreeLibrary as TreeLibrary,
)
from .behavior_tree.model.errors import (
    BehaviorTreeError as BehaviorTreeError,
    BlackboardError as BlackboardError,
    ConversionError as ConversionError,
    FailureStep as FailureStep,
    FailureTrace as FailureTrace,
    LoadError as LoadError,
    NodeExecutionError as NodeExecutionError,
    PortError as PortError,
    RegistrationError as RegistrationError,
    ScriptError as ScriptError,
    TickAbandoned as TickAbandoned,
    TreeLoadError as TreeLoadError,
)
from .behavior_tree.model.outcomes import (
    Choice as Choice,
    Earliest as Earliest,
    Example as Example,
    Exchanged as Exchanged,
    InOrder as InOrder,
    Lasting as Lasting,
    OneOf as OneOf,
    Outcomes as Outcomes,
    PossibleTick as PossibleTick,
    Recovered as Recovered,
    Repeated as Repeated,
    Results as Results,
    TimeLimit as TimeLimit,
    Times as Times,
    WithDefault as WithDefault,
)
from .behavior_tree.model.ports import (
    ANY as ANY,
    BOOL as BOOL,
    DOUBLE as DOUBLE,
    FLOAT as FLOAT,
    INT as INT,
    INT64 as INT64,
    KEY as KEY,
    KEYS as KEYS,
    NO_DEFAULT as NO_DEFAULT,
    NODE_STATUS as NODE_STATUS,
    STRING as STRING,
    UINT8 as UINT8,
    UINT16 as UINT16,
    UINT64 as UINT64,
    UNSIGNED as UNSIGNED,
    Port as Port,
    PortDirection as PortDirection,
    PortType as PortType,
    inout_port as inout_port,
    input_port as input_port,
    list_of as list_of,
    output_port as output_port,
)
from .behavior_tree.model.status import (
    NodeKind as NodeKind,
    NodeStatus as NodeStatus,
)

# Behavior trees: node types
from .behavior_tree.nodes.builtin import (
    builtin_registry as builtin_registry,
)
from .behavior_tree.nodes.loops import (
    Loop as Loop,
)
from .behavior_tree.nodes.nav2.registration import (
    Nav2Branch as Nav2Branch,
    register_nav2 as register_nav2,
)

# Behavior trees: scripts
from .behavior_tree.script.interpreter import (
    ScriptLibrary as ScriptLibrary,
)

# Behavior trees: XML
from .behavior_tree.xml.reader import (
    IncludeResolver as IncludeResolver,
    load_xml as load_xml,
)

# Clocks
from .clock.clock import (
    Clock as Clock,
    ManualClock as ManualClock,
    SteadyClock as SteadyClock,
    Timer as Timer,
    TimerQueue as TimerQueue,
    seconds_asleep as seconds_asleep,
)
from .clock.waiting import (
    CoalescedTimers as CoalescedTimers,
    WakeEvent as WakeEvent,
)
from .clock.work_thread import (
    LateWork as LateWork,
    WorkThread as WorkThread,
    watchdog as watchdog,
)

# The base of all errors
from .errors import (
    FlexbtError as FlexbtError,
)

# Monitors
from .monitors.machine_monitor import (
    MachineMonitor as MachineMonitor,
    declared_resources as declared_resources,
)
from .monitors.monitoring import (
    MAX_REPORTED as MAX_REPORTED,
    Findings as Findings,
    Monitoring as Monitoring,
    violation_text as violation_text,
)
from .monitors.properties import (
    Property as Property,
    Violation as Violation,
    shared_actuators as shared_actuators,
    shared_keys as shared_keys,
)
from .monitors.requirement_text import (
    RequirementError as RequirementError,
    StatedRequirement as StatedRequirement,
    Vocabulary as Vocabulary,
    machine_vocabulary as machine_vocabulary,
    parse_requirement as parse_requirement,
    problems_with as problems_with,
    read_requirements as read_requirements,
    tree_vocabulary as tree_vocabulary,
)
from .monitors.requirements import (
    PROVED_ONLY as PROVED_ONLY,
    After as After,
    Apart as Apart,
    AtMost as AtMost,
    Before as Before,
    Has as Has,
    IsA as IsA,
    Never as Never,
    Possible as Possible,
    Requirement as Requirement,
    Requirements as Requirements,
    While as While,
    Within as Within,
    Written as Written,
    violation_of as violation_of,
)
from .monitors.tree_monitor import (
    TreeMonitor as TreeMonitor,
)

# Skills
from .skills.grounding import (
    GroundAction as GroundAction,
    GroundProblem as GroundProblem,
    argument_texts as argument_texts,
    ground as ground,
)
from .skills.library import (
    ANYTHING as ANYTHING,
    SkillLibrary as SkillLibrary,
    clashes as clashes,
)
from .skills.literals import (
    EQUAL as EQUAL,
    BlackboardSensor as BlackboardSensor,
    ConditionSensor as ConditionSensor,
    Literal as Literal,
    Predicate as Predicate,
    Sensor as Sensor,
    SkillError as SkillError,
    TopicSensor as TopicSensor,
    parse_literal as parse_literal,
    parse_literals as parse_literals,
)
from .skills.observation import (
    SkillMonitor as SkillMonitor,
    claims as claims,
)
from .skills.skill import (
    LEVELS as LEVELS,
    Outcome as Outcome,
    OutcomeClass as OutcomeClass,
    Skill as Skill,
    usual_outcome_class as usual_outcome_class,
)
from .skills.yaml_files import (
    capability_file as capability_file,
    read_skills as read_skills,
    skill_entry as skill_entry,
    write_skills as write_skills,
)

# State machines: writing them
from .state_machine.authoring.checked_definition import (
    define as define,
)
from .state_machine.authoring.data_flow import (
    KeyRead as KeyRead,
    LostWrite as LostWrite,
    WriteRace as WriteRace,
    lost_writes as lost_writes,
    races as races,
    unsure_reads as unsure_reads,
)
from .state_machine.authoring.machine import (
    ConcurrencyContainer as ConcurrencyContainer,
    OperatableStateMachine as OperatableStateMachine,
    PriorityContainer as PriorityContainer,
)
from .state_machine.authoring.wrappers import (
    StateWrapper as StateWrapper,
    with_retry as with_retry,
    with_timeout as with_timeout,
)
from .state_machine.authoring.yaml_form import (
    read_machine as read_machine,
)

# State machines: runs
from .state_machine.engine.engine import (
    RunningCallback as RunningCallback,
)
from .state_machine.engine.leaf import (
    LeafRun as LeafRun,
)
from .state_machine.engine.events import (
    AutonomySet as AutonomySet,
    BreakpointSet as BreakpointSet,
    CommandDecided as CommandDecided,
    ContainerEnded as ContainerEnded,
    DecisionAsked as DecisionAsked,
    DecisionClosed as DecisionClosed,
    DecisionTaken as DecisionTaken,
    Faulted as Faulted,
    HaltAwaited as HaltAwaited,
    LockSet as LockSet,
    Logged as Logged,
    LoggingReader as LoggingReader,
    MachineEntered as MachineEntered,
    MachineSwitched as MachineSwitched,
    OutcomeForced as OutcomeForced,
    OutcomeTaken as OutcomeTaken,
    RunEnded as RunEnded,
    RunEnding as RunEnding,
    RunEvent as RunEvent,
    RunPaused as RunPaused,
    RunReader as RunReader,
    RunRested as RunRested,
    RunStarted as RunStarted,
    StateEntered as StateEntered,
    StateExited as StateExited,
    StateLeft as StateLeft,
    StatePaused as StatePaused,
    TransitionBlocked as TransitionBlocked,
    TransitionUnblocked as TransitionUnblocked,
)
from .state_machine.engine.operator_commands import (
    clear_breakpoint as clear_breakpoint,
    confirm as confirm,
    force as force,
    lock as lock,
    pause as pause,
    repeat as repeat,
    resume as resume,
    set_autonomy as set_autonomy,
    set_breakpoint as set_breakpoint,
    unlock as unlock,
)
from .state_machine.engine.resume import (
    RunPosition as RunPosition,
    position_of as position_of,
    reasons_against as reasons_against,
    start_at as start_at,
    switch_machine as switch_machine,
)
from .state_machine.engine.engine import (
    RunLimits as RunLimits,
    MAX_TRANSITIONS as MAX_TRANSITIONS,
    STOP_TIMEOUT as STOP_TIMEOUT,
)
from .state_machine.engine.run import (
    MachineRun as MachineRun,
)

# State machines: states and definitions
from .state_machine.model.autonomy import (
    AUTONOMY_NAMES as AUTONOMY_NAMES,
    Autonomy as Autonomy,
    Decision as Decision,
    DecisionKind as DecisionKind,
)
from .state_machine.model.definition import (
    ERROR as ERROR,
    PREEMPTED as PREEMPTED,
    ROOT_PATH as ROOT_PATH,
    Child as Child,
    EndCondition as EndCondition,
    Machine as Machine,
    MachineDefinition as MachineDefinition,
    StateDefinition as StateDefinition,
    StateKind as StateKind,
    StructureEntry as StructureEntry,
    Transition as Transition,
    is_inside as is_inside,
)
from .state_machine.model.event_state import (
    DEFAULT_RATE as DEFAULT_RATE,
    EXIT_TIMEOUT as EXIT_TIMEOUT,
    EventState as EventState,
    ExitReason as ExitReason,
    called_state as called_state,
    state_skill as state_skill,
)
from .state_machine.model.state_host import (
    Progress as Progress,
    Severity as Severity,
    StateHost as StateHost,
)
from .state_machine.model.userdata import (
    DefaultUserData as DefaultUserData,
    MachineError as MachineError,
    StateError as StateError,
    StateMachineError as StateMachineError,
    UserData as UserData,
    UserDataError as UserDataError,
)

# Files of named places
from .values.places import (
    Place as Place,
    load_places as load_places,
)
