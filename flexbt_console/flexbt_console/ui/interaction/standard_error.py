# SPDX-License-Identifier: BSD-3-Clause
"""What others write to the terminal, such as the log of the middleware, as lines of our own."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

from flexbt_core.values import one_line

LINE_BYTES = 4_000
"""Of a line at most; what is more begins another one."""


class _Terminal(io.FileIO):
    def write(self, data: Any) -> int:
        """Where nothing can be written any more it is lost: an error would end Textual's thread that writes, and who
        has 30 things to write afterwards waits for that thread for ever."""
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


@contextlib.contextmanager
def standard_error_as_lines(tell: Callable[[str], object]) -> Iterator[None]:
    """In the context, what is written to the standard error of the process is told line by line, from any thread.

    Textual draws there, by ``sys.__stderr__``, which leads to the terminal all the same.
    """
    before = sys.__stderr__
    reading, writing = os.pipe()
    # The middleware logs with the interpreter's lock, without which nobody reads: what is too much at once is lost.
    os.set_blocking(writing, False)
    with io.TextIOWrapper(io.BufferedWriter(_Terminal(os.dup(2), 'w')), encoding='utf-8', errors='replace') as terminal:
        sys.__stderr__ = terminal  # type: ignore[misc]  # which Textual does not let one set
        os.dup2(writing, 2)
        os.close(writing)
        reader = threading.Thread(target=_read, args=(reading, tell), name='standard_error', daemon=True)
        reader.start()
        try:
            yield
        finally:
            os.dup2(terminal.fileno(), 2)  # the end of the pipe
            sys.__stderr__ = before  # type: ignore[misc]
    reader.join()


def _read(pipe: int, tell: Callable[[str], object]) -> None:
    with os.fdopen(pipe, 'rb') as lines:
        while line := lines.readline(LINE_BYTES):
            if text := line.decode(errors='replace').rstrip('\n'):
                tell(one_line(text))
