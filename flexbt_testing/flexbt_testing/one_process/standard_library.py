# SPDX-License-Identifier: BSD-3-Clause
"""``threading``, ``time``, ``datetime``, ``queue``, ``atexit`` and random numbers on the scheduler.

:func:`install` replaces attributes of these modules, so it has to run before the code that shall use them is imported:
what was imported before by name, as pytest was, keeps the real ones. Conditions, events and the like are those of the
standard library, on the locks here.
"""

from __future__ import annotations

import _thread
import atexit
import concurrent.futures.thread
import ctypes
import datetime
import gc
import importlib
import os
import queue
import random
import sys
import threading
import time
import timeit
import uuid
from collections import deque
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any, Final

from .boundary import BOUNDARY
from .scheduler import MOST_LOOKS, SCHEDULER, SECOND, Task

_CPU_CLOCK = -1
"""Clock of the processor time of a thread, which stands still: computing takes no time of a world."""


def _until(timeout: float | None) -> int | None:
    return None if timeout is None else SCHEDULER.after(timeout)


class Lock:
    """Stand-in for ``threading.Lock``. A lock of a killed process is free."""

    __slots__ = ('_owner', '_waiting')

    def __init__(self) -> None:
        self._owner: Task | None = None
        self._waiting: deque[Task] = deque()

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        if not blocking and timeout != -1:
            raise ValueError("can't specify a timeout for a non-blocking call")
        if timeout < 0 and timeout != -1:
            raise ValueError('timeout value must be a non-negative number')
        if not blocking or timeout == 0:
            SCHEDULER.look()
        elif SCHEDULER.preemption:
            SCHEDULER.maybe_yield()
        owner = self._owner
        if owner is None or not owner.process.is_alive:
            self._owner = SCHEDULER.current
            return True
        if not blocking or timeout == 0:
            return False
        task = SCHEDULER.current
        self._waiting.append(task)
        try:
            return SCHEDULER.block(self, None if timeout < 0 else SCHEDULER.after(timeout)) is not None
        except BaseException:  # although it may have got the lock
            if self._owner is task:
                self.hand_over()
            raise
        finally:
            if task in self._waiting:
                self._waiting.remove(task)

    __enter__ = acquire

    def release(self, *_: object) -> None:
        if self._owner is None:
            raise RuntimeError('release unlocked lock')
        if self._waiting:
            self.hand_over()
        else:
            self._owner = None

    __exit__ = release

    def hand_over(self) -> None:
        """Give the lock to a waiting task, or free it."""
        while self._waiting:
            index = SCHEDULER.pick(len(self._waiting))
            task = self._waiting[index]
            del self._waiting[index]
            if task.process.is_alive and SCHEDULER.wake(task, True):
                self._owner = task
                return
        self._owner = None

    @property
    def has_owner(self) -> bool:
        """True if a task of a process that is alive holds the lock."""
        return self._owner is not None and self._owner.process.is_alive

    def locked(self) -> bool:
        return self.has_owner

    def _at_fork_reinit(self) -> None:
        self._owner = None
        self._waiting.clear()

    def __repr__(self) -> str:
        return f'a lock of {self._owner}' if self._owner else 'a free lock'


class Thread(threading.Thread):
    """Stand-in for ``threading.Thread``, which begins, and is waited for, as a task.

    Its place in a set, such as that of a pool, does not depend on its address.
    """

    _task: Task | None = None

    def __hash__(self) -> int:
        return SCHEDULER.number_of(self)

    def start(self) -> None:
        if self._task is not None:
            raise RuntimeError('threads can only be started once')
        self._task = SCHEDULER.spawn(self._bootstrap, self.name)
        self._task.thread = self
        self._ident = self._native_id = self._task.id
        SCHEDULER.yield_turn()  # as the real one, which returns when the thread has begun

    def _bootstrap(self) -> None:
        try:
            self.run()
        except SystemExit:
            pass
        except BaseException:
            threading.excepthook(threading.ExceptHookArgs((*sys.exc_info(), self)))

    def is_alive(self) -> bool:
        return self._task is not None and not self._task.is_done and self._task.process.is_alive

    def join(self, timeout: float | None = None) -> None:
        task, current = self._task, SCHEDULER.current
        if task is None:
            raise RuntimeError('cannot join thread before it is started')
        if task is current:
            raise RuntimeError('cannot join current thread')
        if self.is_alive():
            task.joining.append(current)
            try:
                SCHEDULER.block(f'the end of {task}', _until(timeout))
            finally:
                task.joining.remove(current)

    def __repr__(self) -> str:
        return f'<{type(self).__name__}({self.name})>'


