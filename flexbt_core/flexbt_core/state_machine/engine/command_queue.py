# SPDX-License-Identifier: BSD-3-Clause
"""Commands to a run: given on any thread, applied on the thread of the run, each answered exactly once."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

Answer = Callable[['str | None'], None]
"""Told the fate of a command: None when it was applied, otherwise why it was refused."""


class CommandQueue:
    """Commands in the order in which they were given."""

    def __init__(self) -> None:
        self._commands: deque[tuple[Callable[[], str | None], Answer]] = deque()
        self._closed: str | None = None
        self._lock = threading.Lock()

    def put(self, apply: Callable[[], str | None], answer: Answer) -> None:
        """Keep a command; ``apply`` gives the refusal, or None. When it is too late it is answered at once."""
        with self._lock:
            closed = self._closed
            if closed is None:
                self._commands.append((apply, answer))
        if closed is not None:
            answer(closed)

    def apply_next(self) -> bool:
        """Apply the oldest command; False when there is none."""
        if not self._commands:
            return False
        apply, answer = self._commands.popleft()
        answer(apply())
        return True

    def refuse(self, reason: str) -> None:
        """Refuse what was given up to now; not what the answers bring about, so that it comes to an end."""
        for _ in range(len(self._commands)):
            _, answer = self._commands.popleft()
            answer(reason)

    def close(self, reason: str) -> None:
        """Refuse what was given and whatever will be, on the thread that gives it."""
        with self._lock:
            self._closed = reason
        self.refuse(reason)
