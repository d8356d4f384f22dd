# SPDX-License-Identifier: BSD-3-Clause
"""Python processes for tests, forked with their imports loaded, among them the console in line mode.

Their command line is that of the interpreter: ``-c TEXT ...``, ``-m MODULE ...`` or ``FILE ...``. Their standard input
is empty. Each is a fork of a process that has imported what nodes share, and the modules ``preloaded``, where forks are
possible (:data:`.fork_server.AVAILABLE`).
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from types import TracebackType
from typing import Any, Final, TextIO

from . import fork_server
from .fork_server import ForkedProcess

PROGRAM: Final = 'flexbt_testing.system.python_program'


class ForkedPython(fork_server.ForkedProcess):
    """The useful part of :class:`subprocess.Popen` for a program of a test, with pipes of text for its output."""

    def __init__(self, arguments: Sequence[str], preloaded: Sequence[str] = ()) -> None:
        """Start the process, as :func:`python_process` does."""
        server = fork_server.fork_server(PROGRAM, *preloaded)
        pipes = [os.pipe(), os.pipe()]
        self.args = [sys.executable, *arguments]
        self.stdout, self.stderr = (os.fdopen(reader) for reader, _ in pipes)
        self._said: list[Future[str]] = []
        try:
            pid = server.start(self.args, pipes[0][1], os.environ, errors=pipes[1][1])
        except BaseException:
            self._close()
            raise
        finally:
            for _, writer in pipes:
                os.close(writer)
        super().__init__(server, pid)

    def __enter__(self) -> ForkedPython:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Wait for the end. If the block has failed, end the process first."""
        if error is not None:
            self.kill()
        self._close()
        self.wait()

    def terminate(self) -> None:
        """Send SIGTERM, unless the process has ended."""
        self.send_signal(signal.SIGTERM)

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """Wait for the end and return the unread output and errors.

        Raises:
            subprocess.TimeoutExpired: it, or a child process that can still write, did not end within
                ``timeout`` seconds.
        """
        if not self._said:
            self._said = [_read(stream) for stream in (self.stdout, self.stderr)]
        deadline = None if timeout is None else time.monotonic() + timeout
        self.wait(timeout)
        try:
            output, errors = (
                said.result(None if deadline is None else max(deadline - time.monotonic(), 0.0)) for said in self._said
            )
        except TimeoutError as error:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0) from error
        return output, errors

    def _close(self) -> None:
        """Close the streams that nothing reads. Closing the others would wait for processes that can still write."""
        being_read = [not said.done() for said in self._said] or [False, False]
        for stream, is_read in zip((self.stdout, self.stderr), being_read, strict=True):
            if not is_read:
                stream.close()


def _read(stream: TextIO) -> Future[str]:
    """Return a future of all output, read in a thread that does not keep this process alive."""
    said: Future[str] = Future()

    def read() -> None:
        try:
            with stream:
                text = stream.read()
        except (OSError, ValueError) as error:  # the text cannot be decoded
            said.set_exception(error)
        else:
            said.set_result(text)

    threading.Thread(target=read, daemon=True).start()
    return said


PythonProcess = ForkedPython | subprocess.Popen[str]


def python_process(arguments: Sequence[str], preloaded: Sequence[str] = ()) -> PythonProcess:
    """Start a process and capture its output and errors."""
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
    """Start a process that writes output and errors to a file descriptor."""
    words = [sys.executable, *arguments]
    if fork_server.AVAILABLE:
        server = fork_server.fork_server(PROGRAM, *preloaded)
        return fork_server.ForkedProcess(server, server.start(words, output, os.environ))
    return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=output, stderr=output)


# The operator's console as a process, and the answers of its line-mode commands.
#
# Each is a fork of a process that has loaded what every command needs (:mod:`.python_process`). Tests of the startup of
# a console run the executable itself.

COMMAND: Final = ('-m', 'flexbt_console')
"""Interpreter arguments that run the console."""

LOADED: Final = ('flexbt_console.link.operator_link', 'flexbt_console.ui.line.line_mode')
"""Modules needed by every command that queries an executive."""

_DEADLINE: Final = 120.0


def start_console(*words: str) -> PythonProcess:
    """Start a console with this command line, and capture its output."""
    return python_process([*COMMAND, *words], LOADED)


@contextlib.contextmanager
def silent_console(*words: str) -> Iterator[ForkedProcess | subprocess.Popen[bytes]]:
    """Provide a running console whose output nothing reads; kill it at the end of the block."""
    with open(os.devnull, 'wb') as nothing:  # noqa: PTH123
        process = logged_python_process([*COMMAND, *words], nothing.fileno(), LOADED)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def run_console(*words: str) -> subprocess.CompletedProcess[str]:
    """Run a command to its end.

    Raises:
        AssertionError: it did not end in time; the message shows what each of its threads was doing.
    """
    with start_console(*words) as process:
        try:
            output, errors = process.communicate(timeout=_DEADLINE)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGABRT)
            output, errors = process.communicate()
            raise AssertionError(f'{words} did not end in time\n{output}\n{errors}') from None
    assert process.returncode is not None
    return subprocess.CompletedProcess(words, process.returncode, output, errors)


def console_answer(*words: str, exit_code: int = 0) -> Any:
    """Return the answer of a command, parsed from JSON; None without an answer.

    Raises:
        AssertionError: it did not end with ``exit_code``.
    """
    done = run_console(*words, '--json', '--timeout', '60')
    assert done.returncode == exit_code, done
    return json.loads(done.stdout) if done.stdout else None