class _MainThread(Thread):
    def __init__(self, task: Task) -> None:
        super().__init__(name=task.name, daemon=False)
        self._task, self._ident = task, task.id


class Timer(Thread):
    """Stand-in for ``threading.Timer``, with its methods."""

    __init__ = threading.Timer.__init__
    cancel = threading.Timer.cancel
    run = threading.Timer.run


def _thread_of(task: Task) -> Any:
    if task.thread is None:
        task.thread = _MainThread(task)
    return task.thread


def current_thread() -> Any:
    """Stand-in for ``threading.current_thread``."""
    return _thread_of(SCHEDULER.current)


def main_thread() -> Any:
    """Stand-in for ``threading.main_thread``: the first thread of the process that asks."""
    process = SCHEDULER.current.process
    return _thread_of(next(task for task in (SCHEDULER.main, *SCHEDULER.tasks) if task.process is process))


def _enumerate() -> list[Any]:
    """Stand-in for ``threading.enumerate``: the threads of the process that asks."""
    main_thread()  # which has none before it is asked for
    tasks = [task for task in (SCHEDULER.main, *SCHEDULER.tasks) if task.process is SCHEDULER.current.process]
    return [task.thread for task in tasks if task.thread is not None]


_of_modules: Final = random.Random(0)


def _is_importing() -> bool:
    """Return whether a module is being imported: what that does stays for all later worlds."""
    frame: Any = sys._getframe()
    while frame is not None and frame.f_code.co_filename != '<frozen importlib._bootstrap>':
        frame = frame.f_back
    return frame is not None


def random_bytes(size: int) -> bytes:
    """Stand-in for ``os.urandom``, from the seed. What a module draws as it is imported must not depend on it."""
    drawn = _of_modules if _is_importing() else SCHEDULER.random
    return drawn.getrandbits(8 * size).to_bytes(size, 'big') if size else b''


def _uuid4() -> uuid.UUID:
    return uuid.UUID(bytes=random_bytes(16), version=4)


def _leave() -> None:
    """Let the interpreter end although tasks still wait: nothing waits for them for longer than this time."""
    SCHEDULER.limit = SCHEDULER.after(10.0)
    threading.get_ident = _thread.get_ident  # the interpreter asks whether this is its main thread


_real_register: Final = atexit.register


def _register(function: Callable[..., Any], *arguments: Any, **named: Any) -> Callable[..., Any]:
    """Stand-in for ``atexit.register``: what a program registers is called at its end."""
    if not BOUNDARY.is_inside or _is_importing():
        return _real_register(function, *arguments, **named)
    SCHEDULER.current.process.at_exit.append((function, arguments, named))
    return function


def _unregister(real: Callable[[Any], None], function: Callable[..., Any]) -> None:
    """Stand-in for ``atexit.unregister``."""
    real(function)
    process = SCHEDULER.current.process
    process.at_exit = [one for one in process.at_exit if one[0] != function]


_real_seed: Final = random.Random.seed


def _seed(generator: random.Random, a: Any = None, version: int = 2) -> None:
    """Stand-in for ``random.Random.seed``: without a seed, a generator of a program draws it."""
    _real_seed(generator, random_bytes(32) if a is None and BOUNDARY.is_inside else a, version)


def _look(clock: Callable[..., Any]) -> Callable[..., Any]:
    def read(*which: int) -> Any:
        SCHEDULER.looks += 1
        if SCHEDULER.looks > MOST_LOOKS:
            SCHEDULER.look()
        return clock(*which)

    return read


def _of_clock(clock: int) -> int:
    if clock == _CPU_CLOCK:
        return 0
    return SCHEDULER.wall if clock == time.CLOCK_REALTIME else SCHEDULER.now


class _AtPresent:
    """A function of ``time`` that means the present if it is given no time. As a builtin, it becomes no method."""

    def __init__(self, real: Callable[..., Any], place: int, present: Callable[[], Any]) -> None:
        self._real, self._place, self._present = real, place, present

    def __call__(self, *given: Any) -> Any:
        if len(given) == self._place or given[-1] is None:
            given = (*given[: self._place], self._present())
        return self._real(*given)


