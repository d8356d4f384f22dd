# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def goals() -> int:
    """See :mod:`flexbt_demo_goals.demonstration.main`; gives the exit code."""
    return run_main('flexbt_demo_goals.demonstration.main')
