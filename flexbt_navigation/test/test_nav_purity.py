# SPDX-License-Identifier: BSD-3-Clause
"""The algorithms of the servers are plain Python: nothing of ROS is loaded with them."""

from __future__ import annotations

import subprocess
import sys

PURE = (
    'flexbt_navigation.behaviors.motions',
    'flexbt_navigation.controller.motions',
    'flexbt_navigation.controller.path_follower',
    'flexbt_navigation.costmaps.costmap',
    'flexbt_navigation.costmaps.kernels',
    'flexbt_navigation.costmaps.layers',
    'flexbt_navigation.docking.motions',
    'flexbt_navigation.errors',
    'flexbt_navigation.navigator',
    'flexbt_navigation.planner.hybrid_kernels',
    'flexbt_navigation.planner.planners',
    'flexbt_navigation.planner.smoother',
    'flexbt_navigation.preparation',
    'flexbt_navigation.routes.edge_scorers',
    'flexbt_navigation.routes.graph',
    'flexbt_navigation.routes.route',
)
LISTING = 'import sys; print(*sorted({name.partition(".")[0] for name in sys.modules}))'


def test_what_is_pure_loads_nothing_of_ros() -> None:
    """Ask a fresh interpreter, since the contracts of the imports see no import that is made by a name."""
    command = [sys.executable, '-c', f'import {", ".join(PURE)}\n{LISTING}']
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    loaded = set(done.stdout.split())
    assert 'flexbt_navigation' in loaded
    assert not {one for one in loaded if one.endswith(('_msgs', '_srvs', '_interfaces'))}
    assert not loaded & {'rclpy', 'ament_index_python', 'flexbt_common', 'launch', 'tf2_ros'}
