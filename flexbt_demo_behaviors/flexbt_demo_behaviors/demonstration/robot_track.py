# SPDX-License-Identifier: BSD-3-Clause
"""The track of a robot during a demonstration: poses, speed and plans, and the subscriptions that fill it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseStamped, Quaternion
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import MESSAGE
from flexbt_common.values.message_fields import seconds_of
from flexbt_msgs.msg import TreeStatus, TreeStructure
from flexbt_sim.world import OccupancyMap
from flexbt_sim.world import Pose as Origin

Point = tuple[float, float]

# A new point of the driven path is kept when the robot has moved this far, in metres.
POINT_DISTANCE = 0.02

# Slower than this the robot is at rest: m/s and rad/s.
REST_SPEED = 0.005
REST_TURN = 0.01


@dataclass(frozen=True)
class TrackPose:
    """A pose in the map frame: metres, metres, radians."""

    x: float
    y: float
    yaw: float

    def distance(self, other: TrackPose) -> float:
        """Straight-line distance between the positions, in metres."""
        return math.hypot(self.x - other.x, self.y - other.y)

    def __str__(self) -> str:
        """Return the pose for a person, with the heading in degrees."""
        return f'({self.x:.2f}, {self.y:.2f}, {math.degrees(self.yaw):.0f}°)'


class RobotTrack:
    """The robot's track. Written by the subscriptions, read by the scripted operator, each on its own thread.

    `on_change` is called after every change, on the writer's thread.
    """

    def __init__(self, on_change: Callable[[], None] = lambda: None) -> None:
        self.on_change = on_change
        self._lock = threading.Lock()
        self._map: OccupancyMap | None = None
        self._pose: TrackPose | None = None
        self._time = 0.0
        self._moving = False
        self._way: list[tuple[float, TrackPose]] = []
        self._length = 0.0
        self._plans: list[list[Point]] = []
        self._nodes: dict[str, Mapping[int, str]] = {}
        self._begun: set[tuple[str, int]] = set()

    def restart(self) -> None:
        """Forget the driven path, the plans and what trees have done; the track begins where the robot is."""
        with self._lock:
            self._way = [(self._time, self._pose)] if self._pose else []
            self._length = 0.0
            self._plans = []
            self._begun.clear()

    def set_map(self, grid: OccupancyMap) -> None:
        """Take the map."""
        with self._lock:
            self._map = grid
        self.on_change()

    def add_pose(self, pose: TrackPose, time: float) -> None:
        """Take the true pose of the robot at a simulated time, in seconds."""
        with self._lock:
            before, passed = self._pose, time - self._time
            if before is not None and passed > 0.0:
                turned = math.remainder(pose.yaw - before.yaw, math.tau)
                self._moving = before.distance(pose) > REST_SPEED * passed or abs(turned) > REST_TURN * passed
            self._pose = pose
            self._time = time
            last = self._way[-1][1] if self._way else None
            step = last.distance(pose) if last else 0.0
            if last is None or step >= POINT_DISTANCE:
                self._way.append((time, pose))
                self._length += step
        self.on_change()

    def add_plan(self, points: list[Point]) -> None:
        """Take a planned path. A plan to the same end as the last one is a replan on the way and is not kept."""
        if len(points) < 2:
            return
        with self._lock:
            if not self._plans or math.dist(self._plans[-1][-1], points[-1]) > POINT_DISTANCE:
                self._plans.append(points)
        self.on_change()

    def add_tree(self, run: str, nodes: Mapping[int, str]) -> None:
        """Take the names of the nodes, by their uids, of a tree that begins, or that has others now."""
        with self._lock:
            self._nodes[run] = nodes
        self.on_change()

    def add_begun(self, run: str, nodes: Iterable[int]) -> None:
        """Take the uids of nodes of a tree that have begun to run; its structure may come later."""
        with self._lock:
            self._begun.update((run, node) for node in nodes)
        self.on_change()

    def has_begun(self, name: str) -> bool:
        """Return whether a node of this name has begun to run in any tree."""
        with self._lock:
            return any(self._nodes.get(run, {}).get(node) == name for run, node in self._begun)

    @property
    def map(self) -> OccupancyMap | None:
        """The map, once it has come."""
        with self._lock:
            return self._map

    @property
    def pose(self) -> TrackPose | None:
        """The newest pose, once one has come."""
        with self._lock:
            return self._pose

    @property
    def ready(self) -> bool:
        """True if a map and a pose were received."""
        with self._lock:
            return self._map is not None and self._pose is not None

    @property
    def time(self) -> float:
        """Simulated time of the newest pose, in seconds."""
        with self._lock:
            return self._time

    @property
    def at_rest(self) -> bool:
        """True if the robot is at rest."""
        with self._lock:
            return not self._moving

    @property
    def way(self) -> list[tuple[float, TrackPose]]:
        """Places of the robot, with simulated times in seconds."""
        with self._lock:
            return list(self._way)

    @property
    def began(self) -> float:
        """Simulated time at which the track began, in seconds."""
        with self._lock:
            return self._way[0][0] if self._way else 0.0

    @property
    def driven(self) -> list[Point]:
        """The driven path."""
        return [(pose.x, pose.y) for _, pose in self.way]

    @property
    def length(self) -> float:
        """Length of the driven path, in metres."""
        with self._lock:
            return self._length

    @property
    def plans(self) -> list[list[Point]]:
        """The first plan for each place that was planned to, in order."""
        with self._lock:
            return [list(plan) for plan in self._plans]


# Subscriptions that fill the track of the robot from what the simulator and the planner publish.

EACH = 1000
"""Messages that may wait where each counts: poses, for the driven path, and what trees do."""

POSE_BYTES = 2_000


def subscribe_to_robot(runtime: NodeRuntime, track: RobotTrack) -> None:
    """Subscribe to map, true pose, plans, and what trees do, for as long as the node lives.

    Not to the odometry: while it has a subscriber, the simulator publishes as often as in a drive.
    """

    def on_map(message: OccupancyGrid) -> None:
        info = message.info
        cells = np.asarray(message.data, dtype=np.int8).reshape(info.height, info.width)
        origin = info.origin.position
        track.set_map(OccupancyMap(cells, info.resolution, Origin(origin.x, origin.y, yaw_of(info.origin.orientation))))

    def on_pose(received: Received) -> None:
        message: PoseStamped = received.unpack(PoseStamped)
        position = message.pose.position
        track.add_pose(
            TrackPose(position.x, position.y, yaw_of(message.pose.orientation)), seconds_of(message.header.stamp)
        )

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
        node.create_subscription(OccupancyGrid, names.MAP, on_map, names.transient_local_qos())
        node.create_subscription(Path, names.PLAN, on_plan, 10)
        # All that have come are taken at once: one in a turn of the executor would be seconds late on a busy computer.
        ReceivedMessages(node, PoseStamped, names.POSE, QoSProfile(depth=EACH), on_pose, POSE_BYTES)
        ReceivedMessages(
            node, TreeStructure, names.TREE_STRUCTURE, names.transient_local_qos(EACH), on_structure, MESSAGE
        )
        ReceivedMessages(node, TreeStatus, names.TREE_STATUS, names.transient_local_qos(EACH), on_tree_status, MESSAGE)

    runtime.call(subscribe)


def yaw_of(orientation: Quaternion) -> float:
    """Return the heading of an upright robot, in radians."""
    return 2.0 * math.atan2(orientation.z, orientation.w)


def pose_message(pose: TrackPose, frame: str = 'map') -> PoseStamped:
    """Return a pose as message, with a zero stamp."""
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x = pose.x
    message.pose.position.y = pose.y
    message.pose.orientation.z = math.sin(pose.yaw / 2.0)
    message.pose.orientation.w = math.cos(pose.yaw / 2.0)
    return message
