# SPDX-License-Identifier: BSD-3-Clause
"""What code of a world may not do: reach the network, other processes and files outside, which no seed decides.

Only the processes of a world are watched, not the test. Python tells such actions to an audit hook (PEP 578), before
they happen.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any, Final, NoReturn

from .scheduler import SCHEDULER, Process

_PROGRAM: Final = (
    "start it by world.launch('package/executable') if it is a ROS program in Python, else call a function"
)
_SIGNAL: Final = 'world.kill or world.terminate in the test, or sys.exit() for the end of the own process'
_TOPIC: Final = 'a topic or service of a node that the test makes, or a function that the test replaces'
INSTEAD: Final = {
    'socket.connect': _TOPIC,
    'socket.getaddrinfo': _TOPIC,
    'socket.gethostbyname': _TOPIC,
    'socket.bind': f'{_TOPIC}; servers and clients of asyncio stay in the world',
    'socket.sendto': _TOPIC,
    'socket.sendmsg': _TOPIC,
    'subprocess.Popen': _PROGRAM,
    'os.system': _PROGRAM,
    'os.posix_spawn': _PROGRAM,
    'os.exec': _PROGRAM,
    'os.fork': _PROGRAM,
    'os.forkpty': _PROGRAM,
    'os.spawn': _PROGRAM,
    'os.kill': _SIGNAL,
    'os.killpg': _SIGNAL,
}
_FILES: Final = 'the home directory of the world (Path.home()), or tmp_path of the test'
_CHANGES: Final = {
    'os.chmod': (0, 2),
    'os.link': (1, 3),
    'os.mkdir': (0, 2),
    'os.remove': (0, 1),
    'os.rename': (0, 2),
    'os.rmdir': (0, 1),
    'os.symlink': (1, 2),
    'os.truncate': (0, None),
}
"""Calls that change a file or directory: the places of its name, and of the open directory to which it is relative."""

_WRITES: Final = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class OutsideWorldError(RuntimeError):
    """Code of a world has tried to leave it."""


class Boundary:
    """The boundary of the current world."""

    def __init__(self) -> None:
        self._test: Process | None = None
        self._folders: tuple[str, ...] = ()
        self.crossings: list[str] = []
        """What was stopped, a line each."""
        self._is_hooked = False

    def close_around(self, folders: list[Path]) -> None:
        """Begin to watch all processes but the current one. Their files may be in these folders."""
        self._test, self._folders, self.crossings = (
            SCHEDULER.current.process,
            tuple(f'{folder}/' for folder in folders),
            [],
        )
        if not self._is_hooked:
            self._is_hooked = True
            sys.addaudithook(self._check)

    def open(self) -> None:
        """Watch nothing until the next world."""
        self._test = None

    @property
    def is_inside(self) -> bool:
        """True if the code that runs is of a program of the world, not of the test."""
        return self._test is not None and SCHEDULER.current.process is not self._test

    def _check(self, event: str, arguments: tuple[Any, ...]) -> None:
        if (event != 'open' and event not in INSTEAD and event not in _CHANGES) or not self.is_inside:
            return
        if event == 'open':
            if not self._may_open(*arguments):
                self.stop(f'opens {arguments[0]!r} for writing', _FILES)
        elif event in INSTEAD or not self._may_change(event, arguments):
            self.stop(f'calls {event} {_text(arguments)}', INSTEAD.get(event, _FILES))

    def stop(self, what: str, instead: str) -> NoReturn:
        """Stop code that would leave the world.

        Raises:
            OutsideWorldError: always; it says what to use instead.
        """
        process = SCHEDULER.current.process
        if self.is_inside:
            self.crossings.append(f'{process.name} {what}')
        raise OutsideWorldError(f'{process.name} {what}: not in a simulated world. Use instead: {instead}')

    def _may_open(self, path: Any, mode: Any, flags: Any) -> bool:
        is_written = isinstance(flags, int) and flags & _WRITES
        if not is_written or not isinstance(path, str | bytes):
            return True
        return self._is_own(os.fsdecode(path))

    def _may_change(self, event: str, arguments: tuple[Any, ...]) -> bool:
        name, directory = _CHANGES[event]
        path, above = arguments[name], -1 if directory is None else arguments[directory]
        if not isinstance(path, str | bytes):  # an open file
            return True
        file = os.fsdecode(path)
        if above not in (None, -1):
            file = str(Path(f'/proc/self/fd/{above}').readlink() / file)
        return self._is_own(file) or (event == 'os.mkdir' and Path(file).is_dir())

    def _is_own(self, file: str) -> bool:
        return file == os.devnull or '__pycache__' in file or str(Path(file).absolute()).startswith(self._folders)


def _text(arguments: tuple[Any, ...]) -> str:
    return ' '.join(repr(one) for one in arguments if isinstance(one, str | bytes | list | tuple))[:200]


BOUNDARY: Final = Boundary()
