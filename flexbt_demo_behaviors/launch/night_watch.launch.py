# SPDX-License-Identifier: BSD-3-Clause
"""Start the building and both robots. The operator's consoles have terminals of their own:

ros2 launch flexbt_demo_behaviors night_watch.launch.py speed:=2.0
ros2 run flexbt_console console --namespace alpha
ros2 run flexbt_console console --namespace beta
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from flexbt_demo_behaviors.demonstration.launching import nodes_of, numbers, speed_argument
from flexbt_demo_behaviors.night_watch.processes import watch_processes


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of the process table, for the arguments of this launch."""
    return nodes_of(watch_processes(*numbers(context, 'speed')))


def generate_launch_description() -> LaunchDescription:
    """Describe the night watch to `ros2 launch`."""
    return LaunchDescription([speed_argument(), OpaqueFunction(function=nodes)])
