# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of Nav2 that send goals and requests, on a live server: what they ask for, and what they write."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav2_msgs import srv
from nav2_msgs.action import (
    AssistedTeleop,
    ComputeAndTrackRoute,
    ComputeRoute,
    DockRobot,
    FollowObject,
    FollowPath,
    SmoothPath,
    UndockRobot,
)
from nav2_msgs.msg import Route, RouteNode
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.transform_listener import TransformListener
from flexbt_common.values.entries import from_entry, to_entry
from flexbt_msgs.action import BtExecute
from flexbt_server.nav2 import motion_actions
from flexbt_server.trees.blackboards import RECOVERIES_KEY
from flexbt_testing.nodes.server_world import ON_DEMAND, ServerWorld, open_server_world, pose_stamped
from flexbt_testing.waiting import DEADLINE, wait_until

Result = BtExecute.Result


@pytest.fixture(scope='module')
def opened() -> Iterator[ServerWorld]:
    with open_server_world(tick_rate=50.0) as world:
        world.navigation.serve(ON_DEMAND)
        yield world


@pytest.fixture
def world(opened: ServerWorld) -> ServerWorld:
    """Return the one world, with servers that succeed, and that have forgotten what they were asked for."""
    navigation = opened.navigation
    for server in navigation.actions.values():
        server.forget()
    navigation.fail.clear()
    navigation.hold.clear()
    return opened


@pytest.fixture(scope='module')
def services(opened: ServerWorld) -> dict[str, Service]:
    """Services that take any request, by name; ``answer`` of each makes the response."""
    kinds = {
        'local_costmap/clear_around_local_costmap': srv.ClearCostmapAroundRobot,
        'local_costmap/clear_except_local_costmap': srv.ClearCostmapExceptRegion,
        'local_costmap/clear_around_pose_local_costmap': srv.ClearCostmapAroundPose,
        'reinitialize_global_localization': Empty,
        'collision_monitor/toggle': srv.Toggle,
        'global_costmap/get_cost_global_costmap': srv.GetCost,
    }
    return {name: Service(opened, kind, name) for name, kind in kinds.items()}


class Service:
    """A service whose requests are kept."""

    def __init__(self, world: ServerWorld, kind: Any, name: str) -> None:
        self.requests: list[Any] = []
        self.answer: Callable[[Any, Any], None] = lambda request, response: None
        runtime = world.navigation_runtime
        runtime.call(lambda: runtime.node.create_service(kind, name, self._serve))

    def _serve(self, request: Any, response: Any) -> Any:
        self.requests.append(request)
        self.answer(request, response)
        return response


def run(world: ServerWorld, leaf: str, code: int = Result.SUCCESS, **inputs: Any) -> Any:
    """Run a leaf as a tree, with these entries of the blackboard; gives the result."""
    world.client.load_tree(leaf)
    result = world.client.execute(inputs=inputs, outputs=[RECOVERIES_KEY]).result
    assert result.code == code, result.message
    return result


def recoveries(result: Any) -> int:
    """Return how many a run has counted."""
    return int(from_entry(result.outputs[0]))


def entry(world: ServerWorld, key: str) -> Any:
    """Return what the shared blackboard has under ``key``; None when it has nothing."""
    entries = world.client.get(key).entries
    return from_entry(entries[0]) if entries else None


def goal(world: ServerWorld, name: str) -> Any:
    """Return the one goal that a server has got."""
    (only,) = world.navigation.actions[name].goals
    return only


def path_of(*points: tuple[float, float], frame: str = 'map') -> Path:
    path = Path(poses=[pose_stamped(*point, frame) for point in points])
    path.header.frame_id = frame
    return path


def succeeds_with(world: ServerWorld, name: str, result: Any) -> None:
    world.navigation.actions[name].answer = lambda number, sent: ('succeed', result)


def aborts_with(world: ServerWorld, name: str, result: Any) -> None:
    world.navigation.actions[name].answer = lambda number, sent: ('abort', result)


@pytest.mark.parametrize(('ports', 'is_used'), [
    ('', False), ('start="{here}"', True), ('start="{here}" use_start="true"', True),
    ('start="{here}" use_start="false"', False), ('use_start="true"', False),
    ('start="{nowhere}" use_start="true"', False),
])  # fmt: skip
def test_a_path_begins_at_a_start_that_is_given_and_wanted(world: ServerWorld, ports: str, is_used: bool) -> None:
    """As in Nav2. A start that is only wanted would be the origin of no frame."""
    run(world, f'<ComputePathToPose goal="{{there}}" {ports}/>', there=pose_stamped(4), here=pose_stamped(1))
    assert goal(world, names.COMPUTE_PATH_TO_POSE).use_start is is_used


