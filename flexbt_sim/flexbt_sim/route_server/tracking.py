# SPDX-License-Identifier: BSD-3-Clause
"""A goal of compute_and_track_route: where on its route the robot is, and when the route has to be another one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from nav2_msgs.action import ComputeAndTrackRoute
from nav_msgs.msg import Path

from flexbt_common.calls import ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_sim.ros_messages import path_message
from flexbt_sim.routes import PlannedRoute, Progress, RouteTracker
from flexbt_sim.server_common import SUCCEEDED, GoalEnd, PoseWatch, RobotInterface, RouteParameters, end_by
from flexbt_sim.world import Pose

from .messages import route_message
from .operations import RouteOperations


class Plan(Protocol):
    """Plans what a goal asks for: one of the two functions is called."""

    def __call__(
        self,
        goal: ServedGoal,
        progress: Progress | None,
        on_planned: Callable[[PlannedRoute], None],
        on_end: Callable[[GoalEnd], None],
    ) -> None: ...


class RouteTracking:
    """Begins with planning. On the executor thread; ``on_end`` is told the end and how many seconds it took."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: RouteParameters,
        robot: RobotInterface,
        operations: RouteOperations,
        goal: ServedGoal,
        plan: Plan,
        show: Callable[[Path], None],
        on_end: Callable[[GoalEnd, float], None],
    ) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._operations = operations
        self.goal = goal
        self._plan = plan
        self._show = show
        self._on_end = on_end
        self.active = True
        self._began = runtime.clock.now()
        self._watch: PoseWatch | None = None
        self._tracker: RouteTracker | None = None
        operations.begin()
        robot.on_pose.append(self._on_pose)
        self._replan(None)

    def end(self, end: GoalEnd) -> None:
        """End the goal, once."""
        if not self.active:
            return
        self.active = False
        self._robot.on_pose.remove(self._on_pose)
        if self._watch is not None:
            self._watch.cancel()
        self._operations.finish()
        self._on_end(end, max(0.0, self._runtime.clock.now() - self._began))

    def _replan(self, progress: Progress | None) -> None:
        self._tracker = None
        self._plan(self.goal, progress, self._on_planned, self.end)

    def _on_planned(self, planned: PlannedRoute) -> None:
        if not self.active:
            return
        self._tracker = RouteTracker(planned.route, self._parameters.radii, planned.edge)
        stamp = self._runtime.clock.stamp()
        self._route = route_message(planned.route, self._robot.parameters.map_frame, stamp)
        self._path = path_message(planned.path, self._robot.parameters.map_frame, stamp)
        self._show(self._path)
        self._tell(self._tracker, rerouted=True)
        if self._watch is None:
            self._watch = self._robot.watch_pose(self.end)

    def _on_pose(self, pose: Pose, now: float) -> None:
        tracker = self._tracker
        if tracker is None:
            return
        try:
            changed = tracker.step(pose)
            done = self._operations.process(changed, tracker, pose, now)
        except Exception as error:
            self.end(end_by(self._runtime, error, 'tracking of a route'))
            return
        if changed or done.triggered:
            self._tell(tracker, operations=done.triggered)
        if tracker.is_complete:
            self.end(SUCCEEDED)
        elif done.reroute:
            self._replan(Progress(done.blocked, tracker.last_node, tracker.edge, pose))

    def _tell(self, tracker: RouteTracker, *, rerouted: bool = False, operations: Sequence[str] = ()) -> None:
        """Ids of what there is not are 0."""
        last, ahead, edge = tracker.last_node, tracker.next_node, tracker.edge
        self.goal.publish_feedback(
            ComputeAndTrackRoute.Feedback(
                last_node_id=last.id if last is not None else 0,
                next_node_id=ahead.id if ahead is not None else 0,
                current_edge_id=edge.id if edge is not None else 0,
                route=self._route,
                path=self._path,
                operations_triggered=list(operations),
                rerouted=rerouted,
            )
        )
