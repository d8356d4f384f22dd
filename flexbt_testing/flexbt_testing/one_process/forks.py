# SPDX-License-Identifier: BSD-3-Clause
"""Children of this process that go on with the world as it is now, each with files of its own.

With greenlets the whole world is one thread, so that a fork has all of it. It takes some milliseconds.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import random
import shutil
import signal
import tempfile
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn
from unittest import mock

from .disk import DISK
from .scheduler import SCHEDULER, USES_THREADS, Alarm


class ForkError(Exception):
    """A child has failed; the message has its traceback."""


class Fork:
    """A child that goes on with the world."""

    def __init__(self, pid: int, stream: BinaryIO) -> None:
        self._pid = pid
        self._stream = stream

    def result(self) -> Any:
        """Wait for the end of the child, and return its result, a copy. It can be asked for again.

        Raises:
            ForkError: the child has failed.
        """
        if not self._stream.closed:
            with self._stream:
                self._data = self._stream.read()
            self._exit_code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        if not self._data:
            raise ForkError(f'the child has ended without a result, with exit code {self._exit_code}')
        is_result, value = pickle.loads(self._data)  # noqa: S301 - from a child of this process
        if not is_result:
            raise ForkError(value)
        return value


class Leaf:
    """The side of a child: where it leaves its result."""

    def __init__(self, stream: BinaryIO, folder: Path) -> None:
        self._stream = stream
        self._folder = folder

    def end(self, act: Callable[[], Any]) -> NoReturn:
        """Call ``act``, hand its result to the parent, and end this process."""
        try:
            result = True, act()
            data = pickle.dumps(result)
        except BaseException:
            data = pickle.dumps((False, traceback.format_exc()))
        shutil.rmtree(self._folder, ignore_errors=True)
        try:
            self._stream.write(data)
            self._stream.flush()
        finally:
            os._exit(0)


@dataclass
class Branch:
    """A fork that is planned: its alarm, the side of this process once it is done, and how many events there were.

    ``is_over``: the change was made, or has failed. In the child only.
    """

    alarm: Alarm
    side: Fork | Leaf | None = None
    first: int = 0
    is_over: bool = False


def fork_process() -> int:
    """Return as ``os.fork`` does, in the middle of a world. Its files are those of the parent."""
    if USES_THREADS:
        raise RuntimeError('a world of real threads cannot be forked; unset FLEXBT_ONE_PROCESS')
    preemption, SCHEDULER.preemption = SCHEDULER.preemption, 0.0  # the standard library acquires locks in the child
    state = random.getstate()
    vars(threading)['_active'][SCHEDULER.current.id] = vars(threading)['_main_thread']  # it looks there
    pid = os.fork()
    if pid == 0:
        random.setstate(state)  # Python seeds it anew
    SCHEDULER.preemption = preemption
    return pid


def fork_world(folder: Path, descriptor: int) -> Fork | Leaf:
    """Fork this process; return the child, in the parent, or in the child, where it leaves its result.

    ``folder`` has the files of the world, ``descriptor`` is the open directory. The child gets a copy of them.
    """
    with mock.patch.object(SCHEDULER, 'current', SCHEDULER.main):  # an alarm calls this, on whatever task waits
        reader, writer = os.pipe()
        timer = signal.getitimer(signal.ITIMER_PROF)
        pid = fork_process()
        if pid == 0:
            os.close(reader)
            signal.setitimer(signal.ITIMER_PROF, timer[1], timer[1])
            copy = Path(tempfile.mkdtemp(prefix='flexbt_world_'))
            _copy_files(folder, descriptor, copy)
            DISK.move(folder, copy)
            os.write(writer, b'.')
            return Leaf(os.fdopen(writer, 'wb'), copy)
        os.close(writer)
        os.read(reader, 1)  # the files may change from here on
        return Fork(pid, os.fdopen(reader, 'rb'))


def _copy_files(folder: Path, descriptor: int, copy: Path) -> None:
    """Copy the files, and let all open ones of them, and the open directory, be those of the copy."""
    shutil.copytree(folder, copy, symlinks=True, dirs_exist_ok=True)
    for link in list(Path('/proc/self/fd').iterdir()):
        target = link.readlink() if link.is_symlink() else Path()
        if not target.is_relative_to(folder) or not (own := copy / target.relative_to(folder)).exists():
            continue
        before = int(link.name)
        flags = os.O_RDONLY if before == descriptor else fcntl.fcntl(before, fcntl.F_GETFL) & ~os.O_CREAT
        opened = os.open(own, flags)
        if own.is_file():
            os.lseek(opened, os.lseek(before, 0, os.SEEK_CUR), os.SEEK_SET)
        os.dup2(opened, before, inheritable=False)
        os.close(opened)
