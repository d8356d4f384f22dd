# SPDX-License-Identifier: BSD-3-Clause
"""Immutable records of what the console knows of an executive and of the robot's surroundings.

Their fields declare what the console knows: :mod:`flexbt_console.link.messages` converts messages of flexbt_msgs by
them, and JSON derives from them. Times are seconds on the executive's clock unless said otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from itertools import compress, pairwise, zip_longest
from typing import Final

from flexbt_common.values import queue_options
from flexbt_common.values.queue_options import QueueOptions
from flexbt_core.values.text import one_line


class ExecutiveState(IntEnum):
    """ExecutiveStatus.state."""

    UNKNOWN = 0
    IDLE = 1
    STARTING = 2
    RUNNING = 3
    PAUSED = 4
    STOPPING = 5
    INTERRUPTED = 6


class DecisionKind(IntEnum):
    """PendingDecision.kind."""

    UNKNOWN = 0
    TRANSITION = 1
    CHOICE = 2
    INPUT = 3


class ResultCode(IntEnum):
    """CommandResult.code."""

    UNKNOWN = 0
    APPLIED = 1
    REFUSED = 2


class StateKind(IntEnum):
    """StateStructure.kind."""

    UNKNOWN = 0
    STATE = 1
    MACHINE = 2
    CONCURRENCY = 3
    PRIORITY = 4


class LogSeverity(IntEnum):
    """ExecutiveLog.severity."""

    UNKNOWN = 0
    DEBUG = 1
    INFO = 2
    HINT = 3
    WARN = 4
    ERROR = 5


class CommandKind(IntEnum):
    """ExecutiveCommand.kind, as far as this console sends it."""

    START = 1
    STOP = 2
    AUTONOMY = 3
    CONFIRM = 4
    FORCE = 5
    ANSWER = 6
    DECLINE = 7
    PAUSE = 8
    RESUME = 9
    REPEAT = 10
    LOCK = 11
    UNLOCK = 12
    SWITCH = 13
    BREAKPOINT = 14
    CLEAR_BREAKPOINT = 15
    CLAIM_AUTHORITY = 16
    RELEASE_AUTHORITY = 17
    RESUME_RUN = 18
    ABORT_RUN = 19
    HAND_OVER_AUTHORITY = 20
    NOTE = 21
    REFUSE_AUTHORITY = 22
    STEP_INTO = 23
    STEP_OVER = 24
    STEP_OUT = 25
    TREE_PAUSE = 26
    TREE_STEP = 27
    TREE_CONTINUE = 28
    TREE_RUN_TO = 29
    TREE_BREAK = 30
    TREE_FORCE = 31
    TREE_DUMMY = 32
    TREE_RECORD = 33
    TREE_CLEAR = 34
    QUEUE_ADD = 35
    QUEUE_EDIT = 36
    QUEUE_REMOVE = 37
    QUEUE_MOVE = 38
    QUEUE_HOLD = 39
    QUEUE_RELEASE = 40
    QUEUE_CLEAR = 41
    TREE_SET = 42


class BreakpointKind(IntEnum):
    """TreeBreakpoint.kind."""

    UNKNOWN = 0
    BREAK = 1
    FORCE = 2
    DUMMY = 3
    RECORD = 4


SYNTHESIZED: Final = 'synthesized'
"""The package of a behavior that was synthesized (BehaviorManifest.SYNTHESIZED)."""

NOTE_LENGTH: Final = 1000
"""Characters of a note at most (ExecutiveCommand.NOTE_LENGTH)."""

POSE_TYPES: Final = frozenset({'geometry_msgs/PoseStamped', 'geometry_msgs/Pose', 'geometry_msgs/Pose2D'})
"""Types of a value for which an operator may write a place or ``x y yaw``."""


def plain_type(type: str) -> str:
    """Return the name of a type without ``/msg``."""
    return type.replace('/msg/', '/')


class AutonomyLevel(IntEnum):
    """The level of autonomy: a transition passes iff it requires less than the level."""

    OFF = 0
    LOW = 1
    HIGH = 2
    FULL = 3


PLACE_RADIUS: Final = 0.5
"""Metres within which a pose is called by the name of a place."""


@dataclass(frozen=True, slots=True)
class FramedPose:
    """A pose in the plane: metres and radians in ``frame``."""

    x: float
    y: float
    yaw: float = 0.0
    frame: str = 'map'

    def place(self, places: Mapping[str, FramedPose]) -> str:
        """Return the name of the place that is nearest, if it is within :data:`PLACE_RADIUS`; or else ''."""
        near = [
            (math.dist((self.x, self.y), (at.x, at.y)), name) for name, at in places.items() if at.frame == self.frame
        ]
        distance, name = min(near, default=(math.inf, ''))
        return name if distance <= PLACE_RADIUS else ''


@dataclass(frozen=True, slots=True)
class DriveProgress:
    """The progress of a drive: m, s and goal poses that are left, None while unknown; recoveries that were started.

    ``goal`` is where it drives to.
    """

    distance: float | None = None
    time: float | None = None
    poses: int | None = None
    recoveries: int = 0
    goal: FramedPose | None = None


@dataclass(frozen=True, slots=True)
class ActiveState:
    """An active leaf of the state machine, and what it is doing, one line each.

    ``tree_run_id`` is the run of the tree that it runs, '' when it runs none; ``progress`` None if it reports none.
    """

    path: str
    entered: float = 0.0
    activity: tuple[str, ...] = ()
    paused: bool = False
    not_paused: tuple[str, ...] = ()
    tree_run_id: str = ''
    progress: DriveProgress | None = None


@dataclass(frozen=True, slots=True)
class Decision:
    """A pending decision.

    ``subject`` are the keys of what it is about; the :class:`Subject` of that number has their values, if the number is
    not 0.
    """

    id: str
    kind: DecisionKind
    path: str = ''
    outcome: str = ''
    outcomes: tuple[str, ...] = ()
    required_autonomy: int = -1
    prompt: str = ''
    input_type: str = ''
    input_choices: tuple[str, ...] = ()
    since: float = 0.0
    subject: tuple[str, ...] = ()
    subject_number: int = 0

    @property
    def choices(self) -> tuple[str, ...]:
        """The choices: outcomes, or the allowed texts of an input request."""
        return self.input_choices if self.kind is DecisionKind.INPUT else self.outcomes

    @property
    def wants_text(self) -> bool:
        """True for an input request for text, which any line may be."""
        return self.kind is DecisionKind.INPUT and self.input_type in ('string', 'str')

    @property
    def wants_pose(self) -> bool:
        """True for an input request for one or several poses."""
        return self.kind is DecisionKind.INPUT and plain_type(self.input_type).removesuffix('[]') in POSE_TYPES


@dataclass(frozen=True, slots=True)
class SubjectValue:
    """One of the values that a decision is about: as text, and as the points of a path in a ``frame`` or as a pose if
    it is one."""

    key: str
    type: str = ''
    text: str = ''
    points: tuple[tuple[float, float], ...] = ()
    frame: str = 'map'
    pose: FramedPose | None = None


@dataclass(frozen=True, slots=True)
class Subject:
    """The subject of a decision; ``notes`` describe the parts that are not shown."""

    decision_id: str
    number: int
    values: tuple[SubjectValue, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Subjects:
    """The subjects of the decisions of one executive."""

    executive_id: str
    subjects: tuple[Subject, ...] = ()


@dataclass(frozen=True, slots=True)
class CommandResult:
    """The executive's answer to one command."""

    command_id: str
    code: ResultCode
    reason: str = ''


