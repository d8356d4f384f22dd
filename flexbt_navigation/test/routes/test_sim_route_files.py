# SPDX-License-Identifier: BSD-3-Clause
"""Graphs in GeoJSON: what Nav2's route server reads is read, anything else is refused with file, field and remedy."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from route_graphs import edge, feature, node, write

from flexbt_navigation.errors import GraphError
from flexbt_navigation.routes.graph import load_graph
from flexbt_sim.world import Pose

NODES = [node(0, 0.0, 0.0), node(1, 1.0, 0.5, frame='odom')]


def test_nodes_and_edges_are_read_with_all_that_they_carry(tmp_path: Path) -> None:
    door = {'type': 'TriggerEvent', 'trigger': 'ON_ENTER', 'metadata': {'service_name': 'open_door'}}
    features = [
        edge(7, 1, 0, cost=3.5, overridable=False),
        node(
            0, 0.0, 0.0, metadata={'region': {'x_values': [1.0, 2.0]}}, operations={'halt': door | {'trigger': 'NODE'}}
        ),
        node(1, 1, 0.5, frame='odom'),
        edge(8, 0, 1, metadata={'speed_limit': 0.85}, operations={'open': door}),
        feature('LineString', [[0.0, 0.0], [1.0, 0.5]], id=9, startid=0, endid=0),
        feature('Polygon', [], id=1),
    ]
    graph = load_graph(write(tmp_path / 'graph.geojson', features))
    assert {id: (node.x, node.y, node.frame) for id, node in graph.nodes.items()} == {
        0: (0.0, 0.0, 'map'),
        1: (1.0, 0.5, 'odom'),
    }
    assert graph.frames == {'map', 'odom'}
    assert graph.nodes[0].metadata == {'region': {'x_values': [1.0, 2.0]}}
    (halt,) = graph.nodes[0].operations
    assert (halt.name, halt.type, halt.trigger, halt.metadata) == ('halt', *door.values()) or halt.trigger == 'NODE'
    seven, eight, _ = graph.edges
    assert (seven.start, seven.end, seven.cost, seven.overridable) == (graph.nodes[1], graph.nodes[0], 3.5, False)
    assert (eight.cost, eight.overridable, eight.metadata) == (0.0, True, {'speed_limit': 0.85})
    assert [operation.name for operation in eight.operations] == ['open']
    assert [each.id for each in graph.leaving(graph.nodes[0])] == [8, 9]


def test_edges_may_have_the_same_id(tmp_path: Path) -> None:
    """As in a sample of Nav2, where each way and the one back have one."""
    graph = load_graph(write(tmp_path / 'g', [*NODES, edge(5, 0, 1), edge(5, 1, 0)]))
    assert [(each.id, each.start.id) for each in graph.edges] == [(5, 0), (5, 1)]
    assert [each.end.id for each in graph.leaving(graph.nodes[1])] == [0]


def test_a_graph_in_several_frames_is_moved_to_one(tmp_path: Path) -> None:
    graph = load_graph(write(tmp_path / 'g', [*NODES, edge(0, 0, 1)]))
    moved = graph.moved('map', {'odom': Pose(10.0, 20.0, math.pi / 2.0)})
    assert moved.frames == {'map'}
    assert moved.nodes[1].point == pytest.approx((9.5, 21.0))
    assert moved.nodes[0].point == (0.0, 0.0)
    assert moved.edges[0].end is moved.nodes[1]


REFUSED: dict[str, tuple[Any, str]] = {
    'no json': ('{', 'cannot be read'),
    'text': ('"graph"', 'not a GeoJSON FeatureCollection'),
    'deep': ('[' * 200_000, 'cannot be read'),
    'not utf-8': (b'\xff\xfe{', 'cannot be read'),
    'no features': ({}, 'not a GeoJSON FeatureCollection'),
    'nothing': ([], 'there are no nodes'),
    'no edges': (NODES, 'there are no edges'),
    'no properties': ([{'geometry': {'type': 'Point', 'coordinates': [0, 0]}}], 'features[0].properties: expected'),
    'id': ([node(65536, 0.0, 0.0)], 'features[0].properties.id: expected a whole number of 0 to 65535, got 65536'),
    'text as id': ([feature('Point', [0, 0], id='1')], "got '1'"),
    'true as id': ([feature('Point', [0, 0], id=True)], 'got True'),
    'one coordinate': ([feature('Point', [0.0], id=1)], 'geometry.coordinates: expected x and y'),
    'nowhere': ([node(1, math.nan, 0.0)], 'geometry.coordinates: expected x and y'),
    'too far': ([node(1, 1e9, 0.0)], 'geometry.coordinates: expected x and y'),
    'frame': ([node(1, 0.0, 0.0, frame='')], 'properties.frame'),
    'twice': ([node(1, 0.0, 0.0), node(1, 1.0, 0.0)], 'features[1].properties.id: 1 is the id of another node'),
    'no start': ([*NODES, edge(0, 5, 1)], 'features[2].properties.startid: there is no node 5'),
    'no end': ([*NODES, feature('LineString', [], id=0, startid=0)], 'properties.endid'),
    'cost': ([*NODES, edge(0, 0, 1, cost='dear')], "properties.cost: expected a number, got 'dear'"),
    'endless cost': ([*NODES, edge(0, 0, 1, cost=math.inf)], 'properties.cost'),
    'long cost': ([*NODES, edge(0, 0, 1, cost=10**400)], 'properties.cost'),
    'overridable': ([*NODES, edge(0, 0, 1, overridable='no')], 'properties.overridable'),
    'metadata': ([*NODES, edge(0, 0, 1, metadata=[1])], 'properties.metadata'),
    'operations': ([*NODES, edge(0, 0, 1, operations='wait')], 'properties.operations'),
    'operation': ([*NODES, edge(0, 0, 1, operations={'wait': 1})], 'properties.operations.wait'),
    'type': ([*NODES, edge(0, 0, 1, operations={'wait': {}})], 'properties.operations.wait.type'),
    'trigger': ([*NODES, edge(0, 0, 1, operations=[{'type': 'stop', 'trigger': 'NOW'}])], 'operations.0.trigger'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_is_no_graph_is_refused(tmp_path: Path, case: str) -> None:
    content, said = REFUSED[case]
    file = tmp_path / 'graph.geojson'
    if isinstance(content, list):
        write(file, content)
    elif isinstance(content, dict):
        file.write_text(json.dumps(content))
    else:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(GraphError) as raised:
        load_graph(file)
    assert said in str(raised.value)
    assert str(file) in str(raised.value)


@pytest.mark.parametrize(('name', 'why'), [('missing', 'No such file'), ('.', 'it is a directory')])
def test_a_file_that_is_none_is_refused(tmp_path: Path, name: str, why: str) -> None:
    with pytest.raises(GraphError, match=why):
        load_graph(tmp_path / name)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_damaged_file_is_a_graph_or_a_graph_error(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    features: list[Any] = [*NODES, edge(0, 0, 1, cost=1.0, operations={'a': {'type': 'b', 'trigger': 'NODE'}})]
    file = tmp_path_factory.mktemp('damaged') / 'graph'
    target = json.loads(json.dumps({'features': features}))
    for _ in range(data.draw(st.integers(1, 3))):
        here = target
        for _ in range(data.draw(st.integers(0, 4))):
            if isinstance(here, list) and here:
                step: Any = data.draw(st.integers(0, len(here) - 1))
            elif isinstance(here, dict) and here:
                step = data.draw(st.sampled_from(sorted(here)))
            else:
                break
            if data.draw(st.booleans()) and isinstance(here[step], dict | list):
                here = here[step]
            else:
                here[step] = data.draw(JSON)
                break
    file.write_text(json.dumps(target))
    try:
        graph = load_graph(file)
    except GraphError as error:
        assert str(file) in str(error)
    else:
        assert graph.nodes
        assert graph.edges
