# SPDX-License-Identifier: BSD-3-Clause
"""The console's errors and exit codes. Each error is one exit code of the line mode.

ConsoleError
├── UsageError      2  the command is not written as it has to be
├── RefusedError    3  the command had no effect: refused by the executive, or here before it was sent
│   └── NotShownError  it answers a decision, or starts a behavior, and what that is about was not received
├── NoAnswerError   4  no answer in time; it is not known whether the command had an effect
└── NoLinkError     5  no executive is heard
"""

from __future__ import annotations

from enum import IntEnum
from typing import ClassVar


class ExitCode(IntEnum):
    """The exit codes of commands in line mode, for scripts."""

    OK = 0
    FAULT = 1
    USAGE = 2
    REFUSED = 3
    TIMEOUT = 4
    NO_LINK = 5
    INTERRUPTED = 130


class ConsoleError(Exception):
    """Base of the console's errors; its text is fit for the operator."""

    exit_code: ClassVar[ExitCode] = ExitCode.FAULT


class UsageError(ConsoleError):
    """A command that is not written as it has to be."""

    exit_code = ExitCode.USAGE


class RefusedError(ConsoleError):
    """A command that had no effect; the text says why."""

    exit_code = ExitCode.REFUSED


class NotShownError(RefusedError):
    """The subject of a decision or a behavior was not received, so nothing was sent; an operator may insist."""


class NoAnswerError(ConsoleError):
    """An executive that did not answer in time."""

    exit_code = ExitCode.TIMEOUT


class NoLinkError(ConsoleError):
    """An executive that is not heard, or was lost."""

    exit_code = ExitCode.NO_LINK
