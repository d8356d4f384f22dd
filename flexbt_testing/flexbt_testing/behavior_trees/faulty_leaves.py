# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that work, block, raise or return invalid values, and a record of unfinished work."""

from __future__ import annotations

import asyncio
import collections
import threading
import time
from collections.abc import Callable
from typing import Any, ClassVar, NoReturn

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction, ThreadedAction
from flexbt_core.behavior_tree.engine.leaf import Condition, Halted, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.ports import INT, STRING, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus

STATUSES = {'S': NodeStatus.SUCCESS, 'F': NodeStatus.FAILURE, 'K': NodeStatus.SKIPPED}


class Unprintable(Exception):
    """An error that cannot be converted to text."""

    def __str__(self) -> str:
        raise ValueError('no text')

    __repr__ = __str__


class Rude(BaseException):
    """An error that is not an Exception."""


def _recurse() -> BaseException:
    return _recurse()


FAULTS: dict[str, Callable[[], BaseException]] = {
    'RuntimeError': lambda: RuntimeError('scripted fault'),
    'StopIteration': lambda: StopIteration('scripted fault'),
    'SystemExit': lambda: SystemExit(3),
    'KeyboardInterrupt': KeyboardInterrupt,
    'GeneratorExit': GeneratorExit,
    'CancelledError': asyncio.CancelledError,
    'Rude': lambda: Rude('scripted fault'),
    'MemoryError': MemoryError,
    'RecursionError': _recurse,
    'Unprintable': Unprintable,
    'ExceptionGroup': lambda: BaseExceptionGroup('several', [SystemExit(), ValueError()]),
}
"""Factories of the exceptions that a leaf raises, by the value of its port ``kind``."""

KIND = {'kind': input_port(STRING, default='RuntimeError')}


def raise_fault(leaf: TreeNode) -> NoReturn:
    """Raise the exception that the port ``kind`` of a leaf selects."""
    raise FAULTS[leaf.get_input('kind')]()


NONSENSE: dict[str, Any] = {
    'None': None, '7': 7, '2': 2, "'SUCCESS'": 'SUCCESS', 'True': True, '1.0': 1.0, 'IDLE': NodeStatus.IDLE,
    'unprintable': Unprintable(), 'class': NodeStatus,
}  # fmt: skip


class Work:
    """The leaves with unfinished work. Safe to use from several threads."""

    _lock = threading.Lock()
    _running: ClassVar[collections.Counter[str]] = collections.Counter()

    @classmethod
    def begin(cls, leaf: TreeNode) -> None:
        """Record the start of work by ``leaf``."""
        with cls._lock:
            cls._running[leaf.path] += 1

    @classmethod
    def end(cls, leaf: TreeNode) -> None:
        """Record the end of work by ``leaf``."""
        with cls._lock:
            cls._running[leaf.path] -= 1

    @classmethod
    def running(cls) -> dict[str, int]:
        """Return the number of unfinished pieces of work by leaf path; negative if work ended twice."""
        with cls._lock:
            return {path: count for path, count in cls._running.items() if count}


def tree_threads() -> list[str]:
    """Return the names of the live threads of runs and of leaves."""
    return [thread.name for thread in threading.enumerate() if thread.name.startswith(('tree ', 'leaf '))]


TIMED = {'ms': input_port(INT, default='10'), 'result': input_port(STRING, default='S')}


class Runs(StatefulAction):
    """A leaf that runs for a while."""

    ports: ClassVar[dict[str, Any]] = TIMED

    def on_start(self) -> NodeStatus:
        Work.begin(self)
        self._until = self.clock.now() + self.get_input('ms') / 1000.0
        return self.on_running()

    def on_running(self) -> NodeStatus:
        if self.clock.now() < self._until:
            self.wake_at(self._until)
            return NodeStatus.RUNNING
        Work.end(self)
        return STATUSES[self.get_input('result')]

    def on_halted(self) -> None:
        Work.end(self)


class RaisesInHalt(Runs):
    """A leaf that runs for a while, and raises when it is halted."""

    ports: ClassVar[dict[str, Any]] = {**TIMED, **KIND}

    def on_halted(self) -> None:
        super().on_halted()
        raise_fault(self)


class Blocking(SyncAction):
    """A leaf that blocks the tick for a while."""

    ports: ClassVar[dict[str, Any]] = TIMED

    def tick(self) -> NodeStatus:
        Work.begin(self)
        time.sleep(self.get_input('ms') / 1000.0)
        Work.end(self)
        return STATUSES[self.get_input('result')]


class SlowToStop(CoroutineAction):
    """A leaf that runs for a while, and needs several ticks to stop when it is halted."""

    ports: ClassVar[dict[str, Any]] = TIMED

    async def run(self) -> NodeStatus:
        Work.begin(self)
        try:
            await self.sleep(self.get_input('ms') / 1000.0)
        except Halted:
            for _ in range(2):
                await self.sleep(0.002)
            raise
        finally:  # a halt may also come in the block above
            Work.end(self)
        return STATUSES[self.get_input('result')]


class InCoroutine(CoroutineAction):
    """A leaf that waits on the clock of the tree, in a coroutine."""

    ports: ClassVar[dict[str, Any]] = TIMED

    async def run(self) -> NodeStatus:
        await self.sleep(self.get_input('ms') / 1000.0)
        return STATUSES[self.get_input('result')]


class InThread(ThreadedAction):
    """A leaf that works in a thread, which ends some time after the halt."""

    ports: ClassVar[dict[str, Any]] = TIMED

    def run(self) -> NodeStatus:
        Work.begin(self)
        try:
            self.sleep(self.get_input('ms') / 1000.0)
        finally:
            if self.halt_requested:
                time.sleep(0.005)
            Work.end(self)
        return STATUSES[self.get_input('result')]


