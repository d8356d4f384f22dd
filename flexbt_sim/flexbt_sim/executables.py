# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def simulator() -> int:
    """See :mod:`flexbt_sim.simulator.node`; gives the exit code."""
    return run_main('flexbt_sim.simulator.node')


def navigation() -> int:
    """See :mod:`flexbt_sim.nodes.navigation_servers`; gives the exit code."""
    return run_main('flexbt_sim.nodes.navigation_servers')


def simulation() -> int:
    """See :mod:`flexbt_sim.simulation`; gives the exit code."""
    return run_main('flexbt_sim.simulation')


def world_tool() -> int:
    """See :mod:`flexbt_sim.world_tool`; gives the exit code."""
    return run_main('flexbt_sim.world_tool')
