# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def night_watch() -> int:
    """See :mod:`flexbt_demo_night_watch.demonstration.main`; gives the exit code."""
    return run_main('flexbt_demo_night_watch.demonstration.main')
