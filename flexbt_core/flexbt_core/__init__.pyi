# SPDX-License-Identifier: BSD-3-Clause
# The public names of flexbt_core, and the modules that define them. ``__init__.py`` reads this file, too.

# Behavior trees: base classes of nodes, and running trees
from .behavior_tree.engine.asynchronous_actions import (
    CoroutineAction as CoroutineAction,
)
from .behavior_tree.engine.asynchronous_actions import (
    ThreadedAction as ThreadedAction,
)
from .behavior_tree.engine.context import (
    TreeContext as TreeContext,
)
from .behavior_tree.engine.context import (
    UnfinishedWork as UnfinishedWork,
)
from .behavior_tree.engine.function_nodes import (
    SimpleAction as SimpleAction,
)
from .behavior_tree.engine.function_nodes import (
    SimpleDecorator as SimpleDecorator,
)
from .behavior_tree.engine.function_nodes import (
    simple_action as simple_action,
)
from .behavior_tree.engine.function_nodes import (
    simple_condition as simple_condition,
)
from .behavior_tree.engine.function_nodes import (
    simple_decorator as simple_decorator,
)
from .behavior_tree.engine.leaf import (
    Condition as Condition,
)
from .behavior_tree.engine.leaf import (
    ExpandingAction as ExpandingAction,
)
from .behavior_tree.engine.leaf import (
    Halted as Halted,
)
from .behavior_tree.engine.leaf import (
    StatefulAction as StatefulAction,
)
from .behavior_tree.engine.leaf import (
    SyncAction as SyncAction,
)
from .behavior_tree.engine.node import (
    NodeConfig as NodeConfig,
)
from .behavior_tree.engine.node import (
    StatusObserver as StatusObserver,
)
from .behavior_tree.engine.node import (
    TreeNode as TreeNode,
)
from .behavior_tree.engine.observers import (
    Log as Log,
)
from .behavior_tree.engine.observers import (
    LogReader as LogReader,
)
from .behavior_tree.engine.observers import (
    PostTick as PostTick,
)
from .behavior_tree.engine.observers import (
    PreTick as PreTick,
)
from .behavior_tree.engine.observers import (
    StatusLog as StatusLog,
)
from .behavior_tree.engine.observers import (
    TickCallbacks as TickCallbacks,
)
from .behavior_tree.engine.parents import (
    Control as Control,
)
from .behavior_tree.engine.parents import (
    Decorator as Decorator,
)
from .behavior_tree.engine.registry import (
    NodeRegistry as NodeRegistry,
)
from .behavior_tree.engine.registry import (
    node_skill as node_skill,
)
from .behavior_tree.engine.registry import (
    node_skills as node_skills,
)
from .behavior_tree.engine.tick_control import (
    TickCommand as TickCommand,
)
from .behavior_tree.engine.tick_control import (
    TickControl as TickControl,
)
from .behavior_tree.engine.tree import (
    Tree as Tree,
)
from .behavior_tree.engine.tree_builder import (
    Substitute as Substitute,
)
from .behavior_tree.engine.tree_builder import (
    SubTreeInstance as SubTreeInstance,
)

