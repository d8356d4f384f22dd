# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

import sys

from flexbt_common.executables import NODE_BYTES, run_main

SIMULATION_BYTES = 2_000_000_000
"""Of address space, which these take beside the compiler of their loops."""

SWITCH_INTERVAL = 0.001
"""After so many seconds a thread that computes, such as one that plans, lets the next one go on that wants to: the one
that drives the robots, or moves the world. With Python's own 5 ms these would be late by as much."""


def simulator() -> int:
    """See :mod:`flexbt_sim.simulator.node`; gives the exit code."""
    return _run_threads('flexbt_sim.simulator.node')


def navigation() -> int:
    """See :mod:`flexbt_sim.nodes.navigation_servers`; gives the exit code."""
    return _run_threads('flexbt_sim.nodes.navigation_servers')


def simulation() -> int:
    """See :mod:`flexbt_sim.simulation`; gives the exit code."""
    return _run_threads('flexbt_sim.simulation')


def lifecycle_manager() -> int:
    """See :mod:`flexbt_sim.nodes.lifecycle_manager`; gives the exit code."""
    return run_main('flexbt_sim.nodes.lifecycle_manager', address_space=NODE_BYTES)


def _run_threads(module: str) -> int:
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_main(module, address_space=SIMULATION_BYTES)


def world_tool() -> int:
    """See :mod:`flexbt_sim.world_tool`; gives the exit code."""
    return run_main('flexbt_sim.world_tool')
