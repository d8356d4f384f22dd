# SPDX-License-Identifier: BSD-3-Clause
"""Publish the structure of each run and all status changes, in order, encoded without an object for each change.

Nodes log marks during a tick. Between two ticks, every BATCH_SECONDS, or sooner if there are many, the stream reads the
marks and publishes them. Nothing is published while nothing changes. The last transitions are published before the
result of the run. A message has at most MAX_CHANGES transitions, and the status of every node after them. So late
subscribers, and those that have lost messages (see the sequence number), are complete with the next message.

The queue is bounded: the thread that ticks the tree publishes, so a tree that changes faster than messages can be
created is slowed down. A slow subscriber slows nothing down; it loses messages.
"""

from __future__ import annotations

import itertools
import struct
import threading
import time
from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Final

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.serialization import serialize_message
from rclpy.time import Time

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.observers import LogReader
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.clock.clock import Timer
from flexbt_msgs import msg

from .run_events import RoundEnded, RunEnded, RunEvent, RunEvents, RunPaused, RunReader, RunStarted, TreeExpanded

BATCH_SECONDS: Final = 0.05
"""Minimum time between two messages of a run, s of wall time, unless more than MAX_MARKS marks wait."""

MAX_MARKS: Final = 8192
"""Maximum number of marks that may wait at the end of a round."""

MAX_CHANGES: Final = 4096
"""Maximum number of transitions in a message, which then has 48 kB."""

MESSAGES_KEPT: Final = 64
"""Number of messages of a topic that the middleware keeps, for pending deliveries and for late subscribers."""

_BATCH_NS: Final = round(BATCH_SECONDS * 1e9)

_GATHER_NS: Final = 2_000_000
"""Time for which the first change after a quiet time waits for changes right after it, such as the end of the run, ns.
The tree continues meanwhile, and does not have to send two messages at its end."""


class TreeStream:
    """The two topics, shared by all runs of a server. The stream publishes open runs again for new subscribers.

    The messages that the middleware keeps for them may be of other runs, since a run can be quiet for a long time.
    """

    def __init__(self, runtime: Runtime) -> None:
        self.runtime = runtime
        self._open: dict[RunStream, None] = {}
        self._lock = threading.Lock()
        self.structures = self._publisher(msg.TreeStructure, names.TREE_STRUCTURE, RunStream.show_structure)
        self.statuses = self._publisher(msg.TreeStatus, names.TREE_STATUS, RunStream.show_statuses)

    def open(self, events: RunEvents) -> RunStream:
        """Return the reader that publishes the events of one run."""
        return RunStream(self, events)

    def begin(self, run: RunStream) -> None:
        """Show a run to new subscribers from now on."""
        with self._lock:
            self._open[run] = None

    def end(self, run: RunStream) -> None:
        """Stop showing a run to new subscribers."""
        with self._lock:
            self._open.pop(run, None)

    def _publisher(self, message_type: type[Any], topic: str, show: Callable[[RunStream], None]) -> Any:
        def matched(event: Any) -> None:
            if event.total_count_change > 0:
                with self._lock:
                    runs = tuple(self._open)
                for run in runs:
                    show(run)

        return self.runtime.node.create_publisher(
            message_type,
            topic,
            names.transient_local_qos(MESSAGES_KEPT),
            event_callbacks=PublisherEventCallbacks(matched=matched, use_default_callbacks=False),
        )


