# SPDX-License-Identifier: BSD-3-Clause
"""A leaf whose work is a coroutine that the ticks advance: no thread, and no state machine written by hand."""

from __future__ import annotations

import types
from abc import abstractmethod
from collections.abc import Callable, Coroutine, Generator
from typing import Any, Final, Protocol, TypeVar

from flexbt_core.behavior_tree.engine import Halted, LeafNode, NodeConfig, UnfinishedWork
from flexbt_core.behavior_tree.model import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    NodeExecutionError,
    NodeKind,
    NodeStatus,
)

T = TypeVar('T', covariant=True)

_WAITS: Final = object()


class Future(Protocol[T]):
    """The part of ``concurrent.futures.Future`` that is needed; the futures of rclpy have it as well."""

    def done(self) -> bool: ...

    def result(self) -> T: ...

    def add_done_callback(self, callback: Callable[[Any], object], /) -> object: ...


class CoroutineAction(LeafNode):
    """An action whose :meth:`run` is a coroutine. It is RUNNING until that returns, and each tick advances it.

    ``run`` awaits the methods of the node: :meth:`next_tick`, :meth:`sleep`, :meth:`until` and :meth:`result_of`. A
    halt raises Halted where it waits. It may clean up then (``try``, ``finally``), and wait meanwhile as before: as
    long as it does it is unfinished work of the tree, which the ticks, and the host after the last of them, advance.
    When the node is begun again before, it is RUNNING, and calls ``run`` anew when the call before is over.
    """

    __slots__ = ('_coroutine', '_halted', '_unfinished')

    goes_on = ''  # it is the ticks that advance it

    kind = NodeKind.ACTION

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._coroutine: Coroutine[Any, None, object] | None = None
        self._halted = False
        self._unfinished: UnfinishedWork | None = None

    @abstractmethod
    async def run(self) -> NodeStatus:
        """Does the work; gives SUCCESS, FAILURE or SKIPPED. Must not block."""

    # -- within run --------------------------------------------------------------------------------------------------

    async def next_tick(self) -> None:
        """Goes on at the next tick, whenever that is."""
        await _next_tick()

    async def sleep(self, seconds: float) -> None:
        """Goes on when the time is over, by the clock of the tree, which is woken for it."""
        when = self.clock.now() + seconds
        # While the node is halted, the tree does not keep the times that nodes ask for.
        timer = self.clock.call_at(when, self.wake) if self._halted else None
        try:
            while self.clock.now() < when:
                if timer is None:
                    self.wake_at(when)
                await _next_tick()
        finally:
            if timer is not None:
                timer.cancel()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Goes on when the condition holds. It is asked at each tick; what makes it true may call :meth:`wake`."""
        while not condition():
            await _next_tick()

    async def result_of(self, future: Future[T]) -> T:
        """The result of the future (or its exception, raised), which wakes the tree when it is there."""
        if not future.done():
            future.add_done_callback(lambda _: self.wake())
            await self.until(future.done)
        return future.result()

    # -- within the tick -----------------------------------------------------------------------------------------------

    def execute(self) -> NodeStatus:
        before = self.status
        if before is SUCCESS or before is FAILURE:
            return before
        if self._halted:
            self.status = RUNNING
            return RUNNING
        if self._coroutine is None:
            self._reason = ''
            self._coroutine = self.run()
        try:
            result = self._advance(self._coroutine.send, None)
        except NodeExecutionError:
            self.cancel_wake()
            raise
        except BaseException as error:
            self.cancel_wake()
            raise self.fault(error) from error
        if result is _WAITS:
            self.status = RUNNING
            return self.checked(RUNNING)
        self.cancel_wake()
        status = self.checked(result)
        if status is RUNNING:
            raise self.fault('run has to return when the work is done; RUNNING is no result')
        if status is not SKIPPED:
            self.status = status
        return status

    def _advance(self, step: Callable[[Any], object], value: object) -> object:
        """Lets the coroutine run on. Gives its result, or _WAITS, and only then keeps it; raises what it raises."""
        coroutine, self._coroutine = self._coroutine, None
        assert coroutine is not None
        try:
            awaited = step(value)
            if awaited is not None:
                coroutine.throw(TypeError(f'ticks cannot advance {awaited!r}; await a method of the node instead'))
        except StopIteration as end:
            return end.value
        except Halted:
            return None
        self._coroutine = coroutine
        return _WAITS

    def halt(self) -> None:
        coroutine = self._coroutine
        if self.status is RUNNING and coroutine is not None and not self._halted:
            self.cancel_wake()
            self._halted = True
            self._unfinished = self.context.add_unfinished(f'[{self.path}] is coming to its end', self._come_to_end)
            self._end_by(coroutine.throw, Halted())
        super().halt()

    def _come_to_end(self) -> None:
        """Advances a coroutine that was halted."""
        if self._coroutine is not None:
            self._end_by(self._coroutine.send, None)

    def _end_by(self, step: Callable[[Any], object], value: object) -> None:
        def advance() -> None:
            self._advance(step, value)

        self.stop_by(advance)
        if self._coroutine is None:
            self._halted = False
            assert self._unfinished is not None
            self._unfinished.done()


@types.coroutine
def _next_tick() -> Generator[None, None, None]:
    yield
