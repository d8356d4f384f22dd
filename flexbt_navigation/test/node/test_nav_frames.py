# SPDX-License-Identifier: BSD-3-Clause
"""Requests in other frames than the map's, for a robot whose odometry drifts, on one launched world."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import pytest
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import ComputePathToPose, FollowPath
from nav2_msgs.srv import ClearCostmapAroundPose, IsPathValid
from nav_msgs.msg import Path
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.transform_listener import TransformListener, transformed
from flexbt_common.values.message_fields import duration_message, time_message
from flexbt_msgs.srv import SetFault
from flexbt_sim.messages import pose_of, transform
from flexbt_sim.world import Pose
from flexbt_testing.nodes.sim_world import FAST, RobotProbe, aborted, line, open_sim_world, pose
from flexbt_testing.waiting import DEADLINE, wait_until

WORLD = """
plan:
  rooms: [{from: [0, 0], to: [14, 8]}]
models:
  drifting: {based_on: burger, odometry: {drift: 0.08}}
robots:
  turtle: {model: drifting, pose: [2, 2, 0]}
"""
HERE = (2.0, 4.0, 0.0)
THERE = (10.0, 5.0, 1.5)


@pytest.fixture(scope='module')
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RobotProbe]:
    file = tmp_path_factory.mktemp('worlds') / 'hall.yaml'
    file.write_text(WORLD)
    simulator = FAST | {'world': str(file), 'robot_namespaces': False, 'initialpose_moves_robot': True}
    # An unknown frame has to be waited for until a test tells it, also on a slow machine.
    with open_sim_world(simulator, {'transform_tolerance': 10.0}) as probe:
        probe.runtime.call(lambda: TransformListener.of(probe.runtime))
        yield probe


@pytest.fixture(autouse=True)
def slow(world: RobotProbe) -> None:
    """As fast as the robot's driver answers only while it drives: transforms are kept for 10 s of simulated time."""
    world.set_speed_factor(1.0)


def in_frame(world: RobotProbe, frame: str, place: Sequence[float]) -> PoseStamped:
    """Return a place of the map as a pose in another frame, by the newest transform."""
    listener, now = TransformListener.of(world.runtime), world.now.time

    def is_known() -> bool:
        buffer = listener.buffer
        return frame in buffer.frames and buffer.latest('map', frame) >= now

    wait_until(lambda: world.runtime.call(is_known))
    stamped = pose(place)
    stamped.pose = transformed(stamped.pose, world.runtime.call(lambda: listener.buffer.lookup(frame, 'map')))
    stamped.header.frame_id = frame
    return stamped


def path_in(world: RobotProbe, frame: str, start: Sequence[float], end: Sequence[float]) -> Path:
    x, y, _ = pose_of(in_frame(world, frame, start).pose)
    to_x, to_y, _ = pose_of(in_frame(world, frame, end).pose)
    return line((x, y), (to_x, to_y), frame)


def last(path: Path) -> Pose:
    return pose_of(path.poses[-1].pose)


@pytest.mark.parametrize('frame', ['odom', 'base_link', 'base_scan'])
def test_a_path_is_planned_to_a_goal_and_from_a_start_in_any_frame(world: RobotProbe, frame: str) -> None:
    world.place(HERE)
    goal = in_frame(world, frame, THERE)
    start = in_frame(world, frame, (3.0, 6.0))
    planned = world.send(names.COMPUTE_PATH_TO_POSE, goal=goal, start=start, use_start=True)
    assert planned.wait().status is GoalStatus.SUCCEEDED, planned.result.error_msg
    path = planned.result.path
    assert {path.header.frame_id, *(one.header.frame_id for one in path.poses)} == {'map'}
    assert pose_of(path.poses[0].pose)[:2] == pytest.approx((3.0, 6.0), abs=0.06)
    assert last(path) == pytest.approx(THERE, abs=0.06)
    through = world.send(names.COMPUTE_PATH_THROUGH_POSES, goals=[pose((5.0, 5.0)), goal])
    assert through.wait().status is GoalStatus.SUCCEEDED, through.result.error_msg
    assert last(through.result.path) == pytest.approx(THERE, abs=0.06)


