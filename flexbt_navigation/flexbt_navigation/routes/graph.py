# SPDX-License-Identifier: BSD-3-Clause
"""The graph of places and edges that routes are planned on, and its GeoJSON files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy
import scipy
from numpy.typing import NDArray

from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import read_text
from flexbt_navigation.errors import GraphError
from flexbt_sim.world.plane.geometry import FARTHEST, Pose, compose

MOST: Final = 1e9
"""Greatest number that is accepted, whatever its unit."""


@dataclass(frozen=True, eq=False)
class Operation:
    """An operation on a route. ``trigger`` is NODE (achieved), ON_ENTER or ON_EXIT (of an edge)."""

    name: str
    type: str
    trigger: str
    metadata: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RouteNode:
    """A place, in m in ``frame``. Its ``id`` fits into the messages: 0 to 65535."""

    id: int
    x: float
    y: float
    frame: str = 'map'
    metadata: Mapping[str, Any] = field(default_factory=dict)
    operations: tuple[Operation, ...] = ()

    @property
    def point(self) -> tuple[float, float]:
        return self.x, self.y


@dataclass(frozen=True, eq=False)
class RouteEdge:
    """A directed edge between two nodes. ``metadata`` is writable, for the learned ``abs_time_taken``.

    An edge that is not ``overridable`` costs ``cost``; the edge scorers determine the cost of other edges.
    """

    id: int
    start: RouteNode
    end: RouteNode
    cost: float = 0.0
    overridable: bool = True
    metadata: dict[str, Any] = field(default_factory=dict)
    operations: tuple[Operation, ...] = ()

    @property
    def length(self) -> float:
        """Length, m."""
        return math.dist(self.start.point, self.end.point)

    @property
    def heading(self) -> float:
        """Heading, rad."""
        return math.atan2(self.end.y - self.start.y, self.end.x - self.start.x)


class EdgeLinks:
    """A graph as arrays, for searches. Nodes and edges are represented by their indices in the graph.

    ``starts`` and ``ends`` are the nodes of the edges; ``edge_ids`` and ``end_ids`` are the ids of the edges and of
    their end nodes.
    """

    def __init__(self, graph: RouteGraph) -> None:
        self.index = {id: index for index, id in enumerate(graph.nodes)}
        self.starts = numpy.array([self.index[edge.start.id] for edge in graph.edges], int)
        self.ends = numpy.array([self.index[edge.end.id] for edge in graph.edges], int)
        self.edge_ids = numpy.array([edge.id for edge in graph.edges], int)
        self.end_ids = numpy.array([edge.end.id for edge in graph.edges], int)
        # In this order, edges with the same ends are adjacent; each such group is one entry of the matrix.
        self._order = numpy.lexsort((self.ends, self.starts))
        starts, ends = self.starts[self._order], self.ends[self._order]
        is_first = numpy.ones(len(starts), bool)
        is_first[1:] = (numpy.diff(starts) != 0) | (numpy.diff(ends) != 0)
        self._groups = numpy.flatnonzero(is_first)
        self._columns = ends[self._groups]
        self._rows = numpy.searchsorted(starts[self._groups], numpy.arange(len(self.index) + 1))

    def search(self, costs: NDArray[numpy.float64], start: int) -> tuple[NDArray[numpy.float64], NDArray[numpy.int32]]:
        """Return the cost from a node to each node and the previous node on that path, by Dijkstra's algorithm.

        ``costs`` are those of the edges, not negative; infinite for an edge that must not be used.
        """
        count = len(self.index)
        cheapest = numpy.minimum.reduceat(costs[self._order], self._groups) if len(costs) else costs
        matrix = scipy.sparse.csr_array((cheapest, self._columns, self._rows), shape=(count, count))
        distances, before = scipy.sparse.csgraph.dijkstra(matrix, indices=start, return_predecessors=True)
        return distances, before

    def cheapest(self, costs: NDArray[numpy.float64], start: int, end: int) -> int:
        """Return the cheapest of the edges from one node to another."""
        row = self._columns[self._rows[start] : self._rows[start + 1]]
        group = int(self._rows[start] + numpy.searchsorted(row, end))
        limits = [*self._groups[group : group + 2].tolist(), len(self._order)][:2]
        edges = self._order[slice(*limits)]
        return int(edges[numpy.argmin(costs[edges])])


class RouteGraph:
    """A graph of at least one node, by id, and edges. Edges may share an id, which then stands for all of them."""

    def __init__(self, nodes: Mapping[int, RouteNode], edges: Iterable[RouteEdge]) -> None:
        self.nodes = nodes
        self.edges = tuple(edges)
        self._leaving: dict[int, list[RouteEdge]] = {id: [] for id in nodes}
        for edge in self.edges:
            self._leaving[edge.start.id].append(edge)
        self._of_edges: dict[Callable[[RouteEdge], float], NDArray[numpy.float64]] = {}

    def leaving(self, node: RouteNode) -> list[RouteEdge]:
        """Return the edges that begin at a node."""
        return self._leaving[node.id]

    def of_edges(self, value: Callable[[RouteEdge], float]) -> NDArray[numpy.float64]:
        """Return a constant value of each edge, in order. The array is cached and must not be modified."""
        found = self._of_edges.get(value)
        if found is None:
            found = self._of_edges[value] = numpy.array([value(edge) for edge in self.edges], float)
        return found

    @cached_property
    def links(self) -> EdgeLinks:
        """The same graph as arrays."""
        return EdgeLinks(self)

    def nearest(self, pose: Pose, count: int) -> list[RouteNode]:
        """Return this many nodes, or all if fewer, nearest first."""
        _, found = self._tree.query(pose[:2], k=range(1, min(count, len(self.nodes)) + 1))
        nodes = list(self.nodes.values())
        return [nodes[index] for index in found]

    @cached_property
    def _tree(self) -> Any:
        return scipy.spatial.KDTree([node.point for node in self.nodes.values()])

    @property
    def frames(self) -> set[str]:
        """Frames of the nodes."""
        return {node.frame for node in self.nodes.values()}

    def moved(self, frame: str, origins: Mapping[str, Pose]) -> RouteGraph:
        """Return the same graph in one frame; ``origins`` are the poses of the other frames in it."""

        def place(node: RouteNode) -> RouteNode:
            x, y, _ = compose(origins[node.frame], Pose(node.x, node.y, 0.0))
            return replace(node, x=x, y=y, frame=frame)

        nodes = {id: node if node.frame == frame else place(node) for id, node in self.nodes.items()}
        return RouteGraph(
            nodes,
            [replace(edge, start=nodes[edge.start.id], end=nodes[edge.end.id]) for edge in self.edges],
        )


def speed_limit(edge: RouteEdge) -> float:
    """Return the speed limit of an edge as a fraction of the greatest speed, in (0, 1].

    Nav2 documents percent (85.0), but its samples have fractions (0.85): values up to 1 are fractions.
    """
    value = number(edge, 'speed_limit')
    if value is None or value <= 0.0:
        return 1.0
    return min(1.0, value if value <= 1.0 else value / 100.0)


def number(edge: RouteEdge, key: str) -> float | None:
    """Return a number in the metadata of an edge, or None."""
    value = edge.metadata.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MOST:
        return None
    return float(value)


# Reading a graph from GeoJSON, with the properties that Nav2's route server reads.
#
# A node is a feature with a Point: ``id``, ``frame`` (of the coordinates; map when it is missing), ``metadata``,
# ``operations``. An edge is a feature with a LineString or MultiLineString, whose coordinates do not matter: ``id``,
# ``startid``, ``endid``, ``cost``, ``overridable``, ``metadata``, ``operations``. Other features are ignored.

MOST_BYTES: Final = 64_000_000
HIGHEST_ID: Final = 65535
"""Highest ID that the messages of nav2_msgs can carry."""

TRIGGERS: Final = ('NODE', 'ON_ENTER', 'ON_EXIT')
EDGE_GEOMETRIES: Final = ('LineString', 'MultiLineString')


def load_graph(file: Path) -> RouteGraph:
    """Return the graph of a file.

    Raises:
        GraphError: the file cannot be read or is not a graph.
    """
    nodes: dict[int, RouteNode] = {}
    features = list(_features(file))
    for feature, kind, properties in features:
        if kind == 'Point':
            node = _node(feature, properties)
            if node.id in nodes:
                raise feature.error('properties.id', f'{node.id} is the id of another node, too')
            nodes[node.id] = node
    edges = [_edge(feature, properties, nodes) for feature, kind, properties in features if kind in EDGE_GEOMETRIES]
    if not nodes or not edges:
        missing = 'nodes: features with a Point' if not nodes else 'edges: features with a LineString'
        raise GraphError(file, '', f'there are no {missing}')
    return RouteGraph(nodes, edges)


class _Feature:
    """A feature of the file: its geometry, and the errors about it."""

    def __init__(self, file: Path, index: int, geometry: Mapping[str, Any]) -> None:
        self.file = file
        self.index = index
        self.geometry = geometry

    def error(self, field: str, message: str) -> GraphError:
        return GraphError(self.file, f'features[{self.index}].{field}', message)

    def unfit(self, field: str, expected: str, value: object) -> GraphError:
        return self.error(field, f'expected {expected}, got {short_repr(value)}')


def _features(file: Path) -> Iterator[tuple[_Feature, str, Mapping[str, Any]]]:
    """Yield each feature with the type of its geometry and its properties."""
    try:
        collection = load_json(read_text(file, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise GraphError.unreadable(file, error, 'a GeoJSON file of nodes and edges') from error
    features = collection.get('features') if isinstance(collection, dict) else None
    if not isinstance(features, list):
        raise GraphError(file, 'features', 'expected a list: the file is not a GeoJSON FeatureCollection')
    for index, item in enumerate(features):
        fields = item if isinstance(item, dict) else {}
        geometry = fields.get('geometry')
        kind = geometry.get('type') if isinstance(geometry, dict) else None
        if isinstance(geometry, dict) and kind in ('Point', *EDGE_GEOMETRIES):
            feature = _Feature(file, index, geometry)
            properties = fields.get('properties')
            if not isinstance(properties, dict):
                raise feature.unfit('properties', 'an object', properties)
            yield feature, kind, properties


def _node(feature: _Feature, properties: Mapping[str, Any]) -> RouteNode:
    coordinates = feature.geometry.get('coordinates')
    if not (isinstance(coordinates, list) and len(coordinates) >= 2 and all(map(_is_place, coordinates[:2]))):
        raise feature.unfit('geometry.coordinates', f'x and y, m, of at most {FARTHEST:g}', coordinates)
    frame = properties.get('frame', 'map')
    if not isinstance(frame, str) or not frame:
        raise feature.unfit('properties.frame', 'the name of a frame', frame)
    x, y = map(float, coordinates[:2])
    return RouteNode(
        _id(feature, properties, 'id'), x, y, frame, _metadata(feature, properties), _operations(feature, properties)
    )


def _edge(feature: _Feature, properties: Mapping[str, Any], nodes: Mapping[int, RouteNode]) -> RouteEdge:
    ends = []
    for name in ('startid', 'endid'):
        node_id = _id(feature, properties, name)
        if node_id not in nodes:
            raise feature.error(f'properties.{name}', f'there is no node {node_id}')
        ends.append(nodes[node_id])
    cost = properties.get('cost', 0.0)
    if not _is_number(cost):
        raise feature.unfit('properties.cost', 'a number', cost)
    overridable = properties.get('overridable', True)
    if not isinstance(overridable, bool):
        raise feature.unfit('properties.overridable', 'true or false', overridable)
    return RouteEdge(
        _id(feature, properties, 'id'),
        ends[0],
        ends[1],
        float(cost),
        overridable,
        _metadata(feature, properties),
        _operations(feature, properties),
    )


def _operations(feature: _Feature, properties: Mapping[str, Any]) -> tuple[Operation, ...]:
    given = properties.get('operations', {})
    if not isinstance(given, dict | list):
        raise feature.unfit('properties.operations', 'an object or a list', given)
    named = given.items() if isinstance(given, dict) else enumerate(given)
    operations = []
    for name, fields in named:
        where = f'properties.operations.{name}'
        if not isinstance(fields, dict):
            raise feature.unfit(where, 'an object', fields)
        if not isinstance(fields.get('type'), str):
            raise feature.unfit(f'{where}.type', 'the name of an operation', fields.get('type'))
        if fields.get('trigger') not in TRIGGERS:
            raise feature.unfit(f'{where}.trigger', ' or '.join(TRIGGERS), fields.get('trigger'))
        metadata = _metadata(feature, fields, f'{where}.metadata')
        operations.append(Operation(str(name), fields['type'], fields['trigger'], metadata))
    return tuple(operations)


def _metadata(feature: _Feature, fields: Mapping[str, Any], where: str = 'properties.metadata') -> dict[str, Any]:
    metadata = fields.get('metadata', {})
    if not isinstance(metadata, dict):
        raise feature.unfit(where, 'an object', metadata)
    return metadata


def _id(feature: _Feature, properties: Mapping[str, Any], name: str) -> int:
    value = properties.get(name)
    if not (isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= HIGHEST_ID):
        raise feature.unfit(f'properties.{name}', f'a whole number of 0 to {HIGHEST_ID}', value)
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MOST


def _is_place(value: Any) -> bool:
    return _is_number(value) and abs(value) <= FARTHEST
