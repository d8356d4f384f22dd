# SPDX-License-Identifier: BSD-3-Clause
"""Processes of Python that run a program of a test, without the time that it takes to load what the program imports.

Their command line is that of the interpreter: ``-c TEXT ...``, ``-m MODULE ...`` or ``FILE ...``; their standard input
is empty. Each is a fork of a process that has imported what nodes share, and the modules ``preloaded``, where there are
such (:data:`.fork_server.AVAILABLE`).
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Final

from flexbt_testing.system import fork_server

PROGRAM: Final = 'flexbt_testing.system.python_program'


class ForkedPython(fork_server.ForkedProcess):
    """What of :class:`subprocess.Popen`, with pipes of text for what it says, is of use for a program of a test."""

    def __init__(self, arguments: Sequence[str], preloaded: Sequence[str] = ()) -> None:
        """As :func:`python_process`."""
        server = fork_server.fork_server(PROGRAM, *preloaded)
        pipes = [os.pipe(), os.pipe()]
        self.args = [sys.executable, *arguments]
        self.stdout, self.stderr = (os.fdopen(reader) for reader, _ in pipes)
        self._reader = ThreadPoolExecutor(len(pipes))
        self._said: list[Future[str]] = []
        try:
            pid = server.start(self.args, pipes[0][1], os.environ, errors=pipes[1][1])
        finally:
            for _, writer in pipes:
                os.close(writer)
        super().__init__(server, pid)

    def __enter__(self) -> ForkedPython:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Wait for the end, which is brought about when the block has failed."""
        if error is not None:
            self.kill()
        self._reader.shutdown()
        self.stdout.close()
        self.stderr.close()
        self.wait()

    def terminate(self) -> None:
        """Send SIGTERM, unless it has ended."""
        self.send_signal(signal.SIGTERM)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for the end; gives what it has said that was not read, and its errors.

        Raises:
            subprocess.TimeoutExpired: it did not end within ``timeout`` seconds.
        """
        if not self._said:
            self._said = [self._reader.submit(stream.read) for stream in (self.stdout, self.stderr)]
        self.wait(timeout)
        output, errors = (said.result() for said in self._said)
        return output, errors


PythonProcess = ForkedPython | subprocess.Popen[str]


def python_process(arguments: Sequence[str], preloaded: Sequence[str] = ()) -> PythonProcess:
    """Start one whose output and errors are read."""
    if fork_server.AVAILABLE:
        return ForkedPython(arguments, preloaded)
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def logged_python_process(
    arguments: Sequence[str], output: int, preloaded: Sequence[str] = ()
) -> fork_server.ForkedProcess | subprocess.Popen[bytes]:
    """Start one that writes output and errors to a file descriptor."""
    words = [sys.executable, *arguments]
    if fork_server.AVAILABLE:
        server = fork_server.fork_server(PROGRAM, *preloaded)
        return fork_server.ForkedProcess(server, server.start(words, output, os.environ))
    return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=output, stderr=output)
