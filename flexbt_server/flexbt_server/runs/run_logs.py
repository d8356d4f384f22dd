# SPDX-License-Identifier: BSD-3-Clause
"""Readers of runs: log files for Groot2 (``.btlog``), Nav2's topic ``behavior_tree_log``, the XML of the tree as a
topic, and live views in Groot2.

The nodes in a file are fixed: a run whose nodes change continues in another file.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from nav2_msgs.msg import BehaviorTreeLog, BehaviorTreeStatusChange
from rclpy.event_handler import PublisherEventCallbacks
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.engine.observers import LogReader
from flexbt_core.behavior_tree.engine.tick_control import TickControl
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard_json import JsonTypes
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.work_thread import LateWork, WorkThread
from flexbt_core.values.text import sanitize_for_message
from flexbt_server.errors import ServerParameterError
from flexbt_server.groot2.log_file import SUFFIX, LogBuffer, LogWriter
from flexbt_server.groot2.protocol import tree_document

from .run_events import RoundEnded, RunEnded, RunEvent, RunEvents, RunPaused, RunReader, RunStarted, TreeExpanded

if TYPE_CHECKING:
    from flexbt_server.groot2.server import Groot2Server
    from flexbt_server.groot2.watched_tree import WatchedTree

_OURS: Final = re.compile(rf'\d{{8}}T\d{{6}}\.\d{{6}}Z_.*_[0-9a-f]{{8}}{re.escape(SUFFIX)}')
_UNFIT: Final = re.compile(r'[^\w.-]')
_NAME_LIMIT: Final = 80
"""Maximum number of bytes of the ID of a tree in the name of its file; a file system allows 255 in all."""

MOST_WAITING: Final = 10_000
"""Maximum number of rounds of ticks of all runs that wait for the disk; the log of a run that exceeds it ends."""

STUCK_SECONDS: Final = 2.0
"""Time for writing one round after which the node reports a slow disk, s."""

TELL_SECONDS: Final = 60.0
"""Minimum time between two reports of logs that cannot be written, s: a full disk ends the log of each run."""

_CLOSE_SECONDS: Final = 1.0


class RunLogs:
    """A writer of log files, with a separate thread. File names have start time (UTC), tree and run, in this order."""

    def __init__(self, runtime: Runtime, directory: Path, keep: int) -> None:
        """Raise ServerParameterError if the directory does not exist and cannot be made."""
        try:
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise ServerParameterError(f"parameter 'btlog_directory': {directory}: {error.strerror}") from error
        self._directory = directory
        self._keep = keep
        self._error = runtime.node.get_logger().error
        self._is_stuck = False
        self._writer = WorkThread(
            'btlog',
            runtime.steady,
            STUCK_SECONDS,
            self._tell_stuck,
            lambda error: runtime.post(lambda: runtime.report_fault(error, 'the thread that writes the logs of trees')),
        )
        runtime.on_close(self._close)

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader that writes the log of one run."""
        return _RunLog(self, events.run_id)

    def begin(self, tree: Tree, run_id: str, marks: LogBuffer) -> LogWriter:
        """Begin a file for the present nodes of the tree."""
        start = time.perf_counter_ns()
        epoch = time.time()
        started = datetime.fromtimestamp(epoch, UTC)
        name = _UNFIT.sub('_', tree.key.id).encode()[:_NAME_LIMIT].decode(errors='ignore')
        path = self._directory / f'{started:%Y%m%dT%H%M%S.%fZ}_{name}_{run_id[:8]}{SUFFIX}'
        log = LogWriter(path, tree, marks, start, epoch, write=self._write, on_error=self._tell_end)
        self._write(self._prune)
        return log

    def _write(self, step: Callable[[], None]) -> str:
        """Queue a step for the writer thread. Return '', or the reason if the queue is full."""
        if self._writer.waiting >= MOST_WAITING:
            return f'the disk does not answer, and {MOST_WAITING} rounds wait for it'
        self._writer.submit(step, str(self._directory))
        return ''

    def _tell_end(self, text: str) -> None:
        self._error(text, throttle_duration_sec=TELL_SECONDS)

    def _tell_stuck(self, work: LateWork | None) -> None:
        was_stuck, self._is_stuck = self._is_stuck, work is not None and not work.uses_processor
        if work is not None and self._is_stuck and not was_stuck:
            self._error(
                f'{work.what}: nothing has been written for {work.seconds:g} s, the disk does not answer; the logs of '
                f'trees wait for it, up to {MOST_WAITING} rounds'
            )

    def _close(self) -> None:
        """Wait for a limited time until the queue is written."""
        if not self._writer.is_done_within(_CLOSE_SECONDS):
            self._error(
                f'{self._directory}: the disk has not written the logs of trees within {_CLOSE_SECONDS:g} s of the '
                'end; their last rounds are missing'
            )
        self._writer.close()

    def _prune(self) -> None:
        problem: OSError | None = None
        try:
            files = sorted(path for path in self._directory.iterdir() if _OURS.fullmatch(path.name))
        except OSError as error:
            files, problem = [], error
        for path in files[: -self._keep]:
            try:
                path.unlink(missing_ok=True)  # another server may use the same directory
            except OSError as error:
                problem = error
        if problem is not None:
            self._error(
                f'{self._directory}: old log files cannot be removed: {problem}', throttle_duration_sec=TELL_SECONDS
            )


