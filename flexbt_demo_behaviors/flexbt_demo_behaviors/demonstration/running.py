# SPDX-License-Identifier: BSD-3-Clause
"""From the start of a demonstration's program to its exit code: domain, environment, processes, signals, errors."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from flexbt_console.errors import ConsoleError
from flexbt_core.values import lines

from .process_group import ProcessGroup
from .report import DemoError
from .ros_domain import NoFreeDomainError, own_domain
from .session import set_environment


class Interrupted(BaseException):
    """The user, or the system, wants the demonstration to end."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


def run_demonstration(program: str, logs: Path, interactive: bool, run: Callable[[ProcessGroup, int], int]) -> int:
    """Call `run` with a group of processes, whose logs are in a directory, and the ROS domain that they are in.

    Gives the exit code of the process: that of `run`, or 1 after an error, which is told in the name of `program`.
    Asked to end by a signal, an interactive demonstration has done what it should; a script has not come to its end.
    All processes have ended then.
    """
    _raise_on_signals()
    try:
        with own_domain() as domain:
            set_environment()
            with ProcessGroup(logs) as group:
                try:
                    return run(group, domain)
                finally:
                    _ignore_signals()
    except (DemoError, ConsoleError, NoFreeDomainError, OSError, LookupError) as error:
        print(*lines(f'{program}: {error}'), sep='\n', file=sys.stderr)
        return 1
    except Interrupted as interruption:
        return 0 if interactive else 128 + interruption.number


def _raise_on_signals() -> None:
    def interrupt(number: int, _frame: FrameType | None) -> None:
        _ignore_signals()  # the end has begun; a second signal must not break it off
        raise Interrupted(number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)


def _ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
