# SPDX-License-Identifier: BSD-3-Clause
"""Actions whose work takes many ticks: a coroutine that the ticks advance, or a call on a thread."""

from __future__ import annotations

import threading
import types
from abc import abstractmethod
from collections.abc import Callable, Coroutine, Generator
from typing import Any, Final, Protocol, TypeVar

from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus

from .context import UnfinishedWork
from .leaf import Halted, LeafNode
from .node import NodeConfig

T = TypeVar('T', covariant=True)

_WAITS: Final = object()


class Future(Protocol[T]):
    """The methods of ``concurrent.futures.Future`` used here; the futures of rclpy also have them."""

    def done(self) -> bool: ...

    def result(self) -> T: ...

    def add_done_callback(self, callback: Callable[[Any], object], /) -> object: ...


def _completed(leaf: LeafNode, result: object) -> NodeStatus:
    """Store and return the result of ``run`` of a leaf."""
    status = leaf.checked(result)
    if status is RUNNING:
        raise leaf.fault('run has to return when the work is done; RUNNING is not a result')
    if status is not SKIPPED:
        leaf.status = status
    return status


class CoroutineAction(LeafNode):
    """An action whose :meth:`run` is a coroutine. It is RUNNING until ``run`` returns, and each tick advances it.

    ``run`` awaits the methods of the node: :meth:`next_tick`, :meth:`sleep`, :meth:`until` and :meth:`result_of`. A
    halt raises Halted where ``run`` waits. It may then clean up (``try``, ``finally``), and wait in the same way: until
    it ends, it is unfinished work of the tree, which the ticks, and after the last tick the host, advance. A node that
    starts again before that is RUNNING, and calls ``run`` again when the previous call has ended.
    """

    __slots__ = ('_coroutine', '_halted', '_unfinished')

    goes_on = ''  # only ticks advance it

    kind = NodeKind.ACTION

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._coroutine: Coroutine[Any, None, object] | None = None
        self._halted = False
        self._unfinished: UnfinishedWork | None = None

    @abstractmethod
    async def run(self) -> NodeStatus:
        """Do the work and return SUCCESS, FAILURE or SKIPPED. Must not block."""

    # -- within run --------------------------------------------------------------------------------------------------

    async def next_tick(self) -> None:
        """Wait for the next tick."""
        await _next_tick()

    async def sleep(self, seconds: float) -> None:
        """Wait ``seconds`` by the clock of the tree, and wake the tree at the end."""
        when = self.clock.now() + seconds
        # A halt drops the wake-up times that nodes request.
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
        """Wait until the condition holds. Each tick checks it; code that makes it true may call :meth:`wake`."""
        while not condition():
            await _next_tick()

    async def result_of(self, future: Future[T]) -> T:
        """Wait for the future, which wakes the tree when it is done; return its result or raise its exception."""
        if not future.done():
            future.add_done_callback(lambda _: self.wake())
            await self.until(future.done)
        return future.result()

    # -- within the tick -----------------------------------------------------------------------------------------------

    def execute(self) -> NodeStatus:
        before = self.stored_status
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
        return _completed(self, result)

    def _advance(self, step: Callable[[Any], object], value: object) -> object:
        """Resume the coroutine. Return its result, or keep it and return _WAITS; propagate its exceptions."""
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
        if self.stored_status is RUNNING and coroutine is not None and not self._halted:
            self.cancel_wake()
            self._halted = True
            self._unfinished = self.context.add_unfinished(f'[{self.path}] is coming to its end', self._come_to_end)
            self._end_by(coroutine.throw, Halted())
        super().halt()

    def _come_to_end(self) -> None:
        """Advance a halted coroutine."""
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


# A leaf whose work may block, and runs in a thread.


