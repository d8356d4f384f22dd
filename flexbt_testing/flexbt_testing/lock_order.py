# SPDX-License-Identifier: BSD-3-Clause
"""Detection of potential deadlocks: the order in which threads acquire the locks of FlexBT, and waits with locks held.

:func:`watch_locks` makes each lock that a package of FlexBT creates from then on remember its holder. These are
problems:

- A thread acquires a lock that it already holds and that is not an RLock: it would wait forever. It gets an error.
- Two locks are acquired in both orders, by any threads at any time: some day two of these meet. Locks created by the
  same line of code count as one.
- A thread waits for an event, a result or another thread, without a time limit or with a long one, while it holds a
  lock: the thread that should wake it may need that lock first.

Each problem is reported once, with the stacks. The pytest plug-in fails the test in which one occurs, in the test
process or in a process forked for it (:mod:`flexbt_testing.system.fork_server`).
"""

from __future__ import annotations

import inspect
import os
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any, Final

DIRECTORY: Final = 'FLEXBT_LOCK_PROBLEMS'
"""Environment variable: the directory to which a process writes its problems, one file each."""

LONG_SECONDS: Final = 1.0
"""A wait of this length with a lock held is a problem, s."""

_REAL_LOCK: Final = threading.Lock
_REAL_RLOCK: Final = threading.RLock
_REAL_CONDITION: Final = threading.Condition
_REAL_WAIT: Final = threading.Condition.wait
_REAL_JOIN: Final = threading.Thread.join
_STARTS_THREAD: Final = 'self._started.wait()'
_OURS: Final = 'flexbt_'
_LENT: Final = 'node_executor.py'
"""File that creates the turn lock of an executor, held during all callbacks: a callback may wait."""


class _Held(threading.local):
    """The locks that this thread holds, the last acquired one at the end.

    Not made by a constructor: a finalizer that acquires a lock may run while the object is made for a thread.
    """

    locks: list[_Watched]

    def __getattr__(self, name: str) -> list[_Watched]:
        if name != 'locks':
            raise AttributeError(name)
        self.locks = []
        return self.locks


class _Record:
    """The locks acquired in this process, and their order."""

    def __init__(self) -> None:
        self.lock = _REAL_LOCK()
        self.after: dict[str, dict[str, str]] = {}  # by place of a lock: locks acquired while it is held, and stack
        self.problems: dict[tuple[str, ...], str] = {}

    def taken(self, held: list[_Watched], lock: _Watched) -> None:
        for other in held:
            known = self.after.get(other.place)
            if other.place != lock.place and (known is None or lock.place not in known):
                self._add(other.place, lock.place)

    def report(self, kind: tuple[str, ...], text: str) -> None:
        if kind in self.problems:
            return
        self.problems[kind] = text
        directory = os.environ.get(DIRECTORY)
        if directory:
            with suppress(OSError):  # the test that asked for problems has ended
                name = f'{os.getpid()}_{len(self.problems)}'
                unfinished = Path(directory, f'.{name}')
                unfinished.write_text(f'process {os.getpid()} ({" ".join(sys.argv[:2])}): {text}')
                unfinished.rename(Path(directory, name))

    def _add(self, first: str, second: str) -> None:
        stack = _stack()
        with self.lock:
            self.after.setdefault(first, {})[second] = stack
            back = self._way(second, first)
        if back:
            others = '\n'.join(f'{two} is taken while {one} is held:\n{self.after[one][two]}' for one, two in back)
            self.report(
                tuple(sorted({first, second})),
                f'locks are taken in both orders.\n{second} is taken while {first} is held:\n{stack}\n{others}',
            )

    def _way(self, first: str, last: str) -> list[tuple[str, str]]:
        """Return the steps from one lock to another, each acquired while the previous one is held."""
        ways: list[list[str]] = [[first]]
        seen = {first}
        for way in ways:
            for following in self.after.get(way[-1], ()):
                if following == last:
                    return list(zip(way, [*way[1:], last], strict=True))
                if following not in seen:
                    seen.add(following)
                    ways.append([*way, following])
        return []


_held = _Held()
_record = _Record()


