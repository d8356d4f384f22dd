# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

import sys

from flexbt_common.executables import run_main

SIMULATION_BYTES = 2_000_000_000
"""Maximum address space of the simulator and navigation, bytes, including the compiler of their loops."""

SWITCH_INTERVAL = 0.001
"""Seconds after which a thread that computes, such as one that plans, lets the next one run: the one that drives the
robots, or moves the world. With Python's own 5 ms these would be late by as much."""


def simulator() -> int:
    """Run :mod:`flexbt_sim.simulator.node`, and return the exit code."""
    return run_threads('flexbt_sim.simulator.node')


def world_tool() -> int:
    """Run :mod:`flexbt_sim.world_tool`, and return the exit code."""
    return run_main('flexbt_sim.world_tool')


def run_threads(module: str) -> int:
    """Run a module whose threads compute beside others that must not be late, and return the exit code."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_main(module, address_space=SIMULATION_BYTES)
