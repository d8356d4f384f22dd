# SPDX-License-Identifier: BSD-3-Clause
"""Processes of a world: how one is started, and one with the interface of :class:`subprocess.Popen`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures.thread import _threads_queues
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from rclpy.executors import ExternalShutdownException

from flexbt_testing.system import fork_server, processes
from flexbt_testing.system.hold_up import hold_up

from . import rclpy_globals
from .product import end, terminate
from .scheduler import SCHEDULER, Process

if TYPE_CHECKING:
    from .programs import Program

_POLL_SECONDS = 0.005

rclpy_globals.install()  # before anything uses them


def launch(program: Program, arguments: Sequence[str], on_error: Callable[[BaseException], object]) -> Process:
    """Start a process that runs a program. ``on_error`` is called with what the program raises."""
    main = program.load()
    process = SCHEDULER.process(program.name)
    process.arguments = list(arguments)

    def body() -> None:
        code: object = 1
        try:
            code = main()
        except SystemExit as left:
            code = left.code
        except ExternalShutdownException as error:  # by which rclpy tells of SIGTERM
            on_error(error)
        except BaseException as error:
            on_error(error)
            raise
        finally:
            _join_threads(process)
            _call_at_exit(process)
            end(process, code if isinstance(code, int) else int(code is not None))

    SCHEDULER.spawn(body, 'MainThread', process)
    return process


def _join_threads(process: Process) -> None:
    """Wait for the threads that are no daemons, as the end of an interpreter does."""
    while threads := [
        task.thread
        for task in SCHEDULER.tasks
        if task.process is process and task is not SCHEDULER.current and task.thread and not task.thread.daemon
    ]:
        pool = threads[0]._args[0]() if threads[0] in _threads_queues else None
        if pool is not None:
            pool.shutdown(wait=False)
        threads[0].join()


def _call_at_exit(process: Process) -> None:
    """Call what the program has registered by ``atexit``, as the end of an interpreter does."""
    while process.at_exit:
        function, arguments, named = process.at_exit.pop()
        try:
            function(*arguments, **named)
        except BaseException:
            sys.stderr.write(f'a function at the exit of {process} has failed:\n{traceback.format_exc()}')


class _Streams:
    """A standard stream that writes to the log of the current process, if it has one, and otherwise to ``stream``."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(SCHEDULER.current.process.log or self._stream, name)


class StartedProcess:
    """A process of an installed executable, with what :class:`flexbt_testing.system.processes.Stack` uses of Popen."""

    def __init__(self, words: Sequence[str], log: int, environment: object, fifo: object, network: object) -> None:
        """``words`` are the path of the executable, ``PREFIX/lib/PACKAGE/NAME``, and its arguments.

        What it prints and logs goes to the file descriptor ``log``.

        Raises:
            ValueError: it shall have another environment, or a network of its own.
        """
        if environment is not None or network is not None:
            raise ValueError(f'{words[0]}: the processes of a world have the environment and the network of the test')
        from .programs import Program  # which imports much: most tests start no process

        file = Path(words[0])
        self._process = launch(Program(file.parent.name, file.name), words[1:], lambda _error: None)
        self._process.log = os.fdopen(os.dup(log), 'a', buffering=1, encoding='utf-8')
        for name in ('stdout', 'stderr'):
            stream = getattr(sys, name)
            if not isinstance(stream, _Streams):
                setattr(sys, name, _Streams(stream))
        self.pid = self._process.pid

    def poll(self) -> int | None:
        """Return the exit code; None while it runs."""
        return None if self._process.is_alive else self._process.exit_code

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code, at the end.

        Raises:
            subprocess.TimeoutExpired: it did not end within ``timeout`` seconds.
        """
        until = None if timeout is None else SCHEDULER.after(timeout)
        while (code := self.poll()) is None:
            if until is not None and SCHEDULER.now > until:
                raise subprocess.TimeoutExpired(str(self._process), timeout or 0.0)
            SCHEDULER.sleep(_POLL_SECONDS)
        return code

    def kill(self) -> None:
        """End it as SIGKILL does; no effect after its end."""
        if self._process.is_alive:
            end(self._process)

    def send_signal(self, number: int) -> None:
        """Send SIGSTOP, SIGCONT, SIGKILL, or a signal that ends it in order."""
        act: dict[int, Callable[[], Any]] = {
            signal.SIGSTOP: lambda: SCHEDULER.hold_up(self._process),
            signal.SIGCONT: lambda: SCHEDULER.resume(self._process),
            signal.SIGKILL: self.kill,
        }
        if self._process.is_alive:
            act.get(number, partial(terminate, self._process))()

    def hold_up(self, _fifo: object, method: str, seconds: float) -> None:
        """Make the next call of a method in this process take this much longer."""
        hold_up(method, seconds, lambda: SCHEDULER.current.process is self._process)


def install() -> None:
    """Let :class:`flexbt_testing.system.processes.Stack` start processes of the world."""
    for owner, name, stand_in in (
        (processes, '_start', StartedProcess),
        (processes, '_hold_up', StartedProcess.hold_up),
        (processes, '_thread_states', lambda _pid: iter(())),
        (fork_server, 'AVAILABLE', False),
    ):
        setattr(owner, name, stand_in)
