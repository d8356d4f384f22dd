# SPDX-License-Identifier: BSD-3-Clause
"""Range finder and IMU, and what all sensors share: their times, their noise and their faults."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import (
    MODELS,
    BatteryModel,
    DriveModel,
    GripperModel,
    Imu,
    ImuModel,
    LidarModel,
    ObstacleModel,
    OdometryModel,
    Pose,
    RangeFinder,
    RangeFinderModel,
    Robot,
    RobotModel,
    World,
    ZoneModel,
    box,
)

EXACT_RANGE = RangeFinderModel(noise=0.0)
EXACT_IMU = ImuModel(angular_noise=0.0, linear_noise=0.0)
EQUIPPED = RobotModel(
    lidar=LidarModel(beams=30, dropout=0.1),
    range_finder=RangeFinderModel(),
    imu=ImuModel(),
    bumper=True,
    battery=BatteryModel(),
    gripper=GripperModel(),
)


def carried(model: RobotModel, seed: int = 0) -> tuple[World, Robot]:
    """Return a robot 2 m before a wall, whose near side is at x = 1.95."""
    world = World(seed=seed)
    world.add('wall', ObstacleModel(pose=Pose(2.0, 0.0, 0.0), shape=box(0.1, 20.0)))
    robot: Robot = world.add('alpha', model, Pose(0.0, 0.0, 0.0))
    return world, robot


def finder(robot: Robot) -> RangeFinder:
    found = robot.device(RangeFinder)
    assert found is not None
    return found


def imu(robot: Robot) -> Imu:
    found = robot.device(Imu)
    assert found is not None
    return found


def drive(world: World, robot: Robot, seconds: float, linear: float, angular: float = 0.0) -> None:
    until = world.time + seconds - 1e-9
    while world.time < until:
        robot.command(linear, angular, world.time)
        world.step()


def readings(robot: Robot) -> dict[str, tuple[Any, str, str]]:
    """Return the last readings of all sensors, to the bit."""
    return {one.name: (one.time, repr(one.values()), repr(one.array_values())) for one in robot.sensors}


# -- the range finder --------------------------------------------------------------------------------------------------


def test_a_range_finder_measures_the_nearest_thing_in_its_cone_from_where_it_is() -> None:
    world, robot = carried(RobotModel(range_finder=replace(EXACT_RANGE, pose=Pose(0.2, 0.0, 0.0))))
    world.step()
    assert finder(robot).range == pytest.approx(1.75)
    world.add('post', ObstacleModel(pose=Pose(1.0, 0.08, 0.0), shape=box(0.02, 0.02)))
    world.add('aside', ObstacleModel(pose=Pose(0.8, 0.4, 0.0), shape=box(0.02, 0.02)))
    world.step(0.1)
    assert finder(robot).range == pytest.approx(math.hypot(0.79, 0.07), abs=0.01)


def test_a_range_finder_reports_too_far_and_too_near_as_infinities() -> None:
    world, robot = carried(RobotModel(range_finder=replace(EXACT_RANGE, range_max=1.0)))
    world.step()
    assert finder(robot).range == math.inf
    world, robot = carried(RobotModel(range_finder=replace(EXACT_RANGE, range_min=1.96)))
    world.step()
    assert finder(robot).range == -math.inf
    with pytest.raises(SimulationError, match='range_min of 5 m is not below range_max of 4 m'):
        RangeFinderModel(range_min=5.0)


def test_a_range_finder_sees_nothing_in_a_sensor_shadow() -> None:
    world, robot = carried(RobotModel(range_finder=EXACT_RANGE))
    world.add('glare', ZoneModel(kind='sensor_shadow', area=box(1.0, 1.0)))
    world.step()
    assert finder(robot).range == math.inf


# -- the imu -----------------------------------------------------------------------------------------------------------


def test_an_imu_at_rest_measures_nothing_but_its_bias() -> None:
    world, robot = carried(RobotModel(imu=replace(EXACT_IMU, angular_bias=0.05)))
    world.step(1.0)
    assert (imu(robot).angular_velocity, imu(robot).acceleration) == (0.05, (0.0, 0.0))
    assert imu(robot).constants()['linear_acceleration.z'] == pytest.approx(9.81, abs=0.01)


def test_an_imu_measures_acceleration_and_in_a_bend_the_one_to_the_inside() -> None:
    slow = DriveModel(linear_acceleration=0.5, angular_acceleration=1.0)
    world, robot = carried(RobotModel(drive=slow, imu=EXACT_IMU))
    drive(world, robot, 0.2, 0.2)
    assert imu(robot).acceleration == pytest.approx((0.5, 0.0))
    drive(world, robot, 2.0, 0.2, 0.5)
    assert imu(robot).angular_velocity == pytest.approx(0.5)
    assert imu(robot).acceleration == pytest.approx((0.0, 0.2 * 0.5))


def test_an_imu_apart_from_the_middle_and_turned_measures_in_its_own_frame() -> None:
    world, robot = carried(RobotModel(imu=replace(EXACT_IMU, pose=Pose(0.3, 0.0, math.pi / 2.0))))
    drive(world, robot, 2.0, 0.0, 1.0)
    # It goes round the middle: towards it, which is to its left, 1² x 0.3 m/s².
    assert imu(robot).acceleration == pytest.approx((0.0, 0.3))


def test_an_imu_measures_the_motion_over_ground_which_slipping_wheels_do_not() -> None:
    world, robot = carried(RobotModel(drive=DriveModel(slip=0.3), imu=EXACT_IMU))
    drive(world, robot, 1.0, 0.0, 1.0)
    assert 0.3 < imu(robot).angular_velocity < robot.angular == 1.0


def test_at_a_wall_an_imu_measures_that_the_robot_stops() -> None:
    world, robot = carried(RobotModel(imu=EXACT_IMU, odometry=OdometryModel()))
    seen = []
    while not robot.in_contact:
        robot.command(0.26, 0.0, world.time)
        world.step()
        seen.append(imu(robot).acceleration[0])
    assert seen[-1] == pytest.approx(-0.26 / world.step_size)
    assert robot.twist == (0.0, 0.0)


# -- all sensors -------------------------------------------------------------------------------------------------------


def test_sensors_measure_at_their_rates() -> None:
    world, robot = carried(replace(EQUIPPED, imu=ImuModel(rate=25.0), range_finder=RangeFinderModel(rate=10.0)))
    times: dict[str, set[float]] = {one.name: set() for one in robot.sensors}
    for _ in range(100):
        world.step()
        for one in robot.sensors:
            assert one.time is not None
            times[one.name].add(one.time)
    assert {name: len(seen) for name, seen in times.items()} == {
        'battery': 2 + 1, 'lidar': 10 + 1, 'range_finder': 20 + 1, 'imu': 50 + 1,
    }  # fmt: skip


def test_the_noise_of_a_sensor_has_the_deviation_of_its_model_and_grows_by_a_fault() -> None:
    world, robot = carried(replace(EQUIPPED, imu=ImuModel(angular_noise=0.02, linear_noise=0.3)))

    def deviations() -> tuple[float, ...]:
        seen = []
        for _ in range(1000):
            world.step(0.1)
            seen.append((finder(robot).range, *imu(robot).values()))
        return tuple(numpy.std(seen, axis=0).tolist())

    quiet = deviations()
    assert quiet == pytest.approx((0.01, 0.02, 0.3, 0.3), rel=0.1)
    for sensor in ('range_finder', 'imu'):
        world.set_fault('alpha', 'sensor_noisy', {'sensor': sensor, 'factor': 3.0})
    assert deviations() == pytest.approx(numpy.multiply(3.0, quiet), rel=0.15)


@pytest.mark.parametrize('sensor', ['lidar', 'range_finder', 'imu', 'battery'])
def test_a_frozen_sensor_repeats_its_reading_and_a_silent_one_has_none(sensor: str) -> None:
    world, robot = carried(EQUIPPED)
    drive(world, robot, 1.5, 0.2)
    before = readings(robot)[sensor]
    world.set_fault('alpha', 'sensor_frozen', {'sensor': sensor}, duration=2.0)
    drive(world, robot, 1.5, 0.2)
    frozen = readings(robot)[sensor]
    assert frozen[1:] == before[1:]
    assert frozen[0] > before[0]
    drive(world, robot, 1.5, 0.2)
    assert readings(robot)[sensor][1:] != before[1:]
    last = readings(robot)[sensor]
    world.set_fault('alpha', 'sensor_silent', {'sensor': sensor}, duration=2.0)
    drive(world, robot, 1.9, 0.2)
    assert readings(robot)[sensor] == last
    drive(world, robot, 1.5, 0.2)
    assert readings(robot)[sensor] != last


HIDING = [
    ('lidar_frozen', {}),
    ('lidar_blinded', {}),
    ('sensor_frozen', {'sensor': 'range_finder'}),
    ('sensor_silent', {'sensor': 'imu'}),
    ('sensor_noisy', {'sensor': 'imu'}),
    ('sensor_silent', {'sensor': 'lidar'}),
]


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(HIDING), st.floats(0.0, 1.0), st.floats(0.1, 1.5))
def test_faults_do_not_change_the_noise_of_later_readings(
    fault: tuple[str, dict[str, str]], after: float, duration: float
) -> None:
    one, other = carried(EQUIPPED), carried(EQUIPPED)
    one[0].set_fault('alpha', *fault, after=after, duration=duration)
    for world, robot in (one, other):
        drive(world, robot, 4.0, 0.1, 0.1)
    assert readings(one[1]) == readings(other[1])


def test_more_sensors_change_nothing_of_the_others_and_a_reset_begins_their_noise_anew() -> None:
    few, many = carried(replace(EQUIPPED, imu=None, range_finder=None), seed=3), carried(EQUIPPED, seed=3)
    for world, robot in (few, many):
        drive(world, robot, 3.0, 0.2, 0.3)
    seen = readings(many[1])
    assert {name: seen[name] for name in ('battery', 'lidar')} == readings(few[1])
    assert few[1].pose == many[1].pose
    world, robot = many
    world.reset()
    assert all(one.time is None for one in robot.sensors)
    began = world.time
    drive(world, robot, 3.0, 0.2, 0.3)
    for name, reading in readings(robot).items():
        assert reading[0] == pytest.approx(began + seen[name][0])
        assert reading[1:] == seen[name][1:]


def test_a_snapshot_has_what_devices_hold_whoever_reads_them() -> None:
    world, robot = carried(EQUIPPED)
    world.add('cup', ObstacleModel(pose=Pose(0.4, 0.0, 0.0), shape=box(0.02, 0.02)))
    for device in robot.devices.values():
        device.is_read = False
    world.step()
    assert world.state('alpha').devices == {'battery': pytest.approx(1.0, abs=1e-4), 'bumper': False, 'gripper': ''}
    world.grip('alpha')
    assert world.state('alpha').devices['gripper'] == 'cup'


def test_a_fault_of_a_sensor_that_the_robot_lacks_is_refused() -> None:
    world = World()
    world.add('alpha', MODELS['waffle'], Pose(0.0, 0.0, 0.0))
    with pytest.raises(SimulationError, match="sensor_frozen: 'alpha' has no imu"):
        world.set_fault('alpha', 'sensor_frozen', {'sensor': 'imu'})
    with pytest.raises(SimulationError, match="'gps' is none of battery, lidar, range_finder, imu"):
        world.set_fault('alpha', 'sensor_frozen', {'sensor': 'gps'})
    with pytest.raises(SimulationError, match="'battery' is none of lidar, range_finder, imu"):
        world.set_fault('alpha', 'sensor_noisy', {'sensor': 'battery'})
