# SPDX-License-Identifier: BSD-3-Clause
"""World and navigation are plain Python: nothing of ROS is loaded with them."""

from __future__ import annotations

import subprocess
import sys

PURE = ('world', 'costmaps', 'navigation', 'routes', 'docking')
LISTING = 'import sys; print(*sorted({name.partition(".")[0] for name in sys.modules}))'


def test_what_is_pure_loads_nothing_of_ros() -> None:
    """In a fresh interpreter, since the contracts of the imports see none that is made by a name."""
    command = [sys.executable, '-c', f'import {", ".join(f"flexbt_sim.{room}" for room in PURE)}\n{LISTING}']
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    loaded = set(done.stdout.split())
    assert 'flexbt_sim' in loaded
    assert not {one for one in loaded if one.endswith(('_msgs', '_srvs', '_interfaces'))}
    assert not loaded & {'rclpy', 'ament_index_python', 'flexbt_common', 'launch', 'tf2_ros'}
