# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package, by their names: each loads its module when it is run."""

from flexbt_common.executables import run_main


def console() -> int:
    """Run :mod:`flexbt_console.ui.console`, and return the exit code."""
    return run_main('flexbt_console.ui.console')


def recorder() -> int:
    """Run :mod:`flexbt_console.recording.recorder`, and return the exit code."""
    return run_main('flexbt_console.recording.recorder')


def black_box() -> int:
    """Run :mod:`flexbt_console.recording.black_box`, and return the exit code."""
    return run_main('flexbt_console.recording.black_box')


def replay() -> int:
    """Run :mod:`flexbt_console.recording.replay`, and return the exit code."""
    return run_main('flexbt_console.recording.replay', raises_interrupt=True)
