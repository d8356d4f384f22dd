# SPDX-License-Identifier: BSD-3-Clause
"""Start a simulated robot for Nav2's clients: simulator, navigation, and a BT server with navigators.

ros2 launch flexbt_demo_behaviors nav2.launch.py map:=/home/me/map.yaml initial_pose:="[1.0, 2.0, 0.0]"
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexbt_demo_behaviors.demonstration.demo_processes import ParameterValue, Process
from flexbt_demo_behaviors.demonstration.launching import nodes_of, numbers, speed_argument, text

NAVIGATORS = ('navigate_to_pose', 'navigate_through_poses', 'follow_waypoints')


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes, for the arguments of this launch."""
    (speed,) = numbers(context, 'speed')
    simulator: dict[str, ParameterValue] = {'speed_factor': speed}
    if map := text(context, 'map'):
        simulator['map'] = map
    if text(context, 'initial_pose'):
        simulator['initial_pose'] = tuple(numbers(context, 'initial_pose', 3))
    simulated: dict[str, ParameterValue] = {'use_sim_time': True}
    server = {**simulated, 'navigators': NAVIGATORS, 'allowed_directories': (text(context, 'trees'),)}
    robot = (
        Process('flexbt_sim', 'simulator', simulator),
        Process('flexbt_navigation', 'navigation', simulated),
        Process('flexbt_server', 'bt_server', server),
    )
    return nodes_of(robot, namespace=LaunchConfiguration('namespace'))


def generate_launch_description() -> LaunchDescription:
    """Describe the robot to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('map', default_value='', description='ROS map YAML file; empty for the built-in map'),
            DeclareLaunchArgument('initial_pose', default_value='', description='x, y, yaw; empty for that of the map'),
            DeclareLaunchArgument(
                'trees', default_value='', description='directory from which goals may name XML files'
            ),
            speed_argument(),
            DeclareLaunchArgument('namespace', default_value='', description='namespace of all nodes'),
            OpaqueFunction(function=nodes),
        ]
    )
