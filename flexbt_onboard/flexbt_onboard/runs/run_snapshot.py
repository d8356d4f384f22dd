# SPDX-License-Identifier: BSD-3-Clause
"""What others see of a run: one immutable value, made on the thread of the run, which polls its states for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final

from flexbt_common.runtime.ros_clock import RosClock
from flexbt_common.values.decision_subject import subject_message
from flexbt_core.state_machine.engine.leaf import LeafRun
from flexbt_core.state_machine.engine.region import BlockedTransition
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Decision, DecisionKind
from flexbt_core.state_machine.model.definition import ROOT_PATH, is_inside
from flexbt_core.state_machine.model.state_host import Progress
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.msg import DecisionSubject
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.behaviors.run_context import RunGoals

_MOST_LINES: Final = 20
_LONGEST_LINE: Final = 200
"""Of what a state says that it does: each status has it, and the link may be slow."""

_RAISED: Final = ('activity() raised; see the log',)
"""Instead of what a state says that it does. It is not asked again as long as it is active."""

_PAUSE_RAISED: Final = ('not_paused() raised; see the log',)
"""Instead of what a state says that goes on while it is paused. It is not asked again in that pause."""

_NOT_ENTERED: Final = ('is entered when the run is resumed',)

EventEntry = tuple[str, Mapping[str, Any]]
"""An event of the event log, and its fields."""


class RunPhase(Enum):
    """What a run is at."""

    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    STOPPING = 'stopping'


@dataclass(frozen=True)
class ActiveLeaf:
    """A state that is active; ``entered`` is in nanoseconds of ROS time.

    ``held_back`` are lines about transitions that locks hold back, ``activity`` those of the state itself, and
    ``not_paused`` those about what goes on while it is paused; ``progress`` is how far it says that it has come.
    """

    path: str
    entered: int
    is_paused: bool = False
    held_back: tuple[str, ...] = ()
    activity: tuple[str, ...] = ()
    not_paused: tuple[str, ...] = ()
    progress: Progress | None = None


@dataclass(frozen=True)
class RunDecision:
    """A transition that waits for the operator; see flexbt_msgs/msg/PendingDecision. ``since`` is in ns of ROS time.

    ``subject`` is what it is about, if it is about any value.
    """

    id: str
    kind: DecisionKind
    path: str
    outcome: str
    outcomes: tuple[str, ...]
    required_autonomy: int
    prompt: str
    since: int
    subject: DecisionSubject | None = None


@dataclass(frozen=True)
class RunSnapshot:
    """A run at one moment.

    ``levels`` has the level of autonomy of the root, and of each sub-tree that has another one than what is around it,
    by path. ``operator_gone`` is what the behavior wants when no operator was there for ``operator_gone_after`` s.
    """

    run_id: str
    behavior: str
    levels: Mapping[str, int]
    is_announced: bool = False
    """The operator knows the structure of the run."""
    has_begun: bool = False
    """The nodes that it needs are ready, or were waited for long enough."""
    is_paused: bool = False
    is_stopping: bool = False
    not_stopped: str = ''
    """While it is stopping: what has not stopped yet, and for how long."""
    wrong: str = ''
    """What the monitors have found first."""
    active: tuple[ActiveLeaf, ...] = ()
    decisions: tuple[RunDecision, ...] = ()
    locked: tuple[str, ...] = ()
    breakpoints: tuple[str, ...] = ()
    operator_gone: OperatorGone = OperatorGone.CONTINUE
    operator_gone_after: float = 0.0

    @property
    def phase(self) -> RunPhase:
        """What the run is at, as far as the operator was told."""
        if self.is_stopping:
            return RunPhase.STOPPING
        if not (self.is_announced and self.has_begun):
            return RunPhase.STARTING
        return RunPhase.PAUSED if self.is_paused else RunPhase.RUNNING

    @property
    def autonomy(self) -> int:
        """The level of the run."""
        return self.levels[ROOT_PATH]


@dataclass(frozen=True)
class RunEnd:
    """How a run has ended; ``outputs`` are the values of the machine's output keys."""

    outcome: str
    message: str
    outputs: Mapping[str, Any] = field(default_factory=dict)


