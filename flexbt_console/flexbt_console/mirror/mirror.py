# SPDX-License-Identifier: BSD-3-Clause
"""The mirror: the newest picture of an executive, whatever is lost, late, duplicated or reordered on the way."""

from __future__ import annotations

import bisect
import math
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final, Generic, TypeVar

from flexbt_core.clock.clock import Clock

from .command_tracker import CommandTracker, TrackedCommand
from .freshness import LOST_SECONDS, Freshness
from .records import (
    Behavior,
    BehaviorList,
    Decision,
    DecisionKind,
    EventKind,
    ExecutiveEvent,
    ExecutiveSnapshot,
    FramedPose,
    GridMap,
    IncidentReport,
    LogLine,
    LogSeverity,
    MissionQueue,
    OperatorCommand,
    Points,
    StopGuard,
    Structure,
    Subject,
    Subjects,
    Surroundings,
)
from .trees import TreeNodes, TreeReport, Trees
from .unexpected_motion import UnexpectedMotionDetector
from .view import View

LOG_LENGTH: Final = 500
REMEMBERED_EXECUTIVES: Final = 16
REMEMBERED_STRUCTURES: Final = 4

LISTEN_SECONDS: Final = 2.0
"""Time within which a running executive is received, s: before that it cannot be reported as missing."""

GUARD_SECONDS: Final = 3.0
"""Time after which a stop guard that holds the robot should have been received again, s: it publishes twice a
second."""

TRACE_STEP: Final = 0.05
"""Metres from one point of the driven path that is kept to the next."""

TRACE_LENGTH: Final = 2000


class Change(Enum):
    """The part of the mirror that changed, for its listeners."""

    STATUS = 'status'
    STRUCTURE = 'structure'
    BEHAVIORS = 'behaviors'
    PLACES = 'places'
    SUBJECTS = 'subjects'
    QUEUE = 'queue'
    LOG = 'log'
    EVENTS = 'events'
    LINK = 'link'
    COMMAND = 'command'
    TREE = 'tree'
    SURROUNDINGS = 'surroundings'


@dataclass(frozen=True, slots=True)
class Transit:
    """Wall-clock times of a message in seconds: of sending on the sender's computer, of arrival on ours. Setting our
    clock should not change ours."""

    sent: float
    received: float

    @property
    def duration(self) -> float:
        """Seconds on the way, plus the difference of the two clocks."""
        return self.received - self.sent


