# SPDX-License-Identifier: BSD-3-Clause
"""The core of the simulator knows nothing of ROS."""

from __future__ import annotations

import subprocess
import sys

CORE = (
    'costmap',
    'errors',
    'geometry',
    'lidar',
    'motions',
    'occupancy_map',
    'pacing',
    'path_follower',
    'placement',
    'planner',
    'robot',
    'track',
)


def test_the_core_imports_no_ros() -> None:
    program = f"""
import sys
sys.modules['rclpy'] = None
for name in {CORE!r}:
    __import__('flexbt_sim.' + name)
assert not [name for name in sys.modules if name.endswith('_msgs')]
"""
    subprocess.run([sys.executable, '-c', program], check=True)