class SnapshotSource:
    """Takes snapshots of a machine. Used on the thread of the run only."""

    def __init__(self, machine: MachineRun, clock: RosClock, run_id: str, goals: RunGoals) -> None:
        self.machine = machine
        self._goals = goals
        self._clock = clock
        self._run_id = run_id
        self._entered_at: dict[str, float] = {}  # of what the last snapshot has
        self._subjects: dict[str, dict[str, Any]] = {}  # by decision: the values of which its subject was made

    def is_outdated(self) -> bool:
        """Return whether a state is active that is not in the last snapshot."""
        return any(self._entered_at.get(leaf.path) != leaf.entered_at for leaf in self.machine.active_states())

    def left(self, path: str) -> None:
        """A state was left: when it is seen again it was entered anew, even if no time has passed."""
        self._entered_at.pop(path, None)

    def take(self, before: RunSnapshot) -> tuple[dict[str, Any], list[EventEntry]]:
        """Return what the machine says of the fields of a snapshot, and what is new in it as events.

        What has not changed since the snapshot ``before`` keeps its time stamp.
        """
        machine, known = self.machine, {leaf.path: leaf for leaf in before.active}
        events: list[EventEntry] = []
        active = []
        held_back = machine.held_back
        leaves = machine.active_states()
        for leaf in leaves:
            shown = known.get(leaf.path)
            if shown is None or self._entered_at.get(leaf.path) != leaf.entered_at:
                shown = ActiveLeaf(leaf.path, self._stamp(leaf.entered_at))
                events.append(('entered', {'path': leaf.path}))
            lines = tuple(_line(one, leaf.path) for one in held_back if is_inside(leaf.path, one.path))
            # One that was done before a crash is not entered again: it does nothing. One that was left may still halt.
            does_nothing = machine.is_paused and not leaf.is_entered and leaf.halting() is None
            active.append(replace(shown, is_paused=leaf.is_paused or does_nothing, held_back=lines))
        self._entered_at = {leaf.path: leaf.entered_at for leaf in leaves}
        for path in machine.coming() if machine.is_paused else ():
            shown = known.get(path) or ActiveLeaf(path, self._stamp(self._clock.now()))
            active.append(replace(shown, is_paused=True, held_back=_NOT_ENTERED))
        decisions, decision_events = self._decisions({decision.id: decision for decision in before.decisions})
        fields = {
            'levels': machine.autonomy_levels,
            'is_paused': machine.is_paused,
            'active': tuple(active),
            'decisions': decisions,
            'locked': tuple(machine.locked),
            'breakpoints': tuple(machine.breakpoints),
        }
        return fields, [*events, *decision_events]

    def asked(self, active: tuple[ActiveLeaf, ...]) -> tuple[ActiveLeaf, ...]:
        """Return the active states with what they say that they are doing, and not pausing; this calls their code."""
        runs = {leaf.path: leaf for leaf in self.machine.active_states()}
        return tuple(self._asked(leaf, runs[leaf.path]) if leaf.path in runs else leaf for leaf in active)

    def _asked(self, leaf: ActiveLeaf, run: LeafRun) -> ActiveLeaf:
        if leaf.activity is not _RAISED:
            leaf = replace(leaf, activity=_shown(run.activity(), _RAISED), progress=run.progress())
        if not run.is_paused:
            return replace(leaf, not_paused=()) if leaf.not_paused else leaf
        if leaf.not_paused is not _PAUSE_RAISED:
            goals, own = self._goals.not_paused(run.state.unwrapped), run.not_paused()
            leaf = replace(leaf, not_paused=_shown(None if own is None else [*own, *goals], _PAUSE_RAISED))
        return leaf

    def _decisions(self, known: dict[str, RunDecision]) -> tuple[tuple[RunDecision, ...], list[EventEntry]]:
        decisions: list[RunDecision] = []
        events: list[EventEntry] = []
        for decision in self.machine.decisions:
            shown = known.pop(decision_id(self._run_id, decision.id), None)
            if shown is None:
                shown = RunDecision(
                    id=decision_id(self._run_id, decision.id),
                    kind=decision.kind,
                    path=decision.path,
                    outcome=decision.outcome,
                    outcomes=decision.outcomes,
                    required_autonomy=decision.required,
                    prompt=decision.prompt,
                    since=self._stamp(decision.since),
                )
                events.append(('waiting', _waiting(shown)))
            decisions.append(self._with_subject(shown, decision))
        for id in known:
            self._subjects.pop(id, None)
        return tuple(decisions), [*events, *(('decided', {'decision': id}) for id in known)]

    def _with_subject(self, shown: RunDecision, decision: Decision) -> RunDecision:
        """With what it is about: made anew when one of the values was replaced by another."""
        values, missing = self.machine.subject(decision)
        before = self._subjects.get(shown.id, {})
        is_known = before.keys() == values.keys() and all(before[key] is value for key, value in values.items())
        if is_known and (shown.subject is not None or not missing):
            return shown
        self._subjects[shown.id] = values
        number = shown.subject.number + 1 if shown.subject is not None else 1
        return replace(shown, subject=subject_message(shown.id, number, values, missing))

    def _stamp(self, when: float) -> int:
        """ROS time of a time of the run's clock, which may be ahead of ROS time by jumps that were taken out."""
        now = self._clock.stamp()
        return max(0, now.sec * 10**9 + now.nanosec - int((self._clock.now() - when) * 1e9))


