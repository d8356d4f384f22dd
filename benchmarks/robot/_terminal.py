# SPDX-License-Identifier: BSD-3-Clause
"""A terminal without a window, and what is written to it."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import struct
import termios
import threading
import time
from typing import Any, Final

_ESCAPES: Final = re.compile(rb'\x1b(?:\[[0-?]*[ -/]*[@-~]|\][^\x07\x1b]*(?:\x07|\x1b\\)|[ -/]*[0-~])')


class Terminal:
    """``streams`` are for the process that is to run in it, as subprocess takes them; then comes :meth:`begin`."""

    def __init__(self, rows: int = 30, columns: int = 100) -> None:
        self._file, self._other = os.openpty()
        fcntl.ioctl(self._other, termios.TIOCSWINSZ, struct.pack('HHHH', rows, columns, 0, 0))
        self.streams: dict[str, Any] = {
            **dict.fromkeys(('stdin', 'stdout', 'stderr'), self._other),
            'env': {**os.environ, 'TERM': 'xterm-256color'},
        }
        self._keeps = True
        self._pieces: list[tuple[float, bytes]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)

    def begin(self, *, keeps: bool = True) -> None:
        """Read what is written, and keep it or not."""
        self._keeps = keeps
        os.close(self._other)
        self._reader.start()

    def close(self) -> None:
        """Close the terminal of a process that has ended."""
        self._reader.join()
        os.close(self._file)

    def _read(self) -> None:
        with contextlib.suppress(OSError):  # the process is gone
            while data := os.read(self._file, 65536):
                if self._keeps:
                    self._pieces.append((time.monotonic(), data))

    def type(self, keys: bytes) -> None:
        """Press keys."""
        os.write(self._file, keys)

    def forget(self) -> None:
        """Keep nothing of what was written, nor of what is."""
        self._keeps = False
        self._pieces.clear()

    @property
    def written(self) -> bytes:
        """All that was written so far."""
        return b''.join(data for _, data in self._pieces)

    @property
    def text(self) -> str:
        """The same without what places and colours it."""
        return _ESCAPES.sub(b'', self.written).decode(errors='replace')

    def shown_at(self, text: str, begin: float = 0.0) -> float | None:
        """When, by the monotonic clock, a text was first written that is in what came after a time; None: never."""
        shown = b''
        for when, data in list(self._pieces):
            if when >= begin:
                shown += data
                if text.encode() in _ESCAPES.sub(b'', shown):
                    return when
        return None