@dataclass(frozen=True, slots=True)
class Peer:
    """A node that the executive depends on; ``age`` is the time since its last message, in seconds of wall time.

    One that is not ``expected`` was never seen, and nobody has said that it has to be there.
    """

    name: str
    alive: bool
    since: float = 0.0
    ready: bool = True
    late: bool = False
    age: float = 0.0
    problem: str = ''
    expected: bool = True


@dataclass(frozen=True, slots=True)
class IncidentReport:
    """An incident that the robot's black box has written: its name, its folder on the robot, and what happened."""

    name: str
    folder: str
    text: str


@dataclass(frozen=True, slots=True)
class StopGuard:
    """The status of the stop guard (StopGuardStatus.msg).

    ``carried_out`` are the identifiers of its STOPs, ``operator`` is for whom it holds the robot, if it does.
    ``going_on`` are actions that are active anyway. If it ``is_silent``, it reported that it holds the robot, and a
    further report is overdue.
    """

    carried_out: tuple[str, ...] = ()
    holding: bool = False
    operator: str = ''
    going_on: tuple[str, ...] = ()
    is_silent: bool = False

    @property
    def told(self) -> str:
        """The report that the guard holds the robot, and why; '' while it does not."""
        if not self.holding:
            return ''
        if self.is_silent:
            return 'STOP GUARD SILENT: it held the robot and no longer reports it; stop the robot by other means'
        goes_on = f'; {", ".join(map(one_line, self.going_on))} is still active; restart it' if self.going_on else ''
        who = one_line(self.operator) or 'somebody'
        return f'HELD BY THE STOP GUARD: the executive did not answer; restart it (STOP of {who}){goes_on}'


