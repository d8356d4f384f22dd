# SPDX-License-Identifier: BSD-3-Clause
"""The lanes of the time line: what was active, ran, was asked, commanded, aimed at or wrong, and from when to when."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from operator import attrgetter
from typing import Any, Final

from flexbt_core.values.text import one_line

from .freshness import LOST_PERIODS, LOST_SECONDS
from .mirror import Mirror
from .records import (
    DecisionKind,
    EventKind,
    ExecutiveEvent,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    LogLine,
    LogSeverity,
)
from .trees import MirroredNode, MirroredStatus, TreeNodes, TreeReport

MOST_ENTRIES: Final = 3000
"""Entries of a lane, at most; the oldest are dropped."""

MERGE_SECONDS: Final = 1.0
"""Time between two equal entries that become one, s: a node that ticks often is one entry with a count."""

LATE_SECONDS: Final = 2.0
"""Time by which the reason of an end may arrive later than the end, s."""

MOST_LATE: Final = 8 * 3600.0
"""Age of an event, s, above which its time is that of another clock."""

MOST_RUNS: Final = 16
MOST_WAITING: Final = 100
"""Runs of trees that are followed, and reports that wait for the nodes of their run, at most."""

TEXT_LENGTH: Final = 300
MOST_TEXT: Final = 100_000
"""Characters of an entry's text, and of a text of the log that are looked at."""

ANSWERS: Final = {'CONFIRM': 'confirmed', 'FORCE': 'forced', 'ANSWER': 'answered', 'DECLINE': 'declined'}
FAILED: Final = frozenset({'failed', 'error', 'failure'})


class Lane(StrEnum):
    """A lane of the time line, in the order from top to bottom."""

    STATES = 'states'
    NODES = 'nodes'
    DECISIONS = 'decisions'
    COMMANDS = 'commands'
    GOALS = 'goals'
    FAULTS = 'faults'


@dataclass(slots=True)
class LaneEntry:
    """A part of a lane.

    ``begin`` and ``end`` are in seconds on the reader's clock; ``end`` is None while it goes on. ``key`` tells what it
    is of: the path of a state, or the run's tree and the path of a node. ``word``: how it ended. ``tone``: good, error,
    warning or ''. ``count``: how often it happened. ``revision`` grows with each change of any entry.
    """

    number: int
    lane: Lane
    key: str
    label: str
    begin: float
    end: float | None
    word: str = ''
    tone: str = ''
    text: str = ''
    count: int = 1
    revision: int = 0


