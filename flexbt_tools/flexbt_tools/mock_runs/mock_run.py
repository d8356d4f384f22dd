# SPDX-License-Identifier: BSD-3-Clause
"""A tree that runs with mocks, on a clock that jumps from event to event, or on that of the machine."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NoReturn

from flexbt_core.behavior_tree import (
    Blackboard,
    BlackboardError,
    ConversionError,
    NodeExecutionError,
    NodeStatus,
    StatusLog,
    Tree,
    TreeKey,
    TreeLibrary,
    TreeLoadError,
    TreeNode,
)
from flexbt_core.clock import Clock, ManualClock, SteadyClock
from flexbt_server.groot2 import LogBuffer, LogWriter
from flexbt_tools.errors import RefusedError, UsageError
from flexbt_tools.trees import BlackboardFile

from .mock_plan import MockPlan
from .mocks import Mocking, written

DEFAULT_RATE: Final = 10.0
NO_ENTRIES: Final = BlackboardFile()


class MockRun:
    """A tree with its clock."""

    def __init__(
        self,
        library: TreeLibrary,
        key: TreeKey,
        plan: MockPlan,
        *,
        real_time: bool = False,
        rate: float = DEFAULT_RATE,
        read_inputs: bool = False,
        blackboard: BlackboardFile = NO_ENTRIES,
        on_status: Callable[[float, TreeNode, NodeStatus, NodeStatus], None] | None = None,
        log: Path | None = None,
    ) -> None:
        """``rate`` is the least rate of ticks, Hz. ``on_status(time, node, before, after)`` hears of every change
        of a status; the time is that since the beginning, s. ``log`` is a file for them, as Groot2 opens it.

        Raises RefusedError when the tree cannot be made, or the plan does not fit it.
        """
        self._clock: Clock = SteadyClock() if real_time else ManualClock()
        self._start = self._clock.now()
        self._period = 1.0 / rate
        self._woken = threading.Event()
        self.ticks = 0
        mocking = Mocking(library, plan, read_inputs=read_inputs)
        board = Blackboard()
        blackboard.fill_text(board)
        # Text may be what nodes are made of, and it fixes no type.
        _fill(board, {name: value for name, value in plan.blackboard.items() if isinstance(value, str)})
        try:
            self.tree = Tree(
                library,
                key.id,
                file=key.file,
                blackboard=board,
                clock=self._clock,
                substitute=mocking.substitute,
                on_wake=self._woken.set,
            )
        except TreeLoadError as error:
            raise RefusedError(error.errors) from error
        errors = mocking.wrong()
        if errors:
            raise RefusedError(errors)
        blackboard.fill(board)
        _fill(board, plan.blackboard)
        self._log: LogWriter | None = None
        if log is not None:
            marks = LogBuffer(lambda: round(self.time * 1e9), timed=True)
            self._log = LogWriter(log, self.tree, marks, 0, time.time(), on_error=_cannot_write)
            self.tree.observe(StatusLog(marks), after_round=self._log.flush)
        self._kept = self.tree.observers
        if on_status is not None:
            heard = on_status
            after_round = None if self._log is None else self._log.flush
            self.tree.observe(
                *self._kept,
                lambda node, before, after: heard(self.time, node, before, after),
                after_round=after_round,
            )

    @property
    def time(self) -> float:
        """Time since the beginning, s."""
        return self._clock.now() - self._start

    def run(self, timeout: float) -> NodeStatus:
        """Ticks the tree, as the BT server would, until it is not RUNNING, or for ``timeout`` seconds of its clock.

        Raises NodeExecutionError.
        """
        tree, clock = self.tree, self._clock
        end = self._start + timeout
        while True:
            self.ticks += 1
            status = tree.tick_once()
            now = clock.now()
            if status is not NodeStatus.RUNNING or now >= end or tree.wake_pending:
                return status
            # The next tick of the rate, or what a node has asked for, or the end.
            due = self._start + (math.floor((now - self._start) / self._period + 1e-6) + 1) * self._period
            self._wait(min(due, math.inf if tree.next_wake is None else tree.next_wake, end))
            tree.take_wake()

    def _wait(self, when: float) -> None:
        if isinstance(self._clock, ManualClock):
            self._clock.set(max(when, self._clock.now()))
        else:
            self._woken.wait(max(0.0, when - self._clock.now()))
            self._woken.clear()

    def close(self) -> None:
        """Halts what runs. Raises UsageError when the log cannot be written."""
        after_round = None if self._log is None else self._log.flush
        self.tree.observe(*self._kept, after_round=after_round)
        with contextlib.suppress(NodeExecutionError):
            self.tree.halt()
        if self._log is not None:
            self._log.flush()


def _cannot_write(reason: str) -> NoReturn:
    raise UsageError(reason)


def _fill(board: Blackboard, values: Mapping[str, Any]) -> None:
    """Writes entries, each as the type that it has. Raises UsageError."""
    for key, value in values.items():
        entry = board.entry(key)
        try:
            board.set(key, written(value, None if entry is None else entry.type))
        except (BlackboardError, ConversionError) as error:
            raise UsageError(f'blackboard: {error}') from error
