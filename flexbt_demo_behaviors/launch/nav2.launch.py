# SPDX-License-Identifier: BSD-3-Clause
"""Start a simulated robot for Nav2's clients: simulator, navigation, and a BT server with navigators.

ros2 launch flexbt_demo_behaviors nav2.launch.py map:=/home/me/map.yaml initial_pose:="[1.0, 2.0, 0.0]"
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

NAVIGATORS = ['navigate_to_pose', 'navigate_through_poses', 'follow_waypoints']


def nodes(context: LaunchContext) -> list[Node]:
    """The nodes, for the arguments of this launch."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ('map', 'initial_pose', 'trees')}
    simulator: dict[str, object] = {'speed_factor': float(LaunchConfiguration('speed').perform(context))}
    if given['map']:
        simulator['map'] = given['map']
    if given['initial_pose']:
        simulator['initial_pose'] = [float(number) for number in given['initial_pose'].strip('[] ').split(',')]
    server: dict[str, object] = {'navigators': NAVIGATORS, 'allowed_directories': [given['trees']]}
    common = {'namespace': LaunchConfiguration('namespace'), 'output': 'screen'}
    simulated = {'use_sim_time': True}
    return [
        Node(package='flexbt_sim', executable='simulator', name='simulator', parameters=[simulator], **common),
        Node(package='flexbt_sim', executable='navigation', name='navigation', parameters=[simulated], **common),
        Node(
            package='flexbt_server', executable='bt_server', name='bt_server', parameters=[simulated, server], **common
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the robot to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('map', default_value='', description='ROS map YAML file; empty for the built-in map'),
            DeclareLaunchArgument('initial_pose', default_value='', description='x, y, yaw; empty for that of the map'),
            DeclareLaunchArgument(
                'trees', default_value='', description='directory from which goals may name XML files'
            ),
            DeclareLaunchArgument('speed', default_value='1.0', description='seconds of simulated time in one second'),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of all nodes'),
            OpaqueFunction(function=nodes),
        ]
    )
