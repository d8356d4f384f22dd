# SPDX-License-Identifier: BSD-3-Clause
"""The operator's console as a process, and what a command of its line mode answers.

Each is a fork of a process that has loaded what every command needs (:mod:`.python_process`). Tests that are about the
beginning of a console start the executable itself.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from collections.abc import Iterator
from typing import Any, Final

from flexbt_testing.system.fork_server import ForkedProcess
from flexbt_testing.system.python_process import PythonProcess, logged_python_process, python_process

COMMAND: Final = ('-m', 'flexbt_console')
"""How the interpreter runs it."""

LOADED: Final = ('flexbt_console.link', 'flexbt_console.ui.line')
"""What each command needs that asks an executive."""

_DEADLINE: Final = 120.0


def start_console(*words: str) -> PythonProcess:
    """Start one with this command line, whose output is read."""
    return python_process([*COMMAND, *words], LOADED)


@contextlib.contextmanager
def silent_console(*words: str) -> Iterator[ForkedProcess | subprocess.Popen[bytes]]:
    """One that stays, and whose output nobody reads; it is killed at the end of the block."""
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
        AssertionError: it did not end in time; tells what each of its threads was doing.
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
    """What a command answers, from JSON; None for nothing.

    Raises:
        AssertionError: it has not ended with ``exit_code``.
    """
    done = run_console(*words, '--json', '--timeout', '60')
    assert done.returncode == exit_code, done
    return json.loads(done.stdout) if done.stdout else None