class RunStream(RunReader):
    """A publisher of the events of one run."""

    def __init__(self, stream: TreeStream, events: RunEvents) -> None:
        self.log: list[int] = []
        self._stream = stream
        self._runtime = stream.runtime
        self._run_id = events.run_id
        self._blackboard = events.blackboard
        self._sequence = 0
        self._number = 0
        self._next = 0
        self._latest = 0
        self._timer: Timer | None = None
        self._paused = False
        self._open = False
        self._lock = threading.Lock()

    def read(self, event: RunEvent) -> None:
        """See :class:`RunReader`."""
        match event:
            case RoundEnded():
                self._end_round()
            case RunStarted(tree):
                if self._take_nodes(tree):
                    self._open = True
                    self._stream.begin(self)
            case TreeExpanded(tree):
                self._flush()  # the marks so far belong to the old nodes
                if self._open and self._take_nodes(tree):
                    self._flush(always=True)
            case RunPaused(is_paused):
                self._paused = is_paused
                self._flush(always=True)
            case RunEnded():
                self._stream.end(self)
                self._flush(always=True, finished=True)

    def _take_nodes(self, tree: Tree) -> bool:
        """Publish the present nodes of the tree, to which later changes refer. Return False if that fails."""
        try:
            with self._lock:
                self._number += 1
                self._reader = RoundReader(tree.nodes)
                self._statuses = bytearray(self._reader.statuses)
                self._structure = tree_structure(tree, self._run_id, self._number, self._blackboard, self._now())
            self.show_structure()
        except Exception as error:
            self._stop(error)
            return False
        return True

    def _now(self) -> Time:
        return Time.from_msg(self._runtime.clock.stamp())

    def _end_round(self) -> None:
        log = self.log
        last = log[-1:]
        if not last or last[0] < 0:  # nothing has changed since the last stamp
            return
        now = time.monotonic_ns()
        log.append(-now)
        if len(log) >= MAX_MARKS:
            self._flush()
        elif self._timer is None:
            with self._lock:  # the timer may fire before it is assigned
                self._timer = self._runtime.steady.call_at(max(self._next, now + _GATHER_NS) / 1e9, self._flush)

    def show_structure(self) -> None:
        """Publish the structure, also again for late subscribers."""
        self._stream.structures.publish(self._structure)

    def show_statuses(self) -> None:
        """Publish the statuses for late subscribers."""
        self._flush(always=True)

    def _flush(self, always: bool = False, finished: bool = False) -> None:
        fault: Exception | None = None
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            if not self._open:
                self.log.clear()
                return
            self._open = not finished
            self._next = time.monotonic_ns() + _BATCH_NS
            try:
                for count, changes, is_last in self._batches():
                    if count or always:
                        self._send(count, changes, finished and is_last)
            except Exception as error:
                fault = error
        if fault is not None:
            self._stop(fault)

    def _stop(self, error: Exception) -> None:
        """Stop publishing after a message could not be sent. The tree continues."""
        self._open = False
        self._stream.end(self)
        self._runtime.report_fault(error, 'the monitoring of a tree')

    def _batches(self) -> Iterator[tuple[int, list[bytes], bool]]:
        """Yield the logged changes in batches: number of changes, encoded changes, and whether it is the last batch.

        The last may be empty. When a batch is yielded, ``_statuses`` are the statuses after it.
        """
        length = len(self.log)  # the tree may log more meanwhile
        marks = self.log[:length]
        del self.log[:length]
        now = self._now().nanoseconds
        to_node_time = now - time.monotonic_ns()
        count = 0
        changes: list[bytes] = []
        for stamp, part in _parts(marks):
            # Rounds may end between the lines above, and simulated time differs from the steady clock. So make sure
            # that no stamp is in the future, or older than the previous one unless the node's clock was set back.
            self._latest = min(now, now if stamp is None else max(self._latest, stamp + to_node_time))
            seconds, nanoseconds = divmod(self._latest, 1_000_000_000)
            ends = self._reader.read(part)
            while count + len(ends) > MAX_CHANGES:
                fitting, ends = ends[: MAX_CHANGES - count], ends[MAX_CHANGES - count :]
                apply(fitting, self._statuses)
                yield MAX_CHANGES, [*changes, encoded(seconds, nanoseconds, fitting)], False
                count, changes = 0, []
            count += len(ends)
            changes.append(encoded(seconds, nanoseconds, ends))
            self._statuses[:] = self._reader.statuses
        yield count, changes, True

    def _send(self, count: int, changes: list[bytes], finished: bool) -> None:
        self._sequence += 1
        message = msg.TreeStatus(
            stamp=self._runtime.clock.stamp(),
            run_id=self._run_id,
            sequence=self._sequence,
            structure=self._number,
            finished=finished,
            paused=self._paused and not finished,
            statuses=array('B', self._statuses),
        )
        self._stream.statuses.publish(serialized(message, count, changes))


