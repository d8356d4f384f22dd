# SPDX-License-Identifier: BSD-3-Clause
"""Routes on a graph: the cheapest one, for nodes and for poses, as a path, and where on it the robot is."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import numpy
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from route_graphs import graph, graphs

from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.routes.edge_scorers import (
    SCORERS,
    DynamicEdges,
    RouteRequest,
    Scorer,
    edge_scorer,
    greatest_cost,
    greatest_costs,
)
from flexbt_navigation.routes.graph import RouteEdge, RouteGraph, RouteNode, speed_limit
from flexbt_navigation.routes.route import (
    AchievedRadii,
    Ends,
    PathShape,
    Route,
    RoutePlanner,
    RouteTracker,
    blocked_edge,
    find_route,
    nearest_node,
    pruned,
    route_path,
)
from flexbt_sim.world import Pose
from flexbt_testing.worlds import drawn

DISTANCE = edge_scorer([SCORERS['DistanceScorer']])
SQUARE = graph({1: (0.0, 0.0), 2: (4.0, 0.0), 3: (4.0, 4.0), 4: (0.0, 4.0)}, (1, 2), (2, 3), (3, 4), (4, 1), (2, 1))


def route(graph: RouteGraph, start: int, goal: int, **options: object) -> Route:
    request = RouteRequest(graph.nodes[start], graph.nodes[goal])
    return find_route(graph, request, options.pop('score', DISTANCE), **options)  # type: ignore[arg-type]


def ids(found: Route) -> list[int]:
    return [node.id for node in found.nodes]


# -- the cheapest route ------------------------------------------------------------------------------------------------


def test_a_route_goes_along_edges_in_their_direction() -> None:
    found = route(SQUARE, 1, 3)
    assert (ids(found), [edge.id for edge in found.edges], found.cost) == ([1, 2, 3], [100, 101], 8.0)
    assert ids(route(SQUARE, 3, 2)) == [3, 4, 1, 2]
    alone = route(SQUARE, 2, 2)
    assert (ids(alone), alone.edges, alone.cost) == ([2], (), 0.0)


def cheapest(graph: RouteGraph, dynamic: DynamicEdges) -> dict[tuple[int, int], float]:
    """Of all pairs, by the algorithm of Floyd and Warshall."""
    costs = {(a, b): 0.0 if a == b else math.inf for a, b in product(graph.nodes, repeat=2)}
    for edge in graph.edges:
        if edge.id not in dynamic.closed:
            pair = edge.start.id, edge.end.id
            costs[pair] = min(costs[pair], edge.length + dynamic.costs.get(edge.id, 0.0))
    for via, a, b in product(graph.nodes, repeat=3):
        costs[a, b] = min(costs[a, b], costs[a, via] + costs[via, b])
    return costs


@settings(deadline=None, max_examples=40)
@given(graphs(), st.data())
def test_no_route_is_cheaper_and_none_is_missed(graph: RouteGraph, data: st.DataObject) -> None:
    some = st.sampled_from([edge.id for edge in graph.edges])
    dynamic = DynamicEdges()
    dynamic.adjust(data.draw(st.lists(some)), data.draw(st.lists(some)), data.draw(st.dictionaries(some, st.just(7.5))))
    score = edge_scorer([SCORERS['DistanceScorer'], dynamic])
    for (start, goal), cost in cheapest(graph, dynamic).items():
        try:
            found = route(graph, start, goal, score=score)
        except NavigationError as error:
            assert (error.code, cost) == ('NO_VALID_ROUTE', math.inf)
            continue
        assert found.cost == pytest.approx(cost)
        assert (ids(found)[0], ids(found)[-1]) == (start, goal)
        assert all(before.end is after.start for before, after in pairwise(found.edges))
        assert not dynamic.closed & {edge.id for edge in found.edges}


def test_edges_may_be_adjusted_while_another_thread_scores() -> None:
    """The service does that while a route is looked for; here each time that an edge is looked at."""
    dynamic, more = DynamicEdges(), iter(range(1000, 1010))

    class Ids(numpy.ndarray):
        def __eq__(self, other: object) -> Any:
            dynamic.adjust([next(more)], [100], {next(more): 1.0})
            return numpy.asarray(self) == other

    dynamic.adjust([100], [], {101: 2.0, 102: 3.0})
    square = RouteGraph(SQUARE.nodes, SQUARE.edges)
    square.links.edge_ids = square.links.edge_ids.view(Ids)
    assert dynamic(square, RouteRequest(SQUARE.nodes[1], SQUARE.nodes[3])).tolist() == [0.0, 2.0, 3.0, 0.0, 0.0]
    assert dynamic.closed == {1000, 1002} and set(dynamic.costs) == {101, 102, 1001, 1003}


def test_what_is_blocked_is_not_used_be_it_an_edge_or_a_node() -> None:
    for blocked in ({101}, {3}):
        with pytest.raises(NavigationError) as raised:
            route(SQUARE, 1, 3, blocked=blocked)
        assert raised.value.code == 'NO_VALID_ROUTE'


def test_time_that_is_up_ends_the_search() -> None:
    def up() -> None:
        raise NavigationError('TIMEOUT', 'the time is up')

    with pytest.raises(NavigationError):
        route(SQUARE, 1, 3, check_time=up)


def costs(edges: list[RouteEdge], *scorers: Scorer, **request: object) -> list[float]:
    """Of edges, for a request from the first to the last node."""
    nodes = {node.id: node for edge in edges for node in (edge.start, edge.end)}
    asked = RouteRequest(edges[0].start, edges[-1].end, **request)  # type: ignore[arg-type]
    return edge_scorer(scorers)(RouteGraph(nodes, edges), asked).tolist()


def an_edge(**fields: object) -> RouteEdge:
    """3 m long, to the north."""
    return RouteEdge(5, RouteNode(1, 1.0, 1.0), RouteNode(2, 1.0, 4.0), **fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('scorer', 'metadata', 'cost'),
    [
        ('DistanceScorer', {}, 3.0),
        ('DistanceScorer', {'speed_limit': 0.5}, 6.0),
        ('DistanceScorer', {'speed_limit': 50}, 6.0),
        ('DistanceScorer', {'speed_limit': 'slow'}, 3.0),
        ('DistanceScorer', {'speed_limit': 10**400}, 3.0),
        ('TimeScorer', {}, 6.0),
        ('TimeScorer', {'abs_speed_limit': 1.5}, 2.0),
        ('TimeScorer', {'abs_speed_limit': 1.5, 'abs_time_taken': 9}, 9.0),
        ('PenaltyScorer', {}, 0.0),
        ('PenaltyScorer', {'penalty': 2.5}, 2.5),
        ('PenaltyScorer', {'penalty': -2.5}, 0.0),
    ],
)
def test_an_edge_costs_what_its_metadata_say(scorer: str, metadata: dict[str, object], cost: float) -> None:
    edge = an_edge(metadata=metadata)
    assert costs([edge], SCORERS[scorer]) == pytest.approx([cost])


def test_a_cost_that_is_not_overridable_stands_and_must_be_positive() -> None:
    edge = an_edge(cost=7.0, overridable=False)
    assert costs([edge], SCORERS['DistanceScorer']) == [7.0]
    assert costs([an_edge(cost=7.0)]) == [7.0]
    for cost in (0.0, -1.0):
        wrong = an_edge(cost=cost, overridable=False)
        with pytest.raises(NavigationError) as raised:
            route(RouteGraph({1: wrong.start, 2: wrong.end}, [wrong]), 1, 2)
        assert raised.value.code == 'NO_VALID_GRAPH'


@pytest.mark.parametrize(
    ('start', 'end', 'is_met'),
    [(1, 4, True), (2, 1, True), (2, 4, True), (4, 1, False), (3, 2, False)],
    ids=['from the start', 'back to the start', 'on the way', 'from a farther node', 'from the goal'],
)
def test_an_edge_without_a_valid_cost_counts_where_nav2s_search_meets_it(start: int, end: int, is_met: bool) -> None:
    nodes = {id: RouteNode(id, x, 0.0) for id, x in {1: 0.0, 2: 1.0, 3: 2.0, 4: 9.0}.items()}
    edges = [RouteEdge(10 + a, nodes[a], nodes[b]) for a, b in ((1, 2), (2, 3), (1, 4))]
    graph = RouteGraph(nodes, [*edges, RouteEdge(20, nodes[start], nodes[end], cost=0.0, overridable=False)])
    if is_met:
        with pytest.raises(NavigationError) as raised:
            route(graph, 1, 3)
        assert raised.value.code == 'NO_VALID_GRAPH'
    else:
        assert route(graph, 1, 3).cost == pytest.approx(2.0)


@pytest.mark.parametrize('name', ['StartPoseOrientationScorer', 'GoalPoseOrientationScorer'])
def test_scorers_of_headings_need_poses(name: str) -> None:
    edge = an_edge()
    east = Pose(0.0, 0.0, 0.0)
    assert costs([edge], SCORERS[name], start_pose=east, goal_pose=east) == pytest.approx([math.pi / 2.0])
    back = replace(edge, start=edge.end, end=edge.start)
    turns = costs([edge, back], SCORERS[name], start_pose=east, goal_pose=east)
    assert sorted(turns) == pytest.approx([0.0, math.pi / 2.0])  # the one that leaves the start, or comes to the goal
    beside = replace(edge, start=RouteNode(3, 0.0, 0.0), end=RouteNode(4, 0.0, 1.0))
    assert costs([edge, beside, back], SCORERS[name], start_pose=east, goal_pose=east)[1] == 0.0
    with pytest.raises(NavigationError) as raised:
        costs([edge], SCORERS[name])
    assert raised.value.code == 'INVALID_EDGE_SCORER_USE'


WALL = Costmap(drawn(*['.' * 60 + '#' + '.' * 59] * 60, *['.' * 120] * 60), Inflation())
"""6 m by 6 m; the wall, at x = 3.0, leaves the lower half open."""


def test_an_edge_through_an_obstacle_or_beside_the_map_is_none_for_the_costmap_scorer() -> None:
    places = graph({1: (1.0, 5.0), 2: (5.0, 5.0), 3: (1.0, 1.0), 4: (5.0, 1.0), 5: (9.0, 1.0)}, (1, 2), (3, 4), (4, 5))
    assert costs(list(places.edges), SCORERS['CostmapScorer'], costmap=WALL) == [math.inf, 0.0, math.inf]


coordinates = st.floats(-2.0, 8.0)


def costs_on_line(start: tuple[float, float], end: tuple[float, float]) -> tuple[NDArray[numpy.uint8], bool]:
    """Return the costs of the cells on one line, as far as they are on the map, and whether all of them are."""
    world = WALL.world
    ends = numpy.array([world.grid_position(*start), world.grid_position(*end)])
    count = max(1, math.ceil(2.0 * math.dist(*ends)))
    rows, columns = numpy.floor(numpy.linspace(ends[0], ends[1], count + 1)).astype(int).T
    inside = (rows >= 0) & (rows < world.height) & (columns >= 0) & (columns < world.width)
    return WALL.costs[rows[inside], columns[inside]], bool(inside.all())


@settings(deadline=None, max_examples=100)
@given(st.lists(st.tuples(coordinates, coordinates, coordinates, coordinates), min_size=1, max_size=20), st.booleans())
def test_costs_of_many_lines_are_those_of_each(lines: list[tuple[float, ...]], many: bool) -> None:
    starts, ends = numpy.array(lines)[:, :2], numpy.array(lines)[:, 2:]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('flexbt_navigation.routes.edge_scorers.CELLS_AT_A_TIME', 10**6 if many else 100)
        greatest, is_on_map = greatest_costs(WALL, starts, ends)
    each = [costs_on_line((a, b), (c, d)) for a, b, c, d in lines]
    assert [greatest_cost(WALL, (a, b), (c, d)) for a, b, c, d in lines] == list(
        zip(greatest.tolist(), is_on_map.tolist(), strict=True)
    )
    assert greatest.tolist() == [costs.max(initial=0) for costs, _ in each]
    assert is_on_map.tolist() == [inside for _, inside in each]


def test_of_a_line_across_the_world_the_part_on_the_map_is_looked_at() -> None:
    """A graph in coordinates of another place has such lines to the robot."""
    tracemalloc.start()
    try:
        for start, end, greatest in (
            ((1.0, 5.0), (1e5, 5.0), 254.0),
            ((-1e5, 5.0), (1e5, 5.0), 254.0),
            ((1.0, 1.0), (1e5, 1.0), 0.0),
            ((3.02, 9e4), (3.02, -9e4), 254.0),
            ((-1e5, 9.0), (1e5, 9.0), 0.0),
            ((1e5, 5.0), (2e5, 5.0), 0.0),
        ):
            assert greatest_cost(WALL, start, end) == (greatest, False)
            assert greatest_cost(WALL, end, start) == (greatest, False)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def test_a_speed_limit_is_a_part_or_percent() -> None:
    values = [0.85, 85, 1, 100, 250, 0, -3, 'x', True, math.nan]
    limits = [speed_limit(an_edge(metadata={'speed_limit': value})) for value in values]
    assert limits == [0.85, 0.85, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]


# -- poses -------------------------------------------------------------------------------------------------------------


def test_a_pose_has_the_nearest_node_unless_something_is_in_between() -> None:
    places = graph({1: (3.5, 5.0), 2: (1.0, 3.5), 3: (2.0, 1.0)}, (1, 2))
    here = Pose(2.5, 5.0, 0.0)
    assert nearest_node(places, here, None).id == 1
    assert nearest_node(places, here, WALL).id == 2
    assert nearest_node(places, Pose(-9.0, 5.0, 0.0), WALL).id == 2
    assert nearest_node(places, Pose(3.6, 5.0, 0.0), WALL).id == 1


def test_ends_that_are_passed_already_are_left_out() -> None:
    whole = route(SQUARE, 1, 3)
    assert ids(pruned(whole, (1.0, 0.2), (4.5, 3.0))) == [2]
    assert ids(pruned(whole, (1.0, 0.2), None)) == [2, 3]
    assert pruned(whole, (1.0, 0.2), None).cost == 4.0
    assert ids(pruned(whole, None, (4.5, 3.0))) == [1, 2]
    # At a node, or before it, or far from the edge nothing is.
    for start in ((0.05, 0.0), (-1.0, 0.0), (1.0, 9.0)):
        assert pruned(whole, start, None) == whole
    for goal in ((4.0, 3.9), (4.0, 5.0), (14.0, 3.0)):
        assert pruned(whole, None, goal) == whole
    alone = Route(SQUARE.nodes[1])
    assert pruned(alone, (1.0, 0.0), (1.0, 0.0)) == alone


# -- paths -------------------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=40)
@given(graphs(), st.sampled_from([0.05, 0.3]), st.sampled_from([0.0, 0.5, 1.0]), st.data())
def test_a_path_leads_from_the_first_node_to_the_last_in_small_steps(
    graph: RouteGraph, density: float, radius: float, data: st.DataObject
) -> None:
    start, goal = (data.draw(st.sampled_from(sorted(graph.nodes))) for _ in range(2))
    try:
        found = route(graph, start, goal)
    except NavigationError:
        assume(False)
    path = route_path(found, PathShape(density, radius))
    assert path[0][:2] == graph.nodes[start].point
    assert path[-1][:2] == pytest.approx(graph.nodes[goal].point)
    assert all(0.0 < before.distance(after) <= density * 1.0001 for before, after in pairwise(path))
    for before, after in pairwise(path):
        assert math.cos(before.bearing(*after[:2])) == pytest.approx(1.0)
    if found.edges:
        assert path[-1].yaw == pytest.approx(found.edges[-1].heading)
    # A rounded corner is never farther from it than the radius makes it.
    lines = [(edge.start.point, edge.end.point) for edge in found.edges]
    for pose in path:
        gaps = [gap(pose[:2], *line) for line in lines] or [pose.distance(Pose(*found.start.point, 0.0))]
        assert min(gaps) <= radius + 1e-6


def test_a_route_across_the_world_is_refused_before_its_path_is_made() -> None:
    far = graph({1: (0.0, 0.0), 2: (6000.0, 0.0)}, (1, 2))
    with pytest.raises(NavigationError, match='path_density') as raised:
        RoutePlanner(far, DISTANCE, PathShape()).plan(Ends(1), Ends(2))
    assert raised.value.code == 'NO_VALID_ROUTE'
    assert len(RoutePlanner(far, DISTANCE, PathShape(density=1.0)).plan(Ends(1), Ends(2)).path) == 6001


def gap(place: tuple[float, float], start: tuple[float, float], end: tuple[float, float]) -> float:
    """Distance of a place from a line."""
    along = complex(end[0] - start[0], end[1] - start[1])
    to_place = complex(place[0] - start[0], place[1] - start[1])
    share = (to_place * along.conjugate()).real / abs(along) ** 2 if along else 0.0
    return abs(to_place - min(max(share, 0.0), 1.0) * along)


def test_a_corner_is_an_arc_that_touches_both_edges() -> None:
    path = route_path(route(SQUARE, 1, 3), PathShape(0.05, 1.0))
    arc = [pose for pose in path if pose.x > 3.0 + 1e-9 and pose.y < 1.0 - 1e-9]
    assert len(arc) > 20
    assert all(math.dist(pose[:2], (3.0, 1.0)) == pytest.approx(1.0) for pose in arc)
    sharp = route_path(route(SQUARE, 1, 3), PathShape(0.05, 0.0))
    assert (4.0, 0.0) in [pose[:2] for pose in sharp]
    # Where the edges are too short the corner stays.
    assert [pose[:2] for pose in route_path(route(SQUARE, 1, 3), PathShape(0.05, 5.0))] == [pose[:2] for pose in sharp]


def test_a_path_begins_where_the_robot_is_on_its_way_to_the_first_node() -> None:
    path = route_path(Route(SQUARE.nodes[2]), PathShape(), begin=(3.0, 0.0))
    assert (path[0][:2], path[-1]) == ((3.0, 0.0), Pose(4.0, 0.0, 0.0))
    assert [pose[:2] for pose in route_path(Route(SQUARE.nodes[2]), PathShape())] == [(4.0, 0.0)]


# -- tracking ----------------------------------------------------------------------------------------------------------


def drive(tracker: RouteTracker, *places: tuple[float, float]) -> list[tuple[int, int, int]]:
    """Along straight lines; at each change the ids of last node, next node and edge, 0 for none."""
    seen = []
    for start, end in pairwise(places):
        for part in range(101):
            pose = Pose(start[0] + (end[0] - start[0]) * part / 100, start[1] + (end[1] - start[1]) * part / 100, 0.0)
            if tracker.step(pose):
                seen.append(
                    tuple(each.id if each else 0 for each in (tracker.last_node, tracker.next_node, tracker.edge))
                )
    return seen  # type: ignore[return-value]


def test_nodes_are_achieved_one_after_the_other() -> None:
    tracker = RouteTracker(route(SQUARE, 1, 4), AchievedRadii(1.0, 0.5))
    assert (tracker.last_node, tracker.edge) == (None, None)
    seen = drive(tracker, (-2.0, 0.0), (0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
    assert seen == [(1, 2, 100), (2, 3, 101), (3, 4, 102), (4, 0, 0)]
    assert tracker.is_complete
    assert not tracker.step(Pose(0.0, 4.0, 0.0))


def test_a_node_on_the_way_is_achieved_past_the_line_that_halves_its_corner() -> None:
    tracker = RouteTracker(route(SQUARE, 1, 3), AchievedRadii(2.0, 1.0))
    assert drive(tracker, (0.0, 0.0), (3.0, 0.0)) == [(1, 2, 100)]
    # A shortcut inside of the corner counts from the diagonal on.
    assert not drive(tracker, (3.0, 0.0), (3.2, 0.75))
    assert drive(tracker, (3.2, 0.75), (3.5, 1.0)) == [(2, 3, 101)]


def test_a_node_that_is_driven_by_is_achieved_when_it_is_left_behind() -> None:
    tracker = RouteTracker(route(SQUARE, 1, 3), AchievedRadii(2.0, 1.0))
    drive(tracker, (0.0, 0.0), (1.5, 0.0))
    assert drive(tracker, (1.5, 0.0), (2.5, 0.0), (1.5, 0.0)) == [(2, 3, 101)]


def test_a_robot_that_is_on_an_edge_already_goes_on_there() -> None:
    whole = route(SQUARE, 1, 3)
    tracker = RouteTracker(pruned(whole, (1.0, 0.0), None), AchievedRadii(1.0, 0.5), whole.edges[0])
    assert tracker.last_node is SQUARE.nodes[1]
    assert drive(tracker, (1.0, 0.0), (4.0, 0.0), (4.0, 4.0)) == [(2, 3, 101), (3, 0, 0)]
    assert tracker.left is whole.edges[1]


def test_the_first_blocked_edge_ahead_is_found_within_its_distance() -> None:
    places = graph({1: (1.0, 1.0), 2: (1.0, 5.0), 3: (5.0, 5.0)}, (1, 2), (2, 3))
    tracker = RouteTracker(route(places, 1, 3), AchievedRadii(1.0, 0.5))
    assert blocked_edge(tracker, Pose(1.0, 1.0, 0.0), WALL, 99.0) is None
    tracker.step(Pose(1.0, 1.0, 0.0))
    here = Pose(1.0, 3.0, 0.0)
    found = blocked_edge(tracker, here, WALL, 5.0)
    assert found is places.edges[1]
    assert blocked_edge(tracker, here, WALL, 3.0) is None
