# SPDX-License-Identifier: BSD-3-Clause
"""The scheduler under a world: what ends with a world, what wakes whom, and who gets an error."""

from __future__ import annotations

import gc
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from flexbt_testing import lock_order
from flexbt_testing.one_process.scheduler import MOST_LOOKS, SCHEDULER, SECOND


def test_threads_of_a_former_world_never_run_again() -> None:
    """Their pool wakes them when it is collected, and locks and events that others still have do."""
    ran: list[str] = []
    SCHEDULER.reset(0)
    pool = ThreadPoolExecutor()
    assert pool.submit(ran.append, 'pool').result() is None
    event, lock = threading.Event(), threading.Lock()
    lock.acquire()
    for wait in (event.wait, lock.acquire):
        threading.Thread(target=lambda wait=wait: ran.append(f'{wait()}')).start()
    before = [*SCHEDULER.tasks]
    SCHEDULER.reset(0)
    event.set()
    lock.release()
    del pool
    gc.collect()
    time.sleep(1.0)
    assert ran == ['pool']
    assert not any(task.process.is_alive or task.is_ready for task in before)
    assert lock.acquire(timeout=1.0)


def test_any_number_of_tasks_may_start_each_other() -> None:
    ended: list[int] = []

    def start(number: int) -> None:
        if number < 2 * sys.getrecursionlimit():
            thread = threading.Thread(target=start, args=(number + 1,))
            thread.start()
            thread.join()
        ended.append(number)

    start(0)
    assert ended == [*range(2 * sys.getrecursionlimit(), -1, -1)]


def test_an_alarm_may_look_at_the_clock_while_a_task_that_polls_is_made_to_wait() -> None:
    began, woken = SCHEDULER.now, threading.Event()
    SCHEDULER.call_at(began + SECOND // 2000, time.monotonic)
    SCHEDULER.call_at(began + SECOND, woken.set)
    for _ in range(2 * MOST_LOOKS):
        time.monotonic()
    assert not woken.is_set()
    assert SCHEDULER.now < began + SECOND // 100


def test_threads_and_timers_tell_what_those_of_a_computer_tell() -> None:
    told: list[bool] = []
    timer = threading.Timer(0.5, told.append, [True])
    assert (timer.interval, timer.args, timer.kwargs) == (0.5, [True], {})
    timer.start()
    assert threading.main_thread() is threading.current_thread()
    timer.join()
    assert told == [True]
    with pytest.raises(ValueError, match='non-negative'):
        threading.Lock().acquire(timeout=-2)


def test_a_lock_that_is_polled_lets_its_owner_go_on() -> None:
    lock = threading.Lock()
    lock.acquire()
    threading.Timer(0.02, lock.release).start()
    for _ in range(100 * MOST_LOOKS):
        if lock.acquire(timeout=0):
            return
    pytest.fail('the clock stands still')


def test_a_lock_is_free_after_an_error_that_comes_together_with_it() -> None:
    lock = threading.Lock()
    lock.acquire()

    def release() -> None:
        lock.release()
        SCHEDULER.throw(ValueError('at that moment'))

    threading.Timer(1.0, release).start()
    with pytest.raises(ValueError, match='at that moment'), lock:
        pass
    assert lock.acquire(timeout=1.0)


def test_what_nobody_else_can_raise_reaches_the_test_where_it_waits() -> None:
    def fail() -> None:
        SCHEDULER.sleep(1.0)
        SCHEDULER.throw(ValueError('of another task'))

    SCHEDULER.spawn(fail, 'failing')
    began = SCHEDULER.now
    with pytest.raises(ValueError, match='of another task'):
        time.sleep(60.0)
    assert SCHEDULER.now - began < 2 * SECOND
    time.sleep(120.0)  # the alarm of the wait before wakes nobody
    assert SCHEDULER.now - began > 120 * SECOND


def test_a_finalizer_may_acquire_a_lock_before_its_thread_has_a_list_of_locks() -> None:
    class Prepared(lock_order._Held):
        def __init__(self) -> None:
            seen.append(list(self.locks))  # as a finalizer, when the garbage of a new thread is collected

    seen: list[list[object]] = []
    held = Prepared()
    thread = threading.Thread(target=lambda: seen.append(list(held.locks)))
    thread.start()
    thread.join()
    assert seen == [[], [], []]