@dataclass(frozen=True, slots=True)
class TreeBreakpoint:
    """What was set at a node of a tree to debug it (TreeBreakpoint.msg). ``status`` is that of TreeStatus."""

    kind: BreakpointKind
    tree: str
    path: str = ''
    condition: str = ''
    status: int = 0
    once: bool = False
    operator: str = ''
    stamp: float = 0.0
    hits: int = 0
    problem: str = ''


@dataclass(frozen=True, slots=True)
class TreeHold:
    """A tree that is held at a breakpoint, or paused (TreeHold.msg); ``path`` is the node, '' between two ticks."""

    run_id: str
    tree: str
    path: str = ''
    operator: str = ''
    since: float = 0.0
    reason: str = ''
    not_paused: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ExecutiveSnapshot:
    """The whole state of an executive; ``heartbeat_period`` in seconds of wall time."""

    executive_id: str
    sequence: int
    heartbeat_period: float = 1.0
    state: ExecutiveState = ExecutiveState.IDLE
    run_id: str = ''
    behavior: str = ''
    outcome: str = ''
    message: str = ''
    autonomy: int = 0
    active_states: tuple[ActiveState, ...] = ()
    decisions: tuple[Decision, ...] = ()
    results: tuple[CommandResult, ...] = ()
    peers: tuple[Peer, ...] = ()
    robot_pose: FramedPose | None = None
    pose_problem: str = ''
    locked: tuple[str, ...] = ()
    breakpoints: tuple[str, ...] = ()
    step: str = ''
    tree_breakpoints: tuple[TreeBreakpoint, ...] = ()
    tree_holds: tuple[TreeHold, ...] = ()
    autonomy_levels: tuple[tuple[str, int], ...] = ()
    authority: str = ''
    authority_requests: tuple[str, ...] = ()
    queue_length: int = 0
    queue_held: str = ''
    queue_entry: int = 0
    stamp: float = 0.0

    @property
    def missed_peers(self) -> tuple[Peer, ...]:
        """The expected nodes that are missing, and those that are late or not ready."""
        return tuple(peer for peer in self.peers if peer.expected and not (peer.alive and peer.ready and not peer.late))

    def level_of(self, path: str) -> int:
        """Return the level of autonomy of a state or container: of the smallest sub-tree around it that has one."""
        around = [(len(top), level) for top, level in self.autonomy_levels if f'{path}/'.startswith(f'{top}/')]
        return max(around, default=(0, self.autonomy))[1]


@dataclass(frozen=True, slots=True)
class Transition:
    """An outcome of a state with its target, '' if that is not known, and the autonomy that it requires, or -1."""

    outcome: str
    target: str
    autonomy: int


@dataclass(frozen=True, slots=True)
class StateStructure:
    """One state or container. ``targets`` and ``autonomy`` have one element for each of ``outcomes``."""

    path: str
    kind: StateKind = StateKind.STATE
    type: str = ''
    children: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    autonomy: tuple[int, ...] = ()

    @property
    def transitions(self) -> list[Transition]:
        """Transitions of the state, in the order of its outcomes."""
        rows = zip_longest(self.outcomes, self.targets[: len(self.outcomes)], self.autonomy[: len(self.outcomes)])
        return [Transition(outcome, target or '', -1 if level is None else level) for outcome, target, level in rows]


@dataclass(frozen=True, slots=True)
class Structure:
    """The state machine of a run, depth first, the root machine first."""

    run_id: str
    behavior: str = ''
    states: tuple[StateStructure, ...] = ()

    def state(self, path: str) -> StateStructure | None:
        """Return the state or container of that path."""
        return next((state for state in self.states if state.path == path), None)


