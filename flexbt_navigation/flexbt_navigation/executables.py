# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import NODE_BYTES, run_main
from flexbt_sim.executables import run_threads


def navigation() -> int:
    """Run :mod:`flexbt_navigation.node`, and return the exit code."""
    return run_threads('flexbt_navigation.node')


def simulation() -> int:
    """Run :mod:`flexbt_navigation.simulation`, and return the exit code."""
    return run_threads('flexbt_navigation.simulation')


def lifecycle_manager() -> int:
    """Run :mod:`flexbt_navigation.lifecycle_manager`, and return the exit code."""
    return run_main('flexbt_navigation.lifecycle_manager', address_space=NODE_BYTES)
