# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def behavior_tool() -> int:
    """See :mod:`flexbt_tools.cli.behavior_tool`; gives the exit code."""
    return run_main('flexbt_tools.cli.behavior_tool', raises_interrupt=True)


def bt_tool() -> int:
    """See :mod:`flexbt_tools.cli.bt_tool`; gives the exit code."""
    return run_main('flexbt_tools.cli.bt_tool', raises_interrupt=True)


def security_policy() -> int:
    """See :mod:`flexbt_tools.cli.security_policy`; gives the exit code."""
    return run_main('flexbt_tools.cli.security_policy')