def test_smooth_path(world: ServerWorld) -> None:
    rough, smooth = path_of((0, 0), (1, 1)), path_of((0, 0), (0.5, 0.6), (1, 1))
    succeeds_with(world, names.SMOOTH_PATH, SmoothPath.Result(
        path=smooth, smoothing_duration=Duration(sec=1, nanosec=500_000_000), was_completed=True,
    ))  # fmt: skip
    run(world, '<SmoothPath unsmoothed_path="{rough}" smoothed_path="{smooth}" smoother_id="simple" '
               'max_smoothing_duration="2.5" check_for_collisions="true" smoothing_duration="{took}" '
               'was_completed="{complete}" error_code_id="{code}"/>', rough=rough)  # fmt: skip
    sent = goal(world, names.SMOOTH_PATH)
    assert (sent.path, sent.smoother_id, sent.check_for_collisions) == (rough, 'simple', True)
    assert sent.max_smoothing_duration == Duration(sec=2, nanosec=500_000_000)
    assert [entry(world, key) for key in ('smooth', 'took', 'complete', 'code')] == [smooth, 1.5, True, 0]
    aborts_with(world, names.SMOOTH_PATH, SmoothPath.Result(error_code=503))
    assert run(world, '<SmoothPath unsmoothed_path="{rough}" error_code_id="{smoother_error_code}"/>',
               Result.FAILURE).error_code == 503  # fmt: skip


def test_compute_route_by_ids_and_by_poses(world: ServerWorld) -> None:
    route = Route(route_cost=2.5, nodes=[RouteNode(nodeid=3), RouteNode(nodeid=4)])
    succeeds_with(world, names.COMPUTE_ROUTE, ComputeRoute.Result(route=route, planning_time=Duration(nanosec=5)))
    ports = 'route="{route}" path="{path}" planning_time="{time}"'
    run(world, f'<ComputeRoute start_id="3" goal_id="4" {ports}/>')
    sent = goal(world, names.COMPUTE_ROUTE)
    assert (sent.start_id, sent.goal_id, sent.use_poses, sent.use_start) == (3, 4, False, False)
    assert (entry(world, 'route'), entry(world, 'time')) == (route, Duration(nanosec=5))
    run(world, f'<ComputeRoute use_poses="true" goal="{{there}}" start="{{here}}" use_start="true" {ports}/>',
        there=pose_stamped(4), here=pose_stamped(1))  # fmt: skip
    sent = world.navigation.actions[names.COMPUTE_ROUTE].goals[-1]
    assert (sent.goal, sent.start, sent.use_poses, sent.use_start) == (pose_stamped(4), pose_stamped(1), True, True)
    aborts_with(world, names.COMPUTE_ROUTE, ComputeRoute.Result(error_code=405, route=route))
    ports += ' error_code_id="{compute_route_error_code}"'
    result = run(world, f'<ComputeRoute start_id="3" goal_id="4" {ports}/>', Result.FAILURE)
    assert result.error_code == 405
    assert 'aborted the goal: NO_VALID_ROUTE (error code 405)' in result.message
    assert entry(world, 'route') == Route()


def test_a_route_is_tracked_and_replaced_when_its_goal_changes(world: ServerWorld) -> None:
    server = world.navigation.actions[names.COMPUTE_AND_TRACK_ROUTE]
    server.answer = lambda number, sent: None
    server.preempting = True
    world.client.load_tree(
        '<ComputeAndTrackRoute start_id="1" goal_id="{to}" last_node_id="{last}" next_node_id="{next}" '
        'rerouted="{rerouted}" execution_duration="{duration}"/>'
    )
    world.client.set(to_entry('to', 7, 'uint32'))
    sent = world.client.execute()
    wait_until(lambda: server.running, 'the route')
    server.feedback(0, ComputeAndTrackRoute.Feedback(last_node_id=1, next_node_id=2, rerouted=True))
    wait_until(lambda: entry(world, 'next') == 2, 'the feedback')
    assert (entry(world, 'last'), entry(world, 'rerouted')) == (1, True)
    world.client.set(to_entry('to', 9, 'uint32'))
    wait_until(lambda: len(server.goals) == 2, 'the other goal')
    assert server.goals[1].goal_id == 9
    server.end(1, result=ComputeAndTrackRoute.Result(execution_duration=Duration(sec=4)))
    assert sent.result.code == Result.SUCCESS
    assert (entry(world, 'next'), entry(world, 'duration')) == (0, Duration(sec=4))


