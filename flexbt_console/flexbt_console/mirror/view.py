# SPDX-License-Identifier: BSD-3-Clause
"""The picture of the executive at one moment, and what follows from it. Every picture says how old it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from .command_tracker import TrackedCommand
from .freshness import LinkState
from .records import (
    ActiveState,
    Behavior,
    Decision,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    LogLine,
    StateStructure,
    StopGuard,
    Structure,
    Subject,
    Surroundings,
    plain_type,
)
from .trees import MirroredTree
from .unexpected_motion import UnexpectedMotion


@dataclass(frozen=True, slots=True)
class View:
    """An immutable picture; ``age`` in seconds, None before the first snapshot.

    ``structure`` belongs to the run of the snapshot, ``behaviors`` to its executive; each is None while it has not
    arrived. ``problem`` says what is wrong with the link. ``reasons`` is why a state wants what it wants, by the
    identifier of the decision, as far as it, or the state before it, has said so. ``places`` are those of the robot (of
    which it has told if ``has_places``) and our own; where both have one of the same name, that of the robot counts.
    ``trees`` are those that go on, and the latest that have ended or whose server is gone; they and ``surroundings``
    are known if they were requested. ``subjects`` is what decisions are about, by their identifiers, as it has arrived:
    see :meth:`subject`. ``unwanted_motion``: the robot moves though it should stand. ``guard`` is what the stop guard
    says. ``listening``: no executive was heard yet, and there was no time for it.
    """

    link: LinkState
    age: float | None
    problem: str = ''
    snapshot: ExecutiveSnapshot | None = None
    structure: Structure | None = None
    behaviors: tuple[Behavior, ...] | None = None
    last_command: TrackedCommand | None = None
    reasons: Mapping[str, LogLine] = field(default_factory=dict)
    places: Mapping[str, FramedPose] = field(default_factory=dict)
    has_places: bool = False
    trees: tuple[MirroredTree, ...] = ()
    subjects: Mapping[str, Subject] = field(default_factory=dict)
    surroundings: Surroundings = field(default_factory=Surroundings)
    unwanted_motion: UnexpectedMotion | None = None
    listening: bool = False
    guard: StopGuard = field(default_factory=StopGuard)

    @property
    def live(self) -> bool:
        """True if the picture may be shown as the present."""
        return self.link is LinkState.LIVE

    @property
    def running(self) -> bool:
        """True if a behavior is being started, runs, is paused or stops."""
        return self.snapshot is not None and self.snapshot.state not in (
            ExecutiveState.IDLE,
            ExecutiveState.UNKNOWN,
        )

    @property
    def robot_pose(self) -> FramedPose | None:
        """The pose of the robot, None if it is not known."""
        return self.snapshot.robot_pose if self.snapshot else None

    @property
    def drives(self) -> bool:
        """True if an active state reports the progress of a drive."""
        return self.snapshot is not None and any(state.progress is not None for state in self.snapshot.active_states)

    @property
    def running_trees(self) -> list[MirroredTree]:
        """The trees that run for the active states, in their order, or all that run when no state names its own.

        They go by the clock that the executive goes by: its status says what time it is while nothing changes in them.
        """
        named = [state.tree_run_id for state in self.snapshot.active_states] if self.snapshot else []
        now = self.snapshot.stamp if self.snapshot else 0.0
        running = [replace(run, stamp=max(run.stamp, now)) for run in self.trees if run.is_running]
        return [run for run_id in named if run_id for run in running if run.run_id == run_id] or running

    @property
    def drawn_trees(self) -> list[MirroredTree]:
        """Return the trees to draw: the running ones, or else the last state of those whose server is gone."""
        return self.running_trees or [run for run in self.trees if run.server_gone]

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Decisions that wait for the operator, oldest first."""
        return self.snapshot.decisions if self.snapshot else ()

    @property
    def decision(self) -> Decision | None:
        """The decision to answer first: the oldest, or the one that the operator has chosen."""
        return self.decisions[0] if self.decisions else None

    def pending(self, decision_id: str) -> Decision | None:
        """Return the pending decision of that identifier."""
        return next((decision for decision in self.decisions if decision.id == decision_id), None)

    def subject(self, decision: Decision) -> Subject | None:
        """Return the subject of a decision; None if it has not arrived, or the decision has none."""
        found = self.subjects.get(decision.id)
        return found if found is not None and found.number == decision.subject_number else None

    def lacks(self, decision: Decision) -> str:
        """Name what a decision is about if that has not arrived; '' when it is here, or there is nothing to show."""
        if not decision.subject_number or self.subject(decision) is not None:
            return ''
        return ', '.join(decision.subject) or 'what it is about'

    @property
    def drawn(self) -> Surroundings:
        """The surroundings of the robot as they are drawn while the first decision waits: see :meth:`drawn_for`."""
        return self.drawn_for(self.decision)

    def drawn_for(self, decision: Decision | None) -> Surroundings:
        """Return what is around the robot, with the path and the goal that a decision is about in the place of the
        plan.

        Another plan could be taken for what is asked about. So none is drawn while a decision waits, unless a state is
        driving along it.
        """
        around = self.surroundings
        if decision is None:
            return around
        subject = self.subject(decision)
        values = subject.values if subject is not None else ()
        paths = [value for value in values if value.points or plain_type(value.type) == 'nav_msgs/Path']
        poses = [value for value in values if value.pose is not None]
        goal = next((value.pose for value in sorted(poses, key=lambda value: value.key != 'goal')), None)
        if paths or goal is not None:
            return replace(around, plan=paths[0].points if paths else (), at=None if goal is None else (goal.x, goal.y))
        return around if self.drives and not self.lacks(decision) else replace(around, plan=())

    def turned_to(self, decision_id: str) -> View:
        """Return the same picture with that decision before those that have waited longer, if it is pending."""
        found = self.pending(decision_id)
        if found is None or self.snapshot is None or found is self.decision:
            return self
        others = (one for one in self.decisions if one is not found)
        return replace(self, snapshot=replace(self.snapshot, decisions=(found, *others)))

    @property
    def active_paths(self) -> tuple[str, ...]:
        """Paths of the active leaves."""
        return tuple(state.path for state in self.snapshot.active_states) if self.snapshot else ()

    @property
    def active_levels(self) -> tuple[str, ...]:
        """Paths of all that is known to be active, outermost first, each once: leaves, and containers around them.

        A container that waits for a decision is active, though all of its children may have ended.
        """
        paths = (*self.active_paths, *(decision.path for decision in self.decisions))
        levels = {'/': None} if paths else {}
        for path in paths:
            labels = path.strip('/').split('/')
            levels.update(dict.fromkeys('/' + '/'.join(labels[: n + 1]) for n in range(len(labels))))
        return tuple(levels)

    @property
    def lockable_paths(self) -> tuple[str, ...]:
        """Paths of active states and containers that can be left and so locked, the innermost first."""
        levels = (path for path in self.active_levels if path != '/')
        return tuple(sorted(levels, key=lambda path: path.count('/'), reverse=True))

    def own_activity(self, state: ActiveState) -> tuple[str, ...]:
        """Return what an active state says that it is doing, without the running nodes of its tree, where that is
        known."""
        nodes = {node.path for run in self.trees if run.run_id == state.tree_run_id for node in run.nodes}
        return tuple(line for line in state.activity if line not in nodes)

    def state(self, path: str) -> StateStructure | None:
        """Structure of a state or container of the run, when it is known."""
        return self.structure.state(path) if self.structure else None

    def outcomes(self, path: str) -> tuple[str, ...]:
        """Return the declared outcomes of a state, from the structure or a decision; empty if unknown."""
        state = self.state(path)
        if state is not None:
            return state.outcomes
        return next((d.outcomes for d in self.decisions if d.path == path and d.outcomes), ())
