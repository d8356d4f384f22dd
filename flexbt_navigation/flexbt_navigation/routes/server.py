# SPDX-License-Identifier: BSD-3-Clause
"""The actions compute_route and compute_and_track_route, and the graph that they plan on.

Services replace the graph, close and open edges and make them dearer. The graph is shown on the latched topic
route_graph, the path of the last route on plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Vector3
from nav2_msgs.action import ComputeAndTrackRoute, ComputeRoute
from nav2_msgs.srv import DynamicEdges as DynamicEdgesService
from nav2_msgs.srv import SetRouteGraph
from nav_msgs.msg import Path
from rclpy.task import Future
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.files import resolve_file
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import duration_message
from flexbt_core.errors import FlexbtError
from flexbt_navigation.common.goals import CANCELED, SUCCEEDED, Computation, GoalEnd, finish
from flexbt_navigation.common.requests import Asked, asked_pose
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.robot_interface import RobotInterface
from flexbt_sim.messages import path_message
from flexbt_sim.world.plane.geometry import Pose

from .edge_scorers import SCORERS, DynamicEdges, edge_scorer
from .graph import RouteGraph, load_graph
from .route import Ends, PlannedRoute, RoutePlanner, RouteProgress
from .tracking import (
    DYNAMIC_EDGES,
    RouteOperations,
    RouteParameters,
    RouteTracking,
    point_message,
    route_message,
)

HIGHEST_COST: Final = 1e6
"""Highest cost of an edge that the service sets."""

GRAPH_TIMEOUT: Final = 5.0
"""Time for which transforms of a graph are awaited, s of wall time: at the start they may not be published yet."""

NO_PLACE: Final = 'INDETERMINANT_NODES_ON_GRAPH'


class RouteServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime, parameters: RouteParameters, robot: RobotInterface) -> None:
        """Raise GraphError: the parameter ``graph_filepath`` names no graph."""
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._graph: RouteGraph | None = None
        self._edges = DynamicEdges()
        scorers = {**SCORERS, DYNAMIC_EDGES: self._edges}
        self._score = edge_scorer(scorers[name] for name in parameters.edge_scorers)
        self._computation = Computation(runtime, 'the route planner')
        self._operations = RouteOperations(runtime, parameters, robot)
        self._tracking: RouteTracking | None = None
        node = runtime.node
        self._plan = node.create_publisher(Path, names.PLAN, 1)
        self._markers = node.create_publisher(MarkerArray, names.ROUTE_GRAPH, names.transient_local_qos())
        node.create_service(SetRouteGraph, names.SET_ROUTE_GRAPH, self._set_graph)
        node.create_service(DynamicEdgesService, names.ADJUST_EDGES, self._adjust_edges)
        if parameters.graph_file:
            self._take_graph(load_graph(FilePath(parameters.graph_file)), self._report_graph)
        actions = (
            (ComputeRoute, names.COMPUTE_ROUTE, self._serve, None),
            (ComputeAndTrackRoute, names.COMPUTE_AND_TRACK_ROUTE, self._track, self._cancel_tracking),
        )
        for action_type, name, serve, cancel in actions:
            GoalServer(runtime, action_type, name, serve, cancel)

    def end_all(self, end: GoalEnd) -> None:
        """End what goes on."""
        if self._tracking is not None:
            self._tracking.end(end)

    # -- the graph ---------------------------------------------------------------------------------------------------

    async def _set_graph(self, request: Any, response: Any) -> Any:
        done = Future(executor=self._runtime.node.executor)

        def on_taken(error: Exception | None) -> None:
            self._report_graph(error)
            response.success = error is None
            done.set_result(None)

        def on_loaded(graph: RouteGraph | None, error: Exception | None) -> None:
            if graph is None:
                on_taken(error)
            else:
                self._take_graph(graph, on_taken)

        allowed = self._robot.parameters.allowed_directories
        self._computation.ask(lambda: load_graph(resolve_file(request.graph_filepath, allowed)), on_loaded)
        await done
        return response

    def _take_graph(self, graph: RouteGraph, on_taken: Callable[[Exception | None], None]) -> None:
        """Use a graph when all of it is known in the frame of the map; the one before it stays when that fails."""
        frame = self._robot.parameters.map_frame
        frames = sorted(graph.frames - {frame})

        def take(origins: list[Pose]) -> None:
            self._graph = graph.moved(frame, dict(zip(frames, origins, strict=True)))
            self._markers.publish(graph_markers(self._graph, frame, self._runtime.clock.stamp()))
            on_taken(None)

        origins = [PoseStamped() for _ in frames]
        for origin, name in zip(origins, frames, strict=True):
            origin.header.frame_id = name
        asked = [asked_pose(origin, 'the graph', 'TF_ERROR') for origin in origins]
        self._robot.map_frame.poses(asked, take, on_taken, GRAPH_TIMEOUT)

    def _report_graph(self, error: Exception | None) -> None:
        logger = self._runtime.node.get_logger()
        if error is None:
            assert self._graph is not None
            logger.info(f'graph of routes with {len(self._graph.nodes)} nodes and {len(self._graph.edges)} edges')
        elif isinstance(error, FlexbtError):
            logger.error(f'no new graph of routes: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
        else:
            self._runtime.report_fault(error, 'a graph of routes')

    def _adjust_edges(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            self._check_edges(request)
        except FlexbtError as error:
            self._runtime.node.get_logger().warning(
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

    def _serve(self, goal: ServedGoal) -> None:
        began = self._runtime.steady.now()

        def on_end(end: GoalEnd) -> None:
            result = ComputeRoute.Result(planning_time=duration_message(self._runtime.steady.now() - began))
            self._finish(goal, result, end)

        def on_planned(planned: PlannedRoute) -> None:
            stamp = self._runtime.clock.stamp()
            path = path_message(planned.path, self._robot.parameters.map_frame, stamp)
            self._plan.publish(path)
            result = ComputeRoute.Result(
                planning_time=duration_message(self._runtime.steady.now() - began),
                route=route_message(planned.route, self._robot.parameters.map_frame, stamp),
                path=path,
            )
            self._finish(goal, result, SUCCEEDED)

        self.plan(goal, None, on_planned, on_end)

    def _track(self, goal: ServedGoal) -> None:
        """Track the newest goal."""
        self.end_all(GoalEnd(message='a newer goal has taken over'))

        def on_end(end: GoalEnd, seconds: float) -> None:
            self._finish(goal, ComputeAndTrackRoute.Result(execution_duration=duration_message(seconds)), end)

        self._tracking = RouteTracking(
            self._runtime,
            self._parameters,
            self._robot,
            self._operations,
            goal,
            self.plan,
            self._plan.publish,
            on_end,
        )

    def _cancel_tracking(self, goal: ServedGoal) -> None:
        if self._tracking is not None and self._tracking.goal is goal:
            self._tracking.end(CANCELED)

    def _finish(self, goal: ServedGoal, result: Any, end: GoalEnd) -> None:
        if end.code != 'NONE':  # the result has no room for it
            self._runtime.node.get_logger().warning(
                f'no route: {end.code}: {end.message}', throttle_duration_sec=COMPLAINT_SECONDS
            )
        finish(goal, result, end)

    def plan(
        self,
        goal: ServedGoal,
        progress: RouteProgress | None,
        on_planned: Callable[[PlannedRoute], None],
        on_end: Callable[[GoalEnd], None],
    ) -> None:
        """Plan the route of a goal of one of the actions: call ``on_planned``, or ``on_end`` if there is no route."""

        def search(poses: list[Pose]) -> None:
            start, last = self._ends(goal.request, poses)
            planner, check_time = self._planner(goal.request), self._limit(goal)
            self._computation.run(goal, lambda: planner.plan(start, last, progress, check_time), on_planned, on_end)

        self._robot.with_poses(goal, _asked, search, on_end, 'the route planner')

    def _ends(self, request: Any, poses: list[Pose]) -> tuple[Ends, Ends]:
        if not request.use_poses:
            return Ends(request.start_id), Ends(request.goal_id)
        return Ends(pose=poses[1] if request.use_start else self._robot.pose), Ends(pose=poses[0])

    def _planner(self, request: Any) -> RoutePlanner:
        if self._graph is None:
            raise NavigationError(
                'NO_VALID_GRAPH',
                f'there is no graph: set the parameter graph_filepath, or call {names.SET_ROUTE_GRAPH}',
            )
        needs_costmap = request.use_poses or 'CostmapScorer' in self._parameters.edge_scorers
        costmap = self._robot.costmaps.shared if needs_costmap else None
        return RoutePlanner(self._graph, self._score, self._parameters.shape, costmap)

    def _limit(self, goal: ServedGoal) -> Callable[[], None]:
        steady, seconds = self._runtime.steady, self._parameters.planning_seconds
        end = steady.now() + seconds

        def check_time() -> None:
            if goal.cancel_requested or steady.now() > end:
                raise NavigationError('TIMEOUT', f'no route was found within {seconds:g} s')

        return check_time


def _asked(request: Any) -> list[Asked]:
    """Return the goal, and the start behind it if there is one."""
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
    edges.color = ColorRGBA(g=1.0, a=0.5)  # half, so that a way in both directions stands out
    edges.points = [point_message(end.point) for edge in graph.edges for end in (edge.start, edge.end)]
    texts = []
    for number, node in enumerate(graph.nodes.values()):
        texts.append(_text('route_graph_node_ids', number, node.id, (node.x + 0.07, node.y), ColorRGBA(r=1.0, a=1.0)))
    for number, edge in enumerate(graph.edges):
        x, y = (edge.start.x + edge.end.x) / 2.0, (edge.start.y + edge.end.y) / 2.0
        y += 0.05 if edge.start.id > edge.end.id else -0.05  # apart, when there is one back
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