# Behavior trees: definitions, ports, blackboard and errors
from .behavior_tree.model.blackboard import (
    EMPTY as EMPTY,
)
from .behavior_tree.model.blackboard import (
    Blackboard as Blackboard,
)
from .behavior_tree.model.blackboard import (
    Entry as Entry,
)
from .behavior_tree.model.blackboard_json import (
    JsonObject as JsonObject,
)
from .behavior_tree.model.blackboard_json import (
    JsonTypes as JsonTypes,
)
from .behavior_tree.model.blackboard_json import (
    export_blackboard as export_blackboard,
)
from .behavior_tree.model.blackboard_json import (
    import_blackboard as import_blackboard,
)
from .behavior_tree.model.blackboard_json import (
    show_blackboard as show_blackboard,
)
from .behavior_tree.model.definition import (
    NodeDefinition as NodeDefinition,
)
from .behavior_tree.model.definition import (
    NodeManifest as NodeManifest,
)
from .behavior_tree.model.definition import (
    TreeDefinition as TreeDefinition,
)
from .behavior_tree.model.definition import (
    TreeDocument as TreeDocument,
)
from .behavior_tree.model.definition import (
    TreeKey as TreeKey,
)
from .behavior_tree.model.definition import (
    TreeLibrary as TreeLibrary,
)
from .behavior_tree.model.errors import (
    BehaviorTreeError as BehaviorTreeError,
)
from .behavior_tree.model.errors import (
    BlackboardError as BlackboardError,
)
from .behavior_tree.model.errors import (
    ConversionError as ConversionError,
)
from .behavior_tree.model.errors import (
    FailureStep as FailureStep,
)
from .behavior_tree.model.errors import (
    FailureTrace as FailureTrace,
)
from .behavior_tree.model.errors import (
    LoadError as LoadError,
)
from .behavior_tree.model.errors import (
    NodeExecutionError as NodeExecutionError,
)
from .behavior_tree.model.errors import (
    PortError as PortError,
)
from .behavior_tree.model.errors import (
    RegistrationError as RegistrationError,
)
from .behavior_tree.model.errors import (
    ScriptError as ScriptError,
)
from .behavior_tree.model.errors import (
    TickAbandoned as TickAbandoned,
)
from .behavior_tree.model.errors import (
    TreeLoadError as TreeLoadError,
)
from .behavior_tree.model.outcomes import (
    Choice as Choice,
)
from .behavior_tree.model.outcomes import (
    Earliest as Earliest,
)
from .behavior_tree.model.outcomes import (
    Example as Example,
)
from .behavior_tree.model.outcomes import (
    Exchanged as Exchanged,
)
from .behavior_tree.model.outcomes import (
    InOrder as InOrder,
)
from .behavior_tree.model.outcomes import (
    Lasting as Lasting,
)
from .behavior_tree.model.outcomes import (
    OneOf as OneOf,
)
from .behavior_tree.model.outcomes import (
    Outcomes as Outcomes,
)
from .behavior_tree.model.outcomes import (
    PossibleTick as PossibleTick,
)
from .behavior_tree.model.outcomes import (
    Recovered as Recovered,
)
from .behavior_tree.model.outcomes import (
    Repeated as Repeated,
)
from .behavior_tree.model.outcomes import (
    Results as Results,
)
from .behavior_tree.model.outcomes import (
    TimeLimit as TimeLimit,
)
from .behavior_tree.model.outcomes import (
    Times as Times,
)
from .behavior_tree.model.outcomes import (
    WithDefault as WithDefault,
)
from .behavior_tree.model.ports import (
    ANY as ANY,
)
from .behavior_tree.model.ports import (
    BOOL as BOOL,
)
from .behavior_tree.model.ports import (
    DOUBLE as DOUBLE,
)
from .behavior_tree.model.ports import (
    FLOAT as FLOAT,
)
from .behavior_tree.model.ports import (
    INT as INT,
)
from .behavior_tree.model.ports import (
    INT64 as INT64,
)
from .behavior_tree.model.ports import (
    KEY as KEY,
)
from .behavior_tree.model.ports import (
    KEYS as KEYS,
)
from .behavior_tree.model.ports import (
    NO_DEFAULT as NO_DEFAULT,
)
from .behavior_tree.model.ports import (
    NODE_STATUS as NODE_STATUS,
)
from .behavior_tree.model.ports import (
    STRING as STRING,
)
from .behavior_tree.model.ports import (
    UINT8 as UINT8,
)
from .behavior_tree.model.ports import (
    UINT16 as UINT16,
)
from .behavior_tree.model.ports import (
    UINT64 as UINT64,
)
from .behavior_tree.model.ports import (
    UNSIGNED as UNSIGNED,
)
from .behavior_tree.model.ports import (
    Port as Port,
)
from .behavior_tree.model.ports import (
    PortDirection as PortDirection,
)
from .behavior_tree.model.ports import (
    PortType as PortType,
)
from .behavior_tree.model.ports import (
    inout_port as inout_port,
)
from .behavior_tree.model.ports import (
    input_port as input_port,
)
from .behavior_tree.model.ports import (
    list_of as list_of,
)
from .behavior_tree.model.ports import (
    output_port as output_port,
)
from .behavior_tree.model.status import (
    NodeKind as NodeKind,
)
from .behavior_tree.model.status import (
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
)
from .behavior_tree.nodes.nav2.registration import (
    register_nav2 as register_nav2,
)

