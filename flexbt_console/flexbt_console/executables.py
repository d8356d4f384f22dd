# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def console() -> int:
    """See :mod:`flexbt_console.ui.console`; gives the exit code."""
    return run_main('flexbt_console.ui.console')


def recorder() -> int:
    """See :mod:`flexbt_console.recording.recorder`; gives the exit code."""
    return run_main('flexbt_console.recording.recorder')


def replay() -> int:
    """See :mod:`flexbt_console.recording.replay`; gives the exit code."""
    return run_main('flexbt_console.recording.replay', raises_interrupt=True)
