# SPDX-License-Identifier: BSD-3-Clause
"""A writer and a reader of log files for Groot2 (``.btlog``), and the buffers from which logs are read.

A file consists of: ``BTCPP4-FileLogger2``; one byte, 1; the length of the XML of the tree, 4 bytes; that XML; the start
time since the epoch in µs, 8 bytes; and 9 bytes for each transition, as in a recording (:mod:`.protocol`).
Source: FileLogger2 of BehaviorTree.CPP 4.10, which loses transitions at the end of a run. This writer loses none.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.engine.node import node_path
from flexbt_core.behavior_tree.engine.observers import Log, LogReader
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.errors import Source, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.parser import Element, parse
from flexbt_core.values.text_files import open_private, open_regular, write_whole

from . import protocol
from .protocol import tree_document

SUFFIX: Final = '.btlog'
_MAGIC: Final = b'BTCPP4-FileLogger2'
_VERSION: Final = 1
_LENGTH: Final = struct.Struct('<i')
_TIME: Final = struct.Struct('<q')
_MAX_XML: Final = 1 << 28
_MAX_DEPTH: Final = 10_000

LogStep = Callable[[], None]


class LogError(Exception):
    """A file that is not a log file."""


class LogWriter:
    """A writer of the transitions of one run into a file.

    The tree writes to a log. At the end of each round the writer passes the new content to ``write`` as a step, which
    ``write`` runs in order, at once or on another thread. It may return a reason for a refusal instead: ``on_error``
    gets the reason, and the log ends after the steps passed before. An error of the file system, such as a full disk,
    also ends the log: the file ends with its last complete round, and is removed if not even the header was written.
    """

    def __init__(
        self,
        path: Path,
        tree: Tree,
        log: LogBuffer,
        start: int,
        epoch: float,
        *,
        write: Callable[[LogStep], str | None] = lambda step: step(),
        on_error: Callable[[str], None],
    ) -> None:
        """Begin the file. ``log`` is timed; ``start`` is the start time on its clock, ns, and ``epoch`` the same since
        1970, s."""
        self._path = path
        self._log = log
        self._start = start
        self._write = write
        self._on_error = on_error
        self._reader = LogReader(tree.nodes, _change)
        self._takes_no_more = len(tree.nodes) > protocol.MAX_UID
        self._written = 0
        self._has_failed = False
        if self._takes_no_more:
            on_error(f'{path}: not written, the tree has more than {protocol.MAX_UID} nodes, which is the limit')
        else:
            header = _header(tree, epoch)  # now: at the time of writing the tree may have other nodes
            self._hand_over(lambda: self._store('wb', header))

    def flush(self) -> None:
        """Pass the new content of the log to ``write``. On the thread that ticks the tree."""
        marks = self._log.take()
        if marks and not self._takes_no_more:
            self._hand_over(lambda: self._store('r+b', self._records(marks)))

    def _hand_over(self, step: LogStep) -> None:
        refusal = self._write(step)
        if refusal:
            self._end(refusal)

    def _end(self, why: object) -> None:
        self._takes_no_more = True
        self._on_error(f'{self._path}: the log of this run ends here: {why}')

    def _records(self, marks: list[int]) -> bytes:
        return b''.join(
            protocol.record(max(0, ~when - self._start) // 1000, uid, status)
            for mark, when in zip(marks[::2], marks[1::2], strict=True)
            for uid, status in self._reader.read((mark,))
        )

    def _store(self, mode: str, data: bytes) -> None:
        if self._has_failed:
            return
        try:
            with open(self._path, mode, buffering=0, opener=open_private) as file:
                file.seek(self._written)
                try:
                    write_whole(file.fileno(), data)
                except OSError:
                    file.truncate(self._written)
                    if not self._written:
                        self._path.unlink()
                    raise
            self._written += len(data)
        except OSError as error:
            self._has_failed = True
            self._end(error)


def _change(uid: int, before: int, after: int) -> tuple[int, int]:
    return uid, after


def _header(tree: Tree, epoch: float) -> bytes:
    xml = tree_document(tree).encode()
    return _MAGIC + bytes((_VERSION,)) + _LENGTH.pack(len(xml)) + xml + _TIME.pack(round(epoch * 1e6))


class LoggedNode(NamedTuple):
    """A node of a log, by its uid."""

    path: str
    type: str


class LoggedTransition(NamedTuple):
    """A transition in a log. ``time`` since the start of the log, s; ``before`` is IDLE for a node's first one."""

    time: float
    uid: int
    before: NodeStatus
    after: NodeStatus


