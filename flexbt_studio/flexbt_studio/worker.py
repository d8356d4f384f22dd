# SPDX-License-Identifier: BSD-3-Clause
"""Processes that answer questions, one JSON line each, and can be ended when they do not.

A worker is a module with a function ``main`` that prints a line when it is ready, and then a line for each line that it
reads.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from typing import Any, Final

START_SECONDS: Final = 60.0
"""Time for a worker to be ready, s. It takes one second of a processor."""


class Worker:
    """A process that runs ``module``. It is started again after it has ended. Use it from one thread at a time."""

    def __init__(self, module: str) -> None:
        self._module = module
        self._process: subprocess.Popen[str] | None = None
        self._is_closed = False
        self._lock = threading.Lock()

    def close(self) -> None:
        """End the process for good. From any thread, also while another one starts it."""
        with self._lock:
            self._is_closed = True
        self._end()

    def start(self) -> None:
        """Start the process, so that the first answer is quick. Raises OSError."""
        with self._lock:
            if self._is_closed:
                raise OSError('the studio ends')
            if self._process is not None and self._process.poll() is None:
                return
            call = f'from {self._module} import main; main()'
            self._process = process = subprocess.Popen(  # noqa: S603
                [sys.executable, '-P', '-c', call],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                start_new_session=True,  # a Ctrl-C in the terminal is for its owner, which ends it
            )
        _line(process, START_SECONDS)

    def ask(self, question: dict[str, Any], seconds: float) -> dict[str, Any]:
        """Return the answer to a question. After this many ``seconds`` the process is ended. Raises OSError."""
        self.start()
        process = self._process
        if process is None or process.stdin is None:
            raise OSError('the studio ends')
        try:
            process.stdin.write(json.dumps(question) + '\n')
            process.stdin.flush()
            return dict(json.loads(_line(process, seconds)))
        except (OSError, ValueError):
            self._end()
            raise

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()


def _line(process: subprocess.Popen[str], seconds: float) -> str:
    """Return the next line of a process, which is ended if it writes none in time. Raises OSError."""
    assert process.stdout is not None
    limit = threading.Timer(seconds, process.kill)
    limit.start()
    try:
        line = process.stdout.readline()
    except ValueError as error:  # it was closed meanwhile
        raise OSError('it was ended') from error
    finally:
        limit.cancel()
    if not line:
        raise OSError(f'it gave no answer within {seconds:g} s, or has ended')
    return line