# Behavior trees: scripts
from .behavior_tree.script.interpreter import (
    ScriptLibrary as ScriptLibrary,
)

# Behavior trees: XML
from .behavior_tree.xml.reader import (
    IncludeResolver as IncludeResolver,
)
from .behavior_tree.xml.reader import (
    load_xml as load_xml,
)

# Clocks
from .clock.clock import (
    Clock as Clock,
)
from .clock.clock import (
    ManualClock as ManualClock,
)
from .clock.clock import (
    SteadyClock as SteadyClock,
)
from .clock.clock import (
    Timer as Timer,
)
from .clock.clock import (
    TimerQueue as TimerQueue,
)
from .clock.clock import (
    seconds_asleep as seconds_asleep,
)
from .clock.waiting import (
    CoalescedTimers as CoalescedTimers,
)
from .clock.waiting import (
    WakeEvent as WakeEvent,
)
from .clock.work_thread import (
    LateWork as LateWork,
)
from .clock.work_thread import (
    WorkThread as WorkThread,
)
from .clock.work_thread import (
    watchdog as watchdog,
)

# The base of all errors
from .errors import (
    FlexbtError as FlexbtError,
)

# Monitors
from .monitors.machine_monitor import (
    MachineMonitor as MachineMonitor,
)
from .monitors.machine_monitor import (
    declared_resources as declared_resources,
)
from .monitors.monitoring import (
    MAX_REPORTED as MAX_REPORTED,
)
from .monitors.monitoring import (
    Findings as Findings,
)
from .monitors.monitoring import (
    Monitoring as Monitoring,
)
from .monitors.monitoring import (
    violation_text as violation_text,
)
from .monitors.properties import (
    Property as Property,
)
from .monitors.properties import (
    Violation as Violation,
)
from .monitors.properties import (
    shared_actuators as shared_actuators,
)
from .monitors.properties import (
    shared_keys as shared_keys,
)
from .monitors.requirement_text import (
    RequirementError as RequirementError,
)
from .monitors.requirement_text import (
    StatedRequirement as StatedRequirement,
)
from .monitors.requirement_text import (
    Vocabulary as Vocabulary,
)
from .monitors.requirement_text import (
    machine_vocabulary as machine_vocabulary,
)
from .monitors.requirement_text import (
    parse_requirement as parse_requirement,
)
from .monitors.requirement_text import (
    problems_with as problems_with,
)
from .monitors.requirement_text import (
    read_requirements as read_requirements,
)
from .monitors.requirement_text import (
    tree_vocabulary as tree_vocabulary,
)
from .monitors.requirements import (
    PROVED_ONLY as PROVED_ONLY,
)
from .monitors.requirements import (
    After as After,
)
from .monitors.requirements import (
    Apart as Apart,
)
from .monitors.requirements import (
    AtMost as AtMost,
)
from .monitors.requirements import (
    Before as Before,
)
from .monitors.requirements import (
    Has as Has,
)
from .monitors.requirements import (
    IsA as IsA,
)
from .monitors.requirements import (
    Never as Never,
)
from .monitors.requirements import (
    Possible as Possible,
)
from .monitors.requirements import (
    Requirement as Requirement,
)
from .monitors.requirements import (
    Requirements as Requirements,
)
from .monitors.requirements import (
    While as While,
)
from .monitors.requirements import (
    Within as Within,
)
from .monitors.requirements import (
    Written as Written,
)
from .monitors.requirements import (
    violation_of as violation_of,
)
from .monitors.tree_monitor import (
    TreeMonitor as TreeMonitor,
)

