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
    """What the exit code of a command in line mode tells a script."""

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
    """The command is not written as it has to be."""

    exit_code = ExitCode.USAGE


class RefusedError(ConsoleError):
    """The command had no effect; the text says why."""

    exit_code = ExitCode.REFUSED


class NotShownError(RefusedError):
    """What a decision or a behavior is about was not received, so nothing was sent; an operator may insist."""


class NoAnswerError(ConsoleError):
    """The executive did not answer in time."""

    exit_code = ExitCode.TIMEOUT


class NoLinkError(ConsoleError):
    """No executive is heard, or it was lost."""

    exit_code = ExitCode.NO_LINK
