# SPDX-License-Identifier: BSD-3-Clause
"""A search in a process of its own: however much it takes, the executive and its threads are spared.

The process is told the request by a line of JSON, and tells by lines of JSON what it does, and in the end its answer.
It ends when its standard input does, so none is left behind when the executive is gone.
"""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

_LINE: Final = 16_000_000
"""Bytes of a line of the process, at most."""

_GRACE: Final = 5.0
"""Seconds beyond its time limit that a process may take: it keeps the limit by itself, where it comes to look."""

SearchMessage = Mapping[str, Any]


class SearchProcess:
    """Runs a search. The callbacks are called on a thread of their own: ``on_progress`` with each line before the last,
    ``on_end`` exactly once, with the answer, or with None and why there is none ('' when it was canceled)."""

    def __init__(
        self,
        command: Sequence[str],
        request: Mapping[str, Any],
        seconds: float,
        on_progress: Callable[[SearchMessage], None],
        on_end: Callable[[SearchMessage | None, str], None],
    ) -> None:
        """``seconds`` of wall time are the limit of the search, without the start of the process."""
        self._command = command
        self._request = request
        self._seconds = seconds
        self._on_progress = on_progress
        self._on_end = on_end
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_canceled = False
        self._is_late = False
        self._thread = threading.Thread(target=self._run, name='synthesis', daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """End it. From any thread."""
        with self._lock:
            self._is_canceled = True
            self._kill()

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()

    def _run(self) -> None:
        answer: SearchMessage | None = None
        why = ''
        try:
            answer, why = self._searched()
        except (OSError, ValueError, RuntimeError) as error:  # the last: no thread is left for the timer
            why = f'the search cannot be run: {error}'
        if self._is_canceled:
            answer, why = None, ''
        self._on_end(answer, why)

    def _searched(self) -> tuple[SearchMessage | None, str]:
        # Without the lock: to start a process can take long, and the executor cancels.
        process = subprocess.Popen(  # noqa: S603 - the command is that of an installed package
            [*self._command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        with self._lock:
            self._process = process
            if self._is_canceled:
                self._kill()
        limit = threading.Timer(self._seconds + _GRACE, self._too_late)
        answer: SearchMessage | None = None
        try:
            limit.start()
            with contextlib.suppress(BrokenPipeError), process:
                assert process.stdin is not None and process.stdout is not None
                process.stdin.write(json.dumps(self._request).encode() + b'\n')
                process.stdin.flush()
                while answer is None and (line := process.stdout.readline(_LINE)):
                    told = json.loads(line)
                    if 'code' in told:
                        answer = told
                    else:
                        self._on_progress(told)
                self._kill()  # it has said all that is of use
        finally:
            limit.cancel()
            self._kill()
        return answer, '' if answer is not None else self._end_of(process.wait())

    def _too_late(self) -> None:
        self._is_late = True
        self._kill()

    def _end_of(self, code: int) -> str:
        if self._is_late:
            return f'no answer within {self._seconds:g} s; give it more time, or ask for less'
        how = f'was ended by {signal.Signals(-code).name}' if code < 0 else f'ended with exit code {code}'
        return f'the search {how} without an answer; was there too little memory? The log of the executive may say more'