# Skills
from .skills.grounding import (
    GroundAction as GroundAction,
)
from .skills.grounding import (
    GroundProblem as GroundProblem,
)
from .skills.grounding import (
    argument_texts as argument_texts,
)
from .skills.grounding import (
    ground as ground,
)
from .skills.library import (
    ANYTHING as ANYTHING,
)
from .skills.library import (
    SkillLibrary as SkillLibrary,
)
from .skills.library import (
    clashes as clashes,
)
from .skills.literals import (
    EQUAL as EQUAL,
)
from .skills.literals import (
    BlackboardSensor as BlackboardSensor,
)
from .skills.literals import (
    ConditionSensor as ConditionSensor,
)
from .skills.literals import (
    Literal as Literal,
)
from .skills.literals import (
    Predicate as Predicate,
)
from .skills.literals import (
    Sensor as Sensor,
)
from .skills.literals import (
    SkillError as SkillError,
)
from .skills.literals import (
    TopicSensor as TopicSensor,
)
from .skills.literals import (
    parse_literal as parse_literal,
)
from .skills.literals import (
    parse_literals as parse_literals,
)
from .skills.observation import (
    SkillMonitor as SkillMonitor,
)
from .skills.observation import (
    claims as claims,
)
from .skills.skill import (
    LEVELS as LEVELS,
)
from .skills.skill import (
    Outcome as Outcome,
)
from .skills.skill import (
    OutcomeClass as OutcomeClass,
)
from .skills.skill import (
    Skill as Skill,
)
from .skills.skill import (
    usual_outcome_class as usual_outcome_class,
)
from .skills.yaml_files import (
    capability_file as capability_file,
)
from .skills.yaml_files import (
    read_skills as read_skills,
)
from .skills.yaml_files import (
    skill_entry as skill_entry,
)
from .skills.yaml_files import (
    write_skills as write_skills,
)

# State machines: writing them
from .state_machine.authoring.checked_definition import (
    define as define,
)
from .state_machine.authoring.data_flow import (
    KeyRead as KeyRead,
)
from .state_machine.authoring.data_flow import (
    LostWrite as LostWrite,
)
from .state_machine.authoring.data_flow import (
    WriteRace as WriteRace,
)
from .state_machine.authoring.data_flow import (
    lost_writes as lost_writes,
)
from .state_machine.authoring.data_flow import (
    races as races,
)
from .state_machine.authoring.data_flow import (
    unsure_reads as unsure_reads,
)
from .state_machine.authoring.machine import (
    ConcurrencyContainer as ConcurrencyContainer,
)
from .state_machine.authoring.machine import (
    OperatableStateMachine as OperatableStateMachine,
)
from .state_machine.authoring.machine import (
    PriorityContainer as PriorityContainer,
)
from .state_machine.authoring.wrappers import (
    StateWrapper as StateWrapper,
)
from .state_machine.authoring.wrappers import (
    with_retry as with_retry,
)
from .state_machine.authoring.wrappers import (
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
)
from .state_machine.engine.events import (
    BreakpointSet as BreakpointSet,
)
from .state_machine.engine.events import (
    CommandDecided as CommandDecided,
)
from .state_machine.engine.events import (
    ContainerEnded as ContainerEnded,
)
from .state_machine.engine.events import (
    DecisionAsked as DecisionAsked,
)
from .state_machine.engine.events import (
    DecisionClosed as DecisionClosed,
)
from .state_machine.engine.events import (
    DecisionTaken as DecisionTaken,
)
from .state_machine.engine.events import (
    Faulted as Faulted,
)
from .state_machine.engine.events import (
    HaltAwaited as HaltAwaited,
)
from .state_machine.engine.events import (
    LockSet as LockSet,
)
from .state_machine.engine.events import (
    Logged as Logged,
)
from .state_machine.engine.events import (
    LoggingReader as LoggingReader,
)
from .state_machine.engine.events import (
    MachineSwitched as MachineSwitched,
)
from .state_machine.engine.events import (
    OutcomeForced as OutcomeForced,
)
from .state_machine.engine.events import (
    OutcomeTaken as OutcomeTaken,
)
from .state_machine.engine.events import (
    RunEnded as RunEnded,
)
from .state_machine.engine.events import (
    RunEnding as RunEnding,
)
from .state_machine.engine.events import (
    RunEvent as RunEvent,
)
from .state_machine.engine.events import (
    RunPaused as RunPaused,
)
from .state_machine.engine.events import (
    RunReader as RunReader,
)
from .state_machine.engine.events import (
    RunRested as RunRested,
)
from .state_machine.engine.events import (
    RunStarted as RunStarted,
)
from .state_machine.engine.events import (
    StateEntered as StateEntered,
)
from .state_machine.engine.events import (
    StateExited as StateExited,
)
from .state_machine.engine.events import (
    StateLeft as StateLeft,
)
from .state_machine.engine.events import (
    StatePaused as StatePaused,
)
from .state_machine.engine.events import (
    TransitionBlocked as TransitionBlocked,
)
from .state_machine.engine.events import (
    TransitionUnblocked as TransitionUnblocked,
)
from .state_machine.engine.operator_commands import (
    clear_breakpoint as clear_breakpoint,
)
from .state_machine.engine.operator_commands import (
    confirm as confirm,
)
from .state_machine.engine.operator_commands import (
    force as force,
)
from .state_machine.engine.operator_commands import (
    lock as lock,
)
from .state_machine.engine.operator_commands import (
    pause as pause,
)
from .state_machine.engine.operator_commands import (
    repeat as repeat,
)
from .state_machine.engine.operator_commands import (
    resume as resume,
)
from .state_machine.engine.operator_commands import (
    set_autonomy as set_autonomy,
)
from .state_machine.engine.operator_commands import (
    set_breakpoint as set_breakpoint,
)
from .state_machine.engine.operator_commands import (
    unlock as unlock,
)
from .state_machine.engine.resume import (
    RunPosition as RunPosition,
)
from .state_machine.engine.resume import (
    position_of as position_of,
)
from .state_machine.engine.resume import (
    reasons_against as reasons_against,
)
from .state_machine.engine.resume import (
    start_at as start_at,
)
from .state_machine.engine.resume import (
    switch_machine as switch_machine,
)
from .state_machine.engine.run import (
    RunLimits as RunLimits,
)
from .state_machine.engine.run import (
    MAX_TRANSITIONS as MAX_TRANSITIONS,
)
from .state_machine.engine.run import (
    STOP_TIMEOUT as STOP_TIMEOUT,
)
from .state_machine.engine.run import (
    MachineRun as MachineRun,
)

