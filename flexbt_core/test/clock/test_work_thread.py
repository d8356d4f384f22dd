# SPDX-License-Identifier: BSD-3-Clause
"""A thread whose work a disk may hold up."""

from __future__ import annotations

import gc
import threading
import weakref
from queue import SimpleQueue

from flexbt_core.clock import ManualClock, WorkThread

DEADLINE = 60.0


class Unwanted:
    """Work that is not to be done."""

    def __call__(self) -> None:
        raise AssertionError('it was taken back')


def test_work_is_done_in_order_late_work_is_told_and_what_was_taken_back_is_let_go() -> None:
    clock = ManualClock()
    told: SimpleQueue[str] = SimpleQueue()
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
    assert told.get(timeout=DEADLINE) == 'a file was not read'
    let_go = weakref.ref(kept)
    del kept
    take_back()
    take_back()
    gc.collect()
    assert let_go() is None and worker.waiting == 2
    assert not worker.is_done_within(0.0)
    goes.set()
    assert worker.is_done_within(DEADLINE)
    assert told.get(timeout=DEADLINE) == '' and told.empty()
    assert done == ['hung', 'last'] and [str(fault) for fault in faults] == ['of the work']
    worker.close()
    worker.submit(lambda: done.append('after the end'), 'after the end')
    assert worker.waiting == 0