class _Watched:
    """A lock that remembers its holder. In tests every lock of FlexBT is one, so acquiring it must be cheap."""

    is_reentrant = False

    def __init__(self, place: str) -> None:
        self.place = place
        self._lock: Any = _REAL_RLOCK() if self.is_reentrant else _REAL_LOCK()
        self._holder: list[_Watched] = []

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        held = _held.locks
        if held and blocking and timeout < 0.0 and not (self.is_reentrant and self in held):
            if self in held:
                text = f'{self.place} is taken by a thread that holds it:\n{_stack()}'
                _record.report((self.place,), text)
                raise RuntimeError(text)
            _record.taken(held, self)
        if not self._lock.acquire(blocking, timeout):
            return False
        self._holder = held
        held.append(self)
        return True

    def release(self, *_: object) -> None:
        held = self._holder
        if held is _held.locks and held and held[-1] is self:
            held.pop()
        else:
            with suppress(ValueError):
                held.remove(self)  # the list of another thread, if the lock was handed over
        self._lock.release()

    def locked(self) -> bool:
        return bool(self._lock.locked())

    __enter__ = acquire
    __exit__ = release


class _WatchedRLock(_Watched):
    is_reentrant = True

    # Methods that a condition calls on its lock.

    def _is_owned(self) -> bool:
        return self in _held.locks

    def _release_save(self) -> int:
        count = _held.locks.count(self)
        for _ in range(count):
            self.release()
        return count

    def _acquire_restore(self, count: int) -> None:
        for _ in range(count):
            self.acquire()


def watch_locks() -> None:
    """Watch all locks created from now on, in this process and its forks. May be called twice."""
    threading.Lock = _lock  # type: ignore[assignment]
    threading.RLock = _rlock  # type: ignore[assignment]
    threading.Condition = _condition  # type: ignore[assignment, misc]
    _REAL_CONDITION.wait = _wait  # type: ignore[method-assign]
    threading.Thread.join = _join  # type: ignore[method-assign]
    os.register_at_fork(after_in_child=_forget_others)


def watch_locks_if_asked() -> None:
    """Call :func:`watch_locks` in a process started by one that looks for problems."""
    if DIRECTORY in os.environ:
        watch_locks()


@contextmanager
def unwatched_locks() -> Iterator[None]:
    """Create unwatched locks in this context, for code in which a signal may raise anywhere.

    Python acquires its own lock and enters the ``with`` block as one step. With a watched lock, a signal can come
    between.
    """
    watched = threading.Lock, threading.RLock, threading.Condition
    threading.Lock, threading.RLock = _REAL_LOCK, _REAL_RLOCK
    threading.Condition = _REAL_CONDITION  # type: ignore[misc]
    try:
        yield
    finally:
        threading.Lock, threading.RLock, threading.Condition = watched  # type: ignore[misc]


def take_problems() -> Iterator[str]:
    """Yield the problems since the last call, from this process and those that it has started."""
    _record.problems.update(dict.fromkeys(_record.problems, ''))
    for file in sorted(Path(os.environ[DIRECTORY]).glob('[0-9]*')):
        yield file.read_text()
        file.unlink()


def _forget_others() -> None:
    """Forget the locks of other threads: a fork has only one thread."""
    _record.lock = _REAL_LOCK()


def _lock() -> Any:
    place = _place()
    return _Watched(place) if place else _REAL_LOCK()


def _rlock() -> Any:
    place = _place()
    return _WatchedRLock(place) if place else _REAL_RLOCK()


def _condition(lock: Any = None) -> Any:
    if lock is None and (place := _place()):
        lock = _WatchedRLock(place)
    return _REAL_CONDITION(lock)


def _wait(self: Any, timeout: float | None = None) -> bool:
    _check_wait(self._lock, timeout)
    return _REAL_WAIT(self, timeout)


def _join(self: threading.Thread, timeout: float | None = None) -> None:
    _check_wait(None, timeout)
    _REAL_JOIN(self, timeout)


def _check_wait(own: Any, timeout: float | None) -> None:
    if timeout is not None and timeout < LONG_SECONDS:
        return
    held = [one.place for one in _held.locks if one is not own and not one.place.startswith(_LENT)]
    if held:
        stack = _stack()
        if _STARTS_THREAD in stack:
            return  # the lock of a thread, released before the thread runs any code of FlexBT
        limit = 'no limit' if timeout is None else f'a limit of {timeout:g} s'
        _record.report(('wait', *held), f'a thread waits, with {limit}, while {", ".join(held)} is held:\n{stack}')


def _place() -> str:
    """Return the place in FlexBT's code that creates a lock; '' for other code."""
    frame = _caller()
    name = str(frame.f_globals.get('__name__', ''))
    return f'{Path(frame.f_code.co_filename).name}:{frame.f_lineno} ({name})' if name.startswith(_OURS) else ''


def _stack() -> str:
    return ''.join(traceback.format_stack(_caller())).rstrip()


def _caller() -> FrameType:
    """Return the innermost call outside this module."""
    frame = inspect.currentframe()
    while frame is not None and frame.f_code.co_filename == __file__ and frame.f_back is not None:
        frame = frame.f_back
    assert frame is not None
    return frame
