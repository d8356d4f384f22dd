# SPDX-License-Identifier: BSD-3-Clause
"""The topics of one robot and its devices, in its namespace, and its commands. Only topics with subscribers are
published.

This includes the parts of Nav2's bringup that belong to a robot, under their names: robot_state_publisher's
description, amcl's pose and lifecycle.
"""

from __future__ import annotations

import importlib
import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

import numpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from std_msgs.msg import String
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import time_message
from flexbt_core.errors import FlexbtError
from flexbt_sim.errors import SimulationError
from flexbt_sim.intra_process import IntraProcessPublisher, IntraProcessTopics
from flexbt_sim.messages import faults_message, pose_of, transform
from flexbt_sim.world.device import Device, Sensor
from flexbt_sim.world.faults import TOPICS, MessagesDropped, MessagesLate, ServerFault
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.plane.space import generator
from flexbt_sim.world.robot import Robot

from .displays import robot_description
from .message_template import MessageTemplate, set_field, stamp_fields
from .parameters import SimulatorParameters

UPDATE: Final = (0.25, 0.2)
"""Motion since the last amcl_pose after which the next is published, m and rad: amcl's update_min_d and
update_min_a."""

POSES: Final = 1000
"""Queue depth for true poses: a slow subscriber needs all of them for the path of a robot."""

Stamp = tuple[int, int]
"""A time: seconds and nanoseconds."""

Message = tuple[str, Callable[[Any], object], Any]
"""The relative name of the topic, the function that publishes a message, and the message or its bytes."""


@dataclass(frozen=True)
class Commands:
    """The callbacks for the commands of a robot.

    ``drive(robot, linear, angular)`` gets m/s and rad/s, ``place(robot, pose)`` an initial pose. ``grip(robot, close)``
    returns the name of the obstacle that was picked up or put down. The last two raise SimulationError if that is not
    possible. ``time()`` returns the simulated time, s.
    """

    drive: Callable[[Robot, float, float], None]
    place: Callable[[Robot, Pose], None]
    grip: Callable[[Robot, bool], str]
    time: Callable[[], float]


@dataclass
class _DeviceTopics:
    """A device, its publishers by topic, and its messages."""

    device: Device
    publishers: dict[str, Any]
    has_stamp: bool
    bytes: MessageTemplate
    sent: Any = None
    """The news that was last sent."""

    @property
    def is_heard(self) -> bool:
        return self.device.is_latched or any(one.get_subscription_count() for one in self.publishers.values())

    @property
    def has_news(self) -> bool:
        return self.device.news not in (None, self.sent)

    def messages(self, stamp: Stamp) -> Iterator[Message]:
        """Yield the current message of each topic that has subscribers."""
        if not self.has_news or not self.is_heard:
            return
        self.sent = self.device.news
        if self.device.array:
            self.bytes.fill_array(self.device.array_values())
        filled = self.bytes.filled(*(stamp if self.has_stamp else ()), *self.device.values())
        for topic, publisher in self.publishers.items():
            if self.device.is_latched or publisher.get_subscription_count():
                yield topic, publisher.publish, filled


