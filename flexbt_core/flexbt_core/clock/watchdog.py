# SPDX-License-Identifier: BSD-3-Clause
"""A watchdog: what takes longer than it should is reported while it does."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

from .clock import Clock


@contextlib.contextmanager
def watchdog(clock: Clock, seconds: float, on_expired: Callable[[], object]) -> Iterator[None]:
    """Call ``on_expired()`` on the thread of ``clock`` when the block takes longer than ``seconds``; never after it."""
    lock = threading.Lock()
    has_ended = False

    def expire() -> None:
        with lock:
            if not has_ended:
                on_expired()

    timer = clock.call_at(clock.now() + seconds, expire)
    try:
        yield
    finally:
        timer.cancel()
        with lock:
            has_ended = True
