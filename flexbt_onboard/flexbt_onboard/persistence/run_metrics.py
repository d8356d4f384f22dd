# SPDX-License-Identifier: BSD-3-Clause
"""The metrics of a run, computed from the event log.

The figures are those of FlexBE's evaluation of its logs: time in each state, time of waiting for the operator, visits,
and interventions. Times are in seconds, on the clock of the node or in wall time. They exclude steps of the computer's
clock that was set during a run.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from flexbt_core.skills.literals import SkillError
from flexbt_core.skills.observation import SkillMonitor
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text_files import TextFileError, open_regular

LoggedEvent = Mapping[str, Any]

ROOT: Final = '/'

CLOCK_SET_SECONDS: Final = 0.5
"""Difference between wall and steady clock, from one event to the next, above which the clock was set, s."""

_TOLD: Final = ('path', 'outcome', 'decision', 'autonomy', 'text', 'because', 'why')
"""Fields of a command that make up the text of an :class:`Intervention`."""

_NUMBERS: Final = ('time', 'stamp', 'steady', 'wait_queue', 'wait_interaction')
_LARGEST: Final = 1e12
"""Upper bound for the numbers of an event, above the time of any clock, s."""


@dataclass(frozen=True)
class StateVisit:
    """A visit of a state or machine, from entry to exit. ``outcome`` is '' if it was not left by an outcome."""

    path: str
    begin: float
    end: float
    outcome: str = ''
    reason: str = ''


@dataclass(frozen=True)
class OperatorWait:
    """A wait of a state for the operator.

    ``wall`` is its duration, s of wall time. In ``queue`` s of it the operator handled other decisions, and in
    ``interaction`` s this one, as measured by the console; None if not measured.
    """

    path: str
    begin: float
    end: float
    kind: str
    outcome: str
    decision: str = ''
    wall: float = 0.0
    queue: float | None = None
    interaction: float | None = None


@dataclass(frozen=True)
class Intervention:
    """A command of an operator for the run, with its effect."""

    time: float
    operator: str
    command: str
    effect: str
    text: str


@dataclass(frozen=True)
class Contradiction:
    """An observation in a run that contradicts the skill of a state."""

    time: float
    path: str
    text: str


@dataclass
class PathMetrics:
    """The figures of a state or machine. Times are in seconds."""

    path: str
    visits: int = 0
    total: float = 0.0
    longest: float = 0.0
    waiting: float = 0.0
    outcomes: dict[str, int] = field(default_factory=dict)


@dataclass
class RunMetrics:
    """The figures of one run."""

    run: str
    behavior: str = ''
    by: str = ''
    begin: float = 0.0
    end: float = 0.0
    outcome: str = ''
    message: str = ''
    visits: list[StateVisit] = field(default_factory=list)
    waits: list[OperatorWait] = field(default_factory=list)
    interventions: list[Intervention] = field(default_factory=list)
    faults: int = 0
    contradictions: list[Contradiction] = field(default_factory=list)
    clock_set: list[float] = field(default_factory=list)
    """Steps of the computer's clock during the run, s each. They are excluded from all times."""

    @property
    def duration(self) -> float:
        """Time from the start to the end, or to the last event if the run has no end, s."""
        return self.end - self.begin

    @property
    def waiting(self) -> float:
        """Time in which at least one decision waited for the operator, s."""
        total, until = 0.0, self.begin
        for wait in sorted(self.waits, key=lambda wait: wait.begin):
            total += max(0.0, wait.end - max(wait.begin, until))
            until = max(until, wait.end)
        return total

    def wait_causes(self) -> dict[str, float]:
        """Return the wall time of the waits by cause, s.

        - ``queue``: the operator handled other decisions.
        - ``unnoticed``: the operator had not noticed the decision.
        - ``interaction``: the operator handled this decision.
        - ``not measured``: the console has not measured the wait.

        (Wait times by queues, by loss of situation awareness, and by interaction: Cummings and Mitchell 2008.)
        """
        causes = dict.fromkeys(('queue', 'unnoticed', 'interaction', 'not measured'), 0.0)
        for wait in self.waits:
            if wait.queue is None or wait.interaction is None:
                causes['not measured'] += wait.wall
                continue
            interaction = min(wait.interaction, wait.wall)
            queue = min(wait.queue, wait.wall - interaction)
            causes['interaction'] += interaction
            causes['queue'] += queue
            causes['unnoticed'] += wait.wall - interaction - queue
        return causes

    def paths(self) -> list[PathMetrics]:
        """Return the figures of each path, in the order of the first entry, each machine before its states."""
        found: dict[str, PathMetrics] = {}
        for visit in sorted(self.visits, key=lambda visit: (visit.begin, visit.path)):
            one = found.setdefault(visit.path, PathMetrics(visit.path))
            one.visits += 1
            one.total += visit.end - visit.begin
            one.longest = max(one.longest, visit.end - visit.begin)
            if visit.outcome:
                one.outcomes[visit.outcome] = one.outcomes.get(visit.outcome, 0) + 1
        for wait in self.waits:
            if wait.path in found:
                found[wait.path].waiting += wait.end - wait.begin
        return list(found.values())

    def commands(self) -> dict[str, int]:
        """Return the number of commands by ``KIND`` if applied, else by ``KIND EFFECT``, such as ``START refused``."""
        names = [
            one.command if one.effect == 'applied' else f'{one.command} {one.effect}' for one in self.interventions
        ]
        return dict(Counter(names))


