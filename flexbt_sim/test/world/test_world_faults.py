# SPDX-License-Identifier: BSD-3-Clause
"""Faults of robots and doors: when they begin and end, and what they do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy
import pytest

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import (
    FAULTS,
    MODELS,
    DoorModel,
    LidarModel,
    ObstacleModel,
    OdometryModel,
    Pose,
    Robot,
    RobotModel,
    World,
    ZoneModel,
    box,
)
from flexbt_sim.world.faults import fault_parameters


def alone(model: RobotModel = MODELS['waffle']) -> tuple[World, Robot]:
    world = World()
    world.add('wall', ObstacleModel(pose=Pose(2.0, 0.0, 0.0), shape=box(0.1, 20.0)))
    robot: Robot = world.add('alpha', model, Pose(0.0, 0.0, 0.0))
    return world, robot


def drive(world: World, robot: Robot, seconds: float, linear: float = 0.2, angular: float = 0.0) -> None:
    until = world.time + seconds - 1e-9
    while world.time < until:
        robot.command(linear, angular, world.time)
        world.step()


def test_a_fault_begins_and_ends_at_its_times() -> None:
    world, robot = alone()
    world.set_fault('alpha', 'stuck_wheel', {'side': 'both'}, after=1.0, duration=2.0)
    assert not world.active_faults('alpha')
    drive(world, robot, 1.0)
    moved = robot.pose.x
    assert moved > 0.15
    drive(world, robot, 2.0)
    assert list(world.active_faults('alpha')) == ['stuck_wheel']
    assert world.state('alpha').faults == ('stuck_wheel',)
    assert robot.pose.x == pytest.approx(moved, abs=0.005)
    drive(world, robot, 1.0)
    assert robot.pose.x > moved + 0.15
    assert (world.active_faults('alpha'), world.faults) == ({}, ())


@pytest.mark.parametrize(('side', 'sign'), [('left', 1.0), ('right', -1.0)])
def test_with_a_stuck_wheel_it_goes_round_it(side: str, sign: float) -> None:
    world, robot = alone()
    drive(world, robot, 0.5)
    start = robot.pose
    world.set_fault('alpha', 'stuck_wheel', {'side': side})
    drive(world, robot, 2.0)
    # The other wheel drives round the one that stands: half the speed, about half the distance of the wheels.
    assert robot.linear == pytest.approx(0.1)
    assert robot.angular == pytest.approx(sign * 0.2 / 0.287)
    wheel = (start.x, start.y + sign * 0.287 / 2.0)
    assert math.hypot(robot.pose.x - wheel[0], robot.pose.y - wheel[1]) == pytest.approx(0.287 / 2.0, abs=0.01)
    assert robot.odometry.yaw == pytest.approx(robot.pose.yaw)


def test_a_lost_localization_jumps_drifts_and_is_found_again() -> None:
    world, robot = alone()
    world.set_fault('alpha', 'localization_lost', {'jump': [0.0, 2.0, 0.5], 'drift': 0.1}, duration=4.0)
    assert robot.estimate.y == pytest.approx(2.0)
    assert robot.estimate.yaw == pytest.approx(0.5)
    drive(world, robot, 3.0, 0.0)
    assert robot.estimate.x == pytest.approx(0.3, abs=0.01)
    drive(world, robot, 1.1, 0.0)
    assert tuple(robot.estimate) == pytest.approx(tuple(robot.pose))


def test_an_initial_pose_near_where_it_is_finds_it_and_another_one_does_not() -> None:
    world, robot = alone()
    world.set_fault('alpha', 'localization_lost', {'jump': [0.0, 2.0, 0.0]})
    assert robot.localize(Pose(0.3, 0.2, 0.1))
    assert tuple(robot.estimate) == pytest.approx(tuple(robot.pose), abs=1e-9)
    assert not robot.localize(Pose(-3.0, 0.0, 1.0))
    assert tuple(robot.estimate) == pytest.approx((-3.0, 0.0, 1.0))
    drive(world, robot, 1.0)
    assert robot.estimate.y > 0.1  # it drives on from where it thinks that it is


def test_in_a_sensor_shadow_the_localization_goes_by_odometry_and_is_lost_found_and_put_right_as_elsewhere() -> None:
    world = World()
    drifting = replace(MODELS['waffle'], odometry=OdometryModel(scale=1.1))
    robot: Robot = world.add('alpha', drifting, Pose(0.0, 0.0, 0.0))
    world.add('glare', ZoneModel(kind='sensor_shadow', area=box(60.0, 60.0)))

    def error() -> tuple[float, float, float]:
        return tuple(numpy.subtract(robot.estimate, robot.pose).tolist())

    drive(world, robot, 5.0)
    blind = error()
    assert blind[0] == pytest.approx(0.1, abs=0.01)
    world.set_fault('alpha', 'localization_lost', {'jump': [0.0, 2.0, 0.0], 'drift': 0.5}, duration=1.0)
    assert error() == pytest.approx((blind[0], 2.0, 0.0))
    drive(world, robot, 0.9, 0.0)
    assert error() == pytest.approx((blind[0] + 0.45, 2.0, 0.0), abs=0.03)
    drive(world, robot, 0.2, 0.0)
    assert error() == pytest.approx(blind, abs=0.01)
    assert robot.localize(robot.pose)
    assert error() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    world.move('alpha', Pose(-5.0, 0.0, 0.0))
    assert error() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    drive(world, robot, 5.0)
    assert error() == pytest.approx(blind, abs=0.01)
    world.remove('glare')
    assert error() == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


def test_a_frozen_lidar_tells_the_same_with_a_new_time() -> None:
    world, robot = alone(RobotModel(lidar=LidarModel(rate=10.0)))
    drive(world, robot, 1.0)
    before = robot.scan
    assert before is not None
    world.set_fault('alpha', 'lidar_frozen', duration=2.0)
    drive(world, robot, 2.0)
    assert robot.scan is not None
    assert robot.scan.time > before.time + 1.5
    assert robot.scan.ranges.tobytes() == before.ranges.tobytes()
    drive(world, robot, 0.5)
    assert robot.scan.ranges[0] < before.ranges[0] - 0.3


def test_a_blinded_lidar_sees_nothing_there() -> None:
    world, robot = alone(RobotModel(lidar=LidarModel(rate=10.0)))
    world.set_fault('alpha', 'lidar_blinded', {'direction': 0.0, 'width': 0.2})
    world.step(0.2)
    assert robot.scan is not None
    assert numpy.isinf(robot.scan.ranges[[0, 1, 5, 355]]).all()
    assert numpy.isfinite(robot.scan.ranges[[7, 10, 350]]).all()


def test_dropouts_are_as_often_as_they_are_said_to_be() -> None:
    model = RobotModel(lidar=LidarModel(rate=50.0, beams=100, range_max=30.0, field_of_view=1.0, dropout=0.1))
    world, robot = alone(model)
    lost = []
    for _ in range(200):
        world.step()
        assert robot.scan is not None
        lost.append(numpy.isinf(robot.scan.ranges).mean())
    assert float(numpy.mean(lost)) == pytest.approx(0.1, abs=0.01)


def test_a_battery_is_low_at_once_and_stays() -> None:
    world, robot = alone()
    world.set_fault('alpha', 'battery_low', {'level': 0.2}, duration=1.0)
    world.step(2.0)
    assert robot.battery is not None
    assert robot.battery.level == pytest.approx(0.2, abs=0.01)


def test_a_fault_that_is_active_has_its_effect_after_a_reset_too() -> None:
    world, robot = alone()
    world.set_fault('alpha', 'localization_lost', {'jump': [1.0, 0.5, 0.0]}, duration=10.0)
    world.set_fault('alpha', 'battery_low', {'level': 0.2})
    drive(world, robot, 1.0)
    world.reset()
    assert world.state('alpha').faults == ('localization_lost', 'battery_low')
    assert (robot.pose, robot.battery and robot.battery.level) == (Pose(0.0, 0.0, 0.0), 0.2)
    assert robot.estimate == pytest.approx(Pose(1.0, 0.5, 0.0))
    drive(world, robot, 9.5, linear=0.0)
    assert robot.estimate == pytest.approx(robot.pose)


def test_a_jammed_door_stays_as_it_is() -> None:
    world = World()
    door = world.add('gate', DoorModel(from_=(0.0, 0.0), to=(1.0, 0.0), opening_time=2.0))
    door.command(True)
    world.step(1.0)
    world.set_fault('gate', 'door_jammed', duration=3.0)
    world.step(2.5)
    assert door.opening == pytest.approx(0.5)
    door.command(False)  # is refused: it must not do so when it is mended
    world.step(2.0)
    assert door.opening == 1.0


@pytest.mark.parametrize('automatic', [False, True])
def test_a_door_goes_where_it_jams_and_stays_there_until_that_ends(automatic: bool) -> None:
    world = World()
    door = world.add('gate', DoorModel(from_=(0.0, 0.0), to=(1.0, 0.0), automatic=automatic, open=True))
    world.add('alpha', RobotModel(), Pose(0.5, 1.0, 0.0))  # near: an automatic door is to be open
    world.set_fault('gate', 'door_jammed', {'where': 'closed'}, duration=10.0)
    world.step(5.0)
    assert door.opening == 0.0
    door.command(True)
    world.step(4.0)
    assert door.opening == 0.0
    world.step(5.0)
    assert door.opening == automatic
    world.set_fault('gate', 'door_jammed', {'where': 'open'})
    world.step(5.0)
    assert door.opening == 1.0


def test_faults_are_cleared_and_go_with_their_entity() -> None:
    world, robot = alone()
    world.set_fault('alpha', 'stuck_wheel')
    world.set_fault('alpha', 'lidar_frozen', after=5.0)
    world.set_fault('alpha', 'stuck_wheel', {'side': 'right'})  # in place of the first
    assert [one.name for one in world.faults] == ['lidar_frozen', 'stuck_wheel']
    with pytest.raises(SimulationError, match="there is no fault 'stuck_weel'; did you mean 'stuck_wheel'"):
        world.clear_fault('alpha', 'stuck_weel')
    assert world.clear_fault('alpha', 'stuck_wheel') == 1
    assert world.clear_fault('alpha') == 1
    assert world.clear_fault('alpha') == 0
    drive(world, robot, 1.0)
    assert robot.pose.y == 0.0
    world.set_fault('alpha', 'stuck_wheel', after=1.0)
    world.remove('alpha')
    world.step(2.0)
    assert world.faults == ()


def test_faults_that_nodes_carry_out_are_told_to_them() -> None:
    world, _ = alone()
    world.set_fault('alpha', 'messages_dropped', {'topic': 'scan', 'probability': 0.5}, duration=1.0)
    world.set_fault('alpha', 'server_fails', {'server': 'follow_path', 'error_code': 105})
    told = world.active_faults('alpha')
    assert told == {
        'messages_dropped of scan': fault_parameters('messages_dropped', {'topic': 'scan', 'probability': 0.5}),
        'server_fails of follow_path': fault_parameters('server_fails', {'server': 'follow_path', 'error_code': 105}),
    }
    world.step(1.5)
    assert list(world.active_faults('alpha')) == ['server_fails of follow_path']


def test_each_server_and_each_topic_can_have_a_fault() -> None:
    world, robot = alone()
    for topic in ('scan', 'odom', 'scan'):
        world.set_fault('alpha', 'messages_dropped', {'topic': topic})
    assert list(robot.faults) == ['messages_dropped of odom', 'messages_dropped of scan']
    assert world.clear_fault('alpha', 'messages_dropped') == 2
    for server, code in (('spin', 0), ('wait', 0), ('spin', 701)):
        world.set_fault('alpha', 'server_fails', {'server': server, 'error_code': code})
    had = {one.slot: getattr(one, 'error_code', None) for one in world.active_faults('alpha').values()}
    assert had == {'server_fails of wait': 0, 'server_fails of spin': 701} and len(robot.faults) == 2
    assert world.clear_fault('alpha', 'server_fails') == 2 and robot.faults == {}


@pytest.mark.parametrize(
    ('entity', 'fault', 'parameters', 'times', 'message'),
    [
        ('beta', 'stuck_wheel', {}, (0.0, 0.0), "there is no 'beta'"),
        ('alpha', 'stuck', {}, (0.0, 0.0), "did you mean 'stuck_wheel'"),
        ('alpha', 'door_jammed', {}, (0.0, 0.0), "'alpha' is a robot; a door can have it"),
        ('alpha', 'stuck_wheel', {'wheel': 'left'}, (0.0, 0.0), 'wheel: there is no such key'),
        ('alpha', 'battery_low', {'level': 2.0}, (0.0, 0.0), 'level: 2 is not within 0 to 1'),
        ('alpha', 'messages_late', {'topic': 'scna'}, (0.0, 0.0), "topic: 'scna' is none of amcl_pose, battery_state"),
        ('alpha', 'messages_dropped', {'topic': 'bumper'}, (0.0, 0.0), "'alpha' has no bumper"),
        ('bare', 'messages_dropped', {}, (0.0, 0.0), "'bare' has no lidar"),
        ('bare', 'lidar_frozen', {}, (0.0, 0.0), "'bare' has no lidar"),
        ('bare', 'battery_low', {}, (0.0, 0.0), "'bare' has no battery"),
        ('alpha', 'stuck_wheel', {}, (-1.0, 0.0), 'give times that are not negative'),
        ('alpha', 'stuck_wheel', {}, (0.0, math.inf), 'give times that are not negative'),
    ],
)
def test_what_cannot_be_is_refused(
    entity: str, fault: str, parameters: Mapping[str, Any], times: tuple[float, float], message: str
) -> None:
    world, _ = alone()
    world.add('bare', RobotModel(lidar=None), Pose(-5.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match=message):
        world.set_fault(entity, fault, parameters, *times)
    assert world.faults == ()


def test_every_fault_can_be_had_with_its_defaults() -> None:
    world, _ = alone()
    world.add('gate', DoorModel(from_=(5.0, 5.0), to=(6.0, 5.0)))
    for name, fault in FAULTS.items():
        world.set_fault('gate' if 'door' in fault.entities else 'alpha', name)
    world.step(1.0)
    assert len(world.faults) == len(FAULTS)