@dataclass(frozen=True, slots=True)
class BehaviorParameter:
    """A parameter of a behavior; default, choices and limits as text. A limit that is '' is none."""

    name: str
    type: str = 'string'
    default: str = ''
    choices: tuple[str, ...] = ()
    description: str = ''
    label: str = ''
    unit: str = ''
    minimum: str = ''
    maximum: str = ''


@dataclass(frozen=True, slots=True)
class BehaviorInput:
    """A userdata key that a behavior reads; ``type`` is as in BlackboardEntry, '' when it is not declared."""

    key: str
    type: str = ''
    description: str = ''
    needed: bool = False


@dataclass(frozen=True, slots=True)
class Behavior:
    """A behavior that the executive can run, or why it cannot (``error``).

    ``machine`` is the YAML of one that was synthesized, if it has arrived; see :attr:`lacks_machine`.
    """

    name: str
    package: str = ''
    description: str = ''
    author: str = ''
    parameters: tuple[BehaviorParameter, ...] = ()
    error: str = ''
    inputs: tuple[BehaviorInput, ...] = ()
    machine: str = ''

    @property
    def lacks_machine(self) -> bool:
        """Return whether it was synthesized, and its machine has not arrived: nobody here can judge what it does."""
        return self.package == SYNTHESIZED and not self.machine


@dataclass(frozen=True, slots=True)
class BehaviorList:
    """The behaviors of one executive."""

    executive_id: str
    behaviors: tuple[Behavior, ...] = ()


@dataclass(frozen=True, slots=True)
class LogLine:
    """A line for the operator; may contain line breaks."""

    executive_id: str
    sequence: int
    severity: LogSeverity = LogSeverity.INFO
    text: str = ''
    path: str = ''
    run_id: str = ''
    stamp: float = 0.0


class EventKind(IntEnum):
    """ExecutiveEvent.kind."""

    UNKNOWN = 0
    TRANSITION = 1
    COMMAND = 2


@dataclass(frozen=True, slots=True)
class ExecutiveEvent:
    """A transition, or the result of a command.

    Transition: ``path`` was left by ``outcome`` to ``target``, for this ``reason``. Command: ``command`` is the name of
    its kind, ``decision_id`` what it answers, ``target`` its behavior, operator or level of autonomy, ``reason`` why it
    was refused, ``text`` a remark or the operator's reason.
    """

    executive_id: str
    sequence: int
    kind: EventKind
    path: str = ''
    outcome: str = ''
    target: str = ''
    reason: str = ''
    operator: str = ''
    command: str = ''
    decision_id: str = ''
    applied: bool = True
    text: str = ''
    run_id: str = ''
    stamp: float = 0.0

    @property
    def is_in_log(self) -> bool:
        """True if the log has a line with the same content, as for a note."""
        return self.command == 'NOTE' and self.applied


@dataclass(frozen=True, slots=True)
class InputValue:
    """A typed value as text (BlackboardEntry with ``text``)."""

    key: str
    type: str
    text: str


@dataclass(frozen=True)
class QueueEntry(queue_options.QueueEntry):
    """An entry of the mission queue as its executive tells it. Long values of arguments and inputs are shortened."""

    inputs: tuple[InputValue, ...] = ()
    running: bool = False
    waits_for: str = ''


@dataclass(frozen=True, slots=True)
class MissionQueue:
    """The mission queue of one executive. ``held`` is why it is held, and ``hold`` the number of that, 0 if it is not.

    ``entries`` are in the order in which they start.
    """

    executive_id: str
    hold: int = 0
    held: str = ''
    entries: tuple[QueueEntry, ...] = ()

    def entry(self, number: int) -> QueueEntry | None:
        """Return the entry of that number."""
        return next((entry for entry in self.entries if entry.number == number), None)


@dataclass(frozen=True, slots=True)
class UserdataScope:
    """The userdata of one machine; the type of a value that cannot be sent is empty, and its text shows it.

    ``writers`` and ``written`` are, for each value, the state that has written it, '' for none, and when, s.
    """

    path: str
    values: tuple[InputValue, ...]
    writers: tuple[str, ...] = ()
    written: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class EntryWrite:
    """One write of an entry of a blackboard; ``writer`` is the path of the node, '' if no node wrote it."""

    writer: str
    stamp: float
    value: str