class Lanes:
    """The lanes of a mirror from now on. Thread-safe."""

    def __init__(self, mirror: Mirror) -> None:
        self._lock = threading.Lock()
        self._lanes: dict[Lane, deque[LaneEntry]] = {lane: deque(maxlen=MOST_ENTRIES) for lane in Lane}
        self._latest: OrderedDict[tuple[Lane, str], LaneEntry] = OrderedDict()
        self._open: dict[tuple[Lane, str], LaneEntry] = {}
        self._early: list[ExecutiveEvent | LogLine] = []
        self._resumed: dict[int, tuple[float, float]] = {}
        """Of an entry that goes on after its end: when it went on, and that end."""
        self._numbers = self.revision = 0
        self._now = self._at = 0.0  # now, and when that happened which is told now
        self._snapshot: ExecutiveSnapshot | None = None
        self._heard = math.inf
        self._entered: dict[str, float] = {}
        self._left: dict[str, float] = {}
        """When a state was left the last time, on the executive's clock; its status may be older."""
        self._over: deque[tuple[LaneEntry, float]] = deque(maxlen=MOST_WAITING)
        """The states that have ended, whose outcomes may come later, and the stamp of the status that shows it."""
        self._asked: OrderedDict[str, tuple[LaneEntry, DecisionKind]] = OrderedDict()
        """The newest decisions, by identifier."""
        self._ran = ''
        self._places: Mapping[str, FramedPose] = {}
        self._runs: OrderedDict[str, _Run] = OrderedDict()
        self._takers: dict[str, Callable[..., None]] = {
            '': lambda: self._take_known(mirror.contents()),
            'receive_snapshot': self._take_snapshot,
            'receive_events': self._take_events,
            'receive_log': self._take_log,
            'receive_places': self._take_places,
            'receive_tree_structure': self._take_nodes,
            'receive_tree_status': self._take_report,
            'tree_servers_left': self._take_servers,
            'forget_surroundings': lambda: self._end_runs(lambda run: True, ''),
        }
        mirror.add_reader(self._take)

    def since(self, revision: int = 0, most: int | None = None) -> list[LaneEntry]:
        """Return copies of the entries that are new or have changed since a :attr:`revision`, those of each lane in
        the order in which they began. With ``most``, return the first ones, in the order of their revisions."""
        with self._lock:
            lanes = self._lanes.values() if revision < self.revision else ()
            found = [one for lane in lanes for one in lane if one.revision > revision]
            if most is not None:
                found = sorted(found, key=attrgetter('revision'))[:most]
            return [replace(one) for one in found]

    def _take(self, now: float, method: str, arguments: tuple[Any, ...]) -> None:
        if method in self._takers:
            with self._lock:
                self._now = self._at = now
                self._takers[method](*arguments)

    def _take_known(self, contents: Mapping[str, Any]) -> None:
        """Take what is sent once, and was received before: the places, and the nodes of the trees that run."""
        self._places = contents['_places'] or {}
        for one in contents['_trees'].runs(self._now):
            if one.is_running:
                nodes = TreeNodes(one.run_id, one.tree, one.nodes, one.stamp, one.structure)
                now = one.run_id, one.sequence, one.statuses, (), one.stamp, one.finished, one.paused
                self._take_nodes(nodes)
                self._take_report(TreeReport(*now, structure=one.structure, server=one.server))

    # Entries

    def _add(self, lane: Lane, key: str, label: str, **more: Any) -> LaneEntry:
        """Begin an entry, or go on with the latest one, if it has ended just now."""
        entry = self._latest.get((lane, key))
        if entry is not None and self._is_recent(entry, MERGE_SECONDS) and lane is Lane.NODES:
            assert entry.end is not None
            self._resumed[entry.number] = self._at, entry.end
            entry.end = None
        else:
            self._numbers += 1
            shown = one_line(label, 100), self._at, more.pop('end', None)
            entry = LaneEntry(self._numbers, lane, key, *shown, **more)
            self._lanes[lane].append(entry)
            self._latest[lane, key] = entry
            self._latest.move_to_end((lane, key))
            while len(self._latest) > 2 * MOST_ENTRIES:
                self._latest.popitem(last=False)
        return self._changed(entry)

    def _happened(self, lane: Lane, key: str, label: str, word: str, tone: str, text: str) -> None:
        """Add an entry without duration, or count the latest one if it is the same."""
        text, latest = one_line(text, TEXT_LENGTH), self._latest.get((lane, key))
        if latest is not None and (latest.word, latest.text) == (word, text) and self._is_recent(latest, MERGE_SECONDS):
            latest.count, latest.end = latest.count + 1, self._at
            self._changed(latest)
        else:
            self._add(lane, key, label, end=self._at, word=word, tone=tone, text=text)

    def _end(self, entry: LaneEntry, word: str = '', tone: str = '') -> None:
        began, before = self._resumed.pop(entry.number, (entry.begin, None))
        if before is not None and entry.word != word:  # it has ended otherwise: that is another entry
            entry.end = before
            self._changed(entry)
            self._latest.pop((entry.lane, entry.key), None)
            entry = self._add(entry.lane, entry.key, entry.label, text=entry.text)
            entry.begin = began
        elif before is not None:
            entry.count += 1
        entry.end, entry.word, entry.tone = max(self._at, entry.begin), word or entry.word, tone or entry.tone
        if entry.lane is Lane.STATES and self._snapshot is not None:
            self._over.append((entry, self._snapshot.stamp))
        self._changed(entry)

    def _changed(self, entry: LaneEntry) -> LaneEntry:
        self.revision += 1
        entry.revision = self.revision
        return entry

    def _is_recent(self, entry: LaneEntry, seconds: float) -> bool:
        return entry.end is not None and abs(self._at - entry.end) <= seconds

    def _only(self, lane: Lane, wanted: Mapping[str, Callable[[], LaneEntry]]) -> None:
        """Let exactly these entries of a lane go on, by what tells them apart."""
        for one in [one for one in self._open if one[0] is lane and one[1] not in wanted]:
            self._end(self._open.pop(one))
        for name, make in wanted.items():
            if (lane, name) not in self._open:
                self._open[lane, name] = make()

    # Messages of the executive

    def _take_snapshot(self, snapshot: ExecutiveSnapshot, *_: Any) -> None:
        before, self._snapshot = self._snapshot, snapshot
        if before is None or before.executive_id != snapshot.executive_id or snapshot.stamp < before.stamp:
            self._left.clear()  # another clock, or one that was set
            self._over.clear()
        if before is None:
            early, self._early = self._early, []
            for one in early:
                self._take_events([one]) if isinstance(one, ExecutiveEvent) else self._take_log(one)
        silent = max(LOST_SECONDS, LOST_PERIODS * snapshot.heartbeat_period)
        if self._now - self._heard > silent:
            entry = self._add(Lane.FAULTS, 'link', 'no link', end=self._now, word='no link', tone='error')
            entry.begin, entry.text = self._heard, f'nothing heard for {self._now - self._heard:.0f} s'
        self._heard = self._now
        self._follow_states(snapshot)
        self._only(
            Lane.DECISIONS,
            {
                one.id: lambda one=one: self._add(  # type: ignore[misc]
                    Lane.DECISIONS,
                    one.path,
                    f'{_leaf(one.path)}: {one.outcome or one.kind.name.lower()}',
                    text=one_line(one.prompt if one.kind is DecisionKind.INPUT else '', TEXT_LENGTH),
                )
                for one in snapshot.decisions
            },
        )
        for asked in snapshot.decisions:
            self._asked[asked.id] = self._open[Lane.DECISIONS, asked.id], asked.kind
        while len(self._asked) > MOST_ENTRIES:
            self._asked.popitem(last=False)
        goals = [(one.path, one.progress.goal) for one in snapshot.active_states if one.progress is not None]
        self._only(
            Lane.GOALS,
            {
                f'{path} {goal.x:.2f} {goal.y:.2f}': lambda path=path, goal=goal: self._add(  # type: ignore[misc]
                    Lane.GOALS,
                    path,
                    goal.place(self._places) or f'{goal.x:.1f}, {goal.y:.1f}',
                    text=f'x {goal.x:.2f}  y {goal.y:.2f}  {one_line(path)}',
                )
                for path, goal in goals
                if goal is not None
            },
        )
        gone = [one for one in snapshot.peers if one.expected and not one.alive]
        self._only(
            Lane.FAULTS,
            {
                one.name: lambda one=one: self._add(  # type: ignore[misc]
                    Lane.FAULTS, one.name, f'{_leaf(one.name)} gone', tone='error', text=one_line(one.problem)
                )
                for one in gone
            },
        )
        self._end_runs(lambda run: run.server in {one.name for one in gone}, 'server gone')
        is_over = snapshot.state is ExecutiveState.IDLE
        if is_over and self._ran and self._ran == snapshot.run_id and snapshot.outcome in FAILED:
            what = f'{snapshot.behavior}: {snapshot.outcome}'
            self._happened(Lane.FAULTS, snapshot.behavior, what, snapshot.outcome, 'error', snapshot.message or what)
        self._ran = '' if is_over else snapshot.run_id

    def _follow_states(self, snapshot: ExecutiveSnapshot) -> None:
        leaves = {one.path: one.entered for one in snapshot.active_states}
        now = {path: at for path, at in leaves.items() if at >= self._left.get(path, -math.inf)}
        paths = dict.fromkeys(
            level for path in (*now, *(one.path for one in snapshot.decisions)) for level in _levels(path)
        )
        for path in paths:
            entry, left = self._open.get((Lane.STATES, path)), self._left.get(path, -math.inf)
            is_new = (
                now[path] != self._entered.get(path)
                if path in now
                else bool(entry and entry.word and snapshot.stamp > left)
            )
            if entry is not None and is_new:  # it was left and entered again
                self._end(self._open.pop((Lane.STATES, path)))
        self._entered = now
        self._only(
            Lane.STATES,
            {path: lambda path=path: self._add(Lane.STATES, path, _leaf(path), text=one_line(path)) for path in paths},  # type: ignore[misc]
        )

    def _take_events(self, events: Sequence[ExecutiveEvent]) -> None:
        for event in events:
            if not self._is_dated(event):
                continue
            if event.kind is EventKind.TRANSITION and event.path.strip('/'):
                tone = 'error' if event.outcome in FAILED else ''
                self._left[event.path] = event.stamp
                entry = next((one for one in self._visits(event) if self._lacks_word(one)), None)
                if entry is None:
                    entry = self._add(
                        Lane.STATES, event.path, _leaf(event.path), end=self._at, text=one_line(event.path)
                    )
                entry.word, entry.tone = one_line(event.outcome, 60), tone
                self._changed(entry)
            elif event.kind is EventKind.COMMAND:
                self._take_command(event)

    def _visits(self, event: ExecutiveEvent) -> Iterator[LaneEntry]:
        """Return what a transition may have ended, in order: the status may have told of the next visit already."""
        yield from (one for one, stamp in self._over if one.key == event.path and event.stamp <= stamp)
        if event.stamp >= self._entered.get(event.path, -math.inf) and (Lane.STATES, event.path) in self._open:
            yield self._open[Lane.STATES, event.path]

    def _is_dated(self, one: ExecutiveEvent | LogLine) -> bool:
        """Return whether it is known when this happened: a new reader gets also what is older, at once."""
        if self._snapshot is None:
            self._early = [*self._early[-MOST_WAITING + 1 :], one]
            return False
        self._date(one.stamp if self._snapshot.executive_id == one.executive_id else math.inf)
        return True

    def _date(self, stamp: float) -> None:
        """Note when that happened which is told now, by the executive's clock. What is not late happens now."""
        late = self._snapshot.stamp - stamp if self._snapshot is not None else 0.0
        self._at = self._now - late if LATE_SECONDS < late < MOST_LATE else self._now

    def _take_command(self, event: ExecutiveEvent) -> None:
        who = one_line(event.operator, 60)
        target = '' if event.command in ANSWERS or event.command == 'STOP' else event.target
        asked, kind = self._asked.get(event.decision_id, (self._of(Lane.DECISIONS, event.path), None))
        is_choice = kind is DecisionKind.CHOICE and event.command == 'FORCE'  # so it is answered, by the protocol
        command = 'answer' if is_choice else event.command.lower().replace('_', ' ')
        what = ' '.join(one for one in (command, event.outcome, target) if one)
        word = 'applied' if event.applied else 'refused'
        text = '  '.join(one for one in (what, word, event.path, event.text, event.reason, who) if one)
        self._happened(Lane.COMMANDS, who, what, word, '' if event.applied else 'error', text)
        if event.applied and event.command in ANSWERS and asked is not None:
            asked.word, asked.tone = f'{one_line(event.outcome, 60) or ANSWERS[event.command]} by {who}', 'good'
            self._changed(asked)

    def _of(self, lane: Lane, path: str) -> LaneEntry | None:
        """Return the latest entry of a path, if its end is not explained yet, and not long ago."""
        entry = self._latest.get((lane, path))
        return entry if entry is not None and self._lacks_word(entry) else None

    def _lacks_word(self, entry: LaneEntry) -> bool:
        return not entry.word and (entry.end is None or self._is_recent(entry, LATE_SECONDS))

    def _take_log(self, line: LogLine) -> None:
        if self._is_dated(line) and line.severity >= LogSeverity.WARN:
            tone = 'error' if line.severity is LogSeverity.ERROR else 'warning'
            path = one_line(line.path, TEXT_LENGTH // 3)
            text = f'{_gist(line.text)}  {path}'.rstrip()
            self._happened(Lane.FAULTS, line.path, _gist(line.text), line.severity.name.lower(), tone, text)

    def _take_places(self, places: Mapping[str, FramedPose]) -> None:
        self._places = places

    # Trees

    def _run(self, run_id: str) -> _Run:
        run = self._runs.setdefault(run_id, _Run())
        while len(self._runs) > MOST_RUNS:
            self._end_nodes(self._runs.popitem(last=False)[1], '')
        return run

    def _take_nodes(self, nodes: TreeNodes) -> None:
        run = self._run(nodes.run_id)
        if nodes.structure < run.structure:
            return
        if nodes.structure > run.structure:
            self._end_nodes(run, '')
        run.tree, run.structure, run.nodes = one_line(nodes.tree, 100), nodes.structure, nodes.nodes
        waiting, run.waiting = run.waiting, []
        for report in waiting:
            self._take_report(report)

    def _take_report(self, report: TreeReport) -> None:
        run = self._run(report.run_id)
        run.server = report.server or run.server
        if report.structure != run.structure:
            run.waiting = [*run.waiting[-MOST_WAITING + 1 :], report]
            return
        self._date(report.stamp)
        for change in report.changes:
            self._node_changed(run, change.uid, change.status)
        for uid in [
            uid
            for uid in run.open
            if uid > len(report.statuses) or report.statuses[uid - 1] is not MirroredStatus.RUNNING
        ]:
            self._node_changed(
                run, uid, report.statuses[uid - 1] if uid <= len(report.statuses) else MirroredStatus.IDLE
            )
        for uid, status in enumerate(report.statuses, 1):
            if status is MirroredStatus.RUNNING and uid not in run.open:
                self._node_changed(run, uid, status)
        if report.finished:
            self._end_nodes(run, 'halted')
            del self._runs[report.run_id]

    def _node_changed(self, run: _Run, uid: int, status: MirroredStatus) -> None:
        if status is MirroredStatus.SKIPPED or not 0 < uid <= len(run.nodes):
            return
        entry = run.open.pop(uid, None)
        if status is MirroredStatus.RUNNING:
            run.open[uid] = entry or self._add(Lane.NODES, *_named(run.tree, run.nodes[uid - 1]))
            return
        if status is MirroredStatus.IDLE:
            if entry is not None:
                self._end(entry, 'halted')
            return
        tone = 'error' if status is MirroredStatus.FAILURE else 'good'
        self._end(entry or self._add(Lane.NODES, *_named(run.tree, run.nodes[uid - 1])), status.name.lower(), tone)

    def _end_nodes(self, run: _Run, word: str) -> None:
        for entry in run.open.values():
            self._end(entry, word)
        run.open.clear()

    def _end_runs(self, is_over: Callable[[_Run], bool], word: str) -> None:
        for run in self._runs.values():
            if run.open and is_over(run):
                self._end_nodes(run, word)

    def _take_servers(self, there: Collection[str] = ()) -> None:
        self._end_runs(lambda run: run.server not in there if run.server else not there, 'server gone')


class _Run:
    """A run of a tree: its nodes, those that run as entries, and the reports that came before the nodes."""

    def __init__(self) -> None:
        self.tree = self.server = ''
        self.structure = 0
        self.nodes: Sequence[MirroredNode] = ()
        self.open: dict[int, LaneEntry] = {}
        self.waiting: list[TreeReport] = []


def _named(tree: str, node: MirroredNode) -> tuple[str, str]:
    return f'{tree}\n{node.path}', node.name or node.registration


def _levels(path: str) -> Iterable[str]:
    """Return the containers around a state, from the outside in, and the state itself."""
    labels = path.strip('/').split('/')
    return ['/' + '/'.join(labels[: n + 1]) for n in range(len(labels))] if path.strip('/') else []


def _gist(text: str) -> str:
    """Return the first line, and the last one: of an exception, the name and the reason."""
    lines = text[:MOST_TEXT].strip().splitlines() or ['']
    return one_line('  '.join(dict.fromkeys((lines[0], lines[-1].strip()))), TEXT_LENGTH * 2 // 3 - 2)


def _leaf(path: str) -> str:
    return one_line(path.rpartition('/')[2] or path, 100)