def read_events(files: Iterable[Path]) -> Iterator[LoggedEvent]:
    """Yield the events in the files of an event log. Pass the oldest file first.

    Skip lines that were cut off or are not events.

    Raises:
        OSError: a file cannot be read.
    """
    for file in files:
        try:
            lines = open(file, encoding='utf-8', errors='replace', opener=open_regular)  # noqa: SIM115
        except TextFileError as error:
            raise TextFileError(f'{file}: {error}') from None
        with lines:
            yield from events_in(lines)


def events_in(lines: Iterable[str]) -> Iterator[LoggedEvent]:
    """Yield the events in lines of an event log; see :func:`read_events`."""
    for line in lines:
        try:
            event = load_json(line)
        except (ValueError, RecursionError):
            continue
        if _is_event(event):
            yield event


def _is_event(entry: object) -> bool:
    if not isinstance(entry, dict) or not isinstance(entry.get('event'), str):
        return False
    numbers = [entry[name] for name in _NUMBERS if name in entry]
    return all(isinstance(one, (int, float)) and abs(one) <= _LARGEST for one in numbers)


def metrics_of(events: Iterable[LoggedEvent], *, wall: bool = False) -> list[RunMetrics]:
    """Return the metrics of all runs in an event log, in the order of their starts.

    Times are on the node's clock, or with ``wall`` in wall time.
    """
    runs: dict[str, _Reader] = {}
    for event in events:
        kind = event['event']
        if kind == 'executive':
            for reader in runs.values():
                reader.interrupt()
            continue
        run = str(event.get('run', ''))
        if kind in ('started', 'resumed') and run not in runs:
            runs[run] = _Reader(RunMetrics(run), 'time' if wall else 'stamp')
        if run in runs:
            runs[run].take(kind, event)
    return [reader.finished() for reader in runs.values()]