class Mirror:
    """State of one executive as its operator may know it. Thread-safe; listeners are called without a lock.

    Snapshots are ordered by (executive_id, sequence): an older or repeated one of the same executive is ignored.
    Another executive_id means that the executive was started again, and replaces the picture, unless that
    message was sent before the picture that we have.
    """

    def __init__(
        self,
        clock: Clock,
        own_places: Mapping[str, FramedPose] | None = None,
        lost_after: float = LOST_SECONDS,
        seconds_asleep: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """Make an empty mirror.

        ``own_places`` are added to those of the robot. ``lost_after``: age of the picture above which the link counts
        as lost, s. ``seconds_asleep`` returns the total time for which the computer has slept. ``clock`` omits that
        time, so data and commands are older by it.
        """
        self._clock = clock
        self._seconds_asleep = seconds_asleep
        self._asleep = 0.0
        self._own_places = dict(own_places or {})
        self._places: Mapping[str, FramedPose] | None = None
        self._lock = threading.Lock()
        self._listeners: list[Callable[[Change], None]] = []
        self._readers: list[Callable[[float, str, tuple[Any, ...]], None]] = []
        self._freshness = Freshness(lost_after)
        self._commands = CommandTracker()
        self._guard = StopGuard()
        self._guard_heard = 0.0
        self._incidents: tuple[IncidentReport, ...] = ()
        self._listens_until = self._now() + LISTEN_SECONDS
        self._snapshot: ExecutiveSnapshot | None = None
        self._sent: float | None = None
        self._newest: OrderedDict[str, int] = OrderedDict()
        self._structures: OrderedDict[str, Structure] = OrderedDict()
        self._behaviors: BehaviorList | None = None
        self._subjects: Subjects | None = None
        self._queue: MissionQueue | None = None
        self._log: NumberedList[LogLine] = NumberedList(LOG_LENGTH)
        self._events: NumberedList[ExecutiveEvent] = NumberedList(LOG_LENGTH)
        self._reasons: Mapping[str, LogLine] | None = None
        self._problem = ''
        self._trees = Trees()
        self._standstill = UnexpectedMotionDetector()
        self._surroundings = Surroundings()
        self._scan_until = math.inf

    def copy(self, clock: Clock) -> Mirror:
        """Return a copy with the same contents that continues independently on ``clock``, without listeners and
        commands."""
        with self._lock:
            return Mirror.of(self.contents(), clock)

    @classmethod
    def of(cls, contents: Mapping[str, Any], clock: Clock) -> Mirror:
        """Return a mirror of these :meth:`contents`, which are its own from then on."""
        mirror = cls(clock)
        vars(mirror).update(contents)
        return mirror

    def contents(self) -> dict[str, Any]:
        """Return a copy of all that was received. For readers, see :meth:`add_reader`."""
        return {name: _copied(value) for name, value in vars(self).items() if name not in _OWN}

    def add_reader(self, read: Callable[[float, str, tuple[Any, ...]], None]) -> None:
        """Call ``read`` with the time, the name of a method and its arguments after each message that the mirror takes,
        on the thread that brought it and in their order; first, with no name, for what is there already.

        To show the mirror as it was, call the same methods at the same times. The mirror is locked meanwhile.
        """
        with self._lock:
            self._readers.append(read)
            read(self._now(), '', ())

    def _read(self, now: float, method: str, *arguments: Any) -> None:
        for read in self._readers:
            read(now, method, arguments)

    @contextmanager
    def _taking(self, change: Change, method: str, *arguments: Any) -> Iterator[float]:
        """Lock the mirror while a method takes something, whose time this yields; tell the readers and listeners."""
        with self._lock:
            now = self._now()
            yield now
            self._read(now, method, *arguments)
        self._tell(change)

    def add_listener(self, listener: Callable[[Change], None]) -> None:
        """Call ``listener`` after each change, on the thread that brought it."""
        with self._lock:
            self._listeners.append(listener)

    # Incoming messages

    def receive_snapshot(self, snapshot: ExecutiveSnapshot, transit: Transit | None = None) -> bool:
        """Process a snapshot; return False when it is not newer than the present one."""
        with self._lock:
            now = self._now()
            if not self._is_newer(snapshot, transit, now):
                return False
            current = self._snapshot
            if current is not None and current.executive_id != snapshot.executive_id:
                self._freshness.start_over()
            self._follow(snapshot)
            self._standstill.receive(snapshot)
            self._trees.receive_peers(snapshot.executive_id, snapshot.peers, now)
            self._snapshot = snapshot
            self._reasons = None
            self._sent = None if transit is None else transit.sent
            self._newest[snapshot.executive_id] = snapshot.sequence
            self._newest.move_to_end(snapshot.executive_id)
            while len(self._newest) > REMEMBERED_EXECUTIVES:
                self._newest.popitem(last=False)
            self._freshness.arrived(now, snapshot.heartbeat_period, None if transit is None else transit.duration)
            settled = self._commands.answered(snapshot, now)
            self._read(now, 'receive_snapshot', snapshot, transit)
        self._tell(Change.STATUS)
        if settled:
            self._tell(Change.COMMAND)
        return True

    def receive_guard(self, guard: StopGuard) -> None:
        """Process a status of the stop guard."""
        with self._lock:
            self._guard = guard
            now = self._guard_heard = self._now()
            settled = self._commands.carried_out(guard, now)
            self._read(now, 'receive_guard', guard)
        self._tell(Change.COMMAND if settled else Change.LINK)

    def receive_incidents(self, incidents: tuple[IncidentReport, ...]) -> None:
        """Process the incidents of the last day, newest first."""
        with self._taking(Change.LINK, 'receive_incidents', incidents):
            self._incidents = incidents

    def receive_structure(self, structure: Structure) -> None:
        """Process the state machine of a run."""
        with self._taking(Change.STRUCTURE, 'receive_structure', structure):
            self._structures[structure.run_id] = structure
            self._structures.move_to_end(structure.run_id)
            while len(self._structures) > REMEMBERED_STRUCTURES:
                self._structures.popitem(last=False)

    def receive_behaviors(self, behaviors: BehaviorList) -> None:
        """Process the list of behaviors."""
        with self._taking(Change.BEHAVIORS, 'receive_behaviors', behaviors):
            self._behaviors = behaviors

    def receive_places(self, places: Mapping[str, FramedPose]) -> None:
        """Process the places that the robot knows by name."""
        with self._taking(Change.PLACES, 'receive_places', places):
            self._places = places

    def receive_subjects(self, subjects: Subjects) -> None:
        """Process the subjects of the pending decisions."""
        with self._taking(Change.SUBJECTS, 'receive_subjects', subjects):
            self._subjects = subjects

    def receive_queue(self, queue: MissionQueue) -> None:
        """Process the mission queue."""
        with self._taking(Change.QUEUE, 'receive_queue', queue):
            self._queue = queue

    def receive_log(self, line: LogLine) -> bool:
        """Process a line of the log; return False for one that is known already or too old."""
        with self._lock:
            if not self._log.add(line):
                return False
            self._reasons = None
            self._read(self._now(), 'receive_log', line)
        self._tell(Change.LOG)
        return True

    def receive_events(self, events: Sequence[ExecutiveEvent]) -> bool:
        """Process transitions and commands; return False when all of them are known already, or too old."""
        with self._lock:
            new = [event for event in events if self._events.add(event)]
            self._reasons = None
            if new:
                self._read(self._now(), 'receive_events', new)
        if new:
            self._tell(Change.EVENTS)
        return bool(new)

    def receive_tree_structure(self, nodes: TreeNodes) -> None:
        """Process the nodes of a run of a tree."""
        with self._taking(Change.TREE, 'receive_tree_structure', nodes):
            self._trees.receive_structure(nodes)

    def receive_tree_status(self, report: TreeReport) -> None:
        """Process the events of a run of a tree."""
        with self._lock:
            now = self._now()
            is_newer = self._trees.receive_status(report, now)
            if is_newer:
                self._read(now, 'receive_tree_status', report)
        if is_newer:
            self._tell(Change.TREE)

    def tree_servers_left(self, there: Collection[str] = ()) -> None:
        """Note the only nodes that still publish statuses of trees, as the middleware reports."""
        with self._taking(Change.TREE, 'tree_servers_left', there) as now:
            self._trees.servers_left(there, now)

    def receive_map(self, map: GridMap) -> None:
        """Process the map."""
        self._surround('receive_map', map, map=map)

    def receive_plan(self, plan: Points, frame: str = '') -> None:
        """Process the path that the robot follows, or the latest one that was requested."""
        self._surround('receive_plan', plan, frame, plan=plan, plan_frame=frame)

    def receive_scan(self, scan: Points, seconds: float) -> None:
        """Process the points of the lidar, valid for this many seconds. They may be the same as before."""
        with self._lock:
            now = self._now()
            self._scan_until = now + seconds
            self._read(now, 'receive_scan', scan, seconds)
            if scan is self._surroundings.scan:
                return
            self._surroundings = replace(self._surroundings, scan=scan)
        self._tell(Change.SURROUNDINGS)

    def forget_surroundings(self) -> None:
        """Discard trees, plan and scan, which are not received any more: they must not be shown later. Keep the map."""
        with self._lock:
            self._trees.forget_runs()
        self._surround('forget_surroundings', plan=(), scan=())

    def _surround(self, method: str, *arguments: Any, **parts: Any) -> None:
        with self._taking(Change.SURROUNDINGS, method, *arguments):
            self._surroundings = replace(self._surroundings, **parts)

    def wants_ping(self) -> bool:
        """Return whether an echo of the executive would improve the age of the picture, see :meth:`receive_pong`."""
        with self._lock:
            return self._freshness.wants_ping(self._now())

    def receive_pong(self, ahead: float) -> None:
        """Note an echo that was sent ``ahead`` seconds after the ping, each on the clock of its computer, as in
        :class:`Transit`."""
        with self._taking(Change.LINK, 'receive_pong', ahead) as now:
            self._freshness.echoed(now, ahead)

    def is_silent(self, listened: float = math.inf) -> bool:
        """Return whether the executive is overdue, or was never heard; ``listened`` is the time, s, for which we have
        listened since, without the time when we were busy ourselves."""
        with self._lock:
            return self._freshness.silent(self._now(), listened)

    def sender_gone(self) -> None:
        """Note that no publisher of snapshots is left, as the middleware reports."""
        with self._taking(Change.LINK, 'sender_gone'):
            self._freshness.sender_gone()

    def sender_replaced(self, was_executive: bool) -> None:
        """Start the ages anew: another process sends now, whose numbers and times do not compare with those before.

        If that process replaces one that was not the executive, forget the other messages, too.
        """
        with self._lock:
            self._newest.clear()
            self._sent = None
            self._freshness.start_over()
            self._standstill = UnexpectedMotionDetector()
            self._surroundings = replace(self._surroundings, driven=())
            if not was_executive:
                self._structures.clear()
                self._behaviors = self._places = self._reasons = self._subjects = self._queue = None
                self._log, self._events = NumberedList(LOG_LENGTH), NumberedList(LOG_LENGTH)
            self._read(self._now(), 'sender_replaced', was_executive)

    def set_problem(self, problem: str) -> None:
        """Set the problem of the link (empty: none), e.g. that the sides have different versions."""
        with self._lock:
            changed, self._problem = self._problem != problem, problem
            self._read(self._now(), 'set_problem', problem)
        if changed:
            self._tell(Change.LINK)

    # Commands

    def give(
        self, command: OperatorCommand, timeout: float, label: str = '', send: Callable[[], object] = lambda: None
    ) -> TrackedCommand:
        """Queue a command, which the operator calls ``label``; see :meth:`CommandTracker.give`. Then ``send`` what is
        due, before the listeners are told."""
        with self._lock:
            tracked = self._commands.give(command, self._now(), timeout, label)
        send()
        self._tell(Change.COMMAND)
        return tracked

    def due_commands(self, reachable: bool) -> list[OperatorCommand]:
        """Return the commands to send now; end those whose deadline is over."""
        with self._lock:
            before = len(self._commands.pending())
            send = self._commands.due(self._now(), reachable)
            ended = len(self._commands.pending()) != before
        if ended:
            self._tell(Change.COMMAND)
        return send

    def send_stops_again(self) -> None:
        """Send again the STOPs that wait for an answer: a new participant may not have received them."""
        with self._lock:
            self._commands.send_stops_again(self._now())

    def next_command_time(self, reachable: bool) -> float | None:
        """Time on the mirror's clock of the next work for :meth:`due_commands`, or None."""
        with self._lock:
            return self._on_clock(self._commands.next_due(reachable))

    def passed_over_stops(self) -> frozenset[str]:
        """Return the identifiers of unanswered stops that the executive on display did not receive."""
        with self._lock:
            return self._commands.passed_over()

    def command(self, command_id: str) -> TrackedCommand | None:
        """Return the result of a command."""
        with self._lock:
            return self._commands.get(command_id)

    # Known data

    def view(self) -> View:
        """Return the present view, with its age."""
        with self._lock:
            now = self._now()
            snapshot = self._snapshot
            if self._surroundings.scan and now > self._scan_until:  # what it met may be gone
                self._surroundings = replace(self._surroundings, scan=())
            return View(
                link=self._freshness.state(now),
                age=self._freshness.age(now),
                problem=self._problem,
                snapshot=snapshot,
                structure=self._structures.get(snapshot.run_id) if snapshot else None,
                behaviors=self._current_behaviors(snapshot),
                last_command=self._commands.latest(),
                reasons=self._current_reasons(snapshot) if snapshot else {},
                places={**self._own_places, **(self._places or {})},
                has_places=self._places is not None,
                trees=self._trees.runs(now),
                subjects=self._current_subjects(snapshot),
                queue=self._current_queue(snapshot),
                surroundings=self._surroundings,
                unwanted_motion=self._standstill.motion,
                listening=snapshot is None and not self._problem and now < self._listens_until,
                guard=replace(self._guard, is_silent=self._guard.holding and now - self._guard_heard > GUARD_SECONDS),
                incidents=self._incidents,
                stops=self._commands.stops,
            )

    def log(self, count: int = LOG_LENGTH) -> tuple[LogLine, ...]:
        """Return the last lines of the log in the order in which they were written, those of an earlier executive
        first."""
        with self._lock:
            return self._log.latest(count)

    def events(self, count: int = LOG_LENGTH) -> tuple[ExecutiveEvent, ...]:
        """Return the last transitions and commands in their order, those of an earlier executive first.

        A gap in their numbers is what was left out, or lost.
        """
        with self._lock:
            return self._events.latest(count)

    def next_link_change(self) -> float | None:
        """Time on the mirror's clock at which the link state changes if nothing arrives, or None."""
        with self._lock:
            now = self._now()
            if self._snapshot is None and now < self._listens_until:
                return self._on_clock(self._listens_until)
            return self._on_clock(self._freshness.next_change(now))

    def now(self) -> float:
        """Return the time of all that was received here, s."""
        with self._lock:
            return self._now()

    def _now(self) -> float:
        """Return the mirror's time, s, which includes the time that the computer sleeps."""
        self._asleep = max(self._asleep, self._seconds_asleep())
        return self._clock.now() + self._asleep

    def _on_clock(self, time: float | None) -> float | None:
        return None if time is None else time - self._asleep

    def _follow(self, snapshot: ExecutiveSnapshot) -> None:
        """Record the poses of the robot since its run began."""
        pose, driven = snapshot.robot_pose, self._surroundings.driven
        if self._snapshot is not None and self._snapshot.run_id != snapshot.run_id:
            driven = ()
        if pose is not None and (not driven or math.dist(driven[-1], (pose.x, pose.y)) >= TRACE_STEP):
            driven = (*driven[-TRACE_LENGTH + 1 :], (pose.x, pose.y))
        if driven is not self._surroundings.driven:
            self._surroundings = replace(self._surroundings, driven=driven)

    def _current_behaviors(self, snapshot: ExecutiveSnapshot | None) -> tuple[Behavior, ...] | None:
        known = self._behaviors
        if known is None or (snapshot is not None and snapshot.executive_id != known.executive_id):
            return None
        return known.behaviors

    def _current_subjects(self, snapshot: ExecutiveSnapshot | None) -> Mapping[str, Subject]:
        known = self._subjects
        if known is None or snapshot is None or snapshot.executive_id != known.executive_id:
            return {}
        return {subject.decision_id: subject for subject in known.subjects}

    def _current_queue(self, snapshot: ExecutiveSnapshot | None) -> MissionQueue | None:
        known = self._queue
        return known if known and (snapshot is None or snapshot.executive_id == known.executive_id) else None

    def _current_reasons(self, snapshot: ExecutiveSnapshot) -> Mapping[str, LogLine]:
        if self._reasons is None:
            executive = snapshot.executive_id
            self._reasons = reasons(snapshot, self._log.of(executive), self._events.of(executive))
        return self._reasons

    def _is_newer(self, snapshot: ExecutiveSnapshot, transit: Transit | None, now: float) -> bool:
        newest = self._newest.get(snapshot.executive_id)
        current = self._snapshot
        if newest is not None and snapshot.sequence <= newest:
            # The sender of a lower number, sent later while the picture is silent, is the executive: the higher number
            # never came from it.
            is_later = transit is not None and self._sent is not None and transit.sent > self._sent
            return is_later and self._freshness.silent(now)
        if current is None or current.executive_id == snapshot.executive_id:
            return True
        # Only the time of sending shows a late message of the previous executive. Once the current executive is silent,
        # accept any message, whatever the clocks say.
        older = transit is not None and self._sent is not None and transit.sent < self._sent
        return not older or self._freshness.silent(now)

    def _tell(self, change: Change) -> None:
        with self._lock:
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener(change)


_OWN: Final = frozenset({'_clock', '_lock', '_listeners', '_readers', '_commands', '_seconds_asleep', '_asleep'})
"""What does not belong to the contents of a mirror."""


def _copied(value: Any) -> Any:
    """Return a copy of a mutable value; records are immutable and need none."""
    if isinstance(value, (list, deque)):
        return copy(value)
    if not isinstance(value, (dict, Freshness, NumberedList, Trees, UnexpectedMotionDetector)):
        return value
    made = copy(value)
    parts = made if isinstance(made, dict) else vars(made)
    parts.update({name: _copied(part) for name, part in parts.items()})
    return made


# Numbered messages of an executive, such as log lines: put in order, without duplicates.

NUMBERED_EXECUTIVES: Final = 3
"""Number of starts of the executive that are remembered."""


N = TypeVar('N', LogLine, ExecutiveEvent)


class NumberedList(Generic[N]):
    """The latest numbered items, ``length`` for each start of the executive."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._known: OrderedDict[str, list[N]] = OrderedDict()

    def add(self, one: N) -> bool:
        """Add an item; return False when it is known already or too old."""
        known = self._known.setdefault(one.executive_id, [])
        place = bisect.bisect_left(known, one.sequence, key=lambda old: old.sequence)
        if place < len(known) and known[place].sequence == one.sequence:
            return False
        if place == 0 and len(known) >= self._length:
            return False
        known.insert(place, one)
        del known[: -self._length]
        while len(self._known) > NUMBERED_EXECUTIVES:
            self._known.popitem(last=False)
        return True

    def of(self, executive_id: str) -> list[N]:
        """Return the items of one start of the executive, in their order."""
        return self._known.get(executive_id, [])

    def latest(self, count: int) -> tuple[N, ...]:
        """Return the latest items in their order, those of an earlier executive first."""
        known = [one for of_executive in self._known.values() for one in of_executive]
        return tuple(known[-count:]) if count > 0 else ()


# The reason why a state waits for the operator, from the log of that state or of the states before it.

_OLDER_SECONDS: Final = 1.0
"""Maximum time by which the report of a container about its outcome may be older than its decision, s."""

_PASSING_SECONDS: Final = 1.0
"""A state that was active for a shorter time has only led on from the one before it."""


def reasons(
    snapshot: ExecutiveSnapshot, log: Sequence[LogLine], events: Sequence[ExecutiveEvent]
) -> dict[str, LogLine]:
    """Return the reasons of the decisions of a snapshot: the newest of the most severe lines since the state began.
    For a state that has reported nothing, or requests a value: the line above information of the state that has led to
    it, or of an earlier one, if those between have only led on. Both sequences are in their order.
    """
    if not snapshot.decisions:
        return {}
    entered = {state.path: state.entered for state in snapshot.active_states}
    told = [line for line in log if line.run_id == snapshot.run_id]
    left = [one for one in events if one.kind is EventKind.TRANSITION and one.run_id == snapshot.run_id]
    found = {}
    for decision in snapshot.decisions:
        since = entered.get(decision.path, decision.since - _OLDER_SECONDS)
        asks = decision.kind is DecisionKind.INPUT
        line = None if asks else _gravest(line for line in _inside(told, decision.path) if line.stamp >= since)
        if line := line or _told_before(decision, told, left):
            found[decision.id] = line
    return found


def _told_before(decision: Decision, told: Sequence[LogLine], left: Sequence[ExecutiveEvent]) -> LogLine | None:
    path = decision.path
    before = _to(path, left)
    while before is not None:
        path, until = before.path, before.stamp
        left = [one for one in left if one.sequence < before.sequence]
        entry = _to(path, left)
        since = entry.stamp if entry is not None else 0.0
        grave = (line for line in _inside(told, path) if line.severity > LogSeverity.INFO)
        if line := _gravest(line for line in grave if since <= line.stamp <= until):
            return line
        before = entry if until - since < _PASSING_SECONDS else None
    return None


def _to(path: str, left: Sequence[ExecutiveEvent]) -> ExecutiveEvent | None:
    """Return the latest transition to a state, or to a container around it."""
    return next((one for one in reversed(left) if one.target and f'{path}/'.startswith(f'{one.target}/')), None)


def _inside(told: Sequence[LogLine], path: str) -> Iterable[LogLine]:
    inside = path.rstrip('/') + '/'
    return (line for line in told if f'{line.path}/'.startswith(inside))


def _gravest(lines: Iterable[LogLine]) -> LogLine | None:
    return max(lines, key=lambda line: (line.severity, line.sequence), default=None)
