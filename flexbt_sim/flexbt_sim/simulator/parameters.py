# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the simulator: declared, described and checked in one place; and the world that they describe."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from rclpy.node import Node

from flexbt_common import names
from flexbt_common.runtime.parameters import ALLOWED_DIRECTORIES_TEXT, ParameterDeclarer
from flexbt_core.values.parameter_fields import parameter
from flexbt_sim.errors import SimulationError
from flexbt_sim.messages import check_fault
from flexbt_sim.world.device import Device
from flexbt_sim.world.devices import BatteryModel, Lidar, LidarModel
from flexbt_sim.world.models import DriveModel, RobotModel
from flexbt_sim.world.plane.geometry import Circle, Pose
from flexbt_sim.world.plane.occupancy_map import load_map
from flexbt_sim.world.world import World

SPEED_FACTOR = 'speed_factor'

STEP = 0.015
"""Simulated time of one step, s, where no world file says another: two for a message of odometry."""

ROBOT = 'robot'
"""Name of the robot where no world file names any."""


@dataclass(frozen=True)
class SimulatorParameters:
    """Parameters of the simulator."""

    world: Path | None
    map: Path
    initial_pose: Pose
    robot: RobotModel
    allowed_directories: tuple[Path, ...]
    seed: int = parameter('seed', 0, 'seed of all random numbers; 0 for that of the world file', 0, 2**63 - 1)
    namespaces: bool = parameter(
        'robot_namespaces',
        True,
        "each robot of a world file has a namespace of its name; false: its only one uses the node's",
    )
    initialpose_moves: bool = parameter(
        'initialpose_moves_robot',
        True,
        'initialpose moves the robot, as in nav2_loopback_sim; false: it corrects its localization, as amcl. By '
        'default true without a world file',
    )
    odom_rate: float = parameter(
        'odom_rate',
        33.3,
        'rate of odometry and transforms, and of the pose of a driven robot, Hz of simulated time',
        1.0,
        100.0,
    )
    clock_rate: float = parameter(
        'clock_rate',
        20.0,
        'minimum rate of /clock, Hz of simulated time (poses at rest: half)',
        1.0,
        1000.0,
    )
    stamped_cmd_vel: bool = parameter('enable_stamped_cmd_vel', False, 'commands are TwistStamped instead of Twist')
    cmd_vel_topic: str = parameter('cmd_vel_topic', names.CMD_VEL, 'topic of the velocity commands')
    map_frame: str = parameter('map_frame', 'map', 'frame of the map')
    odom_frame: str = parameter('odom_frame', 'odom', 'frame of the odometry')
    base_frame: str = parameter('base_frame', 'base_link', 'frame of the robot')
    footprint_frame: str = parameter('footprint_frame', 'base_footprint', 'frame of the robot on the ground')
    scan_frame: str = parameter('scan_frame', Lidar.frame, 'frame of the lidar')

    def frame_of(self, device: Device) -> str:
        """Return the frame of a device."""
        return self.scan_frame if device.name == Lidar.name else device.frame

    @property
    def source(self) -> Path:
        """The file of the world."""
        return self.world or self.map

    def make_world(self) -> World:
        """Return the world as it is at the start.

        Raises:
            SimulationError: it cannot be made.
        """
        if self.world is not None:
            world = World.load(self.world, seed=self.seed or None)
            if not self.namespaces and len(world.robots) > 1:
                raise SimulationError(
                    f"parameter 'robot_namespaces' is false, and {self.world} has {len(world.robots)} robots: "
                    'several robots need a namespace each'
                )
            for fault in world.faults:
                check_fault(fault.parameters)
            return world
        world = World(load_map(self.map), seed=self.seed, step=STEP)
        try:
            world.add(ROBOT, self.robot, self.initial_pose)
        except SimulationError as error:
            raise SimulationError(f"parameter 'initial_pose': {error}") from None
        return world

    def namespace_of(self, robot: str) -> str:
        """Return what goes before the names of the topics of a robot: '' or 'robot1/'."""
        return f'{robot}/' if self.world is not None and self.namespaces else ''


def built_in_map() -> Path:
    """Return the included map."""
    return Path(get_package_share_directory('flexbt_sim')) / 'maps' / 'rooms.yaml'


def declare_simulator_parameters(node: Node) -> SimulatorParameters:
    """Declare the parameters on ``node`` and read them. ``speed_factor`` alone can be changed later.

    Raises:
        SimulationError, UnfitParameterError: a value that cannot work.
    """
    declare = ParameterDeclarer(node)
    factor = 'simulated seconds per second; 0 for as fast as possible'
    declare.real(SPEED_FACTOR, 1.0, 0.0, 1000.0, factor, read_only=False)
    world = declare.text('world', '', 'world file; empty for one robot on a map, as follows')
    pose = declare.reals(
        'initial_pose', [0.8, 4.45, 0.0], 'pose of the robot at the start and after a reset: m, m, rad'
    )
    if len(pose) != 3:
        raise SimulationError(f"parameter 'initial_pose': expected [x, y, yaw], got {pose}")
    map_file = Path(
        declare.text('map', '', 'YAML file of a ROS map; empty for the one that comes along') or built_in_map()
    )
    return declare.fields(
        SimulatorParameters(
            world=Path(world) if world else None,
            map=map_file,
            initial_pose=Pose(*pose),
            robot=_robot(declare),
            allowed_directories=(
                *declare.directories('allowed_directories', (), ALLOWED_DIRECTORIES_TEXT),
                (Path(world) if world else map_file).absolute().parent,
            ),
            initialpose_moves=not world,
        )
    )


def _robot(declare: ParameterDeclarer) -> RobotModel:
    """Return the model of the robot if there is no world file. Its battery never runs out."""
    drive, lidar = DriveModel(), LidarModel()
    least, greatest = (
        declare.real('scan_range_min', lidar.range_min, 0.0, 10.0, 'm'),
        declare.real('scan_range_max', lidar.range_max, 0.1, 100.0, 'm'),
    )
    if least >= greatest:
        raise SimulationError(f"parameter 'scan_range_min': {least:g} m is not below 'scan_range_max' {greatest:g} m")
    return RobotModel(
        footprint=Circle(declare.real('radius', 0.22, 0.01, 2.0, 'radius of the robot, m')),
        drive=DriveModel(
            linear_speed=declare.real('linear_speed', drive.linear_speed, 0.01, 10.0, 'greatest speed, m/s'),
            angular_speed=declare.real(
                'angular_speed', drive.angular_speed, 0.01, 20.0, 'greatest turning speed, rad/s'
            ),
            linear_acceleration=declare.real('linear_acceleration', drive.linear_acceleration, 0.01, 100.0, 'm/s²'),
            angular_acceleration=declare.real(
                'angular_acceleration', drive.angular_acceleration, 0.01, 100.0, 'rad/s²'
            ),
            watchdog=declare.real(
                'watchdog', drive.watchdog, 0.05, 10.0, 'time without a command after which it brakes, s'
            ),
        ),
        lidar=LidarModel(
            beams=declare.integer('scan_beams', lidar.beams, 1, 100_000, 'beams of the lidar'),
            range_min=least,
            range_max=greatest,
            noise=declare.real('scan_noise', lidar.noise, 0.0, 1.0, 'standard deviation of a range, m'),
            rate=declare.real('scan_rate', lidar.rate, 0.1, 50.0, 'rate of the scans, Hz of simulated time'),
        ),
        bumper=True,
        battery=BatteryModel(idle=0.0, driving=0.0),
    )