class _Reader:
    """A reader that collects the events of one run."""

    def __init__(self, metrics: RunMetrics, clock: str) -> None:
        self._metrics = metrics
        self._clock = clock
        self._active: dict[str, float] = {}
        self._waiting: dict[str, tuple[float, float, LoggedEvent]] = {}
        self._causes: dict[str, tuple[float, float]] = {}
        self._before: tuple[float, float] | None = None  # wall and steady time of the previous event
        self._set = 0.0  # sum of the steps of the computer's clock, s
        self._wall = 0.0  # wall time of the event without these steps
        self._now: float | None = None
        self._is_over = False
        self._monitor = SkillMonitor({})

    def take(self, kind: str, event: LoggedEvent) -> None:
        """Process an event. If the clock goes back, time stands still until the clock has caught up.

        After the end, only applied commands count: the command that ended the run may be logged after the end.
        """
        metrics = self._metrics
        wall, now = float(event.get('time', 0.0)), float(event.get(self._clock, 0.0))
        if not self._is_over:
            self._see_clock_set(wall, event.get('steady'))
        if abs(now - wall) < CLOCK_SET_SECONDS:  # otherwise the node is on simulated time
            now -= self._set
        self._wall = wall - self._set
        if self._is_over:
            if kind != 'command' or event.get('effect') != 'applied':
                return
            now = metrics.end
        if self._now is None:
            metrics.begin = now
        else:
            now = max(now, self._now)
        self._now = metrics.end = now
        path = str(event.get('path', ''))
        if kind in ('started', 'resumed') and not metrics.behavior:
            metrics.behavior, metrics.by = str(event.get('behavior', '')), str(event.get('by', ''))
        elif kind == 'skills':
            self._declare(event.get('skills'))
        elif kind == 'entered':
            self._note(path, now, self._monitor.began(path))
            for around in _levels(path):
                self._active.setdefault(around, now)
        elif kind == 'left':
            outcome, reason = str(event.get('outcome', '')), str(event.get('reason', ''))
            self._leave(path, now, outcome, reason)
            self._note(path, now, self._monitor.ended(path, outcome, by_itself=reason == 'outcome'))
        elif kind == 'waiting':
            self._waiting[str(event.get('decision'))] = now, self._wall, event
        elif kind == 'decided':
            self._decide(str(event.get('decision')), now)
        elif kind == 'fault':
            metrics.faults += 1
        elif kind == 'command':
            if event.get('effect') == 'applied' and 'wait_queue' in event and 'wait_interaction' in event:
                measured = float(event['wait_queue']), float(event['wait_interaction'])
                self._measure(str(event.get('decision')), *measured)
            parts = [event.get(name) for name in _TOLD]
            text = ' '.join(str(part) for part in parts if part not in (None, ''))
            metrics.interventions.append(
                Intervention(
                    now,
                    str(event.get('operator', '')),
                    str(event.get('command', '')),
                    str(event.get('effect', '')),
                    text,
                )
            )
        elif kind == 'ended':
            metrics.outcome, metrics.message = str(event.get('outcome', '')), str(event.get('message', ''))
            self.interrupt(metrics.outcome)
            self._is_over = True

    def interrupt(self, outcome: str = '') -> None:
        """End all active visits and waits, because the run or the executive has ended."""
        self._before = None  # the computer may have rebooted
        if self._now is not None:
            for path in sorted(self._active, reverse=True):
                self._leave(path, self._now, outcome if path == ROOT else '', '')
            for decision in list(self._waiting):
                self._decide(decision, self._now)

    def finished(self) -> RunMetrics:
        """Return the metrics after the last event."""
        self.interrupt()
        return self._metrics

    def _see_clock_set(self, wall: float, steady: object) -> None:
        before = self._before
        self._before = (wall, steady) if isinstance(steady, float) else None
        if before is not None and self._before is not None:
            by = (wall - before[0]) - (self._before[1] - before[1])
            if abs(by) > CLOCK_SET_SECONDS:
                self._set += by
                self._metrics.clock_set.append(by)

    def _declare(self, skills: object) -> None:
        try:
            self._monitor = SkillMonitor(skills if isinstance(skills, dict) else {})
        except SkillError:
            self._monitor = SkillMonitor({})  # a line of another program, or a corrupt one

    def _note(self, path: str, now: float, texts: Iterable[str]) -> None:
        self._metrics.contradictions += [Contradiction(now, path, text) for text in texts]

    def _leave(self, path: str, now: float, outcome: str, reason: str) -> None:
        inside = [active for active in self._active if active.startswith(f'{path.rstrip("/")}/') and active != path]
        for active in sorted(inside, reverse=True):
            self._metrics.visits.append(StateVisit(active, self._active.pop(active), now))
        begin = self._active.pop(path, now)
        self._metrics.visits.append(StateVisit(path, begin, now, outcome, reason))

    def _measure(self, decision: str, queue: float, interaction: float) -> None:
        """Note the measured times of the newest wait for a decision. A restarted executive numbers its inputs anew."""
        if decision in self._waiting:
            self._causes[decision] = queue, interaction
            return
        waits = self._metrics.waits
        place = next((at for at in reversed(range(len(waits))) if waits[at].decision == decision), None)
        if place is not None:
            waits[place] = replace(waits[place], queue=queue, interaction=interaction)

    def _decide(self, decision: str, now: float) -> None:
        begin, wall, event = self._waiting.pop(decision, (now, 0.0, None))
        queue, interaction = self._causes.pop(decision, (None, None))
        if event is not None:
            self._metrics.waits.append(
                OperatorWait(
                    str(event.get('path', '')),
                    begin,
                    now,
                    str(event.get('kind', '')),
                    str(event.get('outcome', '')),
                    decision,
                    max(0.0, self._wall - wall),
                    queue,
                    interaction,
                )
            )


def _levels(path: str) -> Sequence[str]:
    """Return a path and the paths of the machines around it, root first."""
    labels = [label for label in path.split('/') if label]
    return [ROOT, *('/' + '/'.join(labels[: number + 1]) for number in range(len(labels)))]
