# SPDX-License-Identifier: BSD-3-Clause
"""Start what FlexBT runs on a robot: BT server, executive, stop guard and black box. Nav2 runs beside them.

ros2 launch flexbt_bringup robot.launch.py params_file:=/home/me/robot.yaml
ros2 launch flexbt_bringup robot.launch.py navigators:="[navigate_to_pose, navigate_through_poses]"
"""

from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory('flexbt_bringup')) / 'config' / 'robot.yaml'


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes, for the arguments of this launch."""
    given = yaml.safe_load(LaunchConfiguration('navigators').perform(context)) or []
    navigators = [given] if isinstance(given, str) else given
    simulated = LaunchConfiguration('use_sim_time').perform(context).lower() == 'true'
    records = LaunchConfiguration('black_box').perform(context).lower() == 'true'
    # What is not given here is as in the file, which it would override.
    files = [LaunchConfiguration('params_file')]
    timed = [*files, {'use_sim_time': True}] if simulated else files
    served = [{'navigators': [str(name) for name in navigators]}] if navigators else []
    common = {
        'namespace': LaunchConfiguration('namespace'),
        'output': 'screen',
        'respawn': True,
        'respawn_delay': 2.0,
        'respawn_max_retries': 5,
        'remappings': [('/tf', 'tf'), ('/tf_static', 'tf_static')],
    }
    return [
        Node(package='flexbt_server', executable='bt_server', parameters=[*timed, *served], **common),
        Node(package='flexbt_onboard', executable='onboard_executive', parameters=timed, **common),
        Node(package='flexbt_onboard', executable='stop_guard', parameters=files, **common),
        *([Node(package='flexbt_console', executable='black_box', parameters=files, **common)] if records else []),
    ]


def generate_launch_description() -> LaunchDescription:
    """Describe the robot to `ros2 launch`."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='namespace of the robot'),
            DeclareLaunchArgument('params_file', default_value=str(CONFIG), description='YAML file of parameters'),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='false',
                choices=['true', 'false', 'True', 'False'],
                description='true if a simulation publishes /clock; false: as in params_file',
            ),
            DeclareLaunchArgument(
                'navigators',
                default_value='[]',
                description='actions of bt_navigator and waypoint_follower to serve in their place, one or a YAML '
                'list; []: those in params_file',
            ),
            DeclareLaunchArgument(
                'black_box',
                default_value='true',
                choices=['true', 'false', 'True', 'False'],
                description='keep the last minutes, and write an incident when something goes wrong',
            ),
            OpaqueFunction(function=nodes),
        ]
    )
