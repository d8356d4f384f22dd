# SPDX-License-Identifier: BSD-3-Clause
"""The actions compute_route and compute_and_track_route, and their graph.

Services replace the graph, close and open edges, and raise their costs. The server publishes the graph on the latched
topic route_graph and the path of the last route on plan. While the robot drives, it tracks a route, carries out the
operations of its edges and nodes, and replans it when it has to change.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path as FilePath
from typing import Any, Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped, Vector3
from nav2_msgs.action import ComputeAndTrackRoute, ComputeRoute
from nav2_msgs.msg import Route as RouteMessage
from nav2_msgs.msg import RouteEdge, RouteNode, SpeedLimit
from nav2_msgs.srv import DynamicEdges as DynamicEdgesService
from nav2_msgs.srv import SetRouteGraph
from nav_msgs.msg import Path
from rclpy.task import Future
from std_msgs.msg import ColorRGBA
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.files import resolve_file
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import duration_message
from flexbt_core.errors import FlexbtError
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import short_repr
from flexbt_navigation.common.requests import (
    CANCELED,
    SUCCEEDED,
    Asked,
    Computation,
    GoalEnd,
    Later,
    asked_pose,
    end_by,
    finish,
    follow,
    served,
)
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.robot_interface import PoseWatch, RobotInterface
from flexbt_sim.messages import path_message
from flexbt_sim.world.plane.geometry import Pose

from .edge_scorers import SCORERS, DynamicEdges, edge_scorer
from .graph import Operation, RouteGraph, load_graph, speed_limit
from .route import (
    AchievedRadii,
    Ends,
    PathShape,
    PlannedRoute,
    Route,
    RoutePlanner,
    RouteProgress,
    RouteTracker,
    blocked_edge,
)

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
    """Return a route as a message; it has one node more than edges."""
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


class RouteTracking:
    """The tracking of one route, which begins with planning. Executor thread only."""

    def __init__(self, server: RouteServer, goal: ServedGoal) -> None:
        self._server = server
        self.goal = goal
        self.active = True
        self._began = server.runtime.clock.now()
        self._watch: PoseWatch | None = None
        self._tracker: RouteTracker | None = None
        server.operations.begin()
        server.robot.on_pose.append(self._on_pose)
        self._replan(None)

    def end(self, end: GoalEnd) -> None:
        """End the goal, once."""
        if not self.active:
            return
        self.active = False
        self._server.robot.on_pose.remove(self._on_pose)
        if self._watch is not None:
            self._watch.cancel()
        self._server.operations.finish()
        seconds = max(0.0, self._server.runtime.clock.now() - self._began)
        result = ComputeAndTrackRoute.Result(execution_duration=duration_message(seconds))
        self._server.finish(self.goal, result, end)

    def _replan(self, progress: RouteProgress | None) -> None:
        self._tracker = None
        follow(self._plan(progress))

    async def _plan(self, progress: RouteProgress | None) -> None:
        try:
            planned = await self._server.plan(self.goal, progress)
        except Exception as error:
            self.end(end_by(self._server.runtime, error, 'the route planner'))
            return
        if not self.active:
            return
        self._tracker = RouteTracker(planned.route, self._server.parameters.radii, planned.edge)
        self._route, self._path = self._server.shown(planned)
        self._tell(self._tracker, rerouted=True)
        if self._watch is None:
            self._watch = self._server.robot.watch_pose(self.end)

    def _on_pose(self, pose: Pose, now: float) -> None:
        tracker = self._tracker
        if tracker is None:
            return
        try:
            done = OperationsStep(tracker.step(pose), tracker, pose, now)
            self._server.operations.process(done)
        except Exception as error:
            self.end(end_by(self._server.runtime, error, 'tracking of a route'))
            return
        if done.changed or done.triggered:
            self._tell(tracker, operations=done.triggered)
        if tracker.is_complete:
            self.end(SUCCEEDED)
        elif done.reroute:
            self._replan(RouteProgress(done.blocked, tracker.last_node, tracker.edge, pose))

    def _tell(self, tracker: RouteTracker, *, rerouted: bool = False, operations: Sequence[str] = ()) -> None:
        """Send feedback; a missing node or edge has the id 0."""
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
class OperationsStep:
    """The input of the operations at a pose and a time, s; ``changed`` is True if a node was just achieved.

    It also holds their output: the names of the operations that did something, and whether the route has to be
    replanned, and without which edges.
    """

    changed: bool
    tracker: RouteTracker
    pose: Pose
    now: float
    triggered: list[str] = field(default_factory=list)
    reroute: bool = False
    blocked: frozenset[int] = frozenset()


class RouteOperations:
    """The operations of one route at a time: call ``begin``, ``process`` at each pose of the robot, then ``finish``.
    Executor thread only."""

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
        """Start the operations of a new goal."""
        self._run += 1  # ignore earlier triggers
        self._is_reroute_wanted = False
        self._is_limited = False
        self._checked_at = self._entered_at = -math.inf
        self._failure: str | None = None

    def finish(self) -> None:
        """Remove the speed limit after the end of a goal."""
        self._run += 1
        if self._is_limited:
            self._limit(NO_LIMIT)

    def process(self, step: OperationsStep) -> None:
        """Carry out the operations that are due.

        Raises:
            NavigationError: OPERATION_FAILED.
        """
        if self._failure is not None:
            raise NavigationError('OPERATION_FAILED', self._failure)
        if step.changed:
            for operation in step.tracker.operations():
                self._trigger(operation)
                step.triggered.append(operation.type)
        for name in self._parameters.operations:
            if self._OPERATIONS[name](self, step):
                step.triggered.append(name)

    def _adjust_speed_limit(self, step: OperationsStep) -> bool:
        if not step.changed or step.tracker.edge is None:
            return False
        percent = 100.0 * speed_limit(step.tracker.edge)
        if percent == 100.0 and not self._is_limited:
            return False
        self._is_limited = percent < 100.0
        self._limit(percent)
        return True

    def _limit(self, percent: float) -> None:
        message = SpeedLimit(percentage=True, speed_limit=percent)
        message.header.frame_id, message.header.stamp = self._frame, self._runtime.clock.stamp()
        self._speed_limits.publish(message)

    def _reroute(self, step: OperationsStep) -> bool:
        wanted, self._is_reroute_wanted = self._is_reroute_wanted, False
        if wanted and not step.tracker.is_complete:
            step.reroute = True
        return wanted

    def _on_reroute(self, _request: Any, response: Any) -> Any:
        self._is_reroute_wanted = True
        response.success = True
        return response

    def _watch_collisions(self, step: OperationsStep) -> bool:
        if step.now - self._checked_at < 1.0 / self._parameters.collision_rate:
            return False
        self._checked_at = step.now
        edge = blocked_edge(step.tracker, step.pose, self._robot.costmaps.shared, self._parameters.collision_distance)
        if edge is None:
            return False
        step.reroute, step.blocked = True, step.blocked | {edge.id}
        return True

    def _mark_time(self, step: OperationsStep) -> bool:
        if not step.changed:
            return False
        began, self._entered_at = self._entered_at, step.now
        if step.tracker.left is None or began == -math.inf:
            return False
        step.tracker.left.metadata['abs_time_taken'] = step.now - began
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
        try:
            link = self._services.link(Trigger, service)
        except ValueError as error:
            raise NavigationError('OPERATION_FAILED', str(error)) from None
        ServiceCall(link, Trigger.Request(), on_done=partial(self._on_triggered, self._run, service))

    def _on_triggered(self, run: int, service: str, outcome: ServiceOutcome) -> None:
        if run != self._run:
            return
        if outcome.response is None:
            self._failure = f'{service}: {outcome.reason}'
        elif not outcome.response.success:
            self._failure = f'{service} has failed: {outcome.response.message}'

    _OPERATIONS: Final[dict[str, Callable[[RouteOperations, OperationsStep], bool]]] = {
        ADJUST_SPEED_LIMIT: _adjust_speed_limit,
        REROUTING_SERVICE: _reroute,
        COLLISION_MONITOR: _watch_collisions,
        TIME_MARKER: _mark_time,
    }


HIGHEST_COST: Final = 1e6
"""Highest cost of an edge that the service sets."""

GRAPH_TIMEOUT: Final = 5.0
"""Maximum wait for the transforms of a graph, s of wall time: at start-up they may not be published yet."""

NO_PLACE: Final = 'INDETERMINANT_NODES_ON_GRAPH'


class RouteServer:
    """The server of both actions and the graph services. Executor thread only."""

    def __init__(self, runtime: NodeRuntime, parameters: RouteParameters, robot: RobotInterface) -> None:
        """Raise GraphError if the file of the parameter ``graph_filepath`` is not a graph."""
        self.runtime = runtime
        self.parameters = parameters
        self.robot = robot
        self._graph: RouteGraph | None = None
        self._read = self._used = 0  # numbers of the newest graph that was read, and of the one that is used
        self._edges = DynamicEdges()
        scorers = {**SCORERS, DYNAMIC_EDGES: self._edges}
        self._score = edge_scorer(scorers[name] for name in parameters.edge_scorers)
        self._computation = Computation(runtime, 'the route planner')
        self.operations = RouteOperations(runtime, parameters, robot)
        self._tracking: RouteTracking | None = None
        node = runtime.node
        self._plan = node.create_publisher(Path, names.PLAN, 1)
        self._markers = node.create_publisher(MarkerArray, names.ROUTE_GRAPH, names.transient_local_qos())
        node.create_service(SetRouteGraph, names.SET_ROUTE_GRAPH, self._set_graph)
        node.create_service(DynamicEdgesService, names.ADJUST_EDGES, self._adjust_edges)
        if parameters.graph_file:
            follow(self._report_graph(self._use_graph(load_graph(FilePath(parameters.graph_file)))))
        actions = (
            (
                ComputeRoute,
                names.COMPUTE_ROUTE,
                served(runtime, ComputeRoute, 'planning_time', 'the route planner', self._route, self.finish),
                None,
            ),
            (ComputeAndTrackRoute, names.COMPUTE_AND_TRACK_ROUTE, self._track, self._cancel_tracking),
        )
        for action_type, name, serve, cancel in actions:
            GoalServer(runtime, action_type, name, serve, cancel)

    def end_all(self, end: GoalEnd) -> None:
        """End all active goals."""
        if self._tracking is not None:
            self._tracking.end(end)

    # -- the graph ---------------------------------------------------------------------------------------------------

    async def _set_graph(self, request: Any, response: Any) -> Any:
        async def load() -> None:
            allowed = self.robot.parameters.allowed_directories
            file = request.graph_filepath

            def read() -> RouteGraph:
                return load_graph(resolve_file(file, allowed))

            await self._use_graph(await self._computation.run(lambda: read))

        done = Future(executor=self.runtime.node.executor)
        follow(self._report_graph(load(), done.set_result))
        response.success = await done
        return response

    async def _use_graph(self, graph: RouteGraph) -> None:
        """Use a graph once all its frames can be transformed to the map frame, unless a newer one is used by then."""
        self._read = number = self._read + 1
        frame = self.robot.parameters.map_frame
        frames = sorted(graph.frames - {frame})
        origins = [PoseStamped() for _ in frames]
        for origin, name in zip(origins, frames, strict=True):
            origin.header.frame_id = name
        asked = [asked_pose(origin, 'the graph', 'TF_ERROR') for origin in origins]
        poses: list[Pose] = await Later(partial(self.robot.map_frame.poses, asked, timeout=GRAPH_TIMEOUT))
        if number < self._used:
            raise NavigationError(
                'NO_VALID_GRAPH', 'a newer one is used since before the frames of this one were known'
            )
        self._used = number
        self._graph = graph.moved(frame, dict(zip(frames, poses, strict=True)))
        # On the other thread: many markers take longer than the robot drives without a command.
        markers = partial(graph_markers, self._graph, frame, self.runtime.clock.stamp())
        self._markers.publish(await self._computation.run(lambda: markers))

    async def _report_graph(self, use: Awaitable[None], on_end: Callable[[bool], object] = lambda _: None) -> None:
        """Report whether the graph was replaced; after a failure, the previous one stays."""
        logger, is_used = self.runtime.node.get_logger(), False
        try:
            await use
        except FlexbtError as error:
            logger.error(f'no new graph of routes: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
        except Exception as error:
            self.runtime.report_fault(error, 'a graph of routes')
        else:
            graph, is_used = self._graph, True
            assert graph is not None
            logger.info(f'graph of routes with {len(graph.nodes)} nodes and {len(graph.edges)} edges')
            ids = {edge.id for edge in graph.edges}
            for what, kept in (('closed', self._edges.closed), ('of another cost', self._edges.costs)):
                if still := sorted(int(id) for id in ids.intersection(kept)):
                    logger.warning(f'edges that stay {what} in the new graph, by their ids: {short_repr(still)}')
        on_end(is_used)

    def _adjust_edges(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            self._check_edges(request)
        except FlexbtError as error:
            self.runtime.node.get_logger().warning(
                f'{names.ADJUST_EDGES}: nothing was changed: {error}', throttle_duration_sec=COMPLAINT_SECONDS
            )
            return response
        costs = {edge.edgeid: float(edge.cost) for edge in request.adjust_edges}
        self._edges.adjust(request.closed_edges, request.opened_edges, costs)
        response.success = True
        return response

    def _check_edges(self, request: Any) -> None:
        graph = self._graph
        if graph is None:
            raise NavigationError('NO_VALID_GRAPH', 'there is no graph')
        named = {*request.closed_edges, *request.opened_edges, *(edge.edgeid for edge in request.adjust_edges)}
        if unknown := sorted(int(id) for id in named - {edge.id for edge in graph.edges}):
            raise NavigationError('NO_VALID_GRAPH', f'the graph has no edges {unknown[:10]}')
        for edge in request.adjust_edges:
            if not (math.isfinite(edge.cost) and abs(edge.cost) <= HIGHEST_COST):
                raise NavigationError(
                    'NO_VALID_GRAPH', f'edge {edge.edgeid} cannot cost {edge.cost:g}; give a number within ±1e6'
                )

    # -- routes ------------------------------------------------------------------------------------------------------

    async def _route(self, goal: ServedGoal) -> dict[str, Any]:
        route, path = self.shown(await self.plan(goal, None))
        return {'route': route, 'path': path}

    def _track(self, goal: ServedGoal) -> None:
        """Track the newest goal."""
        self.end_all(GoalEnd(message='a newer goal has taken over'))
        self._tracking = RouteTracking(self, goal)

    def shown(self, planned: PlannedRoute) -> tuple[RouteMessage, Path]:
        """Return a route and its path as messages, and publish the path."""
        frame, stamp = self.robot.parameters.map_frame, self.runtime.clock.stamp()
        path = path_message(planned.path, frame, stamp)
        self._plan.publish(path)
        return route_message(planned.route, frame, stamp), path

    def _cancel_tracking(self, goal: ServedGoal) -> None:
        if self._tracking is not None and self._tracking.goal is goal:
            self._tracking.end(CANCELED)

    def finish(self, goal: ServedGoal, result: Any, end: GoalEnd) -> None:
        """End a goal, and log its error, since the result has no field for the message."""
        if end.code != 'NONE':
            self.runtime.node.get_logger().warning(
                f'no route: {end.code}: {end.message}', throttle_duration_sec=COMPLAINT_SECONDS
            )
        finish(goal, result, end)

    async def plan(self, goal: ServedGoal, progress: RouteProgress | None) -> PlannedRoute:
        """Return the route of a goal of either action. Raises the error that ends the goal if no route was found."""
        poses = await self.robot.poses(goal, _asked)

        def prepare() -> Callable[[], PlannedRoute]:
            start, last = self._ends(goal.request, poses)
            return partial(self._planner(goal.request).plan, start, last, progress, self._limit(goal))

        return await self._computation.run(prepare, goal)

    def _ends(self, request: Any, poses: list[Pose]) -> tuple[Ends, Ends]:
        if not request.use_poses:
            return Ends(request.start_id), Ends(request.goal_id)
        return Ends(pose=poses[1] if request.use_start else self.robot.pose), Ends(pose=poses[0])

    def _planner(self, request: Any) -> RoutePlanner:
        if self._graph is None:
            raise NavigationError(
                'NO_VALID_GRAPH',
                f'there is no graph: set the parameter graph_filepath, or call {names.SET_ROUTE_GRAPH}',
            )
        needs_costmap = request.use_poses or 'CostmapScorer' in self.parameters.edge_scorers
        costmap = self.robot.costmaps.shared if needs_costmap else None
        return RoutePlanner(self._graph, self._score, self.parameters.shape, costmap)

    def _limit(self, goal: ServedGoal) -> Callable[[], None]:
        steady, seconds = self.runtime.steady, self.parameters.planning_seconds
        end = steady.now() + seconds

        def check_time() -> None:
            if goal.cancel_requested or steady.now() > end:
                raise NavigationError('TIMEOUT', f'no route was found within {seconds:g} s')

        return check_time


def _asked(request: Any) -> list[Asked]:
    """Return the goal, followed by the start if the request has one."""
    if not request.use_poses:
        return []
    goal = asked_pose(request.goal, 'the goal', NO_PLACE)
    return [goal, asked_pose(request.start, 'the start', NO_PLACE)] if request.use_start else [goal]


def graph_markers(graph: RouteGraph, frame: str, stamp: Time) -> MarkerArray:
    """Return a graph for display, with the namespaces of Nav2: nodes, edges, and the ids of both."""
    nodes = Marker(ns='route_graph_nodes', type=Marker.SPHERE_LIST, scale=Vector3(x=0.1, y=0.1, z=0.1))
    nodes.color = ColorRGBA(r=1.0, a=1.0)
    nodes.points = [point_message(node.point) for node in graph.nodes.values()]
    edges = Marker(ns='route_graph_edges', type=Marker.LINE_LIST, scale=Vector3(x=0.05))
    edges.color = ColorRGBA(g=1.0, a=0.5)  # half-transparent, so that a two-way edge stands out
    edges.points = [point_message(end.point) for edge in graph.edges for end in (edge.start, edge.end)]
    texts = []
    for number, node in enumerate(graph.nodes.values()):
        texts.append(_text('route_graph_node_ids', number, node.id, (node.x + 0.07, node.y), ColorRGBA(r=1.0, a=1.0)))
    for number, edge in enumerate(graph.edges):
        x, y = (edge.start.x + edge.end.x) / 2.0, (edge.start.y + edge.end.y) / 2.0
        y += 0.05 if edge.start.id > edge.end.id else -0.05  # keep apart from the text of the opposite edge
        texts.append(_text('route_graph_edge_ids', number, edge.id, (x + 0.07, y), ColorRGBA(g=1.0, a=1.0)))
    markers = MarkerArray(markers=[edges, nodes, *texts])
    for marker in markers.markers:
        marker.header.frame_id, marker.header.stamp = frame, stamp
        marker.pose.orientation.w = 1.0
    # Additional elements of an earlier graph are removed.
    markers.markers.insert(0, Marker(action=Marker.DELETEALL))
    return markers


def _text(namespace: str, number: int, id: int, place: tuple[float, float], color: ColorRGBA) -> Marker:
    marker = Marker(ns=namespace, id=number, type=Marker.TEXT_VIEW_FACING, text=str(id), color=color)
    marker.pose.position = point_message(place)
    marker.scale.z = 0.1
    return marker
