# SPDX-License-Identifier: BSD-3-Clause
"""A goal of compute_and_track_route: its route is followed while the robot drives, the operations of its edges and
nodes are carried out, and it is planned again when it has to be another one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, Protocol

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from nav2_msgs.action import ComputeAndTrackRoute
from nav2_msgs.msg import Route as RouteMessage
from nav2_msgs.msg import RouteEdge, RouteNode, SpeedLimit
from nav_msgs.msg import Path
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls.goal_server import ServedGoal
from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.common.goals import SUCCEEDED, GoalEnd, end_by
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.robot_interface import PoseWatch, RobotInterface
from flexbt_sim.messages import path_message
from flexbt_sim.world.plane.geometry import Pose

from .edge_scorers import SCORERS
from .graph import Operation, speed_limit
from .route import AchievedRadii, PathShape, PlannedRoute, Route, RouteProgress, RouteTracker, blocked_edge

DYNAMIC_EDGES: Final = 'DynamicEdgesScorer'
ADJUST_SPEED_LIMIT: Final = 'AdjustSpeedLimit'
REROUTING_SERVICE: Final = 'ReroutingService'
COLLISION_MONITOR: Final = 'CollisionMonitor'
TIME_MARKER: Final = 'TimeMarker'
OPERATIONS: Final = (ADJUST_SPEED_LIMIT, REROUTING_SERVICE, COLLISION_MONITOR, TIME_MARKER)


SCORER_NAMES: Final = (*SCORERS, DYNAMIC_EDGES)


@dataclass(frozen=True)
class RouteParameters:
    """Parameters of the route server."""

    graph_file: str = parameter('graph_filepath', '', 'GeoJSON file of the graph for routes; none when it is empty')
    edge_scorers: tuple[str, ...] = parameter(
        'edge_cost_functions',
        ('DistanceScorer', DYNAMIC_EDGES),
        'what edges of routes cost, added up: ' + ', '.join(SCORER_NAMES),
        choices=SCORER_NAMES,
    )
    operations: tuple[str, ...] = parameter(
        'operations',
        (ADJUST_SPEED_LIMIT, REROUTING_SERVICE, COLLISION_MONITOR),
        'what is done while a route is tracked: ' + ', '.join(OPERATIONS),
        choices=OPERATIONS,
    )
    trigger_events: tuple[str, ...] = parameter(
        'trigger_events',
        ('TriggerEvent',),
        'types of operations in the graph that call the service (std_srvs/Trigger) of their metadata: service_name',
    )
    shape: PathShape = field(default_factory=PathShape)
    radii: AchievedRadii = field(default_factory=AchievedRadii)
    collision_distance: float = parameter(
        'max_collision_dist', 3.0, 'how far ahead on its route the CollisionMonitor looks, m', 0.1, 1000.0
    )
    collision_rate: float = parameter('collision_check_rate', 1.0, 'how often it looks, Hz', 0.01, 50.0)
    planning_seconds: float = parameter(
        'max_planning_time', 2.0, 'how long the search for a route may take, s of wall time', 0.01, 1000.0
    )


def route_message(route: Route, frame: str, stamp: Time) -> RouteMessage:
    """Return a route: one node more than edges."""
    message = RouteMessage(
        route_cost=float(route.cost),
        nodes=[RouteNode(nodeid=node.id, position=point_message(node.point)) for node in route.nodes],
        edges=[
            RouteEdge(edgeid=edge.id, start=point_message(edge.start.point), end=point_message(edge.end.point))
            for edge in route.edges
        ],
    )
    message.header.frame_id, message.header.stamp = frame, stamp
    return message


def point_message(place: tuple[float, float]) -> Point:
    return Point(x=float(place[0]), y=float(place[1]))


class PlanRoute(Protocol):
    """A callback that plans the route of a goal: one of the two functions is called."""

    def __call__(
        self,
        goal: ServedGoal,
        progress: RouteProgress | None,
        on_planned: Callable[[PlannedRoute], None],
        on_end: Callable[[GoalEnd], None],
    ) -> None: ...


class RouteTracking:
    """The tracking of one route, which begins with planning. On the executor thread; ``on_end`` gets the end and its
    duration in seconds."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: RouteParameters,
        robot: RobotInterface,
        operations: RouteOperations,
        goal: ServedGoal,
        plan: PlanRoute,
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

    def _replan(self, progress: RouteProgress | None) -> None:
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
            self._replan(RouteProgress(done.blocked, tracker.last_node, tracker.edge, pose))

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


# Operations while a route is tracked: those of Nav2's route server.

NO_LIMIT: Final = 0.0
"""Limit that removes a speed limit: NO_SPEED_LIMIT of nav2_costmap_2d."""


@dataclass
class OperationsResult:
    """Names of the operations that did something, and whether the route has to be another one, without some edges."""

    triggered: list[str] = field(default_factory=list)
    reroute: bool = False
    blocked: frozenset[int] = frozenset()


