# SPDX-License-Identifier: BSD-3-Clause
"""Subscriptions that fill the track of the robot from what the simulator and the planner publish."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import PoseStamped, Quaternion
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime, Received, ReceivedMessages
from flexbt_common.values import MESSAGE, seconds_of
from flexbt_msgs.msg import TreeStatus, TreeStructure
from flexbt_sim.world import OccupancyMap
from flexbt_sim.world import Pose as Origin

from .robot_track import Pose, RobotTrack

EACH = 1000
"""Messages that may wait where each counts: poses, for the driven path, and what trees do."""

POSE_BYTES = 2_000


def subscribe_to_robot(runtime: NodeRuntime, track: RobotTrack) -> None:
    """Subscribe to map, true pose, plans, and what trees do, for as long as the node lives.

    Not to the odometry: while somebody listens to that, the simulator publishes as often as in a drive.
    """

    def on_map(message: OccupancyGrid) -> None:
        info = message.info
        cells = np.asarray(message.data, dtype=np.int8).reshape(info.height, info.width)
        origin = info.origin.position
        track.set_map(OccupancyMap(cells, info.resolution, Origin(origin.x, origin.y, yaw_of(info.origin.orientation))))

    def on_pose(received: Received) -> None:
        message: PoseStamped = received.unpack(PoseStamped)
        position = message.pose.position
        track.add_pose(Pose(position.x, position.y, yaw_of(message.pose.orientation)), seconds_of(message.header.stamp))

    def on_plan(message: Path) -> None:
        track.add_plan([(pose.pose.position.x, pose.pose.position.y) for pose in message.poses])

    def on_structure(received: Received) -> None:
        message: TreeStructure = received.unpack(TreeStructure)
        track.add_tree(f'{message.run_id}/{message.number}', {node.uid: node.name for node in message.nodes})

    def on_tree_status(received: Received) -> None:
        message: TreeStatus = received.unpack(TreeStatus)
        begun = [change.uid for change in message.changes if change.status == TreeStatus.RUNNING]
        track.add_begun(f'{message.run_id}/{message.structure}', begun)

    def subscribe() -> None:
        node = runtime.node
        node.create_subscription(OccupancyGrid, names.MAP, on_map, names.latched())
        node.create_subscription(Path, names.PLAN, on_plan, 10)
        # All that have come are taken at once: one in a turn of the executor would be seconds late on a busy computer.
        ReceivedMessages(node, PoseStamped, names.POSE, QoSProfile(depth=EACH), on_pose, POSE_BYTES)
        ReceivedMessages(node, TreeStructure, names.TREE_STRUCTURE, names.latched(EACH), on_structure, MESSAGE)
        ReceivedMessages(node, TreeStatus, names.TREE_STATUS, names.latched(EACH), on_tree_status, MESSAGE)

    runtime.call(subscribe)


def yaw_of(orientation: Quaternion) -> float:
    """The heading of an upright robot, in radians."""
    return 2.0 * math.atan2(orientation.z, orientation.w)


def pose_message(pose: Pose, frame: str = 'map') -> PoseStamped:
    """A pose as message, with a zero stamp."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x = pose.x
    message.pose.position.y = pose.y
    message.pose.orientation.z = math.sin(pose.yaw / 2.0)
    message.pose.orientation.w = math.cos(pose.yaw / 2.0)
    return message
