# SPDX-License-Identifier: BSD-3-Clause
"""Routes and graphs as messages."""

from __future__ import annotations

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Vector3
from nav2_msgs.msg import Route as RouteMessage
from nav2_msgs.msg import RouteEdge, RouteNode
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from .graph import RouteGraph
from .route import Route


def route_message(route: Route, frame: str, stamp: Time) -> RouteMessage:
    """Return a route: one node more than edges."""
    message = RouteMessage(
        route_cost=float(route.cost),
        nodes=[RouteNode(nodeid=node.id, position=_point(node.point)) for node in route.nodes],
        edges=[
            RouteEdge(edgeid=edge.id, start=_point(edge.start.point), end=_point(edge.end.point))
            for edge in route.edges
        ],
    )
    message.header.frame_id, message.header.stamp = frame, stamp
    return message


def graph_markers(graph: RouteGraph, frame: str, stamp: Time) -> MarkerArray:
    """Return a graph for display, with the namespaces of Nav2: nodes, edges, and the ids of both."""
    nodes = Marker(ns='route_graph_nodes', type=Marker.SPHERE_LIST, scale=Vector3(x=0.1, y=0.1, z=0.1))
    nodes.color = ColorRGBA(r=1.0, a=1.0)
    nodes.points = [_point(node.point) for node in graph.nodes.values()]
    edges = Marker(ns='route_graph_edges', type=Marker.LINE_LIST, scale=Vector3(x=0.05))
    edges.color = ColorRGBA(g=1.0, a=0.5)  # half, so that a way in both directions stands out
    edges.points = [_point(end.point) for edge in graph.edges for end in (edge.start, edge.end)]
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
    marker.pose.position = _point(place)
    marker.scale.z = 0.1
    return marker


def _point(place: tuple[float, float]) -> Point:
    return Point(x=float(place[0]), y=float(place[1]))
