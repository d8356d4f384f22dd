# SPDX-License-Identifier: BSD-3-Clause
"""Whether the threads of a process answer: what is told of it, in which order."""

from __future__ import annotations

import threading
from collections.abc import Callable

from flexbt_common.runtime import Health
from flexbt_common.runtime.health import LATE_SECONDS, PERIOD
from flexbt_core.clock import ManualClock


def test_an_answer_that_comes_while_lateness_is_told_is_told_after_it() -> None:
    """Otherwise the process would be late for others for ever."""
    clock = ManualClock()
    health = Health(clock)
    told: list[str] = []
    answers: list[Callable[[], None]] = []
    answering: list[threading.Thread] = []

    def tell(problem: str) -> None:
        if problem:  # the thread answers just now, and has time to be told before this is
            answering.append(threading.Thread(target=answers[-1]))
            answering[0].start()
            answering[0].join(0.5)
        told.append(problem)

    health.on_late(tell)
    health.register('the loop', answers.append)
    health.on_beat(lambda: None)
    while not told:
        clock.advance(PERIOD)
        assert clock.now() < LATE_SECONDS + 3 * PERIOD
    answering[0].join(60.0)
    assert [bool(problem) for problem in told] == [True, False]