def test_a_stamp_means_the_transform_at_that_time(world: RobotProbe) -> None:
    world.place(HERE)
    goal = pose((1.0, 0.0), 'base_link')
    assert world.send(names.COMPUTE_PATH_TO_POSE, goal=goal).wait().status is GoalStatus.SUCCEEDED  # tf is heard
    before = world.later(0.5)
    goal.header.stamp = time_message(before.time)
    world.later(0.2)
    world.place(THERE)
    planned = world.send(names.COMPUTE_PATH_TO_POSE, goal=goal)
    assert planned.wait().status is GoalStatus.SUCCEEDED, planned.result.error_msg
    assert last(planned.result.path)[:2] == pytest.approx((3.0, 4.0), abs=0.06)
    goal.header.stamp = time_message(0.001)
    said = aborted(world.send(names.COMPUTE_PATH_TO_POSE, goal=goal), ComputePathToPose.Result.TF_ERROR).error_msg
    assert all(part in said for part in ("'base_link'", 's ago', 'past', "'map'", 'tf')), said


def test_paths_in_other_frames_are_smoothed_and_judged(world: RobotProbe) -> None:
    world.place(HERE)
    smoothed = world.send(
        names.SMOOTH_PATH,
        path=path_in(world, 'odom', HERE, (8.0, 5.0)),
        max_smoothing_duration=duration_message(10.0),
        check_for_collisions=True,
    )
    assert smoothed.wait().status is GoalStatus.SUCCEEDED, smoothed.result.error_msg
    path = smoothed.result.path
    assert {path.header.frame_id, *(one.header.frame_id for one in path.poses)} == {'map'}
    assert last(path)[:2] == pytest.approx((8.0, 5.0), abs=0.01)
    for end, is_valid in (((6.0, 4.0), True), ((2.0, 7.95), False)):
        request = IsPathValid.Request(path=path_in(world, 'base_link', HERE, end))
        assert world.ask(IsPathValid, names.IS_PATH_VALID, request).is_valid is is_valid
    for costmap in names.COSTMAPS:
        request = ClearCostmapAroundPose.Request(pose=pose((1.0, 0.0), 'base_link'), reset_distance=1.0)
        world.ask(ClearCostmapAroundPose, names.costmap_services(costmap)[2], request)


def test_a_path_in_odom_is_followed_as_odom_drifts(world: RobotProbe) -> None:
    world.place(HERE)
    path = path_in(world, 'odom', HERE, (8.0, 4.0))
    goal = world.follow(path)
    world.wait_driving()
    world.set_speed_factor(0.0)
    assert goal.wait().status is GoalStatus.SUCCEEDED, goal.result.error_msg
    rest = world.wait_at_rest()
    there = pose_of(in_frame(world, 'odom', rest[1:]).pose)
    assert there.distance(last(path)) < 0.15  # where the path ends by the odometry
    assert rest.distance((8.0, 4.0)) > 0.5  # not where that was at the beginning


def test_a_path_in_the_frame_of_the_robot_is_meant_from_where_it_is(world: RobotProbe) -> None:
    world.place(HERE)
    goal = world.follow(line((0.0, 0.0), (2.0, 0.0), 'base_link'))
    world.wait_driving()
    world.set_speed_factor(0.0)
    assert goal.wait().status is GoalStatus.SUCCEEDED, goal.result.error_msg
    assert world.wait_at_rest().distance((4.0, 4.0)) < 0.15


def test_a_path_whose_frame_is_not_told_any_more_is_left(world: RobotProbe) -> None:
    world.place(HERE)
    fault = SetFault.Request(fault='messages_dropped', parameters='topic: tf')
    goal = world.follow(path_in(world, 'odom', HERE, (12.0, 4.0)))
    world.wait_driving()
    assert world.ask(SetFault, 'simulator/set_fault', fault).success
    try:
        said = aborted(goal, FollowPath.Result.TF_ERROR).error_msg
    finally:
        fault.clear = True
        assert world.ask(SetFault, 'simulator/set_fault', fault).success
    assert "'odom'" in said and 'tf' in said


def test_a_path_that_waits_for_its_frame_does_not_take_the_robot_from_a_newer_one(world: RobotProbe) -> None:
    world.place(HERE)
    waiting = world.follow(line((0.0, 0.0), (3.0, 0.0), 'shelf'))
    assert waiting.accepted.wait(DEADLINE)
    newer = world.follow(line(HERE, (12.0, 4.0)))
    world.wait_driving()
    node = world.runtime.node
    tell = world.runtime.call(lambda: node.create_publisher(TFMessage, names.TF_STATIC, names.transient_local_qos()))
    tell.publish(TFMessage(transforms=[transform('map', 'shelf', Pose(2.0, 6.0, 0.0), time_message(0.0))]))
    assert 'newer' in aborted(waiting, FollowPath.Result.NONE).error_msg
    assert not newer.ended
    newer.cancel()
    assert newer.wait().status is GoalStatus.CANCELED
    world.runtime.call(lambda: node.destroy_publisher(tell))