def _parts(marks: list[int]) -> Iterator[tuple[int | None, list[int]]]:
    """Yield the marks of each round, with the stamp that follows them; None when the round is not over."""
    begin = 0
    for end in itertools.compress(itertools.count(), map((0).__gt__, marks)):
        yield -marks[end], marks[begin:end]
        begin = end + 1
    if begin < len(marks):
        yield None, marks[begin:]


_KINDS: Final = {kind: getattr(msg.TreeNode, kind.name) for kind in NodeKind}


def tree_structure(tree: Tree, run_id: str, number: int, blackboard: str, now: Time) -> msg.TreeStructure:
    """Return the structure of a tree, for drawing it; ``number`` counts the sets of nodes in the run, from 1."""
    parents = {child.uid: node.uid for node in tree.nodes for child in node.attached}
    return msg.TreeStructure(
        stamp=now.to_msg(),
        run_id=run_id,
        number=number,
        behavior_tree=tree.key.id,
        blackboard=blackboard,
        nodes=[
            msg.TreeNode(
                uid=node.uid,
                parent=parents.get(node.uid, 0),
                kind=_KINDS[node.kind],
                name=node.name,
                registration=node.id,
                path=node.path,
            )
            for node in tree.nodes
        ],
    )


# TreeStatus messages as the middleware sends them, without an object for each of their changes.
#
# Creating and serializing the objects takes about 3 microseconds for a change. But ``changes`` is the last field of the
# message, and its elements have a fixed size, so they can be appended to the serialized rest of the message. The
# changes of a round have the same stamp; the bytes after it are the *end* of a change.

_MOST_REMEMBERED: Final = 2_000_000
"""Maximum size of the rounds that are remembered, bytes."""

_END_BYTES: Final = 100
"""Size of an end in a round that is remembered, with its mark, bytes, at most."""

_STAMP: Final = struct.Struct('=iI')
_END: Final = struct.Struct('=HBB')
_COUNT: Final = struct.Struct('=I')


class RoundReader:
    """A reader of rounds of marks that creates the ends of changes.

    It caches rounds: most trees do the same in most rounds, and a lookup is ten times as fast as reading.
    """

    def __init__(self, nodes: Sequence[TreeNode]) -> None:
        self._reader = LogReader(nodes, _END.pack)
        self._rounds: dict[tuple[bytes, tuple[int, ...]], tuple[list[bytes], bytes]] = {}
        self._remembered = 0

    @property
    def statuses(self) -> bytes:
        """Return the statuses of all nodes after the last read; the index is uid - 1."""
        return bytes(self._reader.statuses[1:])

    def read(self, marks: Sequence[int]) -> list[bytes]:
        """Return the ends of the changes for these marks, which follow those of the last call."""
        reader = self._reader
        key = bytes(reader.statuses), tuple(marks)
        known = self._rounds.get(key)
        if known is not None:
            ends, reader.statuses[:] = known
            return ends
        ends = reader.read(marks)
        size = 2 * len(reader.statuses) + _END_BYTES * len(ends)
        self._remembered += size
        if self._remembered > _MOST_REMEMBERED:
            self._rounds.clear()
            self._remembered = size
        self._rounds[key] = ends, bytes(reader.statuses)
        return ends


def encoded(seconds: int, nanoseconds: int, ends: Iterable[bytes]) -> bytes:
    """Return the bytes of TreeStatusChanges with this stamp and these ends, one after the other."""
    return _STAMP.pack(seconds, nanoseconds).join([b'', *ends])


def apply(ends: Iterable[bytes], statuses: bytearray) -> None:
    """Apply these changes to the statuses, whose index is uid - 1."""
    for end in ends:
        uid, _, after = _END.unpack(end)
        statuses[uid - 1] = after


def serialized(message: msg.TreeStatus, count: int, changes: Sequence[bytes]) -> bytes:
    """Return the serialized ``message``, which has no changes, with ``count`` encoded changes appended."""
    data: Any = serialize_message(message)
    # The message ends with the number of changes, 0.
    return b''.join((data[: -_COUNT.size], _COUNT.pack(count), *changes))
