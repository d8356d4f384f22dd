# SPDX-License-Identifier: BSD-3-Clause
"""compute_route and compute_and_track_route, and the services of the route server."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from nav2_msgs.action import ComputeAndTrackRoute, ComputeRoute
from nav2_msgs.msg import EdgeCost, SpeedLimit
from nav2_msgs.srv import DynamicEdges, SetRouteGraph
from rclpy.duration import Duration
from route_graphs import edge, node, write
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_navigation.routes import server
from flexbt_navigation.routes.graph import RouteGraph, load_graph
from flexbt_navigation.routes.server import graph_markers
from flexbt_sim.messages import pose_of
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import DOCK, FAST, RobotProbe, aborted, open_sim_world, pose
from flexbt_testing.waiting import DEADLINE, wait_until

Result = ComputeRoute.Result
Tracked = ComputeAndTrackRoute.Result

DOOR = {'type': 'TriggerEvent', 'trigger': 'ON_ENTER', 'metadata': {'service_name': 'open_door'}}
CORRIDOR = [
    *(
        node(id, x, y)
        for id, (x, y) in enumerate([(6.5, 4.45), (8.0, 4.45), (10.0, 4.45), (11.0, 4.45), (9.0, 4.1)], 1)
    ),
    node(9, 4.0, 1.2),
    edge(12, 1, 2),
    edge(23, 2, 3),
    edge(34, 3, 4, metadata={'speed_limit': 50}, operations={'door': DOOR}),
    edge(25, 2, 5),
    edge(53, 5, 3),
    edge(32, 3, 2),
    edge(21, 2, 1),
    edge(91, 9, 1, cost=0.0, overridable=False),
]
"""Along the corridor, with a bow at node 5. Node 9 is in the office, from which an edge leads that has no cost."""
START = (6.4, 4.45, 0.0)


@pytest.fixture(scope='module')
def graph_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp('graphs') / 'corridor.geojson', CORRIDOR)


@pytest.fixture(scope='module')
def world(graph_file: Path) -> Iterator[RobotProbe]:
    settings = {
        'graph_filepath': str(graph_file),
        'radius_to_achieve_node': 0.6,
        'boundary_radius_to_achieve_node': 0.4,
        'smoothing_radius': 0.3,
        'max_planning_time': 60.0,  # of wall time: a busy machine may hold the search up
    }
    with open_sim_world(FAST, settings) as probe:
        yield probe


@pytest.fixture(autouse=True)
def corridor_open(world: RobotProbe, graph_file: Path) -> Iterator[None]:
    yield
    set_graph(world, graph_file)
    adjust(world, opened_edges=[23, 12], adjust_edges=[EdgeCost(edgeid=23, cost=0.0)])


def set_graph(world: RobotProbe, file: Path) -> bool:
    request = SetRouteGraph.Request(graph_filepath=str(file))
    return bool(world.ask(SetRouteGraph, names.SET_ROUTE_GRAPH, request).success)


def adjust(world: RobotProbe, **fields: Any) -> bool:
    return bool(world.ask(DynamicEdges, names.ADJUST_EDGES, DynamicEdges.Request(**fields)).success)


def reroute(world: RobotProbe) -> bool:
    return bool(world.ask(Trigger, names.REROUTE, Trigger.Request()).success)


def by_ids(world: RobotProbe, start: int, goal: int, action: str = names.COMPUTE_ROUTE) -> SentGoal:
    return world.send(action, start_id=start, goal_id=goal, use_poses=False)


def nodes(route: Any) -> list[int]:
    return [node.nodeid for node in route.nodes]


def test_a_route_between_nodes_has_its_edges_its_cost_and_a_dense_path(world: RobotProbe) -> None:
    goal = by_ids(world, 1, 3)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    result = goal.result
    assert result.error_code == Result.NONE
    assert (nodes(result.route), [edge.edgeid for edge in result.route.edges]) == ([1, 2, 3], [12, 23])
    assert result.route.route_cost == pytest.approx(3.5)
    assert (result.route.edges[1].start.x, result.route.edges[1].end.x) == (8.0, 10.0)
    assert result.route.header.frame_id == result.path.header.frame_id == 'map'
    places = [pose_of(stamped.pose) for stamped in result.path.poses]
    assert (places[0][:2], places[-1][:2]) == ((6.5, 4.45), (10.0, 4.45))
    assert max(before.distance(after) for before, after in pairwise(places)) <= 0.0501
    assert Duration.from_msg(result.planning_time).nanoseconds > 0


def test_a_route_between_poses_leaves_out_what_is_passed_already(world: RobotProbe) -> None:
    def way_on() -> list[int]:
        goal = world.send(names.COMPUTE_ROUTE, goal=pose((10.6, 4.45)), use_poses=True)
        goal.wait()
        return nodes(goal.result.route)

    world.place((7.0, 4.45, 0.0))
    # From node 1, the nearest, on; but that is behind the robot, and node 4 is beyond the goal. The server may hear of
    # the place after the first goal.
    wait_until(lambda: way_on() == [2, 3], way_on)
    given = world.send(
        names.COMPUTE_ROUTE, start=pose((9.95, 4.45)), goal=pose((8.0, 4.4)), use_poses=True, use_start=True
    )
    assert given.wait().status is GoalStatus.SUCCEEDED
    assert nodes(given.result.route) == [3, 2]
    alone = world.send(names.COMPUTE_ROUTE, goal=pose((6.7, 4.5)), use_poses=True)
    assert alone.wait().status is GoalStatus.SUCCEEDED
    assert (nodes(alone.result.route), len(alone.result.path.poses)) == ([1], 1)


def test_edges_are_closed_opened_and_made_dearer(world: RobotProbe) -> None:
    def way() -> list[int]:
        return nodes(by_ids(world, 1, 3).result.route)

    assert adjust(world, closed_edges=[23])
    assert way() == [1, 2, 5, 3]
    assert adjust(world, opened_edges=[23], adjust_edges=[EdgeCost(edgeid=23, cost=5.0)])
    assert way() == [1, 2, 5, 3]
    assert adjust(world, adjust_edges=[EdgeCost(edgeid=23, cost=0.05)])
    assert way() == [1, 2, 3]
    assert adjust(world, closed_edges=[12])
    aborted(by_ids(world, 1, 3), Result.NO_VALID_ROUTE)
    for nonsense in ({'closed_edges': [777]}, {'adjust_edges': [EdgeCost(edgeid=23, cost=math.nan)]}):
        assert not adjust(world, **nonsense)
    assert adjust(world, opened_edges=[12])
    assert way() == [1, 2, 3]


def test_an_edge_that_is_closed_stays_so_in_another_graph_and_is_told(
    world: RobotProbe, graph_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert adjust(world, closed_edges=[12], adjust_edges=[EdgeCost(edgeid=23, cost=2.0)])
    other = [node(1, 0.0, 0.0), node(2, 1.0, 0.0), edge(12, 1, 2), edge(34, 2, 1)]
    capfd.readouterr()
    assert set_graph(world, write(graph_file.parent / 'beside', other))
    aborted(by_ids(world, 1, 2), Result.NO_VALID_ROUTE)
    assert 'stay closed in the new graph, by their ids: [12]' in capfd.readouterr().err
    assert set_graph(world, graph_file)
    assert 'stay of another cost in the new graph, by their ids: [23]' in capfd.readouterr().err
    assert adjust(world, opened_edges=[12], adjust_edges=[EdgeCost(edgeid=23, cost=0.0)])


REFUSED = {
    'no such start': ({'start_id': 77, 'goal_id': 1}, Result.INDETERMINANT_NODES_ON_GRAPH),
    'no such goal': ({'start_id': 1, 'goal_id': 65535}, Result.INDETERMINANT_NODES_ON_GRAPH),
    'no way': ({'start_id': 4, 'goal_id': 1}, Result.NO_VALID_ROUTE),
    'an edge without a cost': ({'start_id': 9, 'goal_id': 1}, Result.NO_VALID_GRAPH),
    'frame': ({'goal': pose((1.0, 1.0), 'moon'), 'use_poses': True}, Result.TF_ERROR),
    'nowhere': ({'goal': pose((math.nan, 1.0)), 'use_poses': True}, Result.INDETERMINANT_NODES_ON_GRAPH),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_has_no_route_is_refused_with_nav2s_code(world: RobotProbe, case: str) -> None:
    fields, code = REFUSED[case]
    for action in (names.COMPUTE_ROUTE, names.COMPUTE_AND_TRACK_ROUTE):
        result = aborted(world.send(action, **fields), code)
        assert action == names.COMPUTE_AND_TRACK_ROUTE or not result.route.nodes


def test_a_graph_is_drawn_while_the_node_does_something_else(
    world: RobotProbe, graph_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, may_end = threading.Event(), threading.Event()

    def draw(*given: Any) -> MarkerArray:
        begun.set()
        assert may_end.wait(DEADLINE)
        return graph_markers(*given)

    monkeypatch.setattr(server, 'graph_markers', draw)
    loading = threading.Thread(target=set_graph, args=(world, graph_file))
    loading.start()
    world.wait(begun.is_set, 'a drawing')
    assert adjust(world, opened_edges=[12])
    may_end.set()
    loading.join(DEADLINE)
    assert not loading.is_alive()


def test_another_graph_replaces_the_one_before_and_is_shown_and_a_broken_one_does_not(
    world: RobotProbe, graph_file: Path
) -> None:
    shown: list[MarkerArray] = []
    runtime = world.runtime
    subscription = runtime.call(
        lambda: runtime.node.create_subscription(
            MarkerArray, names.ROUTE_GRAPH, shown.append, names.transient_local_qos()
        )
    )
    other = [node(7, 0.0, 0.0), node(8, 1.0, 0.0, frame='base_link'), edge(1, 7, 8)]
    world.place(DOCK)

    def shows_where_the_robot_was_put() -> bool:  # the servers may learn it later than the probe
        if not set_graph(
            world, write(graph_file.parent / 'other', other)
        ):  # no transform of the robot since it was put there
            return False
        goal = by_ids(world, 7, 8)
        assert goal.wait().status is GoalStatus.SUCCEEDED
        place = goal.result.route.nodes[1].position
        return math.dist((place.x, place.y), (DOCK[0] + 1.0, DOCK[1])) < 0.03

    wait_until(shows_where_the_robot_was_put)
    world.set_speed_factor(1.0)  # the moon is waited for, in wall time
    for broken in ([*other, edge(2, 7, 9)], [node(7, 0.0, 0.0, frame='moon'), edge(1, 7, 7)]):
        assert not set_graph(world, write(graph_file.parent / 'broken', broken))
    world.set_speed_factor(FAST['speed_factor'])
    assert not set_graph(world, graph_file.parent / 'missing')
    assert by_ids(world, 7, 8).wait().status is GoalStatus.SUCCEEDED

    def markers(namespace: str) -> list[Marker]:
        return [marker for marker in shown[-1].markers if marker.ns == namespace]

    world.wait(lambda: shown and len(markers('route_graph_nodes')[0].points) == 2, 'the graph')
    assert len(markers('route_graph_edges')[0].points) == 2
    assert [marker.text for marker in markers('route_graph_node_ids')] == ['7', '8']
    runtime.call(lambda: runtime.node.destroy_subscription(subscription))


def test_a_graph_whose_frame_is_told_late_does_not_replace_a_newer_one(
    world: RobotProbe, graph_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As that of the parameter, which is loaded before anybody tells the frames."""
    begun = threading.Event()

    def load(file: Path) -> RouteGraph:
        begun.set()
        return load_graph(file)

    monkeypatch.setattr(server, 'load_graph', load)
    late = write(graph_file.parent / 'late', [node(7, 0.0, 0.0, frame='annexe'), node(8, 1.0, 0.0), edge(1, 7, 8)])
    runtime, loaded = world.runtime, list[bool]()
    world.set_speed_factor(1.0)
    loading = threading.Thread(target=lambda: loaded.append(set_graph(world, late)))
    loading.start()
    world.wait(begun.is_set, 'a graph that is read')
    assert set_graph(world, graph_file)
    annexe = TransformStamped(child_frame_id='annexe')
    annexe.header.frame_id = 'map'
    publisher = runtime.call(
        lambda: runtime.node.create_publisher(TFMessage, names.TF_STATIC, names.transient_local_qos())
    )
    publisher.publish(TFMessage(transforms=[annexe]))
    loading.join(DEADLINE)
    assert loaded == [False]
    assert by_ids(world, 1, 2).wait().status is GoalStatus.SUCCEEDED
    assert set_graph(world, late)
    assert by_ids(world, 7, 8).wait().status is GoalStatus.SUCCEEDED
    world.set_speed_factor(FAST['speed_factor'])
    runtime.call(lambda: runtime.node.destroy_publisher(publisher))


