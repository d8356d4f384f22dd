# SPDX-License-Identifier: BSD-3-Clause
"""Start the operator's page for a browser, on the operator's computer, and what calls people, with a file of rules for
that (``alerts``). The screen has a terminal of its own:

ros2 launch flexbt_bringup operator.launch.py namespace:=robot1
ros2 run flexbt_console console --namespace /robot1
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def page(context: LaunchContext) -> list[Node]:
    """Return the processes that serve the page and call people, for the arguments of this launch."""
    command = ['web']
    for name, option in (('namespace', '--robot'), ('port', '--port'), ('address', '--address')):
        value = LaunchConfiguration(name).perform(context)
        command += [option, value] if value else []
    if LaunchConfiguration('slow_link').perform(context).lower() == 'true':
        command.append('--slow-link')
    again = {'respawn': True, 'respawn_delay': 2.0, 'respawn_max_retries': 5}
    commands = [command]
    if alerts := LaunchConfiguration('alerts').perform(context):
        commands.append(['alerts', alerts])
    return [
        Node(package='flexbt_console', executable='console', arguments=one, output='screen', **again)
        for one in commands
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the operator's computer to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='a robot; empty for every one found'),
            DeclareLaunchArgument('port', default_value='8465', description='port of the page'),
            DeclareLaunchArgument('address', default_value='127.0.0.1', description='address to listen at'),
            DeclareLaunchArgument('alerts', default_value='', description='file of rules: call people about robots'),
            DeclareLaunchArgument('slow_link', default_value='false', description='true: show no scan'),
            OpaqueFunction(function=page),
        ]
    )
