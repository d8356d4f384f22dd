# SPDX-License-Identifier: BSD-3-Clause
"""The executables of the package. Each function imports its module only when called."""

from flexbt_common.executables import run_main


def language_server() -> int:
    """Run :mod:`flexbt_studio.language_server` and return the exit code."""
    return run_main('flexbt_studio.language_server')


def studio() -> int:
    """Run :mod:`flexbt_studio.server.main` and return the exit code."""
    return run_main('flexbt_studio.server.main')