def test_a_halt_cancels_a_route_that_is_tracked(world: ServerWorld) -> None:
    server = world.navigation.actions[names.COMPUTE_AND_TRACK_ROUTE]
    server.answer = lambda number, sent: None
    world.client.load_tree('<ComputeAndTrackRoute start_id="1" goal_id="2"/>')
    sent = world.client.execute()
    wait_until(lambda: server.running, 'the route')
    sent.call.cancel(DEADLINE)
    assert sent.result.code == Result.CANCELED
    assert server.statuses == {0: 'canceled'}


def test_dock_and_undock(world: ServerWorld) -> None:
    ports = 'success="{docked}" num_retries="{retries}" error_code_id="{dock_robot_error_code}"'
    succeeds_with(world, names.DOCK_ROBOT, DockRobot.Result(success=True, num_retries=2))
    run(world, f'<DockRobot dock_id="home" dock_type="ignored" {ports}/>')
    sent = goal(world, names.DOCK_ROBOT)
    assert (sent.use_dock_id, sent.dock_id, sent.dock_type, sent.navigate_to_staging_pose) == (True, 'home', '', True)
    assert (entry(world, 'docked'), entry(world, 'retries')) == (True, 2)
    aborts_with(world, names.DOCK_ROBOT, DockRobot.Result(error_code=904, num_retries=3))
    ports += ' use_dock_id="false" max_staging_time="5"'
    result = run(world, f'<DockRobot dock_pose="{{at}}" dock_type="plug" {ports}/>', Result.FAILURE, at=pose_stamped(3))
    sent = world.navigation.actions[names.DOCK_ROBOT].goals[-1]
    assert (sent.dock_pose, sent.dock_type, sent.max_staging_time, sent.dock_id) == (pose_stamped(3), 'plug', 5.0, '')
    assert (result.error_code, entry(world, 'docked'), entry(world, 'retries')) == (904, False, 3)
    run(world, '<UndockRobot dock_type="plug" success="{free}"/>')
    sent = goal(world, names.UNDOCK_ROBOT)
    assert (sent.dock_type, sent.max_undocking_time, entry(world, 'free')) == (
        'plug',
        30.0,
        UndockRobot.Result().success,
    )


@pytest.mark.parametrize(('is_recovery', 'code', 'counted'), [
    ('false', Result.SUCCESS, 0), ('true', Result.FAILURE, 1),
])  # fmt: skip
def test_teleoperation_that_is_given_up(world: ServerWorld, is_recovery: str, code: int, counted: int) -> None:
    aborts_with(world, names.ASSISTED_TELEOP, AssistedTeleop.Result(error_code=731))
    leaf = f'<AssistedTeleop time_allowance="3" is_recovery="{is_recovery}" error_code_id="{{code}}"/>'
    assert recoveries(run(world, leaf, code)) == counted
    assert goal(world, names.ASSISTED_TELEOP).time_allowance == Duration(sec=3)
    assert entry(world, 'code') == 731


@pytest.mark.parametrize('seconds', ['3e9', '1e300', 'inf', 'nan'])
@pytest.mark.parametrize('leaf', ['<Spin time_allowance="{}"/>', '<Wait wait_duration="{}"/>'])
def test_a_time_that_no_message_can_have_is_a_failure_with_its_reason(
    world: ServerWorld, leaf: str, seconds: str
) -> None:
    result = run(world, leaf.format(seconds), Result.FAILURE)
    assert f'{float(seconds):g} s' in result.message, result.message


def test_follow_object(world: ServerWorld) -> None:
    succeeds_with(world, names.FOLLOW_OBJECT, FollowObject.Result(total_elapsed_time=Duration(sec=8)))
    run(world, '<FollowObject tracked_frame="person" max_duration="1.5" total_elapsed_time="{time}"/>')
    sent = goal(world, names.FOLLOW_OBJECT)
    assert (sent.pose_topic, sent.tracked_frame) == ('dynamic_pose', 'person')
    assert sent.max_duration == Duration(sec=1, nanosec=500_000_000)
    assert entry(world, 'time') == Duration(sec=8)


