# SPDX-License-Identifier: BSD-3-Clause
"""A thread whose work a disk may hold up."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Callable
from queue import SimpleQueue

from flexbt_core.clock.clock import ManualClock, Timer
from flexbt_core.clock.work_thread import LateWork, WorkThread
from flexbt_testing.waiting import DEADLINE


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
    assert told.get(timeout=DEADLINE) == LateWork('a file was not read', 2.0, uses_processor=False)
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


class NoThreads(ManualClock):
    """A clock that has no thread for its timers."""

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        raise RuntimeError('no thread')


def test_work_is_done_also_while_there_is_no_thread_to_watch_it() -> None:
    faults: list[BaseException] = []
    done: list[str] = []
    worker = WorkThread('worker', NoThreads(), 2.0, lambda late: None, faults.append)
    worker.submit(lambda: done.append('work'), 'work')
    assert worker.is_done_within(DEADLINE)
    assert done == ['work'] and {str(fault) for fault in faults} == {'no thread'}
    worker.close()


def test_late_work_is_told_again_and_again_and_whether_it_uses_the_processor() -> None:
    clock = ManualClock()
    told: SimpleQueue[LateWork | None] = SimpleQueue()
    worker = WorkThread('worker', clock, 1.0, told.put, lambda _error: None)
    works = [True, False, False, True]
    steps = [threading.Event() for _ in works]
    worked = threading.Semaphore(0)

    def work() -> None:
        """Between two looks either uses the processor, or not."""
        for is_at_work, step in zip(works, steps, strict=True):
            until = time.thread_time() + (0.03 if is_at_work else 0.0)
            while time.thread_time() < until:
                pass
            worked.release()
            assert step.wait(DEADLINE)

    worker.submit(work, 'a file was not read')
    for number, (is_at_work, step) in enumerate(zip(works, steps, strict=True), 1):
        assert worked.acquire(timeout=DEADLINE)
        clock.advance(1.0)
        assert told.get(timeout=DEADLINE) == LateWork('a file was not read', number, uses_processor=is_at_work)
        step.set()
    assert told.get(timeout=DEADLINE) is None
    worker.close()
