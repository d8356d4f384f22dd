# SPDX-License-Identifier: BSD-3-Clause
"""What of FlexBT is replaced in a world: the process around a node, its identity, and the wait of its executor.

Everything else of the product runs unchanged. :func:`install` has to be called before the product is imported.
"""

from __future__ import annotations

import importlib
import inspect
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from . import disk, event_loop, rclpy_module, standard_library
from .clocks import GuardCondition, Timer, WaitSet
from .graph import DOMAIN, Entity
from .scheduler import SCHEDULER, SECOND, Process, Task
from .topics import Sample, Subscription

HOST: Final = 'one_process'
LEASE: Final = 20 * SECOND
"""Time after which the middleware of the others misses a killed process, ns: that of config/this_computer.xml."""

_CLOSE_SECONDS: Final = 1.7
_RANKS: Final = {'timer': 1, 'subscription': 2, 'guard_condition': 3, 'client': 4, 'service': 5}


def end(process: Process, exit_code: int = -9) -> None:
    """End a process, by default as SIGKILL does: no task of it runs again. The graph shows it until its lease ends."""
    SCHEDULER.abandon(process)
    process.exit_code = exit_code
    for release in process.kept_files:
        release()
    for task in SCHEDULER.tasks:
        lock = task.waits_for
        if isinstance(lock, standard_library.Lock) and not lock.has_owner:
            lock.hand_over()
    SCHEDULER.call_at(SCHEDULER.now + LEASE, lambda: DOMAIN.vanish(lambda one: one.process is process))


def terminate(process: Process) -> None:
    """Send SIGTERM, which a process handles, or which ends it; a stopped one when it goes on.

    A handler runs on a thread of its own. What it raises is raised in the main thread, which would have run it.
    """

    def handle() -> None:
        try:
            (process.signal or partial(end, process, -signal.SIGTERM))()
        except BaseException as error:
            SCHEDULER.throw(error, main)
        while process.pausing:
            SCHEDULER.wake(process.pausing.pop())

    main = next(task for task in SCHEDULER.tasks if task.process is process)
    SCHEDULER.spawn(handle, 'SIGTERM', process)


class _Taken:
    """Stand-in for :class:`flexbt_common.middleware.received_messages.Received`, packed only if asked for bytes."""

    __slots__ = ('_limit', '_sample', 'arrived', 'sent', 'writer')

    def __init__(self, sample: Sample, arrived: int, limit: int) -> None:
        self._sample = sample
        self._limit = limit
        self.writer = sample.gid
        self.sent, self.arrived = sample.stamp * 1e-9, arrived

    @property
    def size(self) -> int:
        return len(self._sample.data())

    @property
    def is_oversized(self) -> bool:
        return self._sample.most_bytes() > self._limit and self.size > self._limit

    @property
    def data(self) -> bytes | None:
        return None if self.is_oversized else self._sample.data()

    def unpack(self, message_type: type[Any]) -> Any:
        from flexbt_common.middleware.received_messages import Received

        if message_type is self._sample.type and not self.is_oversized:
            with suppress(Exception):  # bytes that are no message
                return self._sample.message()
        return Received.unpack(self, message_type)  # type: ignore[arg-type]


class _Taker:
    """Stand-in for the reader that calls functions of rcl."""

    @classmethod
    def make(cls) -> _Taker:
        return cls()

    def take(self, subscription: Any, limit: int) -> _Taken | None:
        with subscription.handle as handle:
            taken = handle.take_sample()
        if taken is None:
            return None
        sample, arrived = taken
        return _Taken(sample, arrived, limit)


@dataclass(eq=False, slots=True)
class _Record:
    """An entity of an executor: how it is taken, and when it is waited for."""

    rank: tuple[int, int]
    take: Any
    what: Any
    is_awaited: Callable[[], bool] | None = None
    wait_set: WaitSet | None = None


