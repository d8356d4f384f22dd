# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def deliveries() -> int:
    """See :mod:`flexbt_demo_nav2_robot.program.deliveries`; gives the exit code."""
    return run_main('flexbt_demo_nav2_robot.program.deliveries', raises_interrupt=True)


def nav2_robot() -> int:
    """See :mod:`flexbt_demo_nav2_robot.demonstration.main`; gives the exit code."""
    return run_main('flexbt_demo_nav2_robot.demonstration.main')
