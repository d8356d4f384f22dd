# SPDX-License-Identifier: BSD-3-Clause
"""What takes longer than it should, told while it does."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

from .clock import Clock


@contextlib.contextmanager
def told_when_late(clock: Clock, seconds: float, tell: Callable[[], object]) -> Iterator[None]:
    """Call ``tell()`` on the thread of ``clock`` when the block takes longer than ``seconds``; never after its end."""
    lock = threading.Lock()
    has_ended = False

    def late() -> None:
        with lock:
            if not has_ended:
                tell()

    timer = clock.call_at(clock.now() + seconds, late)
    try:
        yield
    finally:
        timer.cancel()
        with lock:
            has_ended = True
