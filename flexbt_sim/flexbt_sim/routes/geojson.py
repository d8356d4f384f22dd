# SPDX-License-Identifier: BSD-3-Clause
"""Reads a graph from GeoJSON, with the properties that Nav2's route server reads.

A node is a feature with a Point: ``id``, ``frame`` (of the coordinates; map when it is missing), ``metadata``,
``operations``. An edge is a feature with a LineString or MultiLineString, whose coordinates do not matter: ``id``,
``startid``, ``endid``, ``cost``, ``overridable``, ``metadata``, ``operations``. Other features are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from flexbt_core.values import load_json, read_text, shown
from flexbt_sim.navigation_errors import GraphError
from flexbt_sim.world import FARTHEST

from .graph import MOST, Operation, RouteEdge, RouteGraph, RouteNode

MOST_BYTES: Final = 64_000_000
HIGHEST_ID: Final = 65535
"""What the messages of nav2_msgs can carry."""

TRIGGERS: Final = ('NODE', 'ON_ENTER', 'ON_EXIT')
EDGE_GEOMETRIES: Final = ('LineString', 'MultiLineString')


def load_graph(file: Path) -> RouteGraph:
    """The graph of a file.

    Raises:
        GraphError: the file cannot be read, or it is no graph.
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
    """A feature of the file, for what is said of it and for its geometry."""

    def __init__(self, file: Path, index: int, geometry: Mapping[str, Any]) -> None:
        self.file = file
        self.index = index
        self.geometry = geometry

    def error(self, field: str, message: str) -> GraphError:
        return GraphError(self.file, f'features[{self.index}].{field}', message)

    def unfit(self, field: str, expected: str, value: object) -> GraphError:
        return self.error(field, f'expected {expected}, got {shown(value)}')


def _features(file: Path) -> Iterator[tuple[_Feature, str, Mapping[str, Any]]]:
    """Each feature with the type of its geometry and its properties."""
    try:
        collection = load_json(read_text(file, MOST_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        raise GraphError.unreadable(file, error, 'a GeoJSON file of nodes and edges') from error
    features = collection.get('features') if isinstance(collection, dict) else None
    if not isinstance(features, list):
        raise GraphError(file, 'features', 'expected a list: the file is no GeoJSON FeatureCollection')
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
