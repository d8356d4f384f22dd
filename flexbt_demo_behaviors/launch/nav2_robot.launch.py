# SPDX-License-Identifier: BSD-3-Clause
"""Start the warehouse, the robot and its program. The operator's console has a terminal of its own:

ros2 launch flexbt_demo_behaviors nav2_robot.launch.py speed:=2.0
ros2 run flexbt_console console
"""

from launch import LaunchDescription

from flexbt_demo_behaviors.demonstration.launching import launch_at_speed
from flexbt_demo_behaviors.nav2_robot.main import PROGRAM, robot_processes


def generate_launch_description() -> LaunchDescription:
    """Describe the demonstration to `ros2 launch`."""
    return launch_at_speed(robot_processes, [PROGRAM])
