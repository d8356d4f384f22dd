# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for what a test wants to see, with a deadline; and a clock for what has to be fast."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

DEADLINE: Final = 60.0
"""Seconds within which what a test waits for has to happen, on a busy machine too."""

RESEND_SECONDS: Final = 2.0
"""Time after which a message without an answer is sent again, s of wall time."""

MESSAGE_BYTES: Final = 2_000
"""The greatest poses and velocities that are looked at."""

_SHORTEST_PAUSE: Final = 0.002
_LONGEST_PAUSE: Final = 0.01

_PRESSURE: Final = Path('/proc/pressure/cpu')
_STATISTICS: Final = Path('/proc/stat')


def wait_until(condition: Callable[[], Any], what: Any = 'the condition', deadline: float = DEADLINE) -> Any:
    """Return the first true value of the condition, which is asked again and again for ``deadline`` seconds.

    A condition that has taken long already is checked less often: the time is known to a hundredth, and the waiting
    thread leaves the processors to the awaited one.

    A condition may look at the last of what has come, although nothing has: an IndexError counts as false.

    Raises:
        AssertionError: there was none in time; the text names ``what`` (which is called for it, if it can be).
    """
    start = time.monotonic()
    pause = threading.Event()
    while True:
        value = None
        with suppress(IndexError):
            value = condition()
        if value:
            return value
        waited = time.monotonic() - start
        assert waited < deadline, f'not within {deadline:g} s: {what() if callable(what) else what}'
        pause.wait(min(max(0.01 * waited, _SHORTEST_PAUSE), _LONGEST_PAUSE))


def uncontended_time() -> float:
    """Seconds on a clock that stands still, or goes back, while anything on this machine waits for a processor.

    A limit measured by it is one for what is tested, and says nothing of how busy the machine was: it is strict on an
    idle machine and lenient on a busy one. The sources are Linux' pressure stall information ("some" of the processors,
    `Documentation/accounting/psi.rst`), and the time that a hypervisor took from processors that had work ("steal" in
    `/proc/stat`, see `proc_stat(5)`), of which the former does not know; several processors from which it takes at once
    count each. Where the kernel does not give pressure the clock always stands still.
    """
    return time.monotonic() - contended_time()


def contended_time() -> float:
    """Seconds in which :func:`uncontended_time` stood still, until now: from one moment to another one, as much as what
    is bound by the clock of a simulation may be late.
    """
    try:
        waited = _PRESSURE.read_text().partition('total=')[2].partition('\n')[0]
        with _STATISTICS.open() as statistics:
            stolen = statistics.readline().split()[8]
        return 1e-6 * int(waited) + int(stolen) / os.sysconf('SC_CLK_TCK')
    except OSError:
        return time.monotonic()
