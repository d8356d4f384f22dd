# SPDX-License-Identifier: BSD-3-Clause
"""The state of the robot for operators: its last known pose, and the path that it follows."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry, Path
from rclpy.qos import QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, LatestMessage, Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.transform_listener import TransformListener, transformed
from flexbt_common.values.message_fields import path_points, time_message
from flexbt_msgs.msg import DecisionSubject
from flexbt_msgs.msg import RobotPlan as RobotPlanMessage

SETTLE_SECONDS: Final = 2.0
"""Time for the discovery of the pose topic, s of wall time. After it, other sources are used."""
OLD_SECONDS: Final = 5.0
"""Age above which a transform no longer counts as the pose of the robot, s on the node's clock."""


class RobotPose:
    """The pose of the robot, from the first source that is published. Used on the executor thread.

    The sources are ``topic``, the transform from ``frames[0]`` to ``frames[1]``, the localization (``amcl_pose``) and
    the odometry, in this order. The topic may have the type PoseStamped, PoseWithCovarianceStamped or Odometry. The
    other sources are used only while no node publishes the topic.
    """

    def __init__(self, runtime: Runtime, topic: str, frames: tuple[str, str] = ('map', 'base_link')) -> None:
        self._runtime = runtime
        self._node = runtime.node
        self._main = _PoseTopic(runtime, topic)
        self._frames = frames
        self._others = [_PoseTopic(runtime, name) for name in (names.AMCL_POSE, names.ODOM) if name != topic]
        self._source = self._main.name
        self._pose: PoseStamped | None = None
        self._look_at = runtime.steady.now() + SETTLE_SECONDS

    def latest(self) -> PoseStamped:
        """Return the newest pose. Its frame_id is empty before the first pose."""
        pose = self._main.latest()
        if self._runtime.steady.now() >= self._look_at and not self._main.is_published():
            source, other = self._other()
            if other is not None:
                if source != self._source:
                    self._source = source
                    self._node.get_logger().info(f'nobody publishes {self._main.name}: the pose is that of {source}')
                self._pose = other
                return other
        elif pose is not None:
            self._source = self._main.name
        self._pose = pose if pose is not None else self._pose
        return self._pose or PoseStamped()

    def _other(self) -> tuple[str, PoseStamped | None]:
        """Return the first other source that is published, and its pose; '' and None if none is."""
        pose = self._transform() if self._node.count_publishers(names.TF) > 0 else None
        if pose is not None:
            return 'the transform from {} to {}'.format(*self._frames), pose
        for topic in self._others:
            if topic.is_published():
                return topic.name, topic.latest()
        return '', None

    def _transform(self) -> PoseStamped | None:
        """Return the pose from tf; None if it is unknown or too old."""
        buffer = TransformListener.of(self._runtime).buffer
        world, robot = self._frames
        try:
            place, moment = buffer.lookup(world, robot), buffer.latest(world, robot)
        except TransformError:
            return None
        pose = PoseStamped(pose=transformed(Pose(), place))
        pose.header.frame_id = world
        if math.isfinite(moment):  # otherwise all transforms are static
            if self._runtime.clock.now() - moment > OLD_SECONDS:
                return None
            pose.header.stamp = time_message(max(0.0, moment))
        return pose

    def problem(self, gone: Collection[str] = ()) -> str:
        """Return why the pose is unknown or may be outdated; '' while a node publishes it.

        Nodes that are ``gone`` do not count. The middleware reports the end of a killed node only after its lease.
        """
        if self._source != self._main.name and self._other()[1] is not None:
            return ''
        is_told = self._main.is_published(gone)
        if self._pose is None and self._main.latest() is None:
            return f'nothing came on {self._main.name} yet' if is_told else f'nobody publishes {self._main.name}'
        return '' if is_told else f'nobody publishes {self._main.name} any more'


class _PoseTopic:
    """A topic with poses of one of the types in :data:`POSE_TYPES`."""

    def __init__(self, runtime: Runtime, topic: str) -> None:
        self._node = runtime.node
        self.name: str = runtime.node.resolve_topic_name(topic)
        self._newest: LatestMessage | None = None

    def _open(self) -> None:
        """Subscribe to the topic once a node publishes it, since its type is unknown before."""
        publishers = self._node.get_publishers_info_by_topic(self.name)
        known = [POSE_TYPES[one.topic_type] for one in publishers if one.topic_type in POSE_TYPES]
        if known:
            # Best effort and volatile are compatible with every publisher. A localization that publishes only when the
            # robot has moved latches its pose: the last one is needed.
            qos, latched = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT), names.transient_local_qos()
            if all(qos_check_compatible(one.qos_profile, latched)[0] != QoSCompatibility.ERROR for one in publishers):
                qos = latched
            self._newest = LatestMessage(self._node, known[0], self.name, qos)

    def is_published(self, gone: Collection[str] = ()) -> bool:
        """Return whether a node that is not ``gone`` publishes the topic."""
        if not gone or self._node.count_publishers(self.name) == 0:
            return bool(self._node.count_publishers(self.name))
        return any(names.node_of(one) not in gone for one in self._node.get_publishers_info_by_topic(self.name))

    def latest(self) -> PoseStamped | None:
        """Return the newest pose; None before the first one."""
        if self._newest is None:
            self._open()
        message = None if self._newest is None else self._newest.message
        if message is None or isinstance(message, PoseStamped):
            return message
        return PoseStamped(header=message.header, pose=message.pose.pose)


