# SPDX-License-Identifier: BSD-3-Clause
"""The part of BasicNavigator that a program needs if nav2_simple_commander is not installed: it is not on PyPI.

Names, arguments and results match BasicNavigator (branch jazzy), so a program runs with either.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, Final

import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import FollowWaypoints, NavigateThroughPoses, NavigateToPose
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from flexbt_common import names

POLL_S: Final = 0.1
"""Maximum duration of one check of a task, s."""

ACTIVE: Final = 'active'


class TaskResult(Enum):
    """The result of a task, with the numbers of nav2_simple_commander."""

    UNKNOWN = 0
    SUCCEEDED = 1
    CANCELED = 2
    FAILED = 3


_RESULTS: Final = {
    GoalStatus.STATUS_SUCCEEDED: TaskResult.SUCCEEDED,
    GoalStatus.STATUS_CANCELED: TaskResult.CANCELED,
    GoalStatus.STATUS_ABORTED: TaskResult.FAILED,
}


class Navigator(Node):
    """A node that sends one task at a time, and spins while its program waits."""

    def __init__(self, node_name: str = 'basic_navigator', namespace: str = '') -> None:
        super().__init__(node_name=node_name, namespace=namespace)
        self._navigators: Any = {
            kind: ActionClient(self, kind, name)
            for kind, name in (
                (NavigateToPose, names.NAVIGATE_TO_POSE),
                (NavigateThroughPoses, names.NAVIGATE_THROUGH_POSES),
                (FollowWaypoints, names.FOLLOW_WAYPOINTS),
            )
        }
        self._initial_pose = self.create_publisher(PoseWithCovarianceStamped, names.INITIAL_POSE, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(PoseWithCovarianceStamped, names.AMCL_POSE, self._on_amcl_pose, latched)
        self._start: PoseStamped | None = None
        self._is_localized = False
        self._goal: Any = None
        self._result: Any = None
        self._feedback: Any = None

    def setInitialPose(self, initial_pose: PoseStamped) -> None:
        """Send the robot's initial pose to the localization."""
        self._is_localized = False
        self._start = initial_pose
        self._publish_start()

    def waitUntilNav2Active(self, navigator: str = 'bt_navigator', localizer: str = 'amcl') -> None:
        """Wait until both nodes are active and the pose of the robot is known."""
        self._wait_active(localizer)
        while not self._is_localized:
            self._publish_start()
            rclpy.spin_once(self, timeout_sec=1.0)
        self._wait_active(navigator)

    def goToPose(self, pose: PoseStamped, behavior_tree: str = '') -> bool:
        """Start to drive to a pose. Return whether the goal was accepted."""
        return self._begin(NavigateToPose.Goal(pose=pose, behavior_tree=behavior_tree))

    def goThroughPoses(self, poses: list[PoseStamped], behavior_tree: str = '') -> bool:
        """Start to drive through poses. Return whether the goal was accepted."""
        return self._begin(NavigateThroughPoses.Goal(poses=poses, behavior_tree=behavior_tree))

    def followWaypoints(self, poses: list[PoseStamped]) -> bool:
        """Start to drive from pose to pose. Return whether the goal was accepted."""
        return self._begin(FollowWaypoints.Goal(poses=poses))

    def cancelTask(self) -> None:
        """Cancel the task and wait for the response."""
        if self._goal is not None:
            rclpy.spin_until_future_complete(self, self._goal.cancel_goal_async())

    def isTaskComplete(self) -> bool:
        """Return whether the task has ended, after waiting up to 0.1 s for its end."""
        if self._result is None:
            return True
        rclpy.spin_until_future_complete(self, self._result, timeout_sec=POLL_S)
        return bool(self._result.done())

    def getFeedback(self) -> Any:
        """Return the latest feedback of the task; None before the first."""
        return self._feedback

    def getResult(self) -> TaskResult:
        """Return the result of the task."""
        if self._result is None or not self._result.done():
            return TaskResult.UNKNOWN
        return _RESULTS.get(self._result.result().status, TaskResult.UNKNOWN)

    def destroy_node(self) -> None:
        """Destroy the action clients and the node."""
        for client in self._navigators.values():
            client.destroy()
        super().destroy_node()

    def _begin(self, goal: Any) -> bool:
        client = next(client for kind, client in self._navigators.items() if isinstance(goal, kind.Goal))
        while not client.wait_for_server(timeout_sec=1.0):
            self.get_logger().info('waits for the navigator')
        self._feedback = None
        sent = client.send_goal_async(goal, self._on_feedback)
        rclpy.spin_until_future_complete(self, sent)
        self._goal = sent.result()
        self._result = self._goal.get_result_async() if self._goal.accepted else None
        return bool(self._goal.accepted)

    def _wait_active(self, node: str) -> None:
        client = self.create_client(GetState, f'{node}/get_state')
        while not client.wait_for_service(timeout_sec=1.0):
            self.get_logger().info(f'waits for {node}')
        state = ''
        while state != ACTIVE:
            asked = client.call_async(GetState.Request())
            rclpy.spin_until_future_complete(self, asked, timeout_sec=1.0)
            answer = asked.result() if asked.done() else None
            state = answer.current_state.label if answer is not None else ''
        self.destroy_client(client)

    def _publish_start(self) -> None:
        if self._start is not None:
            message = PoseWithCovarianceStamped(header=self._start.header)
            message.pose.pose = self._start.pose
            self._initial_pose.publish(message)

    def _on_amcl_pose(self, _message: PoseWithCovarianceStamped) -> None:
        self._is_localized = True

    def _on_feedback(self, message: Any) -> None:
        self._feedback = message.feedback