class ThreadedAction(LeafNode):
    """An action that calls :meth:`run` in a thread, and is RUNNING until it returns.

    A halt does not wait: it sets :attr:`halt_requested`, ends :meth:`sleep`, and calls :meth:`on_halted`. Until ``run``
    returns, it is unfinished work of the tree; it can no longer write outputs, and its result is ignored. A node that
    starts again before that is RUNNING, and calls ``run`` again when the previous call has ended.
    """

    __slots__ = ('_call',)

    kind = NodeKind.ACTION
    goes_on = 'its thread continues'

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._call: _Call | None = None

    @abstractmethod
    def run(self) -> NodeStatus:
        """Do the work in a thread; return SUCCESS, FAILURE or SKIPPED. May use the ports, but no other node."""

    def on_halted(self) -> None:
        """Interrupt any wait of :meth:`run` other than :meth:`sleep`. Must not block."""

    # -- within run --------------------------------------------------------------------------------------------------

    @property
    def halt_requested(self) -> bool:
        """True if ``run`` should return soon, with any result."""
        return self._call is not None and self._call.halted

    def sleep(self, seconds: float) -> None:
        """Wait by the clock of the tree. Raises Halted if the node is halted; ``run`` should not catch it."""
        call = self._call
        if call is None:
            raise RuntimeError('sleep is for run alone')
        when = self.clock.now() + seconds
        timer = self.clock.call_at(when, call.woken.set)
        try:
            while not call.halted:
                if self.clock.now() >= when:
                    return
                call.woken.wait()
                call.woken.clear()
        finally:
            timer.cancel()
        raise Halted

    def set_output(self, port: str, value: Any) -> None:
        """Write an output port, as every node does. In a halted ``run``, raise Halted and write nothing."""
        call = self._call
        if call is None or threading.current_thread() is not call.thread:
            super().set_output(port, value)
            return
        with call.lock:
            if call.halted:
                raise Halted
            super().set_output(port, value)

    # -- within the tick -----------------------------------------------------------------------------------------------

    def execute(self) -> NodeStatus:
        before = self.stored_status
        if before is SUCCESS or before is FAILURE:
            return before
        call = self._call
        if call is None or (call.ended and call.halted):
            self._reason = ''
            self._call = call = _Call(self)
            self.status = RUNNING
            try:
                call.thread.start()
            except RuntimeError as error:  # the system cannot start another thread
                self._call = None
                raise self.fault(error) from error
            return self.checked(RUNNING)
        if not call.ended or call.halted:
            self.status = RUNNING
            return RUNNING
        self._call = None
        if call.error is not None:
            raise call.error
        return _completed(self, call.result)

    def halt(self) -> None:
        call = self._call
        if self.stored_status is RUNNING and call is not None and not call.halted:
            call.halt()
            if not call.ended:
                self.stop_by(self.on_halted)
        super().halt()


class _Call:
    """A call of ``run``. State that both threads change is protected by ``lock``."""

    def __init__(self, node: ThreadedAction) -> None:
        self.lock = threading.Lock()
        self.woken = threading.Event()
        self.halted = False
        self.ended = False
        self.result: object = None
        self.error: NodeExecutionError | None = None
        self._node = node
        self._unfinished: UnfinishedWork | None = None
        # A daemon: work that hangs must not keep the process from exiting.
        self.thread = threading.Thread(target=self._execute, name=f'leaf {node.path}', daemon=True)

    def halt(self) -> None:
        with self.lock:
            self.halted = True
            if self.ended:
                self._report_error()
            else:
                self._unfinished = self._node.context.add_unfinished(f'[{self._node.path}] is coming to its end')
        self.woken.set()

    def _execute(self) -> None:
        try:
            self.result = self._node.run()
        except Halted:
            pass
        except NodeExecutionError as error:
            self.error = error
        except BaseException as error:
            self.error = self._node.fault(error)
            self.error.__cause__ = error
        with self.lock:
            self.ended = True
            if self.halted:
                self._report_error()
        if self._unfinished is not None:
            self._unfinished.done()
        self._node.wake()

    def _report_error(self) -> None:
        """Report the error of a halted call, so that the tree raises it."""
        if self.error is not None:
            self._node.context.halt_errors.append(self.error)
