# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the tooling.

WorkspaceError            what went wrong, and the remedy
└── CommandError          a command ended with an error: with the last lines of its log
"""

from __future__ import annotations

import errno
import os
import shlex
import shutil
from pathlib import Path

_FREE_SPACE = 'free disk space, then run the same command again'


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
        super().__init__(f'{what} {ending}', remedy if code > 0 else 'run the same command again')
        self.code = code
        self.log = log
        self.disk_was_full = os.strerror(errno.ENOSPC) in '\n'.join(self.tail()) or _is_full(log.parent)
        if self.disk_was_full:
            self.message += ': the disk is full'
            self.remedy = _FREE_SPACE

    @property
    def was_killed(self) -> bool:
        """Whether a signal ended it, so that it could not clean up after itself."""
        return self.code < 0

    def tail(self, lines: int = 25) -> list[str]:
        """Return the last lines of the log."""
        return self.log.read_text(encoding='utf-8', errors='replace').splitlines()[-lines:]


def of_system(error: OSError, root: Path) -> WorkspaceError:
    """Return what the operating system refused to the tooling of the workspace at `root`, with what usually mends
    it."""
    what = f'{error.filename or root}: {error.strerror or error}'
    if error.errno in (errno.EACCES, errno.EPERM):
        return WorkspaceError(what, write_remedy(root))
    if error.errno == errno.EROFS:
        return WorkspaceError(what, 'clone to a file system that can be written to')
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return WorkspaceError(what, _FREE_SPACE)
    return WorkspaceError(what)


def _is_full(directory: Path) -> bool:
    """Return when it is, a log there may lack the words that say so."""
    return shutil.disk_usage(directory).free < 1_000_000


def write_remedy(root: Path) -> str:
    """Return what makes the workspace at `root` writable."""
    return f'sudo chown -R "$(id -u)" {shlex.quote(str(root))}   (or clone to a place of your own)'
