# SPDX-License-Identifier: BSD-3-Clause
"""Start the building and both robots. The operator's consoles have terminals of their own:

ros2 launch flexbt_demo_behaviors night_watch.launch.py speed:=2.0
ros2 run flexbt_console console --namespace alpha
ros2 run flexbt_console console --namespace beta
"""

from launch import LaunchDescription

from flexbt_demo_behaviors.demonstration.launching import launch_at_speed
from flexbt_demo_behaviors.night_watch.watch import watch_processes


def generate_launch_description() -> LaunchDescription:
    """Describe the night watch to `ros2 launch`."""
    return launch_at_speed(watch_processes)
