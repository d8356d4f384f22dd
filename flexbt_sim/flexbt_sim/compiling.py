# SPDX-License-Identifier: BSD-3-Clause
"""``python3 -m flexbt_sim.compiling`` has numba compile all loops, and keep them for the processes that come.

The set-up of the workspace runs it. Without it the first processes compile them, each for itself.
"""

from __future__ import annotations

from flexbt_sim.costmaps import Inflation
from flexbt_sim.navigation import Steering, prepare_navigation
from flexbt_sim.world import box, prepare_world

if __name__ == '__main__':
    prepare_world()
    prepare_navigation()
    prepare_navigation(inflation=Inflation.of(box(1.0, 0.5)))
    prepare_navigation(Steering(turning_radius=0.1))