class Held:
    """A lock that holds callers until a test releases them."""

    release: ClassVar[threading.Event] = threading.Event()
    entered: ClassVar[threading.Event] = threading.Event()

    @classmethod
    def reset(cls) -> None:
        """Reset for the next test."""
        cls.release.clear()
        cls.entered.clear()

    @classmethod
    def hold(cls, busy: bool = False) -> None:
        """Block the caller, in a wait or in a busy loop."""
        cls.entered.set()
        while busy and not cls.release.is_set():
            pass
        cls.release.wait()


class HeldInTick(SyncAction):
    """A leaf that does not return from its tick."""

    ports: ClassVar[dict[str, Any]] = {'busy': input_port(INT, default='0')}

    def tick(self) -> NodeStatus:
        Held.hold(bool(self.get_input('busy')))
        return NodeStatus.SUCCESS


class HeldInHalt(Runs):
    """A leaf that does not return from its halt."""

    def on_halted(self) -> None:
        super().on_halted()
        Held.hold()


class HeldThread(ThreadedAction):
    """A leaf that works in a thread that ignores a halt."""

    def run(self) -> NodeStatus:
        Held.hold()
        return NodeStatus.SUCCESS


class RaisesInTick(SyncAction):
    """A leaf that raises in its tick."""

    ports: ClassVar[dict[str, Any]] = KIND

    def tick(self) -> NodeStatus:
        raise_fault(self)


class RaisesInCondition(Condition):
    """A condition that raises."""

    ports: ClassVar[dict[str, Any]] = KIND

    def tick(self) -> NodeStatus:
        raise_fault(self)


class RaisesInStart(Runs):
    """A leaf that raises when it starts."""

    ports: ClassVar[dict[str, Any]] = {**TIMED, **KIND}

    def on_start(self) -> NodeStatus:
        raise_fault(self)


class RaisesWhileRunning(Runs):
    """A leaf that raises at its second tick."""

    ports: ClassVar[dict[str, Any]] = {**TIMED, **KIND}

    def on_running(self) -> NodeStatus:
        if self.status is NodeStatus.RUNNING:  # and keeps this status: the halt of the tree ends the work
            raise_fault(self)
        self.wake()
        return NodeStatus.RUNNING


class RaisesInThread(ThreadedAction):
    """A leaf that raises in its thread."""

    ports: ClassVar[dict[str, Any]] = KIND

    def run(self) -> NodeStatus:
        raise_fault(self)


class RaisesInCoroutine(CoroutineAction):
    """A leaf that raises in its coroutine."""

    ports: ClassVar[dict[str, Any]] = KIND

    async def run(self) -> NodeStatus:
        await self.next_tick()
        raise_fault(self)


class RaisesInDecorator(Decorator):
    """A decorator that raises."""

    ports: ClassVar[dict[str, Any]] = KIND

    def tick(self) -> NodeStatus:
        self.tick_child()
        raise_fault(self)


class Returns(SyncAction):
    """A leaf that returns a value that is not a status."""

    ports: ClassVar[dict[str, Any]] = {'what': input_port(STRING)}

    def tick(self) -> Any:
        return NONSENSE[self.get_input('what')]


class ReturnsFromStart(StatefulAction):
    """A leaf that returns a value that is not a status at its start."""

    ports: ClassVar[dict[str, Any]] = {'what': input_port(STRING)}

    def on_start(self) -> Any:
        return NONSENSE[self.get_input('what')]

    def on_running(self) -> NodeStatus:
        return NodeStatus.SUCCESS

    def on_halted(self) -> None:
        pass


class NeverRests(StatefulAction):
    """A leaf that runs without end, and never finishes its halt."""

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        self.context.add_unfinished('a motor that still turns')


class Counts(SyncAction):
    """A leaf that adds one to an entry."""

    ports: ClassVar[dict[str, Any]] = {'key': input_port(STRING)}

    def tick(self) -> NodeStatus:
        key = self.get_input('key')
        self.blackboard.set(key, self.blackboard.get_or(key, 0) + 1)
        return NodeStatus.SUCCESS


class Fails(SyncAction):
    """A leaf that fails with a reason that the test checks."""

    reason: ClassVar[str] = ''

    def tick(self) -> NodeStatus:
        return self.fail(self.reason)


class Scribbles(StatefulAction):
    """A leaf whose thread writes and removes entries for a while, without synchronization."""

    ports: ClassVar[dict[str, Any]] = {'count': input_port(INT)}

    def on_start(self) -> NodeStatus:
        board, count = self.blackboard, self.get_input('count')

        def scribble() -> None:
            for number in range(count):
                board.set(f'key{number % 7}', number)
                board.set('text', str(number))
                board.unset(f'key{(number + 3) % 7}')
            board.set('scribbled', count)
            self.wake()

        self._thread = threading.Thread(target=scribble, name=f'leaf {self.path}')
        self._thread.start()
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.RUNNING if self._thread.is_alive() else NodeStatus.SUCCESS

    def on_halted(self) -> None:
        self._thread.join()


ALL = (
    Runs, RaisesInHalt, Blocking, SlowToStop, InCoroutine, InThread, HeldInTick, HeldInHalt, HeldThread, RaisesInTick,
    RaisesInCondition, RaisesInStart, RaisesWhileRunning, RaisesInThread, RaisesInCoroutine, RaisesInDecorator, Returns,
    ReturnsFromStart, NeverRests, Counts, Fails, Scribbles,
)  # fmt: skip


def register(registry: NodeRegistry) -> None:
    """Register all of these leaves."""
    registry.register_classes(ALL)
