# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``onboard_executive``: the onboard behavior executive as a ROS 2 node."""

from __future__ import annotations

import sys

from flexbt_common import names
from flexbt_common.node_runtime import NodeRuntime, run_node
from flexbt_onboard.executive import open_executive
from flexbt_onboard.executive_parameters import declare_parameters


def setup(runtime: NodeRuntime) -> None:
    """Make the executive from the parameters of the node."""
    parameters = runtime.call(lambda: declare_parameters(runtime.node))
    executive = open_executive(runtime, parameters)
    runtime.node.get_logger().info(f'ready; behaviors: {", ".join(executive.library.entries) or "none installed"}')


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; gives the exit code of the process."""
    return run_node(names.ONBOARD_EXECUTIVE, setup, args)


if __name__ == '__main__':
    sys.exit(main())
