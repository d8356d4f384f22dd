# SPDX-License-Identifier: BSD-3-Clause
"""The status of a run: an immutable snapshot that is computed from the events of the run."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final

from flexbt_common.runtime.ros_clock import RosClock
from flexbt_common.values.decision_subject import subject_message
from flexbt_core.monitors.monitoring import violation_text
from flexbt_core.state_machine.engine.events import RunEvent, RunReader, StateLeft, TransitionBlocked
from flexbt_core.state_machine.engine.leaf import LeafRun
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Decision, DecisionKind
from flexbt_core.state_machine.model.definition import ROOT_PATH, is_inside
from flexbt_core.state_machine.model.state_host import Progress
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.msg import DecisionSubject
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.behaviors.run_context import RunGoals

from .run_events import (
    RunAnnounced,
    RunBuilt,
    RunMoved,
    RunReady,
    StopAwaited,
    StopRequested,
    ViolationFound,
    decision_id,
)

_MOST_LINES: Final = 20
_LONGEST_LINE: Final = 200
"""Maximum characters of a line with the activity of a state. Every status has these, and the link may be slow."""

_RAISED: Final = ('activity() raised; see the log',)
"""Text in place of the activity of a state after an exception. The state is not asked again while it is active."""

_PAUSE_RAISED: Final = ('not_paused() raised; see the log',)
"""Text in place of the not paused parts of a state after an exception. It is not asked again in that pause."""

_NOT_ENTERED: Final = ('is entered when the run is resumed',)


class RunPhase(Enum):
    """The phase of a run."""

    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    STOPPING = 'stopping'


@dataclass(frozen=True)
class ActiveLeaf:
    """A state that is active; ``entered`` is in nanoseconds of ROS time.

    ``held_back`` are lines about transitions that locks block, ``activity`` lines of the state itself, and
    ``not_paused`` lines about parts that continue while the state is paused. ``progress`` is the progress that the
    state reports.
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
    """A transition that waits for the operator; see flexbt_msgs/msg/PendingDecision.

    ``since`` is in nanoseconds of ROS time. ``subject`` has the values that the operator judges, None for none.
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
    """An immutable snapshot of a run.

    ``levels`` has the autonomy level of the root, and of each subtree whose level differs from that of its parent, by
    path. ``operator_gone`` is the reaction of the behavior after ``operator_gone_after`` s without an operator.
    """

    run_id: str
    behavior: str
    levels: Mapping[str, int]
    is_announced: bool = False
    """True if the structure of the run was published."""
    has_begun: bool = False
    """True if the nodes that the run needs are ready, or the wait for them has timed out."""
    is_paused: bool = False
    is_stopping: bool = False
    not_stopped: str = ''
    """Parts that have not stopped yet after a stop, and for how long; '' for none."""
    wrong: str = ''
    """First violation that the monitors have found; '' for none."""
    active: tuple[ActiveLeaf, ...] = ()
    decisions: tuple[RunDecision, ...] = ()
    locked: tuple[str, ...] = ()
    breakpoints: tuple[str, ...] = ()
    step: str = ''
    """The step that is under way; '' for none."""
    operator_gone: OperatorGone = OperatorGone.CONTINUE
    operator_gone_after: float = 0.0

    @property
    def phase(self) -> RunPhase:
        """Phase of the run, as last reported to the operator."""
        if self.is_stopping:
            return RunPhase.STOPPING
        if not (self.is_announced and self.has_begun):
            return RunPhase.STARTING
        return RunPhase.PAUSED if self.is_paused else RunPhase.RUNNING

    @property
    def autonomy(self) -> int:
        """Autonomy level of the run."""
        return self.levels[ROOT_PATH]


class RunStatus(RunReader):
    """The status of a run, computed from its events and published after they are journaled.

    ``snapshot`` is the last published snapshot. It may be read from any thread.
    """

    def __init__(self, run_id: str, behavior: str, autonomy: int, clock: RosClock, goals: RunGoals) -> None:
        self.snapshot = RunSnapshot(run_id, behavior, {ROOT_PATH: autonomy})
        self._goals = goals
        self._clock = clock
        self._lock = threading.Lock()
        self._entered_at: dict[str, float] = {}  # of the states in the last snapshot, by path
        self._subjects: dict[str, dict[str, Any]] = {}  # by decision: the values from which its subject was made

    def read(self, event: RunEvent) -> None:
        match event:
            case StateLeft(path):
                self._entered_at.pop(path, None)  # its next entry is a new one, even if no time has passed
            case RunMoved(machine, _, switched):
                self.publish(**(_of_behavior(switched) if switched is not None else {}), **self._of_machine(machine))
            case RunBuilt():
                self.publish(**_of_behavior(event))
            case RunAnnounced():
                self.publish(is_announced=True)
            case RunReady():
                self.publish(has_begun=True)
            case ViolationFound(violation, True):
                self.publish(wrong=violation_text(violation))
            case StopRequested():
                self.publish(is_stopping=True)
            case StopAwaited(text):
                self.publish(not_stopped=text)

    def publish(self, **changes: Any) -> None:
        """Publish a snapshot with changed fields."""
        with self._lock:
            self.snapshot = replace(self.snapshot, **changes)

    def _of_machine(self, machine: MachineRun) -> dict[str, Any]:
        """Return the fields of a snapshot that depend on the machine. Unchanged parts keep their time stamps."""
        known = {leaf.path: leaf for leaf in self.snapshot.active}
        active = []
        blocked = machine.blocked
        leaves = machine.active_states()
        for leaf in leaves:
            shown = known.get(leaf.path)
            if shown is None or self._entered_at.get(leaf.path) != leaf.entered_at:
                shown = ActiveLeaf(leaf.path, self._stamp(leaf.entered_at))
            lines = tuple(_line(one, leaf.path) for one in blocked if is_inside(leaf.path, one.path))
            # A state that was done before a crash is not entered again and does nothing. A state that was left may
            # still be halting.
            does_nothing = machine.is_paused and not leaf.is_entered and leaf.halting() is None
            active.append(replace(shown, is_paused=leaf.is_paused or does_nothing, held_back=lines))
        self._entered_at = {leaf.path: leaf.entered_at for leaf in leaves}
        for path in machine.coming() if machine.is_paused else ():
            shown = known.get(path) or ActiveLeaf(path, self._stamp(self._clock.now()))
            active.append(replace(shown, is_paused=True, held_back=_NOT_ENTERED))
        return {
            'levels': machine.controls.levels(),
            'is_paused': machine.is_paused,
            'active': tuple(active),
            'decisions': self._decisions(machine),
            'locked': tuple(machine.locked),
            'breakpoints': tuple(machine.breakpoints),
            'step': str(machine.controls.step or ''),
        }

    def asked(self, machine: MachineRun) -> tuple[ActiveLeaf, ...]:
        """Return the active states with their current activity, progress and not paused parts. Calls their code."""
        runs = {leaf.path: leaf for leaf in machine.active_states()}
        active = self.snapshot.active
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

    def _decisions(self, machine: MachineRun) -> tuple[RunDecision, ...]:
        known = {decision.id: decision for decision in self.snapshot.decisions}
        decisions: list[RunDecision] = []
        for decision in machine.decisions:
            id = decision_id(self.snapshot.run_id, decision.id)
            shown = known.pop(id, None) or RunDecision(
                id=id,
                kind=decision.kind,
                path=decision.path,
                outcome=decision.outcome,
                outcomes=decision.outcomes,
                required_autonomy=decision.required,
                prompt=decision.prompt,
                since=self._stamp(decision.since),
            )
            decisions.append(self._with_subject(machine, shown, decision))
        for id in known:
            self._subjects.pop(id, None)
        return tuple(decisions)

    def _with_subject(self, machine: MachineRun, shown: RunDecision, decision: Decision) -> RunDecision:
        """Return a decision with its subject. A new subject is made if one of the values was replaced."""
        values, missing = machine.subject(decision)
        before = self._subjects.get(shown.id, {})
        is_known = before.keys() == values.keys() and all(before[key] is value for key, value in values.items())
        if is_known and (shown.subject is not None or not missing):
            return shown
        self._subjects[shown.id] = values
        number = shown.subject.number + 1 if shown.subject is not None else 1
        return replace(shown, subject=subject_message(shown.id, number, values, missing))

    def _stamp(self, when: float) -> int:
        """Return the ROS time, ns, for a time of the run's clock, s.

        The clock of the run leaves out jumps of ROS time, so it may be ahead of ROS time.
        """
        now = self._clock.stamp()
        return max(0, now.sec * 10**9 + now.nanosec - int((self._clock.now() - when) * 1e9))


def _of_behavior(built: RunBuilt) -> dict[str, Any]:
    return {
        'behavior': built.request.entry.name,
        'operator_gone': built.operator_gone,
        'operator_gone_after': built.operator_gone_after,
    }


def _line(blocked: TransitionBlocked, path: str) -> str:
    who = '' if blocked.path == path else f'{blocked.path}: '
    return sanitize_for_message(
        f"{who}'{blocked.outcome}' waits for the unlock of {', '.join(blocked.locked)}", _LONGEST_LINE
    )


def _shown(lines: list[str] | None, raised: tuple[str, ...]) -> tuple[str, ...]:
    if lines is None:
        return raised
    if len(lines) > _MOST_LINES:
        lines[_MOST_LINES:] = [f'... {len(lines) - _MOST_LINES} more']
    return tuple(sanitize_for_message(line, _LONGEST_LINE) for line in lines)


# The active states of a run are asked for their activity only when needed, since that calls their code.


class ActivityPoll:
    """The poll of the activities of the active states.

    Any thread may request it. The states are asked on the thread of the run.
    """

    def __init__(self) -> None:
        self._has_changed = False
        self._is_requested = False
        self._is_untold = False  # a poll has found a difference that was not reported

    def changed(self) -> None:
        """Request a poll whose result is shown at once, since an activity may have changed."""
        self._has_changed = True

    def request(self) -> None:
        """Request a poll whose result is shown in the next status."""
        self._is_requested = True

    @property
    def is_due(self) -> bool:
        """True if a poll was requested."""
        return self._has_changed or self._is_requested

    def ask(self, status: RunStatus, machine: MachineRun) -> bool:
        """Publish the current activities of the active states. Return True if they should be shown at once.

        A value that differs on every poll, such as a time, does not count as a change. The next status shows it.
        """
        has_changed, self._has_changed, self._is_requested = self._has_changed, False, False
        active = status.asked(machine)
        self._is_untold = self._is_untold or active != status.snapshot.active
        status.publish(active=active)
        is_shown = has_changed and self._is_untold
        self._is_untold = self._is_untold and not is_shown
        return is_shown


def not_paused_lines(before: Sequence[ActiveLeaf], now: Sequence[ActiveLeaf]) -> Iterator[str]:
    """Yield a line for operators for each paused state whose not paused parts have changed."""
    known = {leaf.path: leaf.not_paused for leaf in before}
    for leaf in now:
        if leaf.not_paused and leaf.not_paused != known.get(leaf.path):
            yield f'state {leaf.path} is paused, and yet continues: {"; ".join(leaf.not_paused)}'
