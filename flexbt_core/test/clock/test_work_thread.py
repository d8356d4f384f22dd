# SPDX-License-Identifier: BSD-3-Clause
"""A thread whose work a disk may hold up."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from queue import SimpleQueue

from flexbt_core.clock import LateWork, ManualClock, WorkThread

DEADLINE = 60.0


class Unwanted:
    """Work that is not to be done."""

    def __call__(self) -> None:
        raise AssertionError('it was taken back')


def test_work_is_done_in_order_late_work_is_told_and_what_was_taken_back_is_let_go() -> None:
    clock = ManualClock()
    told: SimpleQueue[LateWork | None] = SimpleQueue()
    faults: list[BaseException] = []
    done: list[str] = []
    hangs, goes, kept = threading.Event(), threading.Event(), Unwanted()
    worker = WorkThread('worker', clock, 2.0, told.put, faults.append)

    def hang() -> None:
        hangs.set()
        assert goes.wait(DEADLINE)
        done.append('hung')

    def raises() -> None:
        raise SystemExit('of the work')

    worker.submit(hang, 'a file was not read')
    assert hangs.wait(DEADLINE)
    take_back = worker.submit(kept, 'taken back')
    worker.submit(raises, 'raises')
    worker.submit(lambda: done.append('last'), 'last')
    assert worker.waiting == 3
    clock.advance(1.9)
    assert told.empty()
    clock.advance(0.2)
    assert told.get(timeout=DEADLINE) == LateWork('a file was not read', 2.0, is_slow=False)
    let_go = weakref.ref(kept)
    del kept
    take_back()
    take_back()
    gc.collect()
    assert let_go() is None and worker.waiting == 2
    assert not worker.is_done_within(0.0)
    goes.set()
    assert worker.is_done_within(DEADLINE)
    assert told.get(timeout=DEADLINE) is None and told.empty()
    assert done == ['hung', 'last'] and [str(fault) for fault in faults] == ['of the work']
    worker.close()
    worker.submit(lambda: done.append('after the end'), 'after the end')
    assert worker.waiting == 0


def test_work_that_uses_the_processor_is_slow_until_it_waits_or_takes_far_too_long() -> None:
    clock = ManualClock()
    told: SimpleQueue[LateWork | None] = SimpleQueue()
    worker = WorkThread('worker', clock, 1.0, told.put, lambda _error: None)
    steps = [threading.Event() for _ in range(15)]
    worked = threading.Semaphore(0)

    def work(rests: set[int]) -> None:
        """Between two looks either uses the processor, or not."""
        for number, step in enumerate(steps):
            until = time.thread_time() + (0.0 if number in rests else 0.03)
            while time.thread_time() < until:
                pass
            worked.release()
            assert step.wait(DEADLINE)

    def lateness(rests: set[int]) -> list[LateWork]:
        for step in steps:
            step.clear()
        worker.submit(lambda: work(rests), 'a file was not read')
        for step in steps:
            assert worked.acquire(timeout=DEADLINE)
            clock.advance(1.0)
            step.set()
        assert worker.is_done_within(DEADLINE)
        *late, end = (told.get(timeout=DEADLINE) for _ in range(told.qsize()))
        assert end is None and None not in late
        return [each for each in late if each is not None]

    def is_slow(seconds: float) -> LateWork:
        return LateWork('a file was not read', seconds, is_slow=True)

    def hangs(seconds: float) -> LateWork:
        return LateWork('a file was not read', seconds, is_slow=False)

    assert lateness(rests={3, 4}) == [is_slow(1.0), hangs(4.0), is_slow(6.0), hangs(12.0)]
    assert lateness(rests=set()) == [is_slow(1.0), hangs(12.0)]
    worker.close()
