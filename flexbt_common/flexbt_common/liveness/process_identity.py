# SPDX-License-Identifier: BSD-3-Clause
"""Which process of which computer somebody is; and, on the same computer, whether it has ended."""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_BOOT_ID: Final = Path('/proc/sys/kernel/random/boot_id')
_PID_NAMESPACE: Final = Path('/proc/self/ns/pid')
_STATE, _START_TIME = 0, 19  # fields 3 and 22 of proc_pid_stat(5), counted after the name


@dataclass(frozen=True)
class ProcessIdentity:
    """``host`` is the computer, since it was switched on, and the namespace in which ``pid`` is valid; '' when that is
    not known. ``began`` tells the process from others that had or will have its number.
    """

    host: str
    pid: int
    began: str

    @staticmethod
    def own() -> ProcessIdentity:
        """That of this process."""
        pid = os.getpid()
        try:
            return _own(pid)
        except OSError:  # no Linux
            return ProcessIdentity('', pid, '')

    @property
    def is_here(self) -> bool:
        """Whether it can be told if this process has ended: it is of this computer."""
        return bool(self.host) and self.host == ProcessIdentity.own().host

    def has_ended(self) -> bool:
        """Whether the process has ended for certain."""
        if not self.is_here:
            return False
        try:
            fields = _stat(str(self.pid))
        except (FileNotFoundError, ProcessLookupError):
            return True
        except OSError:  # it cannot be told: this process has no file descriptor left, for one
            return False
        return fields[_START_TIME] != self.began or fields[_STATE] in ('Z', 'X')


@functools.lru_cache(maxsize=1)
def _own(pid: int) -> ProcessIdentity:
    """By the number of the process: a fork has another one, and is another process."""
    host = f'{_BOOT_ID.read_text().strip()} {_PID_NAMESPACE.readlink()}'
    return ProcessIdentity(host, pid, _stat('self')[_START_TIME])


def _stat(process: str) -> list[str]:
    # The name of the program is in brackets, and may hold anything.
    return Path('/proc', process, 'stat').read_text().rpartition(')')[2].split()
