# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package. Each function imports its module only when called."""

from flexbt_common.executables import run_main


def demo() -> int:
    """Run :mod:`flexbt_demo_behaviors.navigate.main` and return the exit code."""
    return run_main('flexbt_demo_behaviors.navigate.main')


# The executables of the package, by their names: each loads its module when it is run.


def goals() -> int:
    """Run :mod:`flexbt_demo_behaviors.goals.main` and return the exit code."""
    return run_main('flexbt_demo_behaviors.goals.main')


# The executables of the package, by their names: each loads its module when it is run.


def deliveries() -> int:
    """Run :mod:`flexbt_demo_behaviors.nav2_robot.deliveries` and return the exit code."""
    return run_main('flexbt_demo_behaviors.nav2_robot.deliveries', raises_interrupt=True)


def nav2_robot() -> int:
    """Run :mod:`flexbt_demo_behaviors.nav2_robot.main` and return the exit code."""
    return run_main('flexbt_demo_behaviors.nav2_robot.main')


# The executables of the package, by their names: each loads its module when it is run.


def night_watch() -> int:
    """Run :mod:`flexbt_demo_behaviors.night_watch.watch` and return the exit code."""
    return run_main('flexbt_demo_behaviors.night_watch.watch')
