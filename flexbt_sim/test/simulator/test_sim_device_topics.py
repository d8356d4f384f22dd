# SPDX-License-Identifier: BSD-3-Clause
"""The messages of the devices of a robot, as others receive them."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Imu, LaserScan, Range
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import seconds_of
from flexbt_sim.simulator.node import Simulator
from flexbt_sim.world import BatteryModel
from flexbt_testing.waiting import wait_until

WORLD = """\
robots:
  alpha:
    pose: [0, 0, 0]
    bumper: true
    battery: {level: 0.5}
    lidar: {beams: 4, noise: 0.0}
    range_finder: {radiation: infrared, noise: 0.0, pose: [0.2, 0.0, 0.0]}
    imu: {angular_bias: 0.25, angular_noise: 0.0, linear_noise: 0.5, pose: [0.0, 0.1, 0.0]}
obstacles: {wall: {pose: [2, 0, 0], shape: [0.1, 20]}}
"""
TOPICS = {
    names.SCAN: (LaserScan, qos_profile_sensor_data), names.RANGE: (Range, qos_profile_sensor_data),
    names.IMU: (Imu, qos_profile_sensor_data), names.BUMPER: (Bool, names.transient_local_qos()),
    names.BATTERY_STATE: (BatteryState, 10), names.BATTERY_STATUS: (BatteryState, 10),
    names.TF_STATIC: (TFMessage, names.transient_local_qos()),
}  # fmt: skip


@pytest.fixture
def heard(tmp_path: Path) -> Any:
    """Return the last message of each topic."""
    file = tmp_path / 'world.yaml'
    file.write_text(WORLD)
    heard: dict[str, Any] = {}
    with (
        NodeRuntime.open('simulator', parameters={'world': str(file), 'speed_factor': 5.0}) as runtime,
        NodeRuntime.open('observer') as other,
    ):
        simulator = Simulator(runtime)
        for topic, (message_type, qos) in TOPICS.items():
            other.call(
                lambda topic=topic, kind=message_type, qos=qos: other.node.create_subscription(  # type: ignore[misc]
                    kind, f'alpha/{topic}', lambda message: heard.__setitem__(topic, message), qos
                )
            )
        heard['simulator'] = simulator
        wait_until(lambda: heard.keys() >= TOPICS.keys(), 'messages of all devices')
        yield heard


def test_every_device_publishes_what_it_measures_and_how_it_is_described(heard: dict[str, Any]) -> None:
    scan, found, imu, battery = (heard[topic] for topic in ('scan', 'range', 'imu', 'battery_state'))
    assert scan.header.frame_id == 'base_scan'
    assert scan.ranges.tolist() == pytest.approx([1.95 + 0.064, math.inf, math.inf, math.inf])
    assert (found.header.frame_id, found.radiation_type) == ('range_finder_link', Range.INFRARED)
    assert (found.range, found.min_range, found.max_range) == pytest.approx((1.75, 0.02, 4.0))
    assert found.field_of_view == pytest.approx(0.26)
    assert imu.header.frame_id == 'imu_link'
    assert (imu.angular_velocity.z, imu.linear_acceleration.z) == pytest.approx((0.25, 9.80665))
    assert abs(imu.linear_acceleration.x) < 5.0
    assert imu.orientation_covariance[0] == -1.0
    assert imu.linear_acceleration_covariance.tolist() == [0.25, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.25]
    assert heard['bumper'].data is False
    model = BatteryModel()
    assert battery.percentage == pytest.approx(0.5, abs=0.01)
    assert battery.charge == pytest.approx(battery.percentage * battery.capacity)
    assert (battery.voltage, battery.current) == pytest.approx((model.voltage, -model.idle / model.voltage))
    assert battery.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    assert battery.power_supply_health == BatteryState.POWER_SUPPLY_HEALTH_GOOD
    assert battery.power_supply_technology == BatteryState.POWER_SUPPLY_TECHNOLOGY_LION
    assert battery.present and battery.header.stamp.sec >= 0
    fixed = {one.child_frame_id: one.transform.translation for one in heard['tf_static'].transforms}
    assert fixed.keys() == {'base_footprint', 'base_scan', 'range_finder_link', 'imu_link'}
    assert (fixed['range_finder_link'].x, fixed['imu_link'].y) == (0.2, 0.1)


def test_a_silent_sensor_is_not_heard_and_the_messages_of_others_go_on(heard: dict[str, Any]) -> None:
    simulator = heard['simulator']
    with simulator.lock:
        simulator.world.set_fault('alpha', 'sensor_silent', {'sensor': 'imu'})
        begins = simulator.world.time
    wait_until(lambda: heard['range'].header.stamp.sec > begins + 2.0, 'ranges after the fault')
    stamp = heard['imu'].header.stamp
    assert stamp.sec + stamp.nanosec * 1e-9 <= begins + 0.1


def test_which_messages_are_lost_depends_on_the_seed_of_the_file(tmp_path: Path) -> None:
    lossy = '{entity: alpha, fault: messages_dropped, duration: 5, parameters: {topic: pose, probability: 0.5}}'

    def heard(seed: int) -> list[float]:
        file = tmp_path / f'{seed}.yaml'
        file.write_text(f'seed: {seed}\nrobots: {{alpha: {{pose: [0, 0, 0], lidar: null}}}}\nfaults: [{lossy}]\n')
        stamps: list[float] = []
        with (
            NodeRuntime.open('simulator', parameters={'world': str(file)}) as runtime,
            NodeRuntime.open('observer') as other,
        ):
            simulator = Simulator(runtime)
            other.call(
                lambda: other.node.create_subscription(
                    PoseStamped, 'alpha/pose', lambda pose: stamps.append(seconds_of(pose.header.stamp)), 1000
                )
            )
            wait_until(lambda: stamps, 'a pose')
            simulator.pacer.pause()
            runtime.call(simulator.restart)
            stamps.clear()
            assert simulator.pacer.step(300, lambda left, is_over: None, 300)
            wait_until(lambda: stamps and stamps[-1] > 5.5, 'a pose after the fault')
        return [stamp for stamp in stamps if stamp < 5.0]

    one, other = heard(1), heard(2)
    assert min(len(one), len(other)) > 10
    assert one != other


def test_the_clock_is_no_slower_than_its_rate(tmp_path: Path) -> None:
    file = tmp_path / 'world.yaml'
    file.write_text('robots: {alpha: {pose: [0, 0, 0], lidar: null}}\n')
    ticks: list[float] = []
    with (
        NodeRuntime.open('observer') as other,
        NodeRuntime.open('simulator', parameters={'world': str(file), 'clock_rate': 30.0}) as runtime,
    ):
        other.call(
            lambda: other.node.create_subscription(
                Clock, names.CLOCK, lambda clock: ticks.append(seconds_of(clock.clock)), 1000
            )
        )
        Simulator(runtime)
        wait_until(lambda: len(ticks) > 10, 'messages of the clock')
    assert max(later - earlier for earlier, later in pairwise(ticks)) <= 1.0 / 30.0