# State machines: states and definitions
from .state_machine.model.autonomy import (
    AUTONOMY_NAMES as AUTONOMY_NAMES,
)
from .state_machine.model.autonomy import (
    Autonomy as Autonomy,
)
from .state_machine.model.autonomy import (
    Decision as Decision,
)
from .state_machine.model.autonomy import (
    DecisionKind as DecisionKind,
)
from .state_machine.model.definition import (
    ERROR as ERROR,
)
from .state_machine.model.definition import (
    PREEMPTED as PREEMPTED,
)
from .state_machine.model.definition import (
    ROOT_PATH as ROOT_PATH,
)
from .state_machine.model.definition import (
    Child as Child,
)
from .state_machine.model.definition import (
    EndCondition as EndCondition,
)
from .state_machine.model.definition import (
    Machine as Machine,
)
from .state_machine.model.definition import (
    MachineDefinition as MachineDefinition,
)
from .state_machine.model.definition import (
    StateDefinition as StateDefinition,
)
from .state_machine.model.definition import (
    StateKind as StateKind,
)
from .state_machine.model.definition import (
    StructureEntry as StructureEntry,
)
from .state_machine.model.definition import (
    Transition as Transition,
)
from .state_machine.model.definition import (
    is_inside as is_inside,
)
from .state_machine.model.event_state import (
    DEFAULT_RATE as DEFAULT_RATE,
)
from .state_machine.model.event_state import (
    EXIT_TIMEOUT as EXIT_TIMEOUT,
)
from .state_machine.model.event_state import (
    EventState as EventState,
)
from .state_machine.model.event_state import (
    ExitReason as ExitReason,
)
from .state_machine.model.event_state import (
    called_state as called_state,
)
from .state_machine.model.event_state import (
    state_skill as state_skill,
)
from .state_machine.model.state_host import (
    Progress as Progress,
)
from .state_machine.model.state_host import (
    Severity as Severity,
)
from .state_machine.model.state_host import (
    StateHost as StateHost,
)
from .state_machine.model.userdata import (
    DefaultUserData as DefaultUserData,
)
from .state_machine.model.userdata import (
    MachineError as MachineError,
)
from .state_machine.model.userdata import (
    StateError as StateError,
)
from .state_machine.model.userdata import (
    StateMachineError as StateMachineError,
)
from .state_machine.model.userdata import (
    UserData as UserData,
)
from .state_machine.model.userdata import (
    UserDataError as UserDataError,
)

# Files of named places
from .values.places import (
    Place as Place,
)
from .values.places import (
    load_places as load_places,
)
