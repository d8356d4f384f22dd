# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def demo() -> int:
    """See :mod:`flexbt_demo_behaviors.navigate.main`; gives the exit code."""
    return run_main('flexbt_demo_behaviors.navigate.main')


# The executables of the package, by their names: each loads its module when it is run.


def goals() -> int:
    """See :mod:`flexbt_demo_behaviors.goals.main`; gives the exit code."""
    return run_main('flexbt_demo_behaviors.goals.main')


# The executables of the package, by their names: each loads its module when it is run.


def deliveries() -> int:
    """See :mod:`flexbt_demo_behaviors.nav2_robot.deliveries`; gives the exit code."""
    return run_main('flexbt_demo_behaviors.nav2_robot.deliveries', raises_interrupt=True)


def nav2_robot() -> int:
    """See :mod:`flexbt_demo_behaviors.nav2_robot.main`; gives the exit code."""
    return run_main('flexbt_demo_behaviors.nav2_robot.main')


# The executables of the package, by their names: each loads its module when it is run.


def night_watch() -> int:
    """See :mod:`flexbt_demo_behaviors.night_watch.watch`; gives the exit code."""
    return run_main('flexbt_demo_behaviors.night_watch.watch')
