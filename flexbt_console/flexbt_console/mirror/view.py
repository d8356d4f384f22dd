# SPDX-License-Identifier: BSD-3-Clause
"""The picture of the executive at one moment, with its age."""

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
    IncidentReport,
    LogLine,
    MissionQueue,
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
    """An immutable picture of the executive.

    ``age``: seconds, None before the first snapshot.
    ``problem``: description of a fault of the link, '' if none.
    ``structure``: of the run of the snapshot; None until it has arrived.
    ``behaviors``: of the executive of the snapshot; None until they have arrived.
    ``reasons``: for a decision, by identifier, the log line that explains the outcome that the state wants. The state,
    or one before it, has logged it.
    ``places``: places of the robot and of this console; for equal names, the robot's. ``has_places``: the robot has
    sent its places.
    ``trees``: the running trees, and the latest that have ended or whose server is gone. Empty unless requested, as
    ``surroundings``.
    ``subjects``: received subjects of decisions, by the identifier of the decision; see :meth:`subject`.
    ``queue``: the mission queue; None until it has arrived.
    ``unwanted_motion``: motion of the robot at a time when it should stand still.
    ``guard``: latest report of the stop guard.
    ``incidents``: of the last day, newest first.
    ``stops``: number of STOPs that were given here.
    ``listening``: True while no executive has been received, but it is too early to report that.
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
    queue: MissionQueue | None = None
    unwanted_motion: UnexpectedMotion | None = None
    listening: bool = False
    guard: StopGuard = field(default_factory=StopGuard)
    incidents: tuple[IncidentReport, ...] = ()
    stops: int = 0

    @property
    def live(self) -> bool:
        """True if the picture may be shown as the current state."""
        return self.link is LinkState.LIVE

    @property
    def running(self) -> bool:
        """True if a behavior starts, runs, is paused or stops."""
        return self.snapshot is not None and self.snapshot.state not in (
            ExecutiveState.IDLE,
            ExecutiveState.UNKNOWN,
        )

    @property
    def robot_pose(self) -> FramedPose | None:
        """Pose of the robot; None if it is not known."""
        return self.snapshot.robot_pose if self.snapshot else None

    @property
    def drives(self) -> bool:
        """True if an active state reports the progress of a drive."""
        return self.snapshot is not None and any(state.progress is not None for state in self.snapshot.active_states)

    @property
    def running_trees(self) -> list[MirroredTree]:
        """The running trees of the active states, in the order of these; all running trees if that finds none.

        Their ``stamp`` is at least that of the executive's status, because a tree sends no time while it does not
        change. Both use the same clock.
        """
        named = [state.tree_run_id for state in self.snapshot.active_states] if self.snapshot else []
        now = self.snapshot.stamp if self.snapshot else 0.0
        running = [replace(run, stamp=max(run.stamp, now)) for run in self.trees if run.is_running]
        return [run for run_id in named if run_id for run in running if run.run_id == run_id] or running

    @property
    def drawn_trees(self) -> list[MirroredTree]:
        """Trees to draw: the running ones, or else those whose server is gone, in their last known state."""
        return self.running_trees or [run for run in self.trees if run.server_gone]

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Decisions that wait for the operator, oldest first; one chosen by :meth:`turned_to` comes before these."""
        return self.snapshot.decisions if self.snapshot else ()

    @property
    def decision(self) -> Decision | None:
        """The decision to answer first: the oldest one, or the one that the operator has chosen."""
        return self.decisions[0] if self.decisions else None

    def pending(self, decision_id: str) -> Decision | None:
        """Return the pending decision with this identifier; None if it is not pending."""
        return next((decision for decision in self.decisions if decision.id == decision_id), None)

    def subject(self, decision: Decision) -> Subject | None:
        """Return the subject of a decision; None if it has not arrived, or the decision has none."""
        found = self.subjects.get(decision.id)
        return found if found is not None and found.number == decision.subject_number else None

    def lacks(self, decision: Decision) -> str:
        """Return the name of the subject of a decision if that has not arrived; '' if it has, or none is needed."""
        if not decision.subject_number or self.subject(decision) is not None:
            return ''
        return ', '.join(decision.subject) or 'what it is about'

    def is_on_map(self, frame: str) -> bool:
        """Return whether a frame is that of the map: '', or that of the robot's pose or of a place, if any is known."""
        known = {pose.frame for pose in (self.robot_pose, *self.places.values()) if pose is not None}
        return not known or frame in ('', *known)

    @property
    def drawn(self) -> Surroundings:
        """The surroundings of the robot to draw for the first decision; see :meth:`drawn_for`."""
        return self.drawn_for(self.decision)

    def drawn_for(self, decision: Decision | None) -> Surroundings:
        """Return the surroundings of the robot to draw for a decision. If its subject has a path or a goal, these
        replace the plan; what is in another frame than the map is not drawn.

        An operator could mistake another plan for the subject of the decision. So no plan is returned while a decision
        without such a subject waits, unless the robot is driving and the subject has arrived.
        """
        around = self.surroundings
        if not self.is_on_map(around.plan_frame):
            around = replace(around, plan=())
        if decision is None:
            return around
        subject = self.subject(decision)
        values = subject.values if subject is not None else ()
        paths = [value for value in values if value.points or plain_type(value.type) == 'nav_msgs/Path']
        poses = [value for value in values if value.pose is not None]
        if paths or poses:
            plan = next((value.points for value in paths[:1] if self.is_on_map(value.frame)), ())
            goals = [value.pose for value in sorted(poses, key=lambda value: value.key != 'goal')[:1]]
            at = next(((goal.x, goal.y) for goal in goals if goal is not None and self.is_on_map(goal.frame)), None)
            return replace(around, plan=plan, at=at)
        return around if self.drives and not self.lacks(decision) else replace(around, plan=())

    def turned_to(self, decision_id: str) -> View:
        """Return the same picture with this decision first, if it is pending."""
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
        """Paths of the active states and of the containers around them, each once, containers before their children.

        A container that waits for a decision is active, even if all of its children have ended.
        """
        paths = (*self.active_paths, *(decision.path for decision in self.decisions))
        levels = {'/': None} if paths else {}
        for path in paths:
            labels = path.strip('/').split('/')
            levels.update(dict.fromkeys('/' + '/'.join(labels[: n + 1]) for n in range(len(labels))))
        return tuple(levels)

    @property
    def lockable_paths(self) -> tuple[str, ...]:
        """Paths of the active states and containers that can be locked: all except the root, innermost first."""
        levels = (path for path in self.active_levels if path != '/')
        return tuple(sorted(levels, key=lambda path: path.count('/'), reverse=True))

    def own_activity(self, state: ActiveState) -> tuple[str, ...]:
        """Return the activity that an active state reports, without the nodes of its tree, as far as the tree is
        known."""
        nodes = {node.path for run in self.trees if run.run_id == state.tree_run_id for node in run.nodes}
        return tuple(line for line in state.activity if line not in nodes)

    def state(self, path: str) -> StateStructure | None:
        """Return the structure of a state or container of the run; None if it is not known."""
        return self.structure.state(path) if self.structure else None

    def outcomes(self, path: str) -> tuple[str, ...]:
        """Return the declared outcomes of a state, from the structure or a decision; empty if unknown."""
        state = self.state(path)
        if state is not None:
            return state.outcomes
        return next((d.outcomes for d in self.decisions if d.path == path and d.outcomes), ())
