# SPDX-License-Identifier: BSD-3-Clause
"""The pose of the robot: from a topic of any of three types, from transforms, or from odometry alone."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_onboard.link import robot_state
from flexbt_onboard.link.robot_state import RobotPose
from flexbt_testing.waiting import wait_until


class Robot:
    """A robot that publishes poses, and what an executive knows of them."""

    def __init__(self, runtime: NodeRuntime, executive: NodeRuntime) -> None:
        self.runtime = runtime
        self.executive = executive
        self.pose: Any = executive.call(lambda: RobotPose(executive, 'pose'))

    def publisher(self, message: type[Any], topic: str) -> Any:
        return self.runtime.call(lambda: self.runtime.node.create_publisher(message, topic, 1))

    def x(self) -> float:
        found: PoseStamped = self.executive.call(self.pose.latest)
        return float(found.pose.position.x) if found.header.frame_id else -1.0

    def problem(self) -> str:
        return str(self.executive.call(self.pose.problem))


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    monkeypatch.setattr(robot_state, 'SETTLE_SECONDS', 0.0)
    with NodeRuntime.open('localization') as runtime, NodeRuntime.open('executive') as executive:
        yield Robot(runtime, executive)


def posed(message: Any, x: float, frame: str = 'map') -> Any:
    message.header.frame_id = frame
    (message.pose if isinstance(message, PoseStamped) else message.pose.pose).position.x = x
    return message


@pytest.mark.parametrize('message', [PoseStamped, PoseWithCovarianceStamped, Odometry])
def test_the_topic_of_the_pose_may_have_any_of_the_types(robot: Robot, message: type[Any]) -> None:
    publisher = robot.publisher(message, 'pose')
    assert robot.x() == -1.0

    def heard() -> bool:
        publisher.publish(posed(message(), 3.0))
        return robot.x() == 3.0

    wait_until(heard, 'the pose')
    assert robot.problem() == ''


def test_the_localization_serves_where_there_is_no_such_topic(robot: Robot) -> None:
    publisher = robot.publisher(PoseWithCovarianceStamped, 'amcl_pose')

    def heard() -> bool:
        publisher.publish(posed(PoseWithCovarianceStamped(), 4.0))
        return robot.x() == 4.0

    wait_until(heard, 'the pose')
    assert robot.problem() == ''


def test_a_localization_that_is_silent_while_the_robot_stands_is_heard(robot: Robot) -> None:
    latched = names.transient_local_qos()
    node = robot.runtime.node
    publisher = robot.runtime.call(lambda: node.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', latched))
    publisher.publish(posed(PoseWithCovarianceStamped(), 4.0))  # once, before anybody listens
    wait_until(lambda: robot.x() == 4.0, 'the pose')


def test_transforms_serve_before_the_localization_and_not_when_they_are_old(robot: Robot) -> None:
    transforms, odometry = robot.publisher(TFMessage, 'tf'), robot.publisher(Odometry, 'odom')

    def send(x: float, age: float = 0.0) -> None:
        transform = TransformStamped()
        transform.header.frame_id, transform.child_frame_id = 'map', 'base_link'
        moment = time.time() - age
        transform.header.stamp.sec, transform.header.stamp.nanosec = int(moment), int(moment % 1 * 1e9)
        transform.transform.translation.x, transform.transform.rotation.w = x, 1.0
        transforms.publish(TFMessage(transforms=[transform]))
        odometry.publish(posed(Odometry(), 7.0, 'odom'))

    def heard(x: float, age: float) -> bool:
        send(5.0, age)
        return robot.x() == x

    wait_until(lambda: heard(7.0, 60.0), 'the odometry, since the transform is old')
    wait_until(lambda: heard(5.0, 0.0), 'the transform')
    assert robot.problem() == ''


def test_odometry_alone_is_enough_to_see_that_the_robot_moves(robot: Robot) -> None:
    publisher = robot.publisher(Odometry, 'odom')
    for x in (1.0, 2.0):

        def heard(x: float = x) -> bool:
            publisher.publish(posed(Odometry(), x, 'odom'))
            return robot.x() == x

        wait_until(heard, f'x = {x}')


def test_nothing_at_all(robot: Robot) -> None:
    assert (robot.x(), robot.problem()) == (-1.0, 'nobody publishes /pose')
