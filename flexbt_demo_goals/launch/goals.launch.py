# SPDX-License-Identifier: BSD-3-Clause
"""Start the flat and the robot. The operator's console has a terminal of its own:

ros2 launch flexbt_demo_goals goals.launch.py speed:=2.0
ros2 run flexbt_console console
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexbt_demo_goals.demonstration import robot_processes


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes of the process table, for the arguments of this launch."""
    return [
        Node(
            package=process.package,
            executable=process.executable,
            name=process.name,
            parameters=[dict(process.parameters)],
            output='screen',
        )
        for process in robot_processes(float(LaunchConfiguration('speed').perform(context)))
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the demonstration to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('speed', default_value='1.0', description='seconds of simulated time in one second'),
            OpaqueFunction(function=nodes),
        ]
    )