def decision_id(run_id: str, number: str) -> str:
    """Return the name of a decision in this executive: the run numbers its decisions."""
    return f'{run_id[:8]}-{number}'


def decision_number(run_id: str, decision: str) -> str | None:
    """Return the number that the run gave to a decision; None when it is no decision of this run."""
    prefix = decision_id(run_id, '')
    return decision.removeprefix(prefix) if decision.startswith(prefix) else None


def _waiting(decision: RunDecision) -> dict[str, Any]:
    return {
        'decision': decision.id,
        'path': decision.path,
        'kind': decision.kind.name.lower(),
        'outcome': decision.outcome,
        'outcomes': list(decision.outcomes),
        'required': decision.required_autonomy,
        'prompt': decision.prompt,
    }


def _line(held_back: BlockedTransition, path: str) -> str:
    who = '' if held_back.path == path else f'{held_back.path}: '
    return sanitize_for_message(
        f"{who}'{held_back.outcome}' waits for the unlock of {', '.join(held_back.locked)}", _LONGEST_LINE
    )


def _shown(lines: list[str] | None, raised: tuple[str, ...]) -> tuple[str, ...]:
    if lines is None:
        return raised
    if len(lines) > _MOST_LINES:
        lines[_MOST_LINES:] = [f'... {len(lines) - _MOST_LINES} more']
    return tuple(sanitize_for_message(line, _LONGEST_LINE) for line in lines)


# When the active states of a run are asked what they are doing, which calls their code.


class ActivityPoll:
    """Asked for from any thread; the states are asked on the thread of the run."""

    def __init__(self) -> None:
        self._has_changed = False
        self._is_requested = False
        self._is_untold = False  # what was found when it was requested, and nothing had changed

    def changed(self) -> None:
        """What states are doing may be another thing now, which is to be shown."""
        self._has_changed = True

    def request(self) -> None:
        """The next status is to have what the states are doing then."""
        self._is_requested = True

    @property
    def is_due(self) -> bool:
        """Whether the states are to be asked."""
        return self._has_changed or self._is_requested

    def ask(self, source: SnapshotSource, before: tuple[ActiveLeaf, ...]) -> tuple[tuple[ActiveLeaf, ...], bool]:
        """Return the active states with what they say now, and whether that is to be shown at once.

        What is another thing each time that it is asked for, such as a time, is no event: the next status has it.
        """
        has_changed, self._has_changed, self._is_requested = self._has_changed, False, False
        active = source.asked(before)
        self._is_untold = self._is_untold or active != before
        is_shown = has_changed and self._is_untold
        self._is_untold = self._is_untold and not is_shown
        return active, is_shown


def not_paused_lines(before: Sequence[ActiveLeaf], now: Sequence[ActiveLeaf]) -> Iterator[str]:
    """For operators: what goes on although its state is paused, where that is new."""
    known = {leaf.path: leaf.not_paused for leaf in before}
    for leaf in now:
        if leaf.not_paused and leaf.not_paused != known.get(leaf.path):
            yield f'state {leaf.path} is paused, and yet goes on: {"; ".join(leaf.not_paused)}'
