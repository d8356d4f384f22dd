# SPDX-License-Identifier: BSD-3-Clause
"""The node ``simulator``: a robot on a map, and the clock of everything that runs with it.

Publishes map, /clock, odom, pose, scan, tf and tf_static; takes cmd_vel, initialpose and reset. The odometry is
perfect: the frame odom coincides with the map. The lidar is at the centre of the robot. As with Nav2, the topics of the
transforms are in the namespace of the robot.
"""

from __future__ import annotations

import math
import sys
import threading
import traceback
from collections.abc import Iterator
from typing import Any, Final

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.liveness import LivelinessToken
from flexbt_common.runtime import NodeRuntime, run_node
from flexbt_common.values import check_limits
from flexbt_core.errors import FlexbtError
from flexbt_sim.errors import SimulationError
from flexbt_sim.world import Lidar, MapRobot, Pacer, Pose, check_place, load_map

from .ros_messages import grid_message, pose_message, pose_of, stamped, time_message, transform
from .simulator_parameters import SPEED_FACTOR, declare_simulator_parameters

STEP: Final = 0.01
"""Simulated time of one step, s."""

STEPS_PER_CLOCK: Final = 3
"""Steps between two messages of /clock. It costs every node of the robot a wake-up, unless it comes together with the
odometry, which has this period too by default."""