POSE_TYPES: Final[Mapping[str, type[Any]]] = {
    'geometry_msgs/msg/PoseStamped': PoseStamped,
    'geometry_msgs/msg/PoseWithCovarianceStamped': PoseWithCovarianceStamped,
    'nav_msgs/msg/Odometry': Odometry,
}
"""Message types of topics with the pose of the robot, by name."""


# The path that the robot follows is published again, since planners publish it once and a console may start later.

MOST_POINTS: Final = 500
"""Maximum number of points that are published, enough for a map on a screen."""

PERIOD: Final = 0.5
"""Minimum seconds between two plans that are published, since a planner may be fast and the link slow."""

MOST_BYTES: Final = 4_000_000
"""Maximum size of a plan that is published, bytes: 50,000 poses. Reading more would delay everything else."""

MESSAGE_BYTES: Final = 32_000_000

_FARTHEST: Final = 1e9
"""Coordinate, m, from which a point is nowhere, like one that is not a number. Those of a float32 end, too."""

_PATH: Final = 'nav_msgs/msg/Path'


class RobotPlan:
    """A publisher that repeats the newest message of a Path topic as a latched one. Used on the executor thread."""

    def __init__(self, runtime: Runtime, topic: str) -> None:
        self._runtime = runtime
        self._publisher = runtime.node.create_publisher(
            RobotPlanMessage, names.EXECUTIVE_PLAN, names.transient_local_qos()
        )
        self._newest: Received | None = None
        self._due = -math.inf
        self._is_empty = True
        self._is_judged = False
        # Volatile, since planners do not latch their paths.
        self._messages = ReceivedMessages(
            runtime.node, Path, topic, QoSProfile(depth=1), self._on_message, MESSAGE_BYTES
        )

    def clear(self) -> None:
        """Clear the plan, since another run begins."""
        self._newest = None
        if not self._is_empty:
            self._publish(b'')

    def judged(self, subjects: Sequence[DecisionSubject]) -> None:
        """Publish the path that the operator judges as the plan, if this run has received no plan yet.

        The planner may have published before this process started, or not at all. A newer judged path replaces an
        older one.
        """
        paths = (entry.data for one in subjects for entry in one.entries if entry.type == _PATH and entry.data)
        is_unheard = (self._is_empty or self._is_judged) and self._newest is None
        if is_unheard and (path := next(paths, None)) is not None:
            self._publish(bytes(path))
            self._is_judged = True

    def _on_message(self, received: Received) -> None:
        is_planned, self._newest = self._newest is not None, received
        if not is_planned:
            self._runtime.post_in(max(0.0, self._due - self._runtime.steady.now()), self._pass_on)

    def _pass_on(self) -> None:
        received, self._newest = self._newest, None
        if received is None:
            return
        self._due = self._runtime.steady.now() + PERIOD
        self._is_judged = False
        if received.data is not None and received.size <= MOST_BYTES:
            self._publish(received.data)
        else:
            self._publish(b'', f'{received.size} bytes; at most {MOST_BYTES} are shown')

    def _publish(self, path: bytes, problem: str = '') -> None:
        """Publish the points of a serialized path. Without points, the message clears the previous plan."""
        frame, points = '', list[tuple[float, float]]()
        try:
            frame, points = path_points(path, MOST_POINTS) if path else ('', [])
            if not all(abs(x) < _FARTHEST and abs(y) < _FARTHEST for x, y in points):
                points, problem = [], 'a point that is nowhere'
        except ValueError as error:
            problem = str(error)
        if problem:
            text = f'{self._messages.subscription.topic_name}: a plan is not shown to operators: {problem}'
            self._runtime.node.get_logger().error(text, throttle_duration_sec=COMPLAINT_SECONDS)
        self._is_empty = not points
        across, up = zip(*points, strict=True) if points else ((), ())
        self._publisher.publish(RobotPlanMessage(frame_id=frame if points else '', x=across, y=up))
