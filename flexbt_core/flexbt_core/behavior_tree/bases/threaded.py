# SPDX-License-Identifier: BSD-3-Clause
"""A leaf whose work may block, and is done in a thread of its own."""

from __future__ import annotations

import threading
from abc import abstractmethod
from typing import Any

from flexbt_core.behavior_tree.engine import Halted, LeafNode, NodeConfig, UnfinishedWork
from flexbt_core.behavior_tree.model import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeExecutionError, NodeKind, NodeStatus


class ThreadedAction(LeafNode):
    """An action that calls :meth:`run` in a thread, and is RUNNING until that returns.

    A halt does not wait: it makes :attr:`halt_requested` true, ends :meth:`sleep`, and calls :meth:`on_halted`. Until
    ``run`` has returned it is unfinished work of the tree; it can write no output any more, and its result means
    nothing. When the node is begun again meanwhile, it is RUNNING, and calls ``run`` anew when the call before is over.
    """

    __slots__ = ('_call',)

    kind = NodeKind.ACTION
    goes_on = 'its thread goes on'

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._call: _Call | None = None

    @abstractmethod
    def run(self) -> NodeStatus:
        """Does the work, in a thread of its own: SUCCESS, FAILURE or SKIPPED. May use the ports, but no other node."""

    def on_halted(self) -> None:
        """Ends what :meth:`run` waits for, if it waits for anything but :meth:`sleep`. Must not block."""

    # -- within run --------------------------------------------------------------------------------------------------

    @property
    def halt_requested(self) -> bool:
        """Whether ``run`` should return soon, with whatever result."""
        return self._call is not None and self._call.halted

    def sleep(self, seconds: float) -> None:
        """Waits, by the clock of the tree. Raises Halted, which ``run`` should let pass, when the node is halted."""
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
        """As that of every node; but within a ``run`` that was halted it raises Halted, and writes nothing."""
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
        before = self.status
        if before is SUCCESS or before is FAILURE:
            return before
        call = self._call
        if call is None or (call.ended and call.halted):
            self._reason = ''
            self._call = call = _Call(self)
            self.status = RUNNING
            try:
                call.thread.start()
            except RuntimeError as error:  # the machine has no more threads
                self._call = None
                raise self.fault(error) from error
            return self.checked(RUNNING)
        if not call.ended or call.halted:
            self.status = RUNNING
            return RUNNING
        self._call = None
        if call.error is not None:
            raise call.error
        status = self.checked(call.result)
        if status is RUNNING:
            raise self.fault('run has to return when the work is done; RUNNING is no result')
        if status is not SKIPPED:
            self.status = status
        return status

    def halt(self) -> None:
        call = self._call
        if self.status is RUNNING and call is not None and not call.halted:
            call.halt()
            if not call.ended:
                self.stop_by(self.on_halted)
        super().halt()


class _Call:
    """A call of ``run``. What both threads change they change under ``lock``."""

    def __init__(self, node: ThreadedAction) -> None:
        self.lock = threading.Lock()
        self.woken = threading.Event()
        self.halted = False
        self.ended = False
        self.result: object = None
        self.error: NodeExecutionError | None = None
        self._node = node
        self._unfinished: UnfinishedWork | None = None
        # A daemon: work that does not end must not keep the process from ending.
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
        """Of a call whose result nobody asks for any more: the tree raises it."""
        if self.error is not None:
            self._node.context.halt_errors.append(self.error)