def test_navigation_within_a_tree(world: ServerWorld) -> None:
    run(world, '<NavigateToPose goal="{there}" behavior_tree="a.xml"/>', there=pose_stamped(2))
    sent = goal(world, names.NAVIGATE_TO_POSE)
    assert (sent.pose, sent.behavior_tree) == (pose_stamped(2), 'a.xml')
    run(world, '<NavigateThroughPoses goals="{several}"/>', several=[pose_stamped(2), pose_stamped(3)])
    assert list(goal(world, names.NAVIGATE_THROUGH_POSES).poses) == [pose_stamped(2), pose_stamped(3)]


@pytest.mark.parametrize(('node', 'service', 'ports', 'field', 'value'), [
    ('ClearCostmapAroundRobot', 'clear_around_local_costmap', 'reset_distance="2.5"', 'reset_distance', 2.5),
    ('ClearCostmapExceptRegion', 'clear_except_local_costmap', '', 'reset_distance', 1.0),
    ('ClearCostmapAroundPose', 'clear_around_pose_local_costmap', 'pose="{there}"', 'pose', pose_stamped(2)),
])  # fmt: skip
def test_a_costmap_is_cleared_in_part_and_that_is_a_recovery(
    world: ServerWorld, services: dict[str, Service], node: str, service: str, ports: str, field: str, value: Any
) -> None:
    service = f'local_costmap/{service}'
    result = run(world, f'<{node} service_name="{service}" {ports}/>', there=pose_stamped(2))
    assert getattr(services[service].requests[-1], field) == value
    assert recoveries(result) == 1


def test_localization_and_collision_monitor(world: ServerWorld, services: dict[str, Service]) -> None:
    run(world, '<ReinitializeGlobalLocalization/>')
    assert len(services['reinitialize_global_localization'].requests) == 1
    toggle = services['collision_monitor/toggle']
    toggle.answer = lambda request, response: setattr(response, 'success', not request.enable)
    run(world, '<ToggleCollisionMonitor enable="false"/>')
    run(world, '<ToggleCollisionMonitor/>', Result.FAILURE)
    assert [request.enable for request in toggle.requests] == [False, True]


@pytest.mark.parametrize(('cost', 'ports', 'occupied'), [
    (254.0, '', True), (253.0, '', False), (253.0, 'cost_threshold="200"', True),
    (255.0, '', False), (255.0, 'consider_unknown_as_obstacle="true"', True),
])  # fmt: skip
def test_the_cost_of_a_pose(
    world: ServerWorld, services: dict[str, Service], cost: float, ports: str, occupied: bool
) -> None:
    costs = services['global_costmap/get_cost_global_costmap']
    costs.answer = lambda request, response: setattr(response, 'cost', cost)
    code = Result.SUCCESS if occupied else Result.FAILURE
    run(world, f'<CheckPoseOccupancy pose="{{there}}" use_footprint="false" {ports}/>', code, there=pose_stamped(2, 1))
    request = costs.requests[-1]
    assert (request.x, request.y, request.theta, request.use_footprint) == (2.0, 1.0, 0.0, False)


def test_goals_in_collision_are_removed(world: ServerWorld, services: dict[str, Service]) -> None:
    costs = services['global_costmap/get_cost_global_costmap']
    costs.answer = lambda request, response: setattr(response, 'cost', 254.0 if request.x == 2.0 else 0.0)
    leaf = '<RemoveInCollisionGoals input_goals="{given}" output_goals="{left}"/>'
    run(world, leaf, given=[pose_stamped(1), pose_stamped(2), pose_stamped(3)])
    assert entry(world, 'left') == [pose_stamped(1), pose_stamped(3)]
    run(world, leaf, given=[pose_stamped(2)])
    assert entry(world, 'left') == []
    asked = len(costs.requests)
    run(world, leaf.replace('{given}', ''))
    assert len(costs.requests) == asked


def test_the_poses_in_collision_of_a_path(world: ServerWorld) -> None:
    world.navigation.path_valid = False
    leaf = '<ValidatePath path="{path}" collision_poses="{wrong}"/>'
    try:
        run(world, leaf, Result.FAILURE, path=path_of((0, 0), (1, 0)))
    finally:
        world.navigation.path_valid = True
    run(world, leaf)
    assert entry(world, 'wrong') == []