def _set_dates() -> None:
    """Let ``datetime.now`` ask ``time``, as ``date.today`` does. A compiled class keeps what setattr would set."""
    methods = gc.get_referents(datetime.datetime.__dict__)[0]
    methods['now'] = classmethod(lambda cls, tz=None: cls.fromtimestamp(time.time(), tz))
    methods['utcnow'] = classmethod(lambda cls: cls.now(datetime.UTC).replace(tzinfo=None))
    ctypes.pythonapi.PyType_Modified(ctypes.py_object(datetime.datetime))


def _of_this_thread(local: Any) -> nullcontext[None]:
    """Let an object have the attributes of this thread. As in the standard library, but without a lock: no other thread
    runs before they are used."""
    implementation = object.__getattribute__(local, '_local__impl')
    try:
        own = implementation.get_dict()
    except KeyError:
        own = implementation.create_dict()
        arguments, named = implementation.localargs
        local.__init__(*arguments, **named)
    object.__setattr__(local, '__dict__', own)
    return _UNLOCKED


_UNLOCKED: Final = nullcontext()


def install() -> None:
    """Replace what the standard library has."""
    for name, stand_in in {
        'Thread': Thread,
        'Lock': Lock,
        'Timer': Timer,
        'RLock': threading._RLock,  # the one in Python, on the locks here
        '_allocate_lock': Lock,
        'current_thread': current_thread,
        'main_thread': main_thread,
        'get_ident': lambda: SCHEDULER.current.id,
        'get_native_id': lambda: SCHEDULER.current.id,
        'enumerate': _enumerate,
        'active_count': lambda: len(_enumerate()),
    }.items():
        setattr(threading, name, stand_in)
    local: Any = importlib.import_module('_threading_local')  # the one in Python, by current_thread
    threading.local, local._patch = local.local, _of_this_thread
    wall, wall_ns = _look(lambda: SCHEDULER.wall / SECOND), _look(lambda: SCHEDULER.wall)
    steady, steady_ns = _look(lambda: SCHEDULER.now / SECOND), _look(lambda: SCHEDULER.now)
    for name, value in {
        'time': wall,
        'time_ns': wall_ns,
        'sleep': SCHEDULER.sleep,
        'pthread_getcpuclockid': lambda _ident: _CPU_CLOCK,
        'clock_gettime': _look(lambda clock: _of_clock(clock) / SECOND),
        'clock_gettime_ns': _look(_of_clock),
        **dict.fromkeys(('monotonic', 'perf_counter', 'process_time', 'thread_time'), steady),
        **dict.fromkeys(('monotonic_ns', 'perf_counter_ns', 'process_time_ns', 'thread_time_ns'), steady_ns),
    }.items():
        setattr(time, name, value)
    # numba asks it a thousand times as it loads a loop, in the first world of an interpreter only.
    timeit.default_timer = lambda: SCHEDULER.now / SECOND
    for name in ('localtime', 'gmtime', 'ctime'):
        setattr(time, name, _AtPresent(getattr(time, name), 0, wall))
    time.asctime = _AtPresent(time.asctime, 0, time.localtime)
    time.strftime = _AtPresent(time.strftime, 1, time.localtime)
    _set_dates()
    queue.SimpleQueue = queue._PySimpleQueue  # type: ignore[misc, attr-defined]
    queue.time = threading._time = time.monotonic  # type: ignore[attr-defined]  # imported by name
    concurrent.futures.thread._global_shutdown_lock = Lock()  # type: ignore[assignment]
    threading._register_atexit(_leave)  # type: ignore[attr-defined]
    os.urandom = random_bytes
    for owner, name, stand_in in (
        (atexit, 'register', _register),
        (atexit, 'unregister', partial(_unregister, atexit.unregister)),
        (os, 'getrandom', lambda size, _flags=0: random_bytes(size)),
        (random.Random, 'seed', _seed),
        (random, 'seed', partial(_seed, vars(random)['_inst'])),
    ):
        setattr(owner, name, stand_in)
    random._urandom = random_bytes  # type: ignore[attr-defined]  # of secrets, and so of generators of numpy
    uuid.uuid4 = _uuid4
    sys._current_frames = SCHEDULER.frames
