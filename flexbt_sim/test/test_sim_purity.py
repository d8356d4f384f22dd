# SPDX-License-Identifier: BSD-3-Clause
"""The world is plain Python: nothing of ROS is loaded with it."""

from __future__ import annotations

import subprocess
import sys

PURE = ('flexbt_sim.world',)
LISTING = 'import sys; print(*sorted({name.partition(".")[0] for name in sys.modules}))'


def test_what_is_pure_loads_nothing_of_ros() -> None:
    """Ask a fresh interpreter, since the contracts of the imports see no import that is made by a name."""
    command = [sys.executable, '-c', f'import {", ".join(PURE)}\n{LISTING}']
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    loaded = set(done.stdout.split())
    assert 'flexbt_sim' in loaded
    assert not {one for one in loaded if one.endswith(('_msgs', '_srvs', '_interfaces'))}
    assert not loaded & {'rclpy', 'ament_index_python', 'flexbt_common', 'launch', 'tf2_ros'}