def test_a_port_that_the_interfaces_lack_is_told_once(world: ServerWorld, capfd: pytest.CaptureFixture[str]) -> None:
    capfd.readouterr()
    for _ in range(2):
        run(
            world,
            '<Sequence><Spin disable_collision_checks="true"/><Spin disable_collision_checks="false"/></Sequence>',
        )
    told = capfd.readouterr().err
    if hasattr(world.navigation.actions[names.SPIN].goals[0], 'disable_collision_checks'):
        assert 'has no effect' not in told
    else:
        assert told.count('Spin: the port [disable_collision_checks] has no effect') == 1


def test_how_the_robot_is_on_its_path(world: ServerWorld) -> None:
    """Nav2's tree that leaves a path which the robot has left, with a controller that says nothing of it."""
    publish = publisher(world, PoseStamped, names.POSE)
    follow = world.navigation.actions[names.FOLLOW_PATH]
    follow.answer = lambda number, sent: None
    world.client.load_tree(
        '<ReactiveSequence><IsWithinPathTrackingBounds max_error_left="0.5" max_error_right="0.2" '
        'tracking_feedback="{tracking}"/><FollowPath path="{path}" tracking_feedback="{tracking}"/></ReactiveSequence>'
    )
    publish(pose_stamped(0.0))
    sent = world.client.execute(inputs={'path': path_of((0, 0), (5, 0))})
    wait_until(lambda: follow.running, 'the robot to drive')
    publish(pose_stamped(1.0, 0.4))
    follow.feedback(0, FollowPath.Feedback(speed=0.5))
    wait_until(lambda: sent.feedback and not sent.ended, 'the tree to continue')
    publish(pose_stamped(1.0, -0.4))
    assert sent.result.code == Result.FAILURE
    assert '0.40 m to the right of the path' in sent.result.message
    assert follow.statuses == {0: 'canceled'}