class LogContent(NamedTuple):
    """The content of a log file. ``epoch`` is its start since 1970, s; ``left_over`` counts bytes at its end that are
    not a complete or valid transition; ``xml`` is the description of the tree."""

    nodes: dict[int, LoggedNode]
    epoch: float
    transitions: list[LoggedTransition]
    left_over: int
    xml: str


def read_log(path: Path) -> LogContent:
    """Read a log file, even one that is still being written or was cut off. Raises LogError and OSError."""
    with open(path, 'rb', opener=open_regular) as file:
        data = file.read()
    position = len(_MAGIC) + 1 + _LENGTH.size
    if not data.startswith(_MAGIC) or len(data) < position:
        raise LogError(f'{path}: this is not a log file of BehaviorTree.CPP 4 (.btlog)')
    version = data[len(_MAGIC)]
    if version != _VERSION:
        raise LogError(f'{path}: version {version} of the format is not known, only {_VERSION}')
    (length,) = _LENGTH.unpack_from(data, position - _LENGTH.size)
    end = position + length + _TIME.size
    if length < 0 or end > len(data):
        raise LogError(f'{path}: the file ends within the description of its tree')
    try:
        text = data[position : position + length].decode('utf-8', 'replace')
        root = parse(Source(str(path), text), max_bytes=_MAX_XML, max_depth=_MAX_DEPTH)
    except TreeLoadError as error:
        raise LogError(f'{path}: the description of the tree cannot be read: {error}') from error
    (epoch,) = _TIME.unpack_from(data, end - _TIME.size)
    transitions, read = _transitions(data, end)
    return LogContent(dict(described_nodes(root)), epoch / 1e6, transitions, len(data) - read, text)


def _transitions(data: bytes, position: int) -> tuple[list[LoggedTransition], int]:
    transitions = []
    statuses: dict[int, NodeStatus] = {}
    while position + protocol.RECORD_BYTES <= len(data):
        microseconds, uid, number = protocol.read_record(data, position)
        if number > max(NodeStatus):
            break
        status = NodeStatus(number)
        transitions.append(LoggedTransition(microseconds / 1e6, uid, statuses.get(uid, NodeStatus.IDLE), status))
        statuses[uid] = status
        position += protocol.RECORD_BYTES
    return transitions, position


def described_nodes(root: Element) -> Iterator[tuple[int, LoggedNode]]:
    """Yield the nodes of the description of a tree (:func:`.protocol.tree_document`) by their uids."""
    for tree in root.children:
        if tree.tag != 'BehaviorTree':
            continue
        scope = tree.attributes.get('_fullpath', '')
        pending = list(tree.children)
        while pending:
            element = pending.pop()
            pending.extend(element.children)
            written = element.attributes.get('_uid', '')
            if not (written.isascii() and written.isdecimal() and len(written) < 10):
                continue
            uid = int(written)
            type = element.attributes.get('ID', element.tag) if element.tag == 'SubTree' else element.tag
            name = element.attributes.get('name', type)
            path = element.attributes.get('_fullpath') or node_path(scope, type, name, uid)
            yield uid, LoggedNode(path, type)


# Logs of a tree (see ``observers``) with times, which another thread may read later.


class LogBuffer:
    """A log. While it is ``timed``, the complement of its time by ``now`` (ns) follows each mark.

    One thread writes; any thread may take.
    """

    def __init__(self, now: Callable[[], int], *, timed: bool = False) -> None:
        self.timed = timed
        self._marks: list[int] = []
        add = self._marks.append

        def append(mark: int, /) -> None:
            add(mark)
            if self.timed:
                add(~now())

        self.append = append

    def __len__(self) -> int:
        return len(self._marks)

    def take(self) -> list[int]:
        """Return the marks written since the last call."""
        count = len(self._marks)  # the tree may write more meanwhile
        marks = self._marks[:count]
        del self._marks[:count]
        return marks


class TeeLog:
    """A log that writes every mark to several logs."""

    def __init__(self, logs: Sequence[Log]) -> None:
        appends = tuple(log.append for log in logs)

        def append(mark: int, /) -> None:
            for append in appends:
                append(mark)

        self.append = append