class ReadyEntities:
    """Stand-in for the wait set of :class:`flexbt_common.runtime.node_executor.NodeExecutor`.

    An entity that becomes ready puts itself into a list, so that nothing is asked that is not ready.
    """

    def __init__(
        self,
        context: Any,
        wake_guard: Any,
        takes: Mapping[str, Any],
        entities: Mapping[str, Any],
        waitables: Any,
    ) -> None:
        from flexbt_common.runtime.ros_clock import is_clock_subscription

        self._records: dict[Entity, _Record] = {}
        self._maybe: dict[Entity, None] = {}
        self._timers: list[Timer] = []
        self._task: Task | None = None
        self._is_notified = False
        for kind, those in entities.items():
            for one in those:
                is_awaited = None
                if kind == 'subscription':
                    is_awaited = getattr(one.callback, 'is_awaited', None)
                    if is_clock_subscription(one):
                        is_awaited = partial(self._is_time_awaited, one.handle)
                self._add(one.handle, _Record((_RANKS[kind], len(self._records)), takes[kind], one, is_awaited))
        for waitable in waitables:
            wait_set = WaitSet()
            waitable.add_to_wait_set(wait_set)
            for entity in wait_set.entities():
                rank = (0, len(self._records))
                self._add(entity, _Record(rank, takes['waitable'], waitable, None, wait_set))
        self._add(wake_guard.handle, _Record((9, 0), None, None))
        self._ros_timers = [timer for timer in self._timers if timer.clock.type == rclpy_module.ROS_TIME]

    def _add(self, entity: Entity, record: _Record) -> None:
        if entity.is_ended:
            return
        self._records[entity] = record
        self._maybe[entity] = None
        entity.watcher = self
        if isinstance(entity, Timer):
            self._timers.append(entity)

    def _is_time_awaited(self, clock: Subscription) -> bool:
        """Return whether a timer is due by the newest message, or the time goes back: others need not be taken yet."""
        now = clock.newest_time
        return any(not one.is_canceled and not one.clock.nanoseconds() <= now < one.next for one in self._ros_timers)

    def notify(self, entity: Entity) -> None:
        """Note that an entity may be ready, and wake the executor if it waits for it."""
        self._maybe[entity] = None
        self._is_notified = True
        record = self._records[entity]
        if self._task is not None and (record.is_awaited is None or record.is_awaited()):
            SCHEDULER.wake(self._task, True)

    def ready(self, timeout: float | None, turn: Any, some_await: bool) -> list[tuple[Any, Any]]:
        """Wait as :meth:`flexbt_common.runtime.node_executor._Entities.ready`."""
        until = None if timeout is None else SCHEDULER.after(timeout)
        self._is_notified = False
        found = self._look(some_await)
        with turn:
            while not found and (until is None or SCHEDULER.now < until):
                # Another task may have run since the entities were looked at: locks are points of preemption.
                if not self._is_notified:
                    wake_at = until
                    for timer in self._timers:
                        due = timer.due
                        if due is not None and (wake_at is None or due < wake_at):
                            wake_at = due
                    self._task = SCHEDULER.current
                    SCHEDULER.block('the wait of an executor', wake_at)
                    self._task = None
                self._is_notified = False
                found = self._look(some_await)
        return [(record.take, record.what) for record in found if record.take is not None]

    def _look(self, some_await: bool) -> list[_Record]:
        """Return the records of what is ready, in the order in which rclpy calls them."""
        for timer in self._timers:
            if timer.is_ready():
                self._maybe[timer] = None
        found: dict[int, _Record] = {}
        for entity in tuple(self._maybe):
            record = self._records[entity]
            if entity.is_ended or not entity.is_ready():
                del self._maybe[entity]
                continue
            if record.is_awaited is not None and not record.is_awaited():
                continue
            if some_await and record.take is not None and not record.what.callback_group.can_execute(record.what):
                continue
            if record.wait_set is not None:
                record.wait_set.look()
                record.what.is_ready(record.wait_set)
            elif isinstance(entity, GuardCondition):
                entity.is_triggered = False
            found[id(record.what)] = record
        return sorted(found.values(), key=lambda record: record.rank) if len(found) > 1 else [*found.values()]

    def close(self) -> None:
        """Forget the entities."""
        for entity in self._records:
            if entity.watcher is self:
                entity.watcher = None


class _KeptFiles:
    """Stand-in for the set of open journals: the operating system closes those of a killed process."""

    def add(self, journal: Any) -> None:
        SCHEDULER.current.process.kept_files.append(journal.release_files)

    def __iter__(self) -> Iterator[Any]:
        return iter(())


def _leave(real: Callable[[int], None], code: int) -> None:
    """Stand-in for ``os._exit``."""
    process = SCHEDULER.current.process
    if process is SCHEDULER.main.process:
        real(code)
    end(process, code)
    SCHEDULER.block('nothing: its process has ended')


def _run_main(module: str, **_limits: Any) -> int:
    main: Callable[..., int] = importlib.import_module(module).main
    takes_arguments = bool(inspect.signature(main).parameters)
    return main(SCHEDULER.current.process.arguments) if takes_arguments else main()