class Simulator:
    """The simulator on a running node. The world moves on a thread of its own."""

    def __init__(self, runtime: NodeRuntime) -> None:
        """Must be called off the executor thread.

        Raises:
            SimulationError: a parameter or the map cannot be used.
        """
        self._runtime = runtime
        self._parameters = runtime.call(lambda: declare_simulator_parameters(runtime.node))
        parameters = self._parameters
        self._world = load_map(parameters.map)
        try:
            self._check_place(parameters.initial_pose)
        except SimulationError as error:
            raise SimulationError(f"parameter 'initial_pose': {error}") from None
        self._robot = MapRobot(self._world, parameters.initial_pose, parameters.limits)
        self._lidar = Lidar(self._world, parameters.lidar, parameters.seed)
        self._steps = 0
        self._lock = threading.Lock()
        self._pacer = Pacer(float(runtime.node.get_parameter(SPEED_FACTOR).value))
        self._steps_per_odom = max(1, round(1.0 / (parameters.odom_rate * STEP)))
        self._steps_per_scan = max(1, round(1.0 / (parameters.scan_rate * STEP)))
        runtime.call(self._connect)
        self._thread = threading.Thread(target=self._run, name='world', daemon=True)
        runtime.on_close(self._close)
        self._thread.start()
        LivelinessToken(runtime).set_ready(True)
        pose = parameters.initial_pose
        runtime.node.get_logger().info(
            f'{parameters.map}: {self._world.width} x {self._world.height} cells; robot at ({pose.x:g}, {pose.y:g})'
        )

    def _connect(self) -> None:
        node, parameters = self._runtime.node, self._parameters
        clock_qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self._clock = node.create_publisher(Clock, names.CLOCK, clock_qos)
        self._odom = node.create_publisher(Odometry, names.ODOM, 10)
        self._pose = node.create_publisher(PoseStamped, names.POSE, 10)
        self._scan = node.create_publisher(LaserScan, names.SCAN, qos_profile_sensor_data)
        self._map = node.create_publisher(OccupancyGrid, names.MAP, names.latched())
        self._tf = node.create_publisher(TFMessage, names.TF, 100)
        self._tf_static = node.create_publisher(TFMessage, names.TF_STATIC, names.latched())
        command_type: Any = TwistStamped if parameters.stamped_cmd_vel else Twist
        node.create_subscription(command_type, parameters.cmd_vel_topic, self._on_command, 1)
        node.create_subscription(PoseWithCovarianceStamped, names.INITIAL_POSE, self._on_initial_pose, 1)
        node.create_service(Trigger, names.RESET, self._on_reset)
        node.add_on_set_parameters_callback(self._on_parameters)
        start = time_message(0.0)
        self._map.publish(grid_message(self._world, parameters.map_frame, start))
        lidar = transform(parameters.base_frame, parameters.scan_frame, Pose(0.0, 0.0, 0.0), start)
        self._tf_static.publish(TFMessage(transforms=[lidar]))

    @property
    def now(self) -> float:
        """Simulated time, s."""
        return self._steps * STEP

    # -- on the executor thread --------------------------------------------------------------------------------------

    def _on_command(self, message: Any) -> None:
        command = message.twist if self._parameters.stamped_cmd_vel else message
        linear, angular = float(command.linear.x), float(command.angular.z)
        if not (math.isfinite(linear) and math.isfinite(angular)):
            self._runtime.node.get_logger().error(
                f'{self._parameters.cmd_vel_topic}: {linear:g} m/s, {angular:g} rad/s cannot be driven: it stops',
                throttle_duration_sec=5.0,
            )
        with self._lock:
            self._robot.command(linear, angular, self.now)
        self._pacer.command_received()

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        frame = message.header.frame_id
        try:
            check_limits(message)
            if frame not in ('', self._parameters.map_frame):
                raise SimulationError(f'frame {frame!r} is not known; give the pose in {self._parameters.map_frame!r}')
            pose = pose_of(message.pose.pose)
            self._check_place(pose)
        except FlexbtError as error:
            self._runtime.node.get_logger().error(f'{names.INITIAL_POSE} refused, the robot stays: {error}')
            return
        self._place(pose)

    def _on_reset(self, request: Any, response: Any) -> Any:
        self._place(self._parameters.initial_pose)
        response.success = True
        response.message = 'the robot is at its initial pose'
        return response

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            if change.name == SPEED_FACTOR:
                self._pacer.factor = float(change.value)
        return SetParametersResult(successful=True)

    def _check_place(self, pose: Pose) -> None:
        check_place(self._world, pose, self._parameters.limits.radius)

    def _place(self, pose: Pose) -> None:
        with self._lock:
            self._robot.place(pose)

    # -- on the thread of the world ----------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            with self._runtime.health.loop('the world') as loop:
                while not self._pacer.stopped:
                    for _ in range(STEPS_PER_CLOCK):
                        self._step()
                    with loop.resting():
                        self._pacer.wait(STEPS_PER_CLOCK * STEP)
        except BaseException as error:  # without a world there is nothing to simulate
            self._runtime.give_up(f'the world raised: {"".join(traceback.format_exception(error)).rstrip()}')

    def _step(self) -> None:
        with self._lock:
            self._steps += 1
            self._robot.step(self.now, STEP)
            pose, linear, angular = self._robot.pose, self._robot.linear, self._robot.angular
        scans = self._steps % self._steps_per_scan == 0 and self._scan.get_subscription_count() > 0
        moves = self._steps % self._steps_per_odom == 0
        # Made beforehand, so that all arrive at once: a node that waits for several is woken up once.
        messages: list[tuple[Any, Any]] = []
        if scans:
            messages += self._scan_messages(pose)
        if moves:
            messages += self._pose_messages(pose, linear, angular)
        if messages or self._steps % STEPS_PER_CLOCK == 0:
            # First, so that no message is from the future.
            self._clock.publish(Clock(clock=time_message(self.now)))
        commands = self._pacer.commands
        for publisher, message in messages:
            publisher.publish(message)
        if moves and self._pacer.factor == 0.0 and self._is_driven():
            self._pacer.wait_for_answer(commands)

    def _is_driven(self) -> bool:
        commanded = self._robot.commanded_at
        return commanded is not None and self.now - commanded <= self._parameters.limits.watchdog

    def _pose_messages(self, pose: Pose, linear: float, angular: float) -> Iterator[tuple[Any, Any]]:
        parameters = self._parameters
        stamp = time_message(self.now)
        if self._odom.get_subscription_count():
            odometry = Odometry(child_frame_id=parameters.base_frame)
            odometry.header.frame_id, odometry.header.stamp = parameters.odom_frame, stamp
            odometry.pose.pose = pose_message(pose)
            odometry.twist.twist.linear.x, odometry.twist.twist.angular.z = float(linear), float(angular)
            yield self._odom, odometry
        yield self._pose, stamped(pose, parameters.map_frame, stamp)
        if self._tf.get_subscription_count():
            drift = transform(parameters.map_frame, parameters.odom_frame, Pose(0.0, 0.0, 0.0), stamp)
            robot = transform(parameters.odom_frame, parameters.base_frame, pose, stamp)
            yield self._tf, TFMessage(transforms=[drift, robot])

    def _scan_messages(self, pose: Pose) -> Iterator[tuple[Any, Any]]:
        model = self._lidar.model
        scan = LaserScan(
            angle_min=0.0,
            angle_max=float(model.angle_increment * (model.beams - 1)),
            angle_increment=float(model.angle_increment),
            scan_time=float(self._steps_per_scan * STEP),
            range_min=float(model.range_min),
            range_max=float(model.range_max),
        )
        scan.header.frame_id, scan.header.stamp = self._parameters.scan_frame, time_message(self.now)
        scan.ranges.frombytes(self._lidar.scan(pose).tobytes())
        yield self._scan, scan

    def _close(self) -> None:
        self._pacer.stop()
        self._thread.join(1.0)


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``simulator``."""
    return run_node(names.SIMULATOR, Simulator, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