@dataclass(frozen=True, slots=True)
class TreeEntry:
    """An entry of the blackboard of a running tree, with its latest recorded writes, the newest first."""

    scope: str
    key: str
    type: str
    text: str
    count: int
    writes: tuple[EntryWrite, ...]


@dataclass(frozen=True, slots=True)
class TreeBlackboard:
    """The blackboards of a running tree; ``recorded``: who writes is being recorded."""

    run_id: str
    tree: str
    recorded: bool
    entries: tuple[TreeEntry, ...]


LIVENESS: Final = ('fair', 'adversarial', 'fair-outcomes')
"""Assumptions about failures in a synthesis, in the order of the constants of SynthesizeBehavior."""

SYNTHESIS_SECONDS: Final = 60.0
"""Default time limit of a search, s."""


@dataclass(frozen=True, slots=True)
class SynthesisRequest:
    """A request to synthesize a behavior; see SynthesizeBehavior. ``time_limit`` in s."""

    system: str = ''
    capabilities: str = ''
    specification: str = ''
    goals: tuple[str, ...] = ()
    initial_conditions: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = ()
    liveness: str = LIVENESS[0]
    retries: int = -1
    name: str = ''
    time_limit: float = SYNTHESIS_SECONDS


@dataclass(frozen=True, slots=True)
class Synthesis:
    """A behavior that was made, with its machine as YAML; or, with no behavior, the lines that say why none can be."""

    behavior: str
    machine: str
    notes: tuple[str, ...]
    explanation: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class OperatorCommand:
    """A command to an executive. Which fields are used depends on ``kind``; see ExecutiveCommand.

    ``stops``, which is not sent, is the number of STOPs that the operator knew of (:attr:`View.stops`): after a further
    one the command is refused. None: all.
    """

    id: str
    kind: CommandKind
    operator: str
    executive_id: str = ''
    run_id: str = ''
    decision_id: str = ''
    path: str = ''
    outcome: str = ''
    autonomy: int = 0
    behavior: str = ''
    arguments: tuple[tuple[str, str], ...] = ()
    inputs: tuple[InputValue, ...] = ()
    grantee: str = ''
    tree_run_id: str = ''
    text: str = ''
    reason: str = ''
    hold_queue: bool = False
    queue_options: tuple[QueueOptions, ...] = ()
    queue_number: int = 0
    queue_revision: int = 0
    queue_before: int = 0
    wait_queue: float = -1.0
    wait_interaction: float = -1.0
    stops: int | None = None


# The surroundings of the robot as its operator sees them: the map, the plan, and the points of the lidar.

OCCUPIED: Final = 65
"""Percent from which on a cell of a map is occupied (nav_msgs/OccupancyGrid, map_server)."""

_IS_OCCUPIED: Final = bytes(OCCUPIED <= cell <= 100 for cell in range(256))

Points = tuple[tuple[float, float], ...]
"""Points in the frame of the map, m."""


@dataclass(frozen=True, slots=True)
class GridMap:
    """A map (nav_msgs/OccupancyGrid): ``cells`` row by row from ``x``, ``y`` (m) on, a byte each; 255 is unknown."""

    width: int
    height: int
    resolution: float
    x: float
    y: float
    cells: bytes

    def occupied_columns(self, row: int) -> Iterator[int]:
        """Return the columns of the occupied cells of a row, which has none outside the map."""
        first = row * self.width
        cells = self.cells[first : first + self.width] if 0 <= row < self.height else b''
        return compress(range(self.width), cells.translate(_IS_OCCUPIED))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m."""
        return self.width * self.resolution, self.height * self.resolution


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The newest of each, in the frame of the map; ``None`` or empty while it is not known.

    ``scan`` is what the lidar meets; ``at`` the goal where it is known by itself. ``plan_frame`` is the frame of the
    plan, which :attr:`View.drawn` lacks if it is another one than that of the map; '' is that of the map.
    """

    map: GridMap | None = None
    plan: Points = ()
    plan_frame: str = ''
    driven: Points = ()
    scan: Points = ()
    at: tuple[float, float] | None = None

    @property
    def goal(self) -> tuple[float, float] | None:
        """The goal, or else the end of the plan."""
        return self.at or (self.plan[-1] if self.plan else None)

    @property
    def plan_length(self) -> float:
        """Length of the plan, m."""
        return sum(math.dist(a, b) for a, b in pairwise(self.plan))