@pytest.fixture(scope='module')
def door(world: RobotProbe) -> list[bool]:
    """Return what the door says next to whoever wants it to open; the last one of it stays."""
    answers = [True]

    def opens(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = answers[0]
        answers.append(answers[0])
        return response

    world.runtime.call(lambda: world.runtime.node.create_service(Trigger, 'open_door', opens))
    return answers


def track(world: RobotProbe, goal: int) -> SentGoal:
    """From node 1 on, with the robot before it."""
    world.place(START)
    tracked = by_ids(world, 1, goal, names.COMPUTE_AND_TRACK_ROUTE)
    world.wait(lambda: tracked.feedback, 'a route')
    return tracked


def told(tracked: SentGoal) -> list[tuple[int, int, int, bool]]:
    return [(one.last_node_id, one.next_node_id, one.current_edge_id, one.rerouted) for one in tracked.feedback]


def test_a_graph_outside_of_the_allowed_directories_is_refused_whether_it_is_there_or_not(
    world: RobotProbe, graph_file: Path, tmp_path: Path
) -> None:
    outside = write(tmp_path / 'outside', CORRIDOR)
    for file in (
        outside,
        tmp_path / 'missing',
        graph_file.parent / '..' / tmp_path.name / 'outside',
        Path('x' * 10**6),
    ):
        assert not set_graph(world, file)
    assert set_graph(world, graph_file)


def test_a_robot_is_tracked_along_its_route_to_the_end(world: RobotProbe, door: list[bool]) -> None:
    limits: list[SpeedLimit] = []
    runtime = world.runtime
    subscription = runtime.call(
        lambda: runtime.node.create_subscription(SpeedLimit, names.SPEED_LIMIT, limits.append, 9)
    )
    world.wait(lambda: runtime.node.count_publishers(names.SPEED_LIMIT), 'the topic')
    asked = len(door)
    tracked = track(world, 4)
    assert nodes(tracked.feedback[0].route) == [1, 2, 3, 4]
    driven = world.follow(tracked.feedback[0].path)
    assert tracked.wait().status is GoalStatus.SUCCEEDED, tracked.result
    assert driven.wait().status is GoalStatus.SUCCEEDED
    assert told(tracked) == [
        (0, 1, 0, True),
        (1, 2, 12, False),
        (2, 3, 23, False),
        (3, 4, 34, False),
        (4, 0, 0, False),
    ]
    assert set(tracked.feedback[3].operations_triggered) == {'TriggerEvent', 'AdjustSpeedLimit'}
    assert Duration.from_msg(tracked.result.execution_duration).nanoseconds > 1e9
    world.wait(lambda: len(limits) == 2, 'the limit and its end')
    assert [(limit.percentage, limit.speed_limit) for limit in limits] == [(True, 50.0), (True, 0.0)]
    assert len(door) == asked + 1
    runtime.call(lambda: runtime.node.destroy_subscription(subscription))


def test_a_route_becomes_another_one_where_the_robot_is_and_the_robot_stays_on_its_edge(world: RobotProbe) -> None:
    assert reroute(world)  # of no goal; the later request finds the service at once, while the robot is on the edge
    tracked = track(world, 3)
    driven = world.follow(tracked.feedback[0].path)
    world.wait(lambda: world.sightings[-1].x > 7.0, 'the robot on the first edge')
    assert adjust(world, closed_edges=[23])
    assert reroute(world)
    world.wait(lambda: tracked.feedback[-1].rerouted and len(tracked.feedback) > 2, 'the new route')
    another = next(one for one in tracked.feedback[2:] if one.rerouted)
    assert nodes(another.route) == [2, 5, 3]
    assert (another.last_node_id, another.next_node_id, another.current_edge_id) == (1, 2, 12)
    assert 6.9 < another.path.poses[0].pose.position.x < 8.0
    newer = world.follow(another.path)
    assert driven.wait().status is GoalStatus.ABORTED
    assert tracked.wait().status is GoalStatus.SUCCEEDED
    assert told(tracked)[-1] == (3, 0, 0, False)
    assert newer.wait().status is GoalStatus.SUCCEEDED


def test_an_edge_that_an_obstacle_blocks_is_given_up_before_the_robot_is_there(
    world: RobotProbe, graph_file: Path
) -> None:
    """The pillar in the corridor is on the way; nothing leads round it."""
    way = [node(1, 3.0, 4.45), node(2, 4.0, 4.45), node(3, 7.0, 4.45), edge(12, 1, 2), edge(23, 2, 3)]
    assert set_graph(world, write(graph_file.parent / 'pillar', way))
    world.place((3.0, 4.45, 0.0))
    tracked = by_ids(world, 1, 3, names.COMPUTE_AND_TRACK_ROUTE)
    aborted(tracked, Tracked.NO_VALID_ROUTE)
    assert 'CollisionMonitor' in tracked.feedback[-1].operations_triggered


def test_an_operation_that_fails_or_that_nobody_knows_ends_the_tracking(
    world: RobotProbe, door: list[bool], graph_file: Path
) -> None:
    door[0] = False
    tracked = track(world, 4)
    world.place((10.0, 4.45, 0.0))  # past the nodes on the way there: none of them is achieved by that
    tracked.cancel()
    assert tracked.wait().status is GoalStatus.CANCELED
    first = [node(1, 6.4, 4.45), node(2, 8.0, 4.45), edge(3, 1, 2, operations={'door': DOOR})]
    set_graph(world, write(graph_file.parent / 'door', first))
    aborted(track(world, 2), Tracked.OPERATION_FAILED)
    door[0] = True
    wrong = [{}, {'service_name': 'open the door'}, {'service_name': '{open}'}, {'service_name': 'door' * 99}]
    for operation in (DOOR | {'type': 'sing'}, *(DOOR | {'metadata': metadata} for metadata in wrong)):
        first[2] = edge(3, 1, 2, operations=[operation])
        set_graph(world, write(graph_file.parent / 'door', first))
        aborted(track(world, 2), Tracked.OPERATION_FAILED)


def test_a_newer_goal_takes_the_tracking_over_and_a_cancel_ends_it(world: RobotProbe) -> None:
    older = track(world, 4)
    newer = track(world, 3)
    aborted(older, Tracked.NONE)
    newer.cancel()
    assert newer.wait().status is GoalStatus.CANCELED
    assert newer.result.error_code == Tracked.NONE


def test_every_one_of_many_requests_has_its_route_or_its_cancel(world: RobotProbe) -> None:
    goals = [by_ids(world, 1, 4) for _ in range(40)]
    for goal in goals[20:]:
        goal.cancel()
    assert all(nodes(goal.result.route) == [1, 2, 3, 4] for goal in goals[:20])
    assert {goal.wait().status for goal in goals[20:]} <= {GoalStatus.SUCCEEDED, GoalStatus.CANCELED}
