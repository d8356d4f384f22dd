# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for what a test wants to see, with a deadline; and a clock for what has to be fast."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

DEADLINE: Final = 60.0
"""Seconds within which what a test waits for has to happen, on a busy machine too."""

_PRESSURE: Final = Path('/proc/pressure/cpu')


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


def uncontended_time() -> float:
    """Seconds on a monotonic clock that stands still while anything on this machine waits for a processor.

    A limit measured by it is one for what is tested, and says nothing of how busy the machine was: it is strict on an
    idle machine and lenient on a busy one. The source are Linux' pressure stall information ("some" of the processors,
    `Documentation/accounting/psi.rst`); where the kernel does not give it the clock always stands still.
    """
    try:
        waited = _PRESSURE.read_text().partition('total=')[2].partition('\n')[0]
        return time.monotonic() - 1e-6 * int(waited)
    except OSError:
        return 0.0
