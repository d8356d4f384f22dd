# SPDX-License-Identifier: BSD-3-Clause
"""Graphs for tests, as files and at random."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from flexbt_navigation.routes.graph import RouteEdge, RouteGraph, RouteNode


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """Return a feature of GeoJSON."""
    return {'type': 'Feature', 'properties': properties, 'geometry': {'type': kind, 'coordinates': coordinates}}


def node(id: int, x: float, y: float, **properties: Any) -> dict[str, Any]:
    return feature('Point', [x, y], id=id, **properties)


def edge(id: int, start: int, end: int, **properties: Any) -> dict[str, Any]:
    return feature('MultiLineString', [[[0.0, 0.0], [0.0, 0.0]]], id=id, startid=start, endid=end, **properties)


def write(file: Path, features: Iterable[Mapping[str, Any]]) -> Path:
    """Return a GeoJSON file."""
    file.write_text(json.dumps({'type': 'FeatureCollection', 'features': list(features)}))
    return file


def graph(places: Mapping[int, tuple[float, float]], *ways: tuple[int, int]) -> RouteGraph:
    """Nodes at places, and edges between them, whose ids begin with 100."""
    nodes = {id: RouteNode(id, *place) for id, place in places.items()}
    return RouteGraph(nodes, [RouteEdge(id, nodes[start], nodes[end]) for id, (start, end) in enumerate(ways, 100)])


@st.composite
def graphs(draw: st.DrawFn) -> RouteGraph:
    """Draw some nodes, and edges between any of them."""
    places = draw(st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=2, max_size=12))
    ends = st.integers(0, len(places) - 1)
    ways = draw(st.lists(st.tuples(ends, ends), min_size=1, max_size=40))
    return graph({id: (float(x), float(y)) for id, (x, y) in enumerate(places)}, *ways)
