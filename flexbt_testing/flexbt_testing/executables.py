# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package. Each function imports its module only when called."""

from flexbt_common.executables import run_main


def nemesis() -> int:
    """Run :mod:`flexbt_testing.one_process.nemesis` and return the exit code."""
    return run_main('flexbt_testing.one_process.nemesis')
