# SPDX-License-Identifier: BSD-3-Clause
"""Start simulator, navigation, BT server and executive. The operator's console has a terminal of its own:

ros2 launch flexbt_demo_behaviors demo.launch.py speed:=2.0
ros2 run flexbt_console console
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexbt_demo_behaviors.demonstration.demo_processes import (
    DemoSettings,
    built_in_places,
    demo_processes,
    first_place,
)
from flexbt_demo_behaviors.demonstration.launching import nodes_of, numbers, speed_argument, text


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of the process table, for the arguments of this launch."""
    map, places = text(context, 'map'), text(context, 'places')
    (speed,) = numbers(context, 'speed')
    start = first_place(places) if map and places else None
    return nodes_of(
        demo_processes(DemoSettings(map, start, places or ('' if map else built_in_places()), speed)),
        {'autostart': text(context, 'autostart').lower() == 'true'},
        namespace=LaunchConfiguration('namespace'),
    )


def generate_launch_description() -> LaunchDescription:
    """Describe the demonstration to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('map', default_value='', description='ROS map YAML file; empty for the built-in map'),
            DeclareLaunchArgument(
                'places',
                default_value='',
                description='YAML file of named places; on a map of your own, the robot starts at the first of them',
            ),
            speed_argument(),
            DeclareLaunchArgument(
                'autostart',
                default_value='true',
                choices=['true', 'false', 'True', 'False'],
                description='false: wait for a lifecycle manager',
            ),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of all nodes'),
            OpaqueFunction(function=nodes),
        ]
    )