class _RunLog(RunReader):
    def __init__(self, logs: RunLogs, run_id: str) -> None:
        self.log = self._marks = LogBuffer(time.perf_counter_ns, timed=True)
        self._logs = logs
        self._run_id = run_id
        self._writer: LogWriter | None = None

    def read(self, event: RunEvent) -> None:
        if self._writer is not None and isinstance(event, RoundEnded | TreeExpanded | RunEnded):
            self._writer.flush()
        if isinstance(event, RunStarted | TreeExpanded):
            self._writer = self._logs.begin(event.tree, self._run_id, self._marks)


# The topic ``behavior_tree_log`` of Nav2: the status changes in each round of a tick.
#
# (Nav2 publishes them only between two ticks, and so never the last changes of a tree.) Without a subscriber, no
# message is created.

MOST_CHANGES: Final = 1000
"""Maximum number of changes in a message."""

LoggedChange = tuple[int, int, int]
"""The uid of a node, and its status before and after."""


class TreeLogs:
    """A publisher of the log of every run; unless ``always``, of each run that starts while somebody listens."""

    def __init__(self, runtime: Runtime, *, always: bool) -> None:
        self._runtime = runtime
        self._always = always
        self._publisher: Any = runtime.node.create_publisher(BehaviorTreeLog, names.BEHAVIOR_TREE_LOG, 10)

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader that publishes the log of one run."""
        return _TreeLog(self) if self._always or self._publisher.get_subscription_count() else _NoReader()

    def publish(self, names_of: dict[int, str], changes: list[LoggedChange]) -> None:
        """Publish recent changes; from any thread. An error in publishing does not end the tree."""
        if not self._publisher.get_subscription_count():
            return
        now = self._runtime.clock.stamp()
        log = [
            BehaviorTreeStatusChange(
                timestamp=now,
                node_name=names_of[uid],
                uid=uid,
                previous_status=NodeStatus(before).name,
                current_status=NodeStatus(after).name,
            )
            for uid, before, after in changes
        ]
        try:
            for first in range(0, len(log), MOST_CHANGES):
                self._publisher.publish(BehaviorTreeLog(timestamp=now, event_log=log[first : first + MOST_CHANGES]))
        except Exception as error:
            self._runtime.report_fault(error, f'the topic {names.BEHAVIOR_TREE_LOG}')


class _NoReader(RunReader):
    def read(self, event: RunEvent) -> None:
        pass


class _TreeLog(RunReader):
    def __init__(self, logs: TreeLogs) -> None:
        self.log = self._marks = LogBuffer(time.monotonic_ns)
        self._logs = logs
        self._names: dict[int, str] = {}
        self._changes: LogReader[LoggedChange]

    def read(self, event: RunEvent) -> None:
        if isinstance(event, RoundEnded | TreeExpanded | RunEnded) and (marks := self._marks.take()):
            self._logs.publish(self._names, self._changes.read(marks))
        if isinstance(event, RunStarted | TreeExpanded):
            self._names = {node.uid: node.name for node in event.tree.nodes}
            self._changes = LogReader(event.tree.nodes, lambda uid, before, after: (uid, before, after))


# The topic ``behavior_tree_xml``: the XML of the latest tree, with the uids by which ``behavior_tree_log`` names nodes.
#
# Panels for Foxglove draw a tree from these two topics (such as that of Polymath Robotics: a String
# with the XML, a BehaviorTreeLog with the uids or names). There is no agreed standard. The XML is made only when
# somebody listens.


class TreeDocuments:
    """A publisher of the XML of the running tree that started last, or whose nodes have changed last."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._trees: dict[Tree, None] = {}
        """The running trees, the latest last."""
        self._publisher: Any = runtime.node.create_publisher(
            String,
            names.BEHAVIOR_TREE_XML,
            names.transient_local_qos(),
            event_callbacks=PublisherEventCallbacks(matched=self._matched, use_default_callbacks=False),
        )

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader that publishes the document of one run."""
        return _TreeDocument(self)

    def show(self, tree: Tree) -> None:
        """Show a tree from now on. From any thread."""
        self._trees.pop(tree, None)
        self._trees[tree] = None
        if self._publisher.get_subscription_count():
            self._publish(tree)

    def forget(self, tree: Tree) -> None:
        """Keep the document of a tree that has ended with the middleware only."""
        self._trees.pop(tree, None)

    def _matched(self, event: Any) -> None:
        tree = next(reversed(tuple(self._trees)), None)
        if event.total_count_change > 0 and tree is not None:
            self._publish(tree)

    def _publish(self, tree: Tree) -> None:
        try:
            self._publisher.publish(String(data=sanitize_for_message(tree_document(tree))))
        except Exception as error:
            self._runtime.report_fault(error, f'the topic {names.BEHAVIOR_TREE_XML}')


class _TreeDocument(RunReader):
    def __init__(self, documents: TreeDocuments) -> None:
        self._documents = documents
        self._tree: Tree | None = None

    def read(self, event: RunEvent) -> None:
        match event:
            case RunStarted() | TreeExpanded():
                self._tree = event.tree
                self._documents.show(event.tree)
            case RunEnded() if self._tree is not None:
                self._documents.forget(self._tree)


# Shows the runs of the server to Groot2; see :class:`Groot2Server`.


class Groot2Runs:
    """The owner of the Groot2 port: it opens the port, and closes it with the node."""

    def __init__(self, runtime: Runtime, port: int, address: str, only: str, types: JsonTypes) -> None:
        """``only``: the ID of the tree to show, '' for the newest; ``types`` converts values of blackboards.

        Raises:
            ServerParameterError: the port cannot be opened.
        """
        try:
            # Import here: only users of Groot2 need pyzmq.
            from flexbt_server.groot2.server import Groot2Server
        except ImportError as error:
            raise ServerParameterError(
                f"parameter 'groot2_port': {error.name} is missing; install python3-zmq and python3-msgpack"
            ) from error
        try:
            self._server = Groot2Server(port, address, only=only, types=types)
        except OSError as error:
            raise ServerParameterError(f"parameter 'groot2_port': {error.strerror}") from error
        runtime.on_close(self._server.close)

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader that shows one run. All readers see a breakpoint that holds the run as a pause."""
        return _Groot2Run(self._server, events)


class _Groot2Run(RunReader):
    def __init__(self, server: Groot2Server, events: RunEvents) -> None:
        self.log = self._marks = LogBuffer(time.perf_counter_ns)
        self._server = server
        self._events = events
        self._control: TickControl | None = None
        self._watched: WatchedTree | None = None

    def read(self, event: RunEvent) -> None:
        watched = self._watched
        match event:
            case RunStarted(tree, control):
                self._control = control
                self._watched = self._server.add(tree, self._marks, self._pause)
            case RoundEnded() if watched is None:
                self._marks.take()
            case RoundEnded() if watched is not None:
                watched.settle()
            case TreeExpanded() if watched is not None:
                self._watched = self._server.expanded(watched, self._pause)
            case RunEnded() if watched is not None:
                self._server.remove(watched)

    def _pause(self, is_held: bool) -> None:
        is_paused = self._control is not None and self._control.paused  # then a step has come to the breakpoint
        self._events.emit(RunPaused(is_held or is_paused))
