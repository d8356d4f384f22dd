# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the simulator: declared, described and checked in one place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from rclpy.node import Node

from flexbt_common import names
from flexbt_common.runtime import ParameterDeclarer
from flexbt_sim.errors import SimulationError
from flexbt_sim.world import LidarModel, Pose, RobotLimits


@dataclass(frozen=True)
class SimulatorParameters:
    """Values of the parameters; see :func:`declare_simulator_parameters` for meaning and unit."""

    map: Path
    initial_pose: Pose
    seed: int
    limits: RobotLimits
    lidar: LidarModel
    odom_rate: float
    scan_rate: float
    stamped_cmd_vel: bool
    cmd_vel_topic: str
    map_frame: str
    odom_frame: str
    base_frame: str
    scan_frame: str


SPEED_FACTOR = 'speed_factor'


def built_in_map() -> Path:
    """The map that comes along."""
    return Path(get_package_share_directory('flexbt_sim')) / 'maps' / 'rooms.yaml'


def declare_simulator_parameters(node: Node) -> SimulatorParameters:
    """Declare the parameters on ``node`` and read them. ``speed_factor`` alone can be changed later.

    Raises:
        SimulationError, UnfitParameterError: a value that cannot work.
    """
    declare = ParameterDeclarer(node)
    factor = 'seconds of the simulated world per second; 0 for as fast as whoever drives the robot keeps up'
    declare.real(SPEED_FACTOR, 1.0, 0.0, 1000.0, factor, read_only=False)
    limits, lidar = RobotLimits(), LidarModel()
    pose = declare.reals(
        'initial_pose', [0.8, 4.45, 0.0], 'pose of the robot at the start and after a reset: m, m, rad'
    )
    if len(pose) != 3:
        raise SimulationError(f"parameter 'initial_pose': expected [x, y, yaw], got {pose}")
    range_min = declare.real('scan_range_min', lidar.range_min, 0.0, 10.0, 'm')
    range_max = declare.real('scan_range_max', lidar.range_max, 0.1, 100.0, 'm')
    if range_min >= range_max:
        raise SimulationError(
            f"parameter 'scan_range_min': {range_min:g} m is not below 'scan_range_max' {range_max:g} m"
        )
    lidar = LidarModel(
        beams=declare.integer('scan_beams', lidar.beams, 1, 100_000, 'beams of the lidar'),
        range_min=range_min,
        range_max=range_max,
        noise=declare.real('scan_noise', lidar.noise, 0.0, 1.0, 'standard deviation of a range, m'),
    )
    return SimulatorParameters(
        map=Path(
            declare.text('map', '', 'YAML file of a ROS map; empty for the one that comes along') or built_in_map()
        ),
        initial_pose=Pose(*pose),
        seed=declare.integer('seed', 0, 0, 2**63 - 1, 'seed of all random numbers'),
        limits=RobotLimits(
            linear_speed=declare.real('linear_speed', limits.linear_speed, 0.01, 10.0, 'greatest speed, m/s'),
            angular_speed=declare.real(
                'angular_speed', limits.angular_speed, 0.01, 20.0, 'greatest turning speed, rad/s'
            ),
            linear_acceleration=declare.real('linear_acceleration', limits.linear_acceleration, 0.01, 100.0, 'm/s²'),
            angular_acceleration=declare.real(
                'angular_acceleration', limits.angular_acceleration, 0.01, 100.0, 'rad/s²'
            ),
            radius=declare.real('radius', limits.radius, 0.01, 2.0, 'radius of the robot, m'),
            watchdog=declare.real(
                'watchdog', limits.watchdog, 0.05, 10.0, 'time without a command after which it brakes, s'
            ),
        ),
        lidar=lidar,
        odom_rate=declare.real(
            'odom_rate', 33.3, 1.0, 100.0, 'rate of odometry, pose and transforms, Hz of simulated time'
        ),
        scan_rate=declare.real('scan_rate', 5.0, 0.1, 50.0, 'rate of the scans, Hz of simulated time'),
        stamped_cmd_vel=declare.flag('enable_stamped_cmd_vel', False, 'commands are TwistStamped instead of Twist'),
        cmd_vel_topic=declare.text('cmd_vel_topic', names.CMD_VEL, 'topic of the velocity commands'),
        map_frame=declare.text('map_frame', 'map', 'frame of the map'),
        odom_frame=declare.text('odom_frame', 'odom', 'frame of the odometry; it coincides with the map'),
        base_frame=declare.text('base_frame', 'base_link', 'frame of the robot'),
        scan_frame=declare.text('scan_frame', 'base_scan', 'frame of the lidar, at the centre of the robot'),
    )