class RouteOperations:
    """On the executor thread. For one route at a time: ``begin``, ``process`` at each pose of the robot, ``finish``."""

    def __init__(self, runtime: NodeRuntime, parameters: RouteParameters, robot: RobotInterface) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._services = ServiceLinks(runtime)
        self._speed_limits = runtime.node.create_publisher(SpeedLimit, names.SPEED_LIMIT, 1)
        self._frame = robot.parameters.map_frame
        runtime.node.create_service(Trigger, names.REROUTE, self._on_reroute)
        self._run = 0
        self.begin()

    def begin(self) -> None:
        """There is a new goal."""
        self._run += 1  # what was triggered before does not concern it
        self._is_reroute_wanted = False
        self._is_limited = False
        self._checked_at = self._entered_at = -math.inf
        self._failure: str | None = None

    def finish(self) -> None:
        """Lift the speed limit: the goal has ended."""
        self._run += 1
        if self._is_limited:
            self._limit(NO_LIMIT)

    def process(self, changed: bool, tracker: RouteTracker, pose: Pose, now: float) -> OperationsResult:
        """Do what is due at a pose, at a time in s. ``changed``: a node was just achieved.

        Raises:
            NavigationError: OPERATION_FAILED.
        """
        if self._failure is not None:
            raise NavigationError('OPERATION_FAILED', self._failure)
        done = OperationsResult()
        if changed:
            for operation in tracker.operations():
                self._trigger(operation)
                done.triggered.append(operation.type)
        for name in self._parameters.operations:
            if self._OPERATIONS[name](self, done, changed, tracker, pose, now):
                done.triggered.append(name)
        return done

    def _adjust_speed_limit(
        self, _done: OperationsResult, changed: bool, tracker: RouteTracker, _pose: Pose, _now: float
    ) -> bool:
        if not changed or tracker.edge is None:
            return False
        percent = 100.0 * speed_limit(tracker.edge)
        if percent == 100.0 and not self._is_limited:
            return False
        self._is_limited = percent < 100.0
        self._limit(percent)
        return True

    def _limit(self, percent: float) -> None:
        message = SpeedLimit(percentage=True, speed_limit=percent)
        message.header.frame_id, message.header.stamp = self._frame, self._runtime.clock.stamp()
        self._speed_limits.publish(message)

    def _reroute(self, done: OperationsResult, _changed: bool, tracker: RouteTracker, _pose: Pose, _now: float) -> bool:
        wanted, self._is_reroute_wanted = self._is_reroute_wanted, False
        if wanted and not tracker.is_complete:
            done.reroute = True
        return wanted

    def _on_reroute(self, _request: Any, response: Any) -> Any:
        self._is_reroute_wanted = True
        response.success = True
        return response

    def _watch_collisions(
        self, done: OperationsResult, _changed: bool, tracker: RouteTracker, pose: Pose, now: float
    ) -> bool:
        if now - self._checked_at < 1.0 / self._parameters.collision_rate:
            return False
        self._checked_at = now
        edge = blocked_edge(tracker, pose, self._robot.costmaps.shared, self._parameters.collision_distance)
        if edge is None:
            return False
        done.reroute, done.blocked = True, done.blocked | {edge.id}
        return True

    def _mark_time(
        self, _done: OperationsResult, changed: bool, tracker: RouteTracker, _pose: Pose, now: float
    ) -> bool:
        if not changed:
            return False
        began, self._entered_at = self._entered_at, now
        if tracker.left is None or began == -math.inf:
            return False
        tracker.left.metadata['abs_time_taken'] = now - began
        return True

    def _trigger(self, operation: Operation) -> None:
        if operation.type not in self._parameters.trigger_events:
            raise NavigationError(
                'OPERATION_FAILED',
                f'the graph wants the operation {operation.type!r}, which trigger_events does not name',
            )
        service = operation.metadata.get('service_name')
        if not isinstance(service, str) or not service:
            raise NavigationError(
                'OPERATION_FAILED', f'the metadata of the operation {operation.name!r} have no service_name'
            )
        link = self._services.link(Trigger, service)
        ServiceCall(link, Trigger.Request(), on_done=partial(self._on_triggered, self._run, service))

    def _on_triggered(self, run: int, service: str, outcome: ServiceOutcome) -> None:
        if run != self._run:
            return
        if outcome.response is None:
            self._failure = f'{service}: {outcome.reason}'
        elif not outcome.response.success:
            self._failure = f'{service} has failed: {outcome.response.message}'

    _OPERATIONS: Final[dict[str, Callable[..., bool]]] = {
        ADJUST_SPEED_LIMIT: _adjust_speed_limit,
        REROUTING_SERVICE: _reroute,
        COLLISION_MONITOR: _watch_collisions,
        TIME_MARKER: _mark_time,
    }
