# SPDX-License-Identifier: BSD-3-Clause
"""A process that sends the robot along the corridor and waits, until somebody kills it. Usage: goal_giver.py NAME."""

from __future__ import annotations

import sys

from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_testing.nodes.sim_world import DOCK, RobotProbe, line


def main() -> int:
    """Return the node NAME says on stdout when its goal is accepted."""

    def setup(runtime: NodeRuntime) -> None:
        LivelinessToken(runtime)
        goal = RobotProbe(runtime).follow(line(DOCK, (11.2, 4.45)))
        goal.accepted.wait()
        print('accepted', flush=True)

    return run_node(sys.argv[1], setup, [])


if __name__ == '__main__':
    sys.exit(main())
