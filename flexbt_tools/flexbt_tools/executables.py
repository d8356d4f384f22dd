# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package. Each function imports its module only when called."""

from flexbt_common.executables import run_main


def behavior_tool() -> int:
    """Run :mod:`flexbt_tools.cli.behavior_tool` and return the exit code."""
    return run_main('flexbt_tools.cli.behavior_tool', raises_interrupt=True)


def bt_tool() -> int:
    """Run :mod:`flexbt_tools.cli.bt_tool` and return the exit code."""
    return run_main('flexbt_tools.cli.bt_tool', raises_interrupt=True)


def security_policy() -> int:
    """Run :mod:`flexbt_tools.cli.security_policy` and return the exit code."""
    return run_main('flexbt_tools.cli.security_policy')
