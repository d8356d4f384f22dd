# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the tooling.

WorkspaceError            what went wrong, and the remedy
└── CommandError          a command ended with an error: with the last lines of its log
"""

from __future__ import annotations

from pathlib import Path


class WorkspaceError(Exception):
    """Something that the person at the terminal has to know: `message`, and what to do about it in `remedy`."""

    def __init__(self, message: str, remedy: str = '') -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy


class CommandError(WorkspaceError):
    """A command ended with exit code `code`; its output is in the file `log`."""

    def __init__(self, what: str, code: int, log: Path, remedy: str = '') -> None:
        ending = f'was killed by signal {-code}' if code < 0 else f'ended with exit code {code}'
        super().__init__(f'{what} {ending}', remedy)
        self.code = code
        self.log = log

    def tail(self, lines: int = 25) -> list[str]:
        """The last lines of the log."""
        return self.log.read_text(encoding='utf-8', errors='replace').splitlines()[-lines:]
