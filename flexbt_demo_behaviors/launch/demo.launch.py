# SPDX-License-Identifier: BSD-3-Clause
"""Start simulator, navigation, BT server and executive. The operator's console has a terminal of its own:

ros2 launch flexbt_demo_behaviors demo.launch.py speed:=2.0
ros2 run flexbt_console console
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexbt_demo_behaviors.demonstration import DemoSettings, built_in_places, demo_processes


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes of the process table, for the arguments of this launch."""
    map, places = (LaunchConfiguration(name).perform(context) for name in ('map', 'places'))
    settings = DemoSettings(
        map=map,
        places=places or ('' if map else built_in_places()),
        speed=float(LaunchConfiguration('speed').perform(context)),
    )
    autostart = {'autostart': LaunchConfiguration('autostart').perform(context).lower() == 'true'}
    return [
        Node(
            package=process.package,
            executable=process.executable,
            name=process.name,
            namespace=LaunchConfiguration('namespace'),
            parameters=[dict(process.parameters), autostart],
            output='screen',
            respawn=True,  # one that died; not for ever
            respawn_delay=1.0,
            respawn_max_retries=5,
        )
        for process in demo_processes(settings)
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the demonstration to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('map', default_value='', description='ROS map YAML file; empty for the built-in map'),
            DeclareLaunchArgument('places', default_value='', description='YAML file of the places of the map'),
            DeclareLaunchArgument('speed', default_value='1.0', description='seconds of simulated time in one second'),
            DeclareLaunchArgument('autostart', default_value='true', description='false: wait for a lifecycle manager'),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of all nodes'),
            OpaqueFunction(function=nodes),
        ]
    )