def install() -> None:
    """Make this interpreter run in worlds: standard library, rclpy and FlexBT. A second call has no effect.

    Raises:
        RuntimeError: rclpy or FlexBT was imported before.
    """
    if rclpy_module.is_installed():
        return
    early = [name for name in sys.modules if name.startswith(('rclpy.node', 'flexbt_common.', 'flexbt_core.'))]
    early = [name for name in early if name != 'flexbt_common.executables']  # which only starts executables
    if early:
        text = 'install the world before what shall run in it, for pytest by the option -p flexbt_testing.world'
        raise RuntimeError(f'{early[0]} is imported already: {text}')
    standard_library.install()
    event_loop.install()
    disk.install()
    rclpy_module.install()
    os._exit = partial(_leave, os._exit)  # type: ignore[assignment]
    os.setpriority = lambda *_: None  # of a process of the world, which shares that of the test
    os.environ.setdefault('OMP_NUM_THREADS', '1')  # sums of a thread pool are not reproducible

    from rclpy.node import Node

    from flexbt_common import executables
    from flexbt_common.lifecycle import liveliness
    from flexbt_common.middleware import received_messages
    from flexbt_common.runtime import node_executor, node_runtime
    from flexbt_onboard.persistence import journal
    from flexbt_sim.world import pacing
    from flexbt_testing import waiting

    class WorldHost(node_runtime.Host):
        """The process of a world around a node: a signal is an event."""

        def die(self) -> None:
            end(SCHEDULER.current.process)
            SCHEDULER.block('nothing: its process has ended')

        @contextmanager
        def entered(self) -> Iterator[tuple[Callable[[], object], Callable[[], object]]]:
            ended = threading.Event()
            SCHEDULER.current.process.signal = ended.set
            yield ended.wait, ended.set

        def close_in_time(self, name: str, runtime: Any) -> None:
            if runtime is None:
                return
            process = SCHEDULER.current.process

            def leave() -> None:
                end(process, int(not runtime.is_at_rest or runtime.has_failed))

            alarm = SCHEDULER.call_at(SCHEDULER.after(_CLOSE_SECONDS), leave)
            runtime.close()
            alarm.cancel()

    class OwnLibraryLog(node_runtime._LibraryLog):
        """The log of the libraries in a process of a world, which ends with it."""

        def __init__(self, logger: Any) -> None:
            super().__init__(logger)
            self._process = SCHEDULER.current.process
            self._process.kept_files.append(partial(logging.getLogger().removeHandler, self))

        def emit(self, record: logging.LogRecord) -> None:
            if SCHEDULER.current.process is self._process:
                super().emit(record)

    identity = liveliness.ProcessIdentity

    def own() -> Any:
        process = SCHEDULER.current.process
        return identity(HOST, process.pid, str(process.began))

    def has_ended(one: Any) -> bool:
        process = SCHEDULER.processes.get(one.pid)
        lives = process is not None and process.is_alive and str(process.began) == one.began
        return one.host == HOST and not lives

    wait_for_answers = pacing.Pacer._wait_for_answers

    def wait_as_on_a_computer(pacer: Any, simulated: float, now: float) -> None:
        wait_for_answers(pacer, simulated, now)
        pacer._sleep(simulated / pacing.IDLE_FACTOR)  # answers take no time here, and a robot would drive for hours

    for name in ('checked', 'participant', 'process'):
        setattr(_Taken, name, vars(received_messages.Received)[name])
    for owner, name, stand_in in (
        (Node, '__hash__', lambda node: SCHEDULER.number_of(node)),  # executors have sets of nodes
        (executables, 'run_main', _run_main),
        (liveliness, 'warn_of_losses', lambda _warn: None),  # of a middleware that was not tested
        (identity, 'own', staticmethod(own)),
        (identity, 'started', staticmethod(lambda: SCHEDULER.current.process.began / SECOND)),
        (identity, 'has_ended', has_ended),
        (node_runtime, 'HOST', WorldHost()),
        (node_runtime, '_LibraryLog', OwnLibraryLog),
        (node_executor, '_Entities', ReadyEntities),
        (received_messages, '_Taker', _Taker),
        (journal, '_held', _KeptFiles()),
        (pacing.Pacer, '_wait_for_answers', wait_as_on_a_computer),
        (waiting, 'contended_time', lambda: 0.0),
    ):
        setattr(owner, name, stand_in)