class RobotTopics:
    """The topics of a robot. They are created and closed on the executor thread; messages are created on the world
    thread."""

    def __init__(
        self,
        runtime: NodeRuntime,
        robot: Robot,
        namespace: str,
        parameters: SimulatorParameters,
        commands: Commands,
        in_process: IntraProcessTopics,
    ) -> None:
        """``namespace`` is the prefix of the topic names: '' or 'robot1/'."""
        self.robot = robot
        self.namespace = namespace
        self._runtime = runtime
        self._parameters = parameters
        self._commands = commands
        self._in_process = in_process
        self._entities: list[tuple[Callable[[Any], Any], Any]] = []
        self._late: dict[str, deque[tuple[float, Message]]] = {topic: deque() for topic in TOPICS}
        self._loss = generator(robot.seed, robot.name, 'messages')
        self._told_at: Pose | None = None
        self._told_faults: tuple[ServerFault, ...] | None = None
        self.is_busy = False
        self._connect()
        self._prefill()

    # -- on the executor thread --------------------------------------------------------------------------------------

    def _connect(self) -> None:
        node, parameters, model = self._runtime.node, self._parameters, self.robot.model
        self._odom = self._publisher(Odometry, names.ODOM, 10)
        self._pose = self._in_process.publisher(self._publisher(PoseStamped, names.POSE, POSES))
        self._tf = self._publisher(TFMessage, names.TF, 100)
        self._amcl_pose = self._publisher(PoseWithCovarianceStamped, names.AMCL_POSE, names.transient_local_qos())
        self._devices = [self._connect_device(one) for one in self.robot.devices.values() if one.topics]
        if model.gripper:
            service = node.create_service(SetBool, f'{self.namespace}{names.GRIPPER}', self._on_gripper)
            self._entities.append((node.destroy_service, service))
        self._server_faults = self._publisher(String, names.SERVER_FAULTS, names.transient_local_qos())
        self._describe()
        command_type: Any = TwistStamped if parameters.stamped_cmd_vel else Twist
        self._command = self._subscribe(command_type, parameters.cmd_vel_topic, self._on_command)
        self._in_process.receive_instead(self._command, self._on_command)
        self._subscribe(PoseWithCovarianceStamped, names.INITIAL_POSE, self._on_initial_pose)
        self._amcl = LifecycleSubnode(self._runtime, f'{self.namespace}{names.AMCL}')

    def _connect_device(self, device: Device) -> _DeviceTopics:
        package, _, name = device.message.partition('/')
        message_type: Any = getattr(importlib.import_module(f'{package}.msg'), name)
        message = message_type()
        for path, value in device.constants().items():
            set_field(message, path, value)
        has_stamp = hasattr(message, 'header')
        if has_stamp:
            message.header.frame_id = self._parameters.frame_of(device)
        stamp = stamp_fields('header.stamp') if has_stamp else ()
        template = MessageTemplate(message, *stamp, *device.fields, array=device.array)
        is_fast = isinstance(device, Sensor) and device.is_prompt
        qos = names.transient_local_qos() if device.is_latched else qos_profile_sensor_data if is_fast else 10
        publishers = {topic: self._publisher(message_type, topic, qos) for topic in device.topics}
        if is_fast:
            publishers = {topic: self._in_process.publisher(one) for topic, one in publishers.items()}
        return _DeviceTopics(device, publishers, has_stamp, template)

    def _publisher(self, message_type: Any, topic: str, qos: QoSProfile | int) -> Any:
        node = self._runtime.node
        publisher = node.create_publisher(message_type, f'{self.namespace}{topic}', qos)
        self._entities.append((node.destroy_publisher, publisher))
        return publisher

    def _subscribe(self, message_type: Any, topic: str, callback: Callable[[Any], None]) -> Any:
        node = self._runtime.node
        subscription = node.create_subscription(message_type, f'{self.namespace}{topic}', callback, 1)
        self._entities.append((node.destroy_subscription, subscription))
        return subscription

    def _describe(self) -> None:
        """Publish the URDF and the static transforms, which do not change."""
        parameters = self._parameters
        base, footprint = parameters.base_frame, parameters.footprint_frame
        sensors = {parameters.frame_of(one): one.pose for one in self.robot.sensors if one.frame}
        urdf = robot_description(self.robot.name, self.robot.model.footprint, base, footprint, sensors)
        self._publisher(String, names.ROBOT_DESCRIPTION, names.transient_local_qos()).publish(String(data=urdf))
        start = time_message(0.0)
        fixed = [transform(base, footprint, Pose(0.0, 0.0, 0.0), start)]
        fixed += [transform(base, frame, pose, start) for frame, pose in sensors.items()]
        self._publisher(TFMessage, names.TF_STATIC, names.transient_local_qos()).publish(TFMessage(transforms=fixed))

    def close(self) -> None:
        """Remove all topics and services: the robot is gone."""
        self._in_process.forget(self._command)
        for publisher in (self._pose, *chain.from_iterable(one.publishers.values() for one in self._devices)):
            if isinstance(publisher, IntraProcessPublisher):
                self._in_process.withdraw(publisher)
        for destroy, entity in self._entities:
            destroy(entity)
        self._amcl.close()

    def _on_command(self, message: Any) -> None:
        """Handle a command. On any thread: that of the sender, if it is in this process."""
        if self._is_lost(names.CMD_VEL) or self._is_late((names.CMD_VEL, self._drive, message), self._commands.time()):
            return
        self._drive(message)

    def _drive(self, message: Any) -> None:
        command = message.twist if self._parameters.stamped_cmd_vel else message
        linear, angular = float(command.linear.x), float(command.angular.z)
        if not (math.isfinite(linear) and math.isfinite(angular)):
            self._complain(
                f'{self._parameters.cmd_vel_topic}: {linear:g} m/s, {angular:g} rad/s cannot be driven: it stops'
            )
        self._commands.drive(self.robot, linear, angular)

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        frame = message.header.frame_id
        try:
            check_limits(message)
            if frame not in ('', self._parameters.map_frame):
                raise SimulationError(f'frame {frame!r} is not known; give the pose in {self._parameters.map_frame!r}')
            self._commands.place(self.robot, pose_of(message.pose.pose))
        except FlexbtError as error:
            self._complain(f'{names.INITIAL_POSE} refused, the robot stays: {error}')
            return
        self._told_at = None

    def _on_gripper(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            response.message = self._commands.grip(self.robot, bool(request.data))
            response.success = True
        except SimulationError as error:
            response.message = str(error)
        return response

    def _complain(self, text: str) -> None:
        name = f'{self.robot.name}: ' if self.namespace else ''
        self._runtime.node.get_logger().error(f'{name}{text}', throttle_duration_sec=COMPLAINT_SECONDS)

    # -- on the thread of the world ----------------------------------------------------------------------------------

    def _prefill(self) -> None:
        parameters = self._parameters
        odometry = Odometry(child_frame_id=parameters.base_frame)
        odometry.header.frame_id = parameters.odom_frame
        self._odometry_bytes = MessageTemplate(
            odometry,
            *stamp_fields('header.stamp'),
            *_planar('pose.pose.position', 'pose.pose.orientation'),
            ('d', 'twist.twist.linear.x'),
            ('d', 'twist.twist.angular.z'),
        )
        pose = PoseStamped()
        pose.header.frame_id = parameters.map_frame
        self._pose_bytes = MessageTemplate(
            pose, *stamp_fields('header.stamp'), *_planar('pose.position', 'pose.orientation')
        )
        frames = (parameters.map_frame, parameters.odom_frame), (parameters.odom_frame, parameters.base_frame)
        moving = [TransformStamped(child_frame_id=child) for _, child in frames]
        for one, (parent, _) in zip(moving, frames, strict=True):
            one.header.frame_id = parent
        self._tf_bytes = [self._tf_template(moving), self._tf_template(moving[1:])]

    @staticmethod
    def _tf_template(transforms: list[TransformStamped]) -> MessageTemplate:
        fields: list[tuple[str, str]] = []
        for index in range(len(transforms)):
            at = f'transforms.{index}'
            fields += stamp_fields(f'{at}.header.stamp')
            fields += _planar(f'{at}.transform.translation', f'{at}.transform.rotation')
        return MessageTemplate(TFMessage(transforms=transforms), *fields)

    def look_round(self, now: float, *, can_cast: bool) -> None:
        """Determine which devices have subscribers, and whether the robot is busy: it is being driven, or its odometry
        or transforms have subscribers. Other messages are rare.

        ``can_cast`` is True if casting beams does not hold up the world.
        """
        for one in self._devices:
            one.device.is_read = one.is_heard and (can_cast or not one.device.casts)
        self.is_busy = (
            self.robot.is_driven(now)
            or self._odom.get_subscription_count() > 0
            or self._tf.get_subscription_count() > 0
        )

    @property
    def has_messages(self) -> bool:
        """True if a message is due between two messages of odometry: a scan, a contact or a late message."""
        return any(one.has_news for one in self._devices if one.device.is_prompt) or any(self._late.values())

    @property
    def has_navigation(self) -> bool:
        """True if a node carries out the faults of navigation servers."""
        topic = self._server_faults.topic_name
        heard_by = self._runtime.node.get_subscriptions_info_by_topic(topic)
        return any(one.node_name == names.NAVIGATION for one in heard_by)

    def publish_server_faults(self) -> None:
        """Publish the faults of navigation servers if they have changed. Requires the lock; on any thread."""
        faults = tuple(one for one in self.robot.faults.values() if isinstance(one, ServerFault))
        if faults != self._told_faults:
            self._told_faults = faults
            self._server_faults.publish(faults_message(faults))

    def messages(self, now: float, stamp: Stamp, *, moves: bool) -> Iterator[Message]:
        """Yield the messages that are due at a time of the world, s, which is ``stamp`` by the published clock.

        ``moves`` is True if odometry, pose and transforms are due.
        """
        made = chain(self._moves(stamp) if moves else (), self._sensed(stamp, moves=moves))
        yield from (one for one in made if not (self._is_lost(one[0]) or self._is_late(one, now)))
        for queue in self._late.values():
            while queue and queue[0][0] <= now:
                yield queue.popleft()[1]

    def _is_lost(self, topic: str) -> bool:
        dropped = self.robot.faults.get(MessagesDropped.slot_of(topic))
        return isinstance(dropped, MessagesDropped) and bool(self._loss.random() < dropped.probability)

    def _is_late(self, message: Message, now: float) -> bool:
        """Return whether the message is held back by its delay or behind others of its topic; :meth:`messages` yields
        it later."""
        late, queue = self.robot.faults.get(MessagesLate.slot_of(message[0])), self._late[message[0]]
        try:
            last = queue[-1][0]
        except IndexError:  # not asked before: the thread of the world empties the queue of commands
            last = now
        due = max(now + late.delay if isinstance(late, MessagesLate) else now, last)
        if due > now:
            queue.append((due, message))
        return due > now

    def _sensed(self, stamp: Stamp, *, moves: bool) -> Iterator[Message]:
        """Yield the messages of devices. They follow the pose: the driver answers the pose and the world waits for the
        answer, while other nodes can process the scan."""
        for one in self._devices:
            if moves or one.device.is_prompt:
                yield from one.messages(stamp)

    def _moves(self, stamp: Stamp) -> Iterator[Message]:
        robot = self.robot
        if self._odom.get_subscription_count():
            filled = self._odometry_bytes.filled(*stamp, *_place(robot.odometry), robot.linear, robot.angular)
            yield names.ODOM, self._odom.publish, filled
        is_localized = self._amcl.is_active
        estimate = robot.estimate
        if is_localized:
            yield names.POSE, self._pose.publish, self._pose_bytes.filled(*stamp, *_place(estimate))
        if self._tf.get_subscription_count():
            moved = (*stamp, *_place(robot.odometry))
            if is_localized:
                filled = self._tf_bytes[0].filled(*stamp, *_place(robot.map_to_odom), *moved)
            else:
                filled = self._tf_bytes[1].filled(*moved)
            yield names.TF, self._tf.publish, filled
        if is_localized and self._has_moved(estimate):
            self._told_at = estimate
            yield names.AMCL_POSE, self._amcl_pose.publish, self._amcl_message(estimate, stamp)

    def restart(self, robot: Robot) -> None:
        """Switch to the robot of a new world, which has the same model."""
        self.robot = robot
        self._loss = generator(robot.seed, robot.name, 'messages')
        self._told_at = self._told_faults = None
        for one in self._devices:
            one.device, one.sent = robot.devices[one.device.name], None
        for queue in self._late.values():
            queue.clear()

    def _has_moved(self, estimate: Pose) -> bool:
        last = self._told_at
        return last is None or (
            estimate.distance(last) >= UPDATE[0] or abs(math.remainder(estimate.yaw - last.yaw, math.tau)) >= UPDATE[1]
        )

    def _amcl_message(self, estimate: Pose, stamp: Stamp) -> PoseWithCovarianceStamped:
        message = PoseWithCovarianceStamped()
        message.header.frame_id, message.header.stamp = self._parameters.map_frame, Time(sec=stamp[0], nanosec=stamp[1])
        position, turned = message.pose.pose.position, message.pose.pose.orientation
        position.x, position.y, turned.z, turned.w = _place(estimate)
        message.pose.covariance = numpy.zeros(36)
        return message


def _planar(position: str, orientation: str) -> tuple[tuple[str, str], ...]:
    """Return the fields of a pose in the plane; see :func:`_place`."""
    return ('d', f'{position}.x'), ('d', f'{position}.y'), ('d', f'{orientation}.z'), ('d', f'{orientation}.w')


def _place(pose: Pose) -> tuple[float, float, float, float]:
    return pose.x, pose.y, math.sin(pose.yaw / 2.0), math.cos(pose.yaw / 2.0)
