# SPDX-License-Identifier: BSD-3-Clause
"""The simulator's node: what it publishes, how time passes, and what it does with commands and places."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pytest
from action_msgs.msg import GoalStatus as GoalStatusMessage
from action_msgs.msg import GoalStatusArray
from nav2_msgs.action import ComputePathToPose
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data as LOSSY
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.transform_buffer import TransformBuffer
from flexbt_common.transform_listener import take_transforms
from flexbt_common.values.message_fields import seconds_of
from flexbt_sim.messages import map_of, pose_of
from flexbt_sim.simulator.node import Simulator
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import DriveModel, load_map
from flexbt_testing.nodes.sim_world import DOCK, OFFICE, RobotProbe, open_probe, open_simulator
from flexbt_testing.waiting import uncontended_time, wait_until

LIMITS = DriveModel()
RADIUS = 0.22
BRAKING = LIMITS.linear_speed / LIMITS.linear_acceleration


@pytest.fixture(scope='module')
def simulator() -> Iterator[RobotProbe]:
    with open_simulator(speed_factor=5.0, scan_noise=0.0) as probe:
        yield probe


def receive(probe: RobotProbe, message_type: Any, topic: str, count: int = 1, qos: Any = LOSSY) -> list[Any]:
    """Return the next messages of a topic."""
    messages: list[Any] = []
    node = probe.runtime.node
    subscription = probe.runtime.call(lambda: node.create_subscription(message_type, topic, messages.append, qos))
    probe.wait(lambda: len(messages) >= count, f'{count} messages of {topic}')
    probe.runtime.call(lambda: node.destroy_subscription(subscription))
    return messages


def test_the_map_is_there_for_whoever_comes_late(simulator: RobotProbe) -> None:
    (grid,) = receive(simulator, OccupancyGrid, names.MAP, qos=names.transient_local_qos())
    assert grid.header.frame_id == 'map'
    received, drawn = map_of(grid), load_map(built_in_map())
    assert (received.cells == drawn.cells).all()
    assert received.origin == drawn.origin
    assert received.resolution == pytest.approx(drawn.resolution)


def test_odometry_tells_pose_and_speed_at_its_rate(simulator: RobotProbe) -> None:
    simulator.place(DOCK)
    told: list[Odometry] = []

    def drive_on(odometry: Odometry) -> None:
        told.append(odometry)
        simulator.drive(0.2)

    def steady() -> list[Odometry]:
        """Ten in a row while which no command and none of them was late or lost."""
        for start in range(len(told) - 9):
            ten = told[start : start + 10]
            took = seconds_of(ten[-1].header.stamp) - seconds_of(ten[0].header.stamp)
            if took < 9 * 0.036 and all(one.twist.twist.linear.x == pytest.approx(0.2) for one in ten):
                return ten
        return []

    node = simulator.runtime.node
    subscription = simulator.runtime.call(lambda: node.create_subscription(Odometry, names.ODOM, drive_on, LOSSY))
    first, *_, last = simulator.wait(steady, 'a steady drive')
    simulator.runtime.call(lambda: node.destroy_subscription(subscription))
    assert (last.header.frame_id, last.child_frame_id) == ('odom', 'base_link')
    driven = pose_of(first.pose.pose).distance(pose_of(last.pose.pose))
    took = seconds_of(last.header.stamp) - seconds_of(first.header.stamp)
    assert driven / took == pytest.approx(0.2, rel=0.02)
    assert took / 9 == pytest.approx(0.03, rel=0.2)


def test_poses_and_clock_come_rarely_while_the_robot_is_at_rest_and_often_while_it_is_driven(
    simulator: RobotProbe,
) -> None:
    simulator.place(DOCK)
    ticks: list[float] = []
    node = simulator.runtime.node
    on_clock = simulator.runtime.call(
        lambda: node.create_subscription(Clock, names.CLOCK, lambda told: ticks.append(seconds_of(told.clock)), LOSSY)
    )
    simulator.wait(lambda: min(gaps(simulator)) > 0.08 and min(gaps_of(ticks), default=0.0) > 0.04, 'a robot at rest')
    assert min(gaps(simulator)) < 0.12

    def is_often() -> bool:
        simulator.drive(0.2)
        return any(gap < 0.04 for gap in gaps(simulator)) and any(gap < 0.04 for gap in gaps_of(ticks))

    simulator.wait(is_often, 'poses and clock of a drive')
    simulator.runtime.call(lambda: node.destroy_subscription(on_clock))


def gaps(probe: RobotProbe) -> list[float]:
    """Return the simulated time between the last six poses, s."""
    return gaps_of([sighting.time for sighting in probe.sightings])


def gaps_of(times: list[float]) -> list[float]:
    """From each of the last six to the next, s."""
    return [later - earlier for earlier, later in pairwise(times[-6:])]


def test_transforms_lead_from_the_map_to_the_lidar(simulator: RobotProbe) -> None:
    there = simulator.place(OFFICE)
    tf = receive(simulator, TFMessage, names.TF)[-1]
    tf_static = receive(simulator, TFMessage, names.TF_STATIC, qos=names.transient_local_qos())[0]
    moving, fixed = tf.transforms, tf_static.transforms
    frames = [(transform.header.frame_id, transform.child_frame_id) for transform in (*moving, *fixed)]
    assert frames == [
        ('map', 'odom'),
        ('odom', 'base_link'),
        ('base_link', 'base_footprint'),
        ('base_link', 'base_scan'),
    ]
    buffer = TransformBuffer()
    take_transforms(buffer, tf, is_static=False)
    take_transforms(buffer, tf_static, is_static=True)
    for frame in ('base_link', 'base_footprint', 'base_scan'):
        (x, y, _), (_, _, qz, qw) = buffer.lookup('map', frame)
        assert (x, y, 2.0 * math.atan2(qz, qw)) == pytest.approx(there[1:])
    assert all(one.header.stamp == moving[0].header.stamp for one in moving)
    assert seconds_of(moving[0].header.stamp) >= there.time


def test_transforms_are_in_the_namespace_of_the_robot() -> None:
    with NodeRuntime.open(names.SIMULATOR, namespace='/robot1') as runtime, open_probe() as probe:
        Simulator(runtime)
        for topic in (names.TF, names.TF_STATIC):
            assert receive(
                probe, TFMessage, f'/robot1/{topic}', qos=names.transient_local_qos() if 'static' in topic else LOSSY
            )


def test_scans_show_the_walls_of_the_map(simulator: RobotProbe) -> None:
    simulator.place(DOCK)
    scan = receive(simulator, LaserScan, names.SCAN)[-1]
    assert scan.header.frame_id == 'base_scan'
    assert len(scan.ranges) == 360 == round((scan.angle_max - scan.angle_min) / scan.angle_increment) + 1
    assert (scan.range_min, scan.range_max) == pytest.approx((0.12, 3.5))
    assert scan.ranges[0] == math.inf
    assert [scan.ranges[index] for index in (90, 180, 270)] == pytest.approx([0.95, 0.65, 0.9], abs=0.06)


def test_a_robot_without_commands_stops_by_itself(simulator: RobotProbe) -> None:
    simulator.place(DOCK)
    commanded = simulator.now.time
    simulator.drive(0.26)
    simulator.wait_driving(0.25)
    rest = simulator.wait_at_rest()
    assert rest.time - commanded < LIMITS.watchdog + BRAKING + 0.5  # the command took a moment to arrive
    moved = rest.distance(DOCK)
    assert moved == pytest.approx(LIMITS.linear_speed * LIMITS.watchdog, rel=0.2)


@pytest.mark.parametrize(('asked', 'speed'), [(100.0, LIMITS.linear_speed), (math.nan, 0.0)])
def test_commands_are_cut_to_what_the_robot_can_do(simulator: RobotProbe, asked: float, speed: float) -> None:
    start = simulator.place(DOCK)
    for _ in range(8):
        simulator.drive(asked)
        simulator.later(0.1)
    speeds = simulator.speeds([seen for seen in simulator.sightings if seen.time >= start.time])
    assert max(speeds) == pytest.approx(speed, abs=1e-3)


def test_a_wall_stops_the_robot(simulator: RobotProbe) -> None:
    simulator.place((0.6, 4.45, math.pi))
    for _ in range(20):
        simulator.drive(0.26)
        simulator.later(0.1)
    assert simulator.wait_at_rest().x == pytest.approx(0.15 + RADIUS, abs=0.03)


@pytest.mark.parametrize(
    'place',
    [(1.0, 3.45, 0.0), (1.0, 3.7, 0.0), (-5.0, 2.0, 0.0), (1e9, 1e9, 0.0), (math.nan, 1.0, 0.0), (2.0, 4.4, math.nan)],
)
def test_a_place_where_the_robot_does_not_fit_is_refused_and_the_world_goes_on(
    simulator: RobotProbe, place: tuple[float, float, float]
) -> None:
    there = simulator.place(DOCK)
    simulator.put(place)
    assert simulator.later(0.5)[1:] == there[1:]
    simulator.place(OFFICE)


def test_a_place_in_another_frame_is_refused(simulator: RobotProbe) -> None:
    there = simulator.place(DOCK)
    simulator.put(OFFICE, 'odom')
    assert simulator.later(0.5)[1:] == there[1:]


def test_a_reset_brings_the_driving_robot_back_to_rest_at_its_start(simulator: RobotProbe) -> None:
    simulator.place((5.0, 4.0, 0.0))
    before = simulator.now.time
    simulator.drive(0.26, 0.5)
    simulator.wait_driving()
    response = simulator.ask(Trigger, names.RESET, Trigger.Request())
    assert response.success
    rest = simulator.wait_at_rest()
    assert rest[1:] == pytest.approx(DOCK)
    assert rest.time > before  # time does not start again


def rate(probe: RobotProbe) -> float:
    """Return simulated seconds per second, over half a second."""
    times: list[tuple[float, float]] = []
    node = probe.runtime.node

    def on_clock(clock: Clock) -> None:
        times.append((time.monotonic(), seconds_of(clock.clock)))

    subscription = probe.runtime.call(lambda: node.create_subscription(Clock, names.CLOCK, on_clock, 10))
    probe.wait(lambda: times and times[-1][0] - times[0][0] > 0.5, 'the clock')
    probe.runtime.call(lambda: node.destroy_subscription(subscription))
    assert times == sorted(times)
    return (times[-1][1] - times[0][1]) / (times[-1][0] - times[0][0])


def test_time_passes_at_the_speed_factor_which_can_be_changed(simulator: RobotProbe) -> None:
    for factor in (1.0, 4.0):
        simulator.set_speed_factor(factor)
        rates = (rate(simulator) for _ in range(10))  # a busy machine may hold it up now and then
        assert any(measured == pytest.approx(factor, rel=0.2) for measured in rates)
    simulator.set_speed_factor(0.0)
    assert any(rate(simulator) > 5.0 for _ in range(10))
    simulator.set_speed_factor(5.0)


def wait_still(probe: RobotProbe, seconds: float) -> None:
    """Wait until no pose has come for so long, s of wall time."""
    last = [0.0, 0.0]

    def still() -> bool:
        if len(probe.sightings) != last[0]:
            last[:] = len(probe.sightings), time.monotonic()
        return time.monotonic() - last[1] > seconds

    probe.wait(still, 'a world that stands still')


def test_a_world_that_stands_nearly_still_goes_on_as_soon_as_it_is_told_to(simulator: RobotProbe) -> None:
    for slowest in (1e-3, 1e-300):
        try:
            simulator.set_speed_factor(slowest)
            wait_still(simulator, 0.5)
        finally:
            began = uncontended_time()
            simulator.set_speed_factor(5.0)
        simulator.later(0.2)
        assert uncontended_time() - began < 5.0


@pytest.mark.parametrize('factor', [-1.0, 2000.0, math.nan, math.inf])
def test_other_speed_factors_are_refused(simulator: RobotProbe, factor: float) -> None:
    change = Parameter('speed_factor', value=factor).to_parameter_msg()
    response = simulator.ask(SetParameters, 'simulator/set_parameters', SetParameters.Request(parameters=[change]))
    assert not response.results[0].successful
    assert 'speed_factor' in response.results[0].reason
    simulator.later(0.5)


def test_as_fast_as_possible_a_driver_keeps_up_all_the_same(simulator: RobotProbe) -> None:
    """A driver that answers each pose never finds that the watchdog has stopped its robot."""
    simulator.place(DOCK)
    simulator.set_speed_factor(0.0)
    simulator.drive(0.26)
    start = simulator.wait_driving(0.25)
    while simulator.now.time < start.time + 10.0:
        seen = len(simulator.sightings)
        simulator.drive(0.26)
        simulator.wait(lambda: len(simulator.sightings) > seen, 'the next pose')  # noqa: B023
    simulator.set_speed_factor(5.0)
    assert (
        min(simulator.speeds([seen for seen in simulator.sightings if start.time <= seen.time <= start.time + 10.0]))
        > 0.2
    )


def test_as_fast_as_possible_the_world_waits_for_whoever_computes_and_for_nobody_else(simulator: RobotProbe) -> None:
    """A plan that takes a second of wall time takes one of simulated time, or a little more, not fifty."""
    planning: list[ServedGoal] = []
    runtime = simulator.runtime
    server = runtime.call(lambda: GoalServer(runtime, ComputePathToPose, names.COMPUTE_PATH_TO_POSE, planning.append))
    try:
        simulator.set_speed_factor(0.0)
        goal = simulator.plan(OFFICE)
        simulator.wait(lambda: planning, 'the goal')
        wait_until(lambda: rate(simulator) < 2.0, 'a world that waits')
        assert max(rate(simulator) for _ in range(3)) < 2.0
        runtime.call(lambda: planning[0].succeed(ComputePathToPose.Result()))
        assert goal.wait().status is GoalStatus.SUCCEEDED
        wait_until(lambda: rate(simulator) > 10.0, 'a world that waits for nobody')
    finally:
        simulator.set_speed_factor(5.0)
        runtime.call(server.close)


def test_as_fast_as_possible_the_world_does_not_wait_for_a_server_that_has_died(simulator: RobotProbe) -> None:
    node = simulator.runtime.node
    status = f'{names.COMPUTE_PATH_TO_POSE}/_action/status'
    publisher = simulator.runtime.call(
        lambda: node.create_publisher(GoalStatusArray, status, names.transient_local_qos())
    )
    try:
        simulator.set_speed_factor(0.0)
        publisher.publish(GoalStatusArray(status_list=[GoalStatusMessage(status=GoalStatusMessage.STATUS_EXECUTING)]))
        wait_until(lambda: rate(simulator) < 2.0, 'a world that waits')
        simulator.runtime.call(lambda: node.destroy_publisher(publisher))
        wait_until(lambda: rate(simulator) > 10.0, 'a world that waits for nobody')
    finally:
        simulator.set_speed_factor(5.0)