def test_a_controller_waits_for_a_path_only_after_a_failure_and_not_for_ever(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = (
        '<RecoveryNode number_of_retries="1"><FollowPath path="{path}"/>'
        '<SetBlackboard value="{none}" output_key="unused"/></RecoveryNode>'
    )
    lose = '<SetBlackboard value="{none}" output_key="path"/>'
    follow = world.navigation.actions[names.FOLLOW_PATH]
    how = {0: 'abort'}
    monkeypatch.setattr(follow, 'answer', lambda number, sent: (how.get(number, 'succeed'), FollowPath.Result()))
    inputs = {'path': path_of((0, 0), (5, 0)), 'none': Path()}
    monkeypatch.setattr(motion_actions, 'PATH_SECONDS', 1e6)
    run(world, f'<Repeat num_cycles="2"><Sequence>{again}{lose}</Sequence></Repeat>', **inputs)
    assert [len(request.path.poses) for request in follow.goals] == [2, 2, 0]
    follow.forget()
    monkeypatch.setattr(motion_actions, 'PATH_SECONDS', 0.1)
    run(world, again.replace('unused', 'path'), **inputs)
    assert [len(request.path.poses) for request in follow.goals] == [2, 0]


def publisher(world: ServerWorld, message_type: type[Any], topic: str) -> Callable[[Any], None]:
    """Publish messages, once somebody has subscribed."""
    runtime = world.client.runtime
    made = runtime.call(lambda: runtime.node.create_publisher(message_type, topic, 1))
    wait_until(made.get_subscription_count, f'a subscription of {topic}')
    return lambda message: runtime.call(lambda: made.publish(message))


def test_the_pose_of_the_robot_in_any_frame(world: ServerWorld) -> None:
    here = pose_stamped(3.0, 1.0)
    here.header.stamp.sec = 7
    publisher(world, PoseStamped, names.POSE)(here)
    runtime = world.client.runtime
    broadcaster = runtime.call(
        lambda: runtime.node.create_publisher(TFMessage, names.TF_STATIC, names.transient_local_qos())
    )
    camera = TransformStamped()
    camera.header.frame_id, camera.child_frame_id = 'hall', 'map'
    camera.transform.translation.x, camera.transform.rotation.w = 10.0, 1.0
    runtime.call(lambda: broadcaster.publish(TFMessage(transforms=[camera])))
    wait_until(lambda: leaves(world, '<TransformAvailable parent="hall" child="map"/>'), 'the transform')
    run(world, '<GetCurrentPose current_pose="{here}"/>')
    assert entry(world, 'here') == here
    run(world, '<GetCurrentPose global_frame="hall" current_pose="{here}"/>')
    assert (entry(world, 'here').pose.position.x, entry(world, 'here').header.stamp.sec) == (13.0, 7)
    run(
        world,
        '<ArePosesNear ref_pose="{a}" target_pose="{b}" tolerance="0.1"/>',
        a=pose_stamped(1),
        b=pose_stamped(11, 0, 'hall'),
    )
    run(world, '<GoalReached goal="{a}"/>', a=pose_stamped(3.2, 1.0))
    assert not leaves(world, '<GoalReached goal="{a}"/>', a=pose_stamped(3.3, 1.0))
    assert not leaves(world, '<GetCurrentPose global_frame="nowhere"/>')
    assert not leaves(world, '<TransformAvailable parent="nowhere" child="map"/>')


def test_one_leaf_waits_for_an_unknown_transform_and_the_others_do_not(
    world: ServerWorld, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[str] = []
    look_up = TransformListener.lookup

    def kept(
        self: TransformListener, target: str, source: str, time: Any, found: Any, failed: Any, wait: float
    ) -> None:
        waits.extend([source] if wait else [])
        look_up(self, target, source, time, found, failed, wait)

    monkeypatch.setattr(TransformListener, 'lookup', kept)
    unknown = ['shed'] * 30 + ['attic']
    asks = ''.join(f'<Inverter><TransformAvailable parent="{one}" child="map"/></Inverter>' for one in unknown)
    run(world, f'<Sequence>{asks}</Sequence>')
    assert waits.count('attic') == 1
    assert 1 <= waits.count('shed') < 10, 'once a second'


@pytest.mark.parametrize(('leaf', 'kind', 'topic'), [
    ('<IsBatteryLow min_battery="1" battery_topic="cells"/>', BatteryState, 'cells'),
    ('<IsBatteryCharging/>', BatteryState, '/battery_status'),
    ('<SpeedController><CheckStopStatus/></SpeedController>', Odometry, names.ODOM),
    ('<GoalUpdater input_goal="{goal}"><AlwaysSuccess/></GoalUpdater>', PoseStamped, 'goal_update'),
    (f'<Sequence>{100 * "<IsBatteryCharging/>"}<SmootherSelector topic_name="smooth"/></Sequence>', String, 'smooth'),
])  # fmt: skip
def test_what_a_loaded_tree_asks_for_is_heard_before_it_runs(
    world: ServerWorld, leaf: str, kind: Any, topic: str
) -> None:
    runtime = world.client.runtime
    made = runtime.call(lambda: runtime.node.create_publisher(kind, topic, names.transient_local_qos()))
    world.client.load_tree(leaf)
    wait_until(made.get_subscription_count, topic)


@pytest.mark.parametrize('topic', ['a b', '7', 'a//b'])
def test_a_topic_that_cannot_be_is_told_by_the_tree_that_reads_it(world: ServerWorld, topic: str) -> None:
    faults: list[BaseException] = []
    world.server_runtime.on_fault(faults.append)
    world.client.load_tree(f'<PlannerSelector topic_name="{topic}" default_planner="p" selected_planner="{{p}}"/>')
    result = world.client.execute().result
    assert result.code == Result.ERROR
    assert f"no topic can be called '{topic}'" in result.message
    assert not faults


def leaves(world: ServerWorld, leaf: str, **inputs: Any) -> bool:
    """Return whether a leaf succeeds."""
    world.client.load_tree(leaf)
    return bool(world.client.execute(inputs=inputs).result.code == Result.SUCCESS)


def test_battery(world: ServerWorld) -> None:
    low, charging = '<IsBatteryLow min_battery="0.3"/>', '<IsBatteryCharging/>'
    assert not leaves(world, low)
    assert not leaves(world, charging)
    publish = publisher(world, BatteryState, '/battery_status')
    publish(BatteryState(percentage=0.25, voltage=24.0, power_supply_status=BatteryState.POWER_SUPPLY_STATUS_CHARGING))
    wait_until(lambda: leaves(world, low), 'the battery')
    assert leaves(world, charging)
    assert not leaves(world, '<IsBatteryLow min_battery="23" is_voltage="true"/>')
    assert leaves(world, '<IsBatteryLow min_battery="24" is_voltage="true"/>')


def test_the_robot_stands_or_bumps_into_something(world: ServerWorld) -> None:
    stopped = '<CheckStopStatus duration_stopped="100"/>'
    assert not leaves(world, stopped)
    assert not leaves(world, '<IsStuck/>')
    publish = publisher(world, Odometry, names.ODOM)

    def drive(seconds: int, speed: float) -> None:
        odometry = Odometry()
        odometry.header.stamp.sec = seconds
        odometry.twist.twist.linear.x = speed
        publish(odometry)

    drive(10, 30.0)
    wait_until(lambda: not leaves(world, stopped), 'the odometry')
    drive(11, 0.0)
    wait_until(lambda: leaves(world, '<IsStuck/>'), 'the collision')
    assert leaves(world, stopped)
    assert leaves(world, '<IsStopped duration_stopped="100"/>')  # as kilted calls it
    drive(12, 0.0)
    wait_until(lambda: not leaves(world, '<IsStuck/>'), 'the robot to be free')
    # It stands since then, by the stamp: for years, not from this tick on.
    assert leaves(world, '<CheckStopStatus duration_stopped="1000000000"/>')
    drive(13, 30.0)
    wait_until(lambda: not leaves(world, stopped), 'the robot to drive')
    drive(2_000_000_000, 0.0)  # by a clock that is ahead
    wait_until(lambda: leaves(world, stopped), 'the robot to stand')


@pytest.mark.parametrize(('canceling', 'leaf', 'server'), [
    ('CancelControl', 'FollowPath path="{path}"', names.FOLLOW_PATH),
    ('CancelSpin', 'Spin', names.SPIN),
    ('CancelBackUp', 'BackUp', names.BACKUP),
    ('CancelWait', 'Wait', names.WAIT),
    ('CancelDriveOnHeading', 'DriveOnHeading', names.DRIVE_ON_HEADING),
    ('CancelAssistedTeleop', 'AssistedTeleop is_recovery="true"', names.ASSISTED_TELEOP),
    ('CancelComputeAndTrackRoute', 'ComputeAndTrackRoute start_id="1" goal_id="2"', names.COMPUTE_AND_TRACK_ROUTE),
    ('CancelFollowObject', 'FollowObject', names.FOLLOW_OBJECT),
])  # fmt: skip
def test_what_another_tree_has_asked_for_is_canceled(
    world: ServerWorld, canceling: str, leaf: str, server: str
) -> None:
    world.navigation.actions[server].answer = lambda number, sent: None
    world.client.load_tree(f'<{leaf}/>', 'Held')
    held = world.client.execute('Held', inputs={'path': path_of((0, 0), (1, 0))}, blackboard=f'held {canceling}')
    wait_until(lambda: world.navigation.actions[server].running, 'the goal')
    run(world, f'<{canceling}/>')
    assert (held.result.code, held.result.error_code) == (Result.FAILURE, 0)
    assert world.navigation.actions[server].statuses == {0: 'canceled'}


@pytest.mark.parametrize(
    'kind', ['controller', 'planner', 'smoother', 'goal_checker', 'progress_checker', 'path_handler']
)
def test_a_plugin_is_selected_by_a_latched_topic_and_before_by_the_default(world: ServerWorld, kind: str) -> None:
    node = f'{kind.title().replace("_", "")}Selector'
    leaf = f'<{node} default_{kind}="usual" topic_name="my_{kind}" selected_{kind}="{{{kind}}}"/>'
    assert not leaves(world, f'<{node} topic_name="my_{kind}" selected_{kind}="{{{kind}}}"/>')
    run(world, leaf)
    assert entry(world, kind) == 'usual'
    runtime = world.client.runtime
    made = runtime.call(lambda: runtime.node.create_publisher(String, f'my_{kind}', names.transient_local_qos()))
    runtime.call(lambda: made.publish(String(data='other')))
    wait_until(lambda: leaves(world, leaf) and entry(world, kind) == 'other', 'the selection')
    runtime.call(lambda: made.publish(String()))  # none is chosen any more
    wait_until(lambda: leaves(world, leaf) and entry(world, kind) == 'usual', 'the default')
