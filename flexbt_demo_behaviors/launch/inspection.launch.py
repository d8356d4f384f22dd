# SPDX-License-Identifier: BSD-3-Clause
"""Start what the behavior Inspection needs: a BT server, an executive, and the executive of the inspector.

ros2 launch flexbt_demo_behaviors inspection.launch.py
ros2 run flexbt_console console start Inspection site=gate --wait
"""

from launch import LaunchDescription
from launch_ros.actions import Node

from flexbt_demo_behaviors.demonstration.launching import RESPAWN


def generate_launch_description() -> LaunchDescription:
    """Describe the three levels to `ros2 launch`."""
    common = {'output': 'screen', **RESPAWN}
    executive = {'package': 'flexbt_onboard', 'executable': 'onboard_executive', **common}
    return LaunchDescription(
        [
            Node(package='flexbt_server', executable='bt_server', **common),
            Node(**executive, parameters=[{'peers': ['bt_server', 'inspector/onboard_executive']}]),
            Node(**executive, namespace='inspector', parameters=[{'peers': ['']}]),
        ]
    )
