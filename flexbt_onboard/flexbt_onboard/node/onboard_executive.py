# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``onboard_executive``: the onboard behavior executive as a ROS 2 node."""

from __future__ import annotations

import sys

from flexbt_common import names
from flexbt_common.lifecycle import run_managed_node
from flexbt_common.runtime import NodeRuntime

from .executive import Executive, open_executive
from .executive_parameters import declare_parameters
from .unconfigured_executive import UnconfiguredExecutive


def configure(runtime: NodeRuntime, refusal: str) -> Executive:
    """Make the executive from the parameters of the node."""
    parameters = runtime.call(lambda: declare_parameters(runtime.node))
    executive = open_executive(runtime, parameters, refusal=refusal)
    runtime.node.get_logger().info(f'configured; behaviors: {", ".join(executive.library.entries) or "none installed"}')
    return executive


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; gives the exit code of the process."""
    return run_managed_node(
        names.ONBOARD_EXECUTIVE, configure, args, UnconfiguredExecutive, declare_parameters, __doc__
    )


if __name__ == '__main__':
    sys.exit(main())
