# SPDX-License-Identifier: BSD-3-Clause
"""Start the warehouse, the robot and its program. The operator's console has a terminal of its own:

ros2 launch flexbt_demo_behaviors nav2_robot.launch.py speed:=2.0
ros2 run flexbt_console console
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from flexbt_demo_behaviors.demonstration.launching import nodes_of, numbers, speed_argument
from flexbt_demo_behaviors.nav2_robot.processes import PROGRAM, robot_processes


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of the process table, for the arguments of this launch.

    The program names its node itself, and is not started again: its end is that of its work.
    """
    robot = nodes_of(robot_processes(*numbers(context, 'speed')))
    return [*robot, Node(package=PROGRAM.package, executable=PROGRAM.executable, output='screen')]


def generate_launch_description() -> LaunchDescription:
    """Describe the demonstration to `ros2 launch`."""
    return LaunchDescription([speed_argument(), OpaqueFunction(function=nodes)])
