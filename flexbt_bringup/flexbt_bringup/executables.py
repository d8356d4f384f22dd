# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the package: it loads its module when it is run."""

from flexbt_common.executables import run_main


def flexbt() -> int:
    """See :mod:`flexbt_bringup.cli`; gives the exit code."""
    return run_main('flexbt_bringup.cli', raises_interrupt=True)
