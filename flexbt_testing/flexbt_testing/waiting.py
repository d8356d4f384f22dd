# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for conditions with a deadline, and a clock for tests of speed."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

DEADLINE: Final = 60.0
"""Time limit for the events that a test waits for, s; long enough for a busy machine."""

RESEND_SECONDS: Final = 2.0
"""Time after which a message without an answer is sent again, s of wall time."""

MESSAGE_BYTES: Final = 2_000
"""Maximum size of the poses and velocities that are read, bytes."""

_SHORTEST_PAUSE: Final = 0.002
_LONGEST_PAUSE: Final = 0.01

_PRESSURE: Final = Path('/proc/pressure/cpu')
_STATISTICS: Final = Path('/proc/stat')


def wait_until(
    condition: Callable[[], Any], what: Any = 'the condition', deadline: float = DEADLINE, every: float = 0.0
) -> Any:
    """Poll the condition for up to ``deadline`` seconds, and return its first true value.

    A condition that has taken long to come true is polled less often: the measured time is accurate to one percent, and
    the waiting thread leaves the processors to the awaited one. So is one that takes long to ask, such as a command.
    ``every`` is the least time between two looks, s, for a condition that makes others work.

    An IndexError counts as false, so a condition may look at the last message before any has arrived.

    Raises:
        AssertionError: the condition was not true in time; the text contains ``what`` (or its result, if callable).
    """
    start = time.monotonic()
    pause = threading.Event()
    while True:
        value, asked = None, time.monotonic()
        with suppress(IndexError):
            value = condition()
        if value:
            return value
        now = time.monotonic()
        waited = now - start
        assert waited < deadline, f'not within {deadline:g} s: {what() if callable(what) else what}'
        pause.wait(max(min(max(0.01 * waited, _SHORTEST_PAUSE), _LONGEST_PAUSE), now - asked, every))


@contextmanager
def held(runtime: Any) -> Iterator[None]:
    """Hold the executor of a NodeRuntime during a ``with`` block, as a callback that takes long does."""
    reached, free = threading.Event(), threading.Event()
    runtime.post(reached.set)
    runtime.post(lambda: free.wait(DEADLINE))
    assert reached.wait(DEADLINE), 'the executor does not get to it'
    try:
        yield
    finally:
        free.set()


def uncontended_time() -> float:
    """Return the seconds on a clock that stands still, or goes back, while anything on this machine waits for a
    processor.

    A limit on this clock tests the code, regardless of the load of the machine: it is strict on an idle machine and
    lenient on a busy one.

    It has two sources. One is Linux' pressure stall information ("some" of the processors,
    `Documentation/accounting/psi.rst`). The other is the time that a hypervisor took from processors with work ("steal"
    in `/proc/stat`, see `proc_stat(5)`), which pressure does not include; if it takes time from several processors at
    once, each counts. On a kernel without pressure information the clock always stands still.
    """
    return time.monotonic() - contended_time()


def processor_time() -> float:
    """Return the processor time of this process, s.

    Unlike ``time.process_time``, it goes on in a simulated world, where computing takes no time.
    """
    used = os.times()
    return used.user + used.system


def contended_time() -> float:
    """Return the seconds for which :func:`uncontended_time` has stood still so far.

    The difference between two moments is the delay to allow for events that depend on the clock of a simulation.
    """
    try:
        waited = _PRESSURE.read_text().partition('total=')[2].partition('\n')[0]
        with _STATISTICS.open() as statistics:
            stolen = statistics.readline().split()[8]
        return 1e-6 * int(waited) + int(stolen) / os.sysconf('SC_CLK_TCK')
    except OSError:
        return time.monotonic()
