# SPDX-License-Identifier: BSD-3-Clause
"""Start the warehouse, the robot and its program. The operator's console has a terminal of its own:

ros2 launch flexbt_demo_nav2_robot nav2_robot.launch.py speed:=2.0
ros2 run flexbt_console console
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexbt_demo_nav2_robot.demonstration import PROGRAM, robot_processes


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes of the process table, for the arguments of this launch; the program names its node itself."""
    speed = float(LaunchConfiguration('speed').perform(context))
    robot = [
        Node(
            package=process.package,
            executable=process.executable,
            name=process.name,
            parameters=[dict(process.parameters)],
            output='screen',
        )
        for process in robot_processes(speed)
    ]
    return [*robot, Node(package=PROGRAM.package, executable=PROGRAM.executable, output='screen')]


def generate_launch_description() -> LaunchDescription:
    """Describe the demonstration to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('speed', default_value='1.0', description='seconds of simulated time in one second'),
            OpaqueFunction(function=nodes),
        ]
    )
