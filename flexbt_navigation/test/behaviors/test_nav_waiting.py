# SPDX-License-Identifier: BSD-3-Clause
"""wait: in the time of the simulation, any number at a time, beside everything else."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Iterator
from unittest.mock import Mock

import numpy
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.calls.goal_server import ServedGoal
from flexbt_common.middleware.received_messages import Received, reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import duration_message, seconds_of, time_message
from flexbt_navigation import robot_interface
from flexbt_navigation.common.requests import follow
from flexbt_navigation.costmaps import server
from flexbt_navigation.costmaps.server import CostmapServer
from flexbt_navigation.parameters import declare_navigation_parameters
from flexbt_navigation.robot_interface import RobotInterface
from flexbt_sim.messages import transform
from flexbt_sim.world import OccupancyMap, Pose
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, line, open_sim_world, pose, without_faults
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until


@pytest.fixture(scope='module')
def world() -> Iterator[RobotProbe]:
    with open_sim_world({'speed_factor': 10.0}) as probe:
        yield probe


def robot_of(runtime: NodeRuntime) -> RobotInterface:
    """Return what navigation servers on a node would have of the robot."""

    def make() -> RobotInterface:
        parameters = declare_navigation_parameters(runtime.node)
        return RobotInterface(runtime, parameters.robot, parameters.costmaps)

    return runtime.call(make)


def wait(world: RobotProbe, seconds: float) -> SentGoal:
    """Wait, s."""
    return world.send(names.WAIT, time=duration_message(seconds))


def test_it_takes_the_time_asked_for_on_the_simulated_clock(world: RobotProbe) -> None:
    began = world.now.time
    goals = {seconds: wait(world, seconds) for seconds in (2.0, 0.7, 1.0)}
    for seconds, goal in goals.items():
        assert goal.wait().status is GoalStatus.SUCCEEDED
        assert seconds <= seconds_of(goal.result.total_elapsed_time) < world.now.time - began + 1.0
    told = [seconds_of(message.time_left) for message in goals[2.0].feedback]
    assert 0.0 < told[0] <= 2.0
    assert told == sorted(told, reverse=True)
    assert len(told) >= 2


@pytest.mark.parametrize('duration', [Duration(), Duration(sec=-5)])
def test_no_time_is_over_at_once(world: RobotProbe, duration: Duration) -> None:
    began = world.now.time
    goal = world.send(names.WAIT, time=duration)
    assert goal.wait().status is GoalStatus.SUCCEEDED
    assert seconds_of(goal.result.total_elapsed_time) < world.now.time - began + 1.0


def test_one_of_several_is_canceled_the_others_wait_on(world: RobotProbe) -> None:
    long, short = wait(world, 1000.0), wait(world, 1.0)
    long.cancel()
    assert long.wait().status is GoalStatus.CANCELED
    assert short.wait().status is GoalStatus.SUCCEEDED


def test_the_robot_drives_meanwhile(world: RobotProbe) -> None:
    world.place(DOCK)
    path, pause = world.follow(line(DOCK, (1.8, 4.45))), wait(world, 3.0)
    assert path.wait().status is GoalStatus.SUCCEEDED
    assert pause.wait().status is GoalStatus.SUCCEEDED


@pytest.mark.skipif(not reports_writers(), reason='the stock executor takes whatever comes')
def test_poses_of_a_robot_at_rest_are_heard_when_somebody_asks(
    world: RobotProbe, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[float] = []
    tell = RobotInterface._tell_waiting

    def counted(robot: RobotInterface) -> None:
        heard.append(world.sightings[-1].time)
        tell(robot)

    monkeypatch.setattr(RobotInterface, '_tell_waiting', counted)
    world.place(DOCK)
    world.later(1.0)
    seen, before = len(world.sightings), len(heard)
    world.later(10.0)
    assert len(heard) - before < (len(world.sightings) - seen) / 3
    before, began = len(heard), uncontended_time()
    goal = wait(world, 1000.0)
    world.wait(lambda: len(heard) > before + 20, 'poses')
    assert uncontended_time() - began < 10.0, 'more than one a second'
    goal.cancel()
    assert goal.wait().status is GoalStatus.CANCELED


def test_who_has_nothing_to_do_sees_that_somebody_else_drives_the_robot() -> None:
    heard, places = list[Pose](), itertools.count(1)
    with (
        without_faults('robot_interface', parameters={'pose_topic': 'driven'}) as runtime,
        NodeRuntime.open('driver') as driver,
    ):
        robot = robot_of(runtime)
        robot.on_pose.append(lambda where, _time: heard.append(where))
        poses = driver.call(lambda: driver.node.create_publisher(PoseStamped, 'driven', 1))

        def is_seen_at_rest() -> bool:
            poses.publish(pose((0.0, 0.0)))
            return len(heard) > 1

        def is_seen_moving() -> bool:
            poses.publish(pose((next(places), 0.0)))
            return runtime.call(robot._demand._look)

        wait_until(is_seen_at_rest, 'the robot at rest')
        assert not runtime.call(robot._demand._look)
        wait_until(is_seen_moving, 'the robot that is driven')


def test_a_pose_is_as_old_as_its_sending_and_no_older_than_the_one_before() -> None:
    with without_faults('robot_interface', parameters={'pose_topic': 'nobodys_pose'}) as runtime:
        robot = robot_of(runtime)
        data = serialize_message(pose(DOCK))

        def receive(age: float) -> tuple[float, float]:
            """Return the silence after a pose, and before it, when its stamp says that it was sent so many seconds
            ago."""
            before = robot.silence
            robot._receive_pose(Received(data, len(data), b'', time.time() - age))
            return robot.silence, before

        assert runtime.call(lambda: receive(0.8))[0] >= 0.8 - 1e-6  # a wall time in s has no more digits
        assert runtime.call(lambda: receive(-100.0))[0] == 0.0
        silence, before = runtime.call(lambda: receive(100.0))  # the sender's clock is behind
        assert silence <= before
        # While poses are waited for, one that comes late is no silence: this node was held up.
        robot._demand.reasons.append(lambda: True)
        robot._demand._look()
        assert runtime.call(lambda: receive(0.8))[0] <= 0.0


def test_a_scan_waits_for_the_frame_of_its_lidar_and_one_that_never_comes_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[str] = []
    monkeypatch.setattr(CostmapServer, '_complain', lambda _, error: told.append(str(error)))
    with without_faults('robot_interface', namespace='/alone') as runtime:
        costmaps = robot_of(runtime).costmaps
        scan = LaserScan(ranges=[1.0], range_max=3.5)
        scan.header.frame_id = 'base_scan'

        def see(seconds: float) -> bool:
            """Return whether there is an obstacle after a scan and a pose of that time."""
            scan.header.stamp = time_message(seconds)
            data = serialize_message(scan)
            costmaps._receive_scan(Received(data, len(data), b'', time.time()))
            costmaps.add_pose(seconds, Pose(1.0, 1.0, 0.0))
            return bool(costmaps.local.obstacles.any())

        runtime.call(
            lambda: costmaps.set_map(OccupancyMap(numpy.zeros((60, 60), numpy.int8), 0.05, Pose(0.0, 0.0, 0.0)))
        )
        assert not runtime.call(lambda: see(1.0))
        assert told == []
        monkeypatch.setattr(server, 'LIDAR_FRAME_SECONDS', 0.0)
        assert not runtime.call(lambda: see(2.0))
        assert len(told) == 1 and "'base_scan' is not known" in told[0]
        monkeypatch.setattr(server, 'LIDAR_FRAME_SECONDS', 1000.0)
        assert not runtime.call(lambda: see(3.0))
        mounted = transform('base_link', 'base_scan', Pose(0.0, 0.0, 0.0), time_message(0.0))
        runtime.call(lambda: costmaps._receive_frames(TFMessage(transforms=[mounted])))
        assert runtime.call(lambda: costmaps.local.obstacles.any())
        assert len(told) == 1


def test_scans_of_a_robot_that_drives_far_between_two_poses_count_but_not_those_before_it_was_put_elsewhere() -> None:
    with without_faults('robot_interface', namespace='/alone') as runtime:
        costmaps = robot_of(runtime).costmaps

        def marks(seconds: float, x: float) -> int:
            """Return how many obstacles there are after a scan and, 0.1 s later, a pose."""
            scan = LaserScan(ranges=[1.0], range_max=3.5)
            scan.header.stamp, scan.header.frame_id = time_message(seconds - 0.1), 'base_link'
            data = serialize_message(scan)
            costmaps._receive_scan(Received(data, len(data), b'', time.time()))
            costmaps.add_pose(seconds, Pose(x, 5.0, math.pi / 2.0))
            return int(costmaps.shared.obstacles.sum())

        def drive() -> list[int]:
            costmaps.set_map(OccupancyMap(numpy.zeros((200, 600), numpy.int8), 0.05, Pose(0.0, 0.0, 0.0)))
            places = itertools.accumulate([0.0, 0.4, 0.8, 1.0, 1.0, 1.0, 1.0, 15.0, 3.0, 0.0, 0.4])
            return [marks(1.0 + number, 1.0 + place) for number, place in enumerate(places)]

        assert runtime.call(drive) == [0, 1, 2, 3, 4, 5, 6, 6, 6, 7, 8]


def test_a_robot_that_is_back_is_waited_for_no_longer_than_before_it_was_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_interface, 'RETURN_SECONDS', 1000.0)
    parameters = {'pose_topic': 'nobodys_pose', 'map_topic': 'nobodys_map', 'pose_timeout': 0.1}
    with without_faults('robot_interface', parameters=parameters) as runtime:
        robot = robot_of(runtime)
        data = serialize_message(pose(DOCK))
        went_on = threading.Event()

        async def go_on() -> None:
            await robot.known(Mock(spec=ServedGoal, cancel_requested=False))  # there is no map
            went_on.set()

        def come_and_go() -> None:
            robot.forget_pose()
            robot._receive_pose(Received(data, len(data), b'', time.time()))
            follow(go_on())

        runtime.call(come_and_go)
        assert went_on.wait(DEADLINE)
