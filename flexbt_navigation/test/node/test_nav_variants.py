# SPDX-License-Identifier: BSD-3-Clause
"""Robots that are set up in another way: in a namespace, with stamped commands, in other frames, without power."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav2_msgs.action import DockRobot, FollowPath, Spin
from sensor_msgs.msg import BatteryState

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.middleware.fastdds import can_ignore
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.errors import FlexbtError
from flexbt_msgs.srv import SetFault
from flexbt_navigation.node import Navigation
from flexbt_navigation.simulation import Simulation
from flexbt_sim.simulator.node import Simulator
from flexbt_sim.world import DriveModel
from flexbt_testing.nodes.sim_world import (
    DOCK,
    FAST,
    OFFICE,
    RobotProbe,
    aborted,
    line,
    open_sim_world,
    pose,
    without_faults,
)

PLACE = '/fleet/robot1'


def test_a_robot_in_a_namespace_with_stamped_commands_is_driven_as_fast_as_possible() -> None:
    stamped = {'enable_stamped_cmd_vel': True, 'cmd_vel_topic': 'stamped_commands'}
    fast = stamped | {'speed_factor': 0.0, 'map_frame': 'world'}
    slaved = stamped | {'use_sim_time': True, 'global_frame': 'world'}
    with (
        without_faults(names.SIMULATOR, namespace=PLACE, parameters=fast) as simulator,
        without_faults(names.NAVIGATION, namespace=PLACE, parameters=slaved) as navigation,
        without_faults('probe', namespace=PLACE) as client,
    ):
        probe = RobotProbe(client)
        commands: list[TwistStamped] = []
        node = client.node
        client.call(lambda: node.create_subscription(TwistStamped, f'{PLACE}/stamped_commands', commands.append, 100))
        Simulator(simulator)
        Navigation(navigation)
        path = probe.send(names.COMPUTE_PATH_TO_POSE, goal=pose(OFFICE, 'world')).result.path
        assert path.header.frame_id == 'world'
        began = probe.now.time
        assert probe.follow(path).wait().status is GoalStatus.SUCCEEDED
        rest = probe.wait_at_rest()
        assert rest.distance(OFFICE) < 0.15
        driven = [seen for seen in probe.sightings if began <= seen.time <= rest.time]
        assert max(probe.speeds(driven)) > 0.9 * DriveModel().linear_speed
        assert began <= seconds_of(commands[-1].header.stamp) <= probe.now.time


ROBOTS = """
plan: {rooms: [{from: [0, 0], to: [8, 6]}]}
robots: {alpha: {pose: [1, 1, 0]}, beta: {pose: [1, 4, 0]}}
"""


def test_in_one_process_each_robot_has_navigation_of_its_own(tmp_path: Path) -> None:
    world = tmp_path / 'two.yaml'
    world.write_text(ROBOTS, encoding='utf-8')
    with (
        without_faults(names.SIMULATOR, namespace='/fleet', parameters=FAST | {'world': str(world)}) as simulator,
        without_faults('one', namespace='/fleet/alpha') as one,
        without_faults('other', namespace='/fleet/beta') as other,
    ):
        # The commands of the other are sent, and need not be.
        probes = [RobotProbe(one), RobotProbe(other, hears_commands=False)]
        given = '--ros-args -r __node:=x -r __ns:=/y -p desired_linear_vel:=0.2'  # as ros2 launch names the simulator
        Simulation(simulator, given.split())
        places = [(4.0, 1.0), (3.0, 4.0)]
        paths = [probe.plan(place).result.path for probe, place in zip(probes, places, strict=True)]
        goals = [probe.follow(path) for probe, path in zip(probes, paths, strict=True)]
        assert [goal.wait().status for goal in goals] == [GoalStatus.SUCCEEDED] * 2
        nodes = one.call(lambda: one.node.get_node_names_and_namespaces())
        assert {('navigation', '/fleet/alpha'), ('navigation', '/fleet/beta')} <= set(nodes)
        alpha, _beta = simulator.further  # which have nothing to say to each other
        plans = f'/fleet/beta/{names.PLAN}'
        assert one.node.count_publishers(plans)
        assert alpha.node.count_publishers(plans) == 0 or not can_ignore()
        for robot in ('alpha', 'beta'):  # to navigation the pose is handed over
            heard_by = one.call(partial(one.node.get_subscriptions_info_by_topic, f'/fleet/{robot}/{names.POSE}'))
            assert [known.node_name for known in heard_by if known.node_name == names.NAVIGATION] == []
        for probe, place in zip(probes, places, strict=True):
            assert probe.wait_at_rest().distance(place) < 0.15
            assert 0.18 < max(probe.speeds(probe.sightings)) < 0.21


YARD = """
plan: {rooms: [{from: [0, 0], to: [30, 20]}]}
robots: {robot: {model: car, pose: [12, 10, 0]}}
stations: {home: {pose: [24, 10, 0]}}
"""


def test_a_car_drives_backward_to_what_is_behind_it_and_onto_a_dock(tmp_path: Path) -> None:
    file = tmp_path / 'yard.yaml'
    file.write_text(YARD, encoding='utf-8')
    goal = (9.0, 10.5, 0.0)
    car = {'use_sim_time': True, 'world': str(file), 'dock_database': str(file)}
    for unfit, said in (
        ({'robot': 'robt'}, "no robot 'robt'; did you mean 'robot'"),
        ({'staging_yaw_offset': 0.5}, 'cannot turn on the spot at the staging pose; give 0'),
    ):
        with without_faults('lost', parameters=car | unfit) as lost, pytest.raises(FlexbtError, match=said):
            Navigation(lost)
    with (
        without_faults(names.SIMULATOR, namespace='/robot', parameters=FAST | {'world': str(file)}) as simulator,
        without_faults(names.NAVIGATION, namespace='/robot/robot', parameters=car) as node,
        without_faults('probe', namespace='/robot/robot') as client,
    ):
        probe = RobotProbe(client)
        Simulator(simulator)
        Navigation(node)
        path = probe.plan(goal).result.path
        assert probe.follow(path).wait().status is GoalStatus.SUCCEEDED
        there = probe.wait_at_rest()
        assert there.distance(goal[:2]) < 0.15
        assert abs(there.yaw) < 0.15
        assert max(probe.speeds(probe.sightings)) > 1.0  # nobody has told it how fast a car is
        refused = aborted(probe.send(names.SPIN, target_yaw=1.0), Spin.Result.UNKNOWN)
        assert 'minimum_turning_radius of 5 m' in refused.error_msg
        docked = probe.send(names.DOCK_ROBOT, use_dock_id=True, dock_id='home')
        assert docked.wait().status is GoalStatus.SUCCEEDED, docked.result
        assert probe.wait_at_rest().distance((24.0, 10.0)) < 0.15
        left = probe.send(names.UNDOCK_ROBOT, max_undocking_time=60.0)
        assert left.wait().status is GoalStatus.SUCCEEDED, left.result
        assert probe.wait_at_rest().distance((24.0, 10.0)) == pytest.approx(5.0, abs=0.2)


CORRIDOR = """
plan: {rooms: [{from: [0, 0], to: [8, 4]}]}
robots: {robot: {model: waffle, pose: [3, 2, 0]}}
stations: {home: {pose: [6, 2, 0]}}
"""


def test_a_robot_leaves_a_dock_that_it_has_found_elsewhere_also_when_that_charges_no_more(tmp_path: Path) -> None:
    world, docks = tmp_path / 'corridor.yaml', tmp_path / 'docks.yaml'
    world.write_text(CORRIDOR, encoding='utf-8')
    docks.write_text('docks: {home: {type: simple_charging_dock, pose: [5.8, 2, 0]}}', encoding='utf-8')
    settings = {'dock_database': str(docks), 'use_external_detection_pose': True, 'external_detection_timeout': 60.0}
    with open_sim_world(FAST | {'world': str(world), 'robot_namespaces': False}, settings) as probe:
        node = probe.runtime.node
        seen = probe.runtime.call(lambda: node.create_publisher(PoseStamped, names.DETECTED_DOCK_POSE, 1))
        batteries = probe.runtime.call(lambda: node.create_publisher(BatteryState, names.BATTERY_STATE, 1))

        def dock(detected: PoseStamped, **fields: bool) -> DockRobot.Result:
            goal = probe.send(names.DOCK_ROBOT, use_dock_id=True, dock_id='home', **fields)
            while not goal.ended:
                seen.publish(detected)
                probe.later(0.2)
            return goal.result

        old = pose((6.0, 2.0))
        old.header.stamp.sec = 1
        probe.later(61.0)
        code = dock(old, navigate_to_staging_pose=False).error_code
        assert code == DockRobot.Result.FAILED_TO_DETECT_DOCK  # however often it is reported
        docked = dock(pose((6.0, 2.0)))
        assert docked.success, docked
        assert probe.wait_at_rest().distance((6.0, 2.0)) < 0.1
        silence = SetFault.Request(fault='sensor_silent', parameters='{sensor: battery}')
        assert probe.ask(SetFault, 'simulator/set_fault', silence).success
        batteries.publish(BatteryState(power_supply_status=BatteryState.POWER_SUPPLY_STATUS_NOT_CHARGING))
        probe.later(0.2)
        left = probe.send(names.UNDOCK_ROBOT, max_undocking_time=30.0)
        assert left.wait().status is GoalStatus.SUCCEEDED, left.result
        assert probe.wait_at_rest().distance((6.0, 2.0)) == pytest.approx(0.7, abs=0.12)


def test_a_robot_that_gets_nowhere_fails_to_make_progress() -> None:
    # Its wheels hardly turn, which navigation does not know.
    with open_sim_world(FAST | {'linear_speed': 0.01}, {'movement_time_allowance': 3.0}) as world:
        result = aborted(world.follow(line(DOCK, (4.0, 4.45))), FollowPath.Result.FAILED_TO_MAKE_PROGRESS)
        assert '3 s' in result.error_msg
        assert world.wait_at_rest().distance(DOCK) < 0.1
