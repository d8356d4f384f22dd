# SPDX-License-Identifier: BSD-3-Clause
"""The errors and exit codes of ``bt_tool`` and ``behavior_tool``. Each error is one exit code.

::

    ToolError
    ├── UsageError      2  the command line is not valid, or this computer lacks a requirement
    ├── RefusedError    3  a file that is needed cannot be used
    └── UnfitError      3  files can be read, but their contents are inconsistent
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import ClassVar

from flexbt_core.behavior_tree.model.errors import LoadError


class ExitCode(IntEnum):
    """Exit codes for scripts."""

    OK = 0
    NEGATIVE = 1
    USAGE = 2
    REFUSED = 3
    NODE_ERROR = 4
    UNFINISHED = 5
    UNREACHABLE = 6
    INTERRUPTED = 130


class ToolError(Exception):
    """Base of the errors. The text is suitable for users."""

    exit_code: ClassVar[ExitCode]


class UsageError(ToolError):
    """The command is not valid as written, or cannot run on this computer."""

    exit_code = ExitCode.USAGE


def missing_package(wanted: str) -> UsageError:
    """Return the error for a feature of flexbt_formal when that package is not installed."""
    return UsageError(
        f'{wanted} needs the package flexbt_formal, which is not installed; install it beside flexbt_tools '
        '(colcon build --packages-up-to flexbt_formal)'
    )


class RefusedError(ToolError):
    """A required file cannot be used. ``errors`` contains the reasons and their places."""

    exit_code = ExitCode.REFUSED

    def __init__(self, errors: Iterable[LoadError]) -> None:
        self.errors = tuple(errors)
        super().__init__('\n'.join(map(str, self.errors)))


class UnfitError(ToolError):
    """Errors in files, or between them; each problem contains its place."""

    exit_code = ExitCode.REFUSED
