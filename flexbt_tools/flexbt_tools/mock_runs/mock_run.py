# SPDX-License-Identifier: BSD-3-Clause
"""Run a tree with mocks, on a clock that jumps from event to event or on the system clock."""

from __future__ import annotations

import contextlib
import json
import math
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, NoReturn

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes, export_blackboard, import_blackboard
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import BlackboardError, ConversionError, NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import Clock, ManualClock, SteadyClock
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text_files import read_text, write_text
from flexbt_server.groot2.log_file import LogBuffer, LogWriter
from flexbt_tools.errors import RefusedError, UsageError

from .mock_plan import MockPlan
from .mocks import Mocking, written


def json_types(registry: NodeRegistry) -> JsonTypes:
    """Return the types that files may contain: the registered ones, and messages if ROS is available."""
    try:
        from flexbt_server.trees.ros_ports import RosJsonTypes
    except ImportError:
        return registry.json_types
    return RosJsonTypes(registry.json_types)


class BlackboardFile:
    """The content of a file; empty without a file name. Raises UsageError if it cannot be read."""

    def __init__(self, name: str | None = None, types: JsonTypes | None = None) -> None:
        self._name = name
        self._types = types if types is not None else JsonTypes()
        self._document: Mapping[str, Any] = {}
        if name is None:
            return
        try:
            document = load_json(read_text(name))
        except (OSError, ValueError, RecursionError) as error:
            raise UsageError(f'--blackboard {name}: {error}') from error
        if not isinstance(document, dict):
            raise UsageError(f'--blackboard {name}: expected an object, {{"key": value}}')
        self._document = document

    def fill_text(self, board: Blackboard) -> None:
        """Write the text entries, which a tree may need when it is built and which fix no type."""
        self._write(board, {key: value for key, value in self._document.items() if isinstance(value, str)})

    def fill(self, board: Blackboard) -> None:
        """Write all entries. Raises UsageError if one is not understood, or does not fit."""
        self._write(board, self._document)

    def _write(self, board: Blackboard, document: Mapping[str, Any]) -> None:
        try:
            import_blackboard(board, document, self._types)
        except BlackboardError as error:
            raise UsageError(f'--blackboard {self._name}: {error}') from error


def save_blackboard(board: Blackboard, name: str, types: JsonTypes) -> list[str]:
    """Write the blackboard to a file and return the problems of entries that could not be saved.

    Raises UsageError if the file cannot be written.
    """
    document, problems = export_blackboard(board, types)
    try:
        write_text(name, json.dumps(document, indent=2, allow_nan=False) + '\n')
    except OSError as error:
        raise UsageError(f'--save-blackboard {name}: {error}') from error
    return problems


# A tree that runs with mocks, on a clock that jumps from event to event or on the system clock.

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
        """Build the tree.

        ``rate`` is the minimum tick rate, Hz. ``on_status(time, node, before, after)`` is called for every status
        change; the time is in s since the start. ``log`` is a file for the changes, in the format that Groot2 opens.

        Raises RefusedError if the tree cannot be built, or the plan does not fit it.
        """
        self._clock: Clock = SteadyClock() if real_time else ManualClock()
        self._start = self._clock.now()
        self._period = 1.0 / rate
        self._woken = threading.Event()
        self.ticks = 0
        mocking = Mocking(library, plan, read_inputs=read_inputs)
        board = Blackboard()
        blackboard.fill_text(board)
        # Nodes may need text when they are built, and text fixes no type.
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
        self.wakes_itself = False
        """True once a tick has ended because the tree wakes itself without end."""
        self.tree.on_livelock = self._note_livelock
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
        """Time since the start, s."""
        return self._clock.now() - self._start

    def run(self, timeout: float) -> NodeStatus:
        """Tick the tree like the BT server until it is not RUNNING, or for ``timeout`` seconds of its clock.

        Raises NodeExecutionError.
        """
        tree, clock = self.tree, self._clock
        end = self._start + timeout
        while True:
            self.ticks += 1
            status = tree.tick_once()
            now = clock.now()
            if status is not NodeStatus.RUNNING or now >= end or self.wakes_itself:
                return status
            # The earliest of the next periodic tick, the time requested by a node, and the end.
            due = self._start + (math.floor((now - self._start) / self._period + 1e-6) + 1) * self._period
            self._wait(min(due, math.inf if tree.next_wake is None else tree.next_wake, end))
            tree.take_wake()

    def _note_livelock(self, message: str) -> None:
        self.wakes_itself = True

    def _wait(self, when: float) -> None:
        if isinstance(self._clock, ManualClock):
            self._clock.set(max(when, self._clock.now()))
        elif not self.tree.wake_pending:
            self._woken.wait(max(0.0, when - self._clock.now()))
        self._woken.clear()

    def close(self) -> None:
        """Halt the tree. Raises UsageError if the log cannot be written."""
        after_round = None if self._log is None else self._log.flush
        self.tree.observe(*self._kept, after_round=after_round)
        with contextlib.suppress(NodeExecutionError):
            self.tree.halt()
        if self._log is not None:
            self._log.flush()


def _cannot_write(reason: str) -> NoReturn:
    raise UsageError(reason)


def _fill(board: Blackboard, values: Mapping[str, Any]) -> None:
    """Write entries, each converted to the type of its entry. Raises UsageError."""
    for key, value in values.items():
        entry = board.entry(key)
        try:
            board.set(key, written(value, None if entry is None else entry.type))
        except (BlackboardError, ConversionError) as error:
            raise UsageError(f'blackboard: {error}') from error
