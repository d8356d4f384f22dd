# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for what a test wants to see, with a deadline."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, Final

DEADLINE: Final = 20.0
"""Seconds within which what a test waits for has to happen, on a busy machine too."""


def wait_until(condition: Callable[[], Any], what: Any = 'the condition', deadline: float = DEADLINE) -> Any:
    """The first true value of the condition, which is asked again and again for ``deadline`` seconds.

    Raises:
        AssertionError: there was none in time; the text names ``what`` (which is called for it, if it can be).
    """
    end = time.monotonic() + deadline
    pause = threading.Event()
    while not (value := condition()):
        assert time.monotonic() < end, f'not within {deadline:g} s: {what() if callable(what) else what}'
        pause.wait(0.002)
    return value
