# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files of runs. A crash loses only the last few messages, and a file without its end can be read.

While the disk is full, data wait in memory. A file that was not closed, or could not be completed on a full disk, ends
after a whole record and lacks the index that many readers need. :func:`recover_run` writes a copy with an index, as
``mcap recover`` of MCAP's tools does.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, Final, cast

import lz4.frame
import zstandard
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from flexbt_console.errors import UsageError
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import open_private, open_regular

CHUNK: Final = 4096
"""Bytes that are compressed and written together; a crash may lose them. Some ten statuses of the executive."""

MOST_WAITING: Final = 16_000_000
"""Maximum bytes that wait for the disk."""

MOST_RECORD: Final = 64_000_000
"""Maximum bytes of a record, and of the decompressed content of a chunk."""

SET_BACK: Final = 10 * 10**9
"""Time by which a message is earlier than one of its topic before it, if the clock was set back in between, ns."""

_MAGIC: Final = b'\x89MCAP0\r\n'

RECORDING: Final = 'recording.mcap'
"""Name of the recording in the folder of an incident."""

DAMAGED: Final = 'lacks its end: its recorder was killed, or the file was cut off or damaged'
"""Warning about a recording for which :func:`read_run` has called ``at_damage``."""

RELATIVE_NAME: Final = 'flexbt_topic'
"""Key in a channel's metadata for the name of the topic relative to the namespace of the robot."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recorded message.

    ``topic`` is relative to the robot's namespace, ``resolved`` is the full name. ``definition`` is the full definition
    of the type, ``data`` the message in CDR. ``time`` is when it was received, ``sent`` when it was sent, ns since the
    epoch.
    """

    topic: str
    resolved: str
    type: str
    definition: str
    data: bytes
    time: int
    sent: int


class RunWriter:
    """A writer of a recording; thread-safe.

    Raises OSError:

    - on creation, if the file cannot be created;
    - on :meth:`add`, if more than :data:`MOST_WAITING` bytes would wait for the disk; then it accepts no more messages;
    - on :meth:`close`, if some bytes still cannot be written.

    In the last two cases the file ends after the last record that fits, and has no index.
    """

    def __init__(self, file: Path) -> None:
        self._stream = _WholeWrites(file)
        self._lock = threading.Lock()
        self._writer = Writer(cast('IO[Any]', self._stream), chunk_size=CHUNK)
        self._writer.start(profile='ros2', library='flexbt')
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add_topic(self, topic: str, resolved: str, type: str, definition: str) -> None:
        """Add a topic, unless it was added before: its name relative to the robot's namespace, and its full name."""
        with self._lock:
            if topic in self._channels:
                return
            if type not in self._schemas:
                self._schemas[type] = self._writer.register_schema(type, 'ros2msg', definition.encode())
            self._channels[topic] = self._writer.register_channel(
                resolved, 'cdr', self._schemas[type], {RELATIVE_NAME: topic, 'offered_qos_profiles': ''}
            )

    def add(self, topic: str, data: bytes, heard: int, sent: int) -> None:
        """Write a message of a topic that was added. ``heard`` and ``sent`` are in ns since the epoch."""
        with self._lock:
            self._writer.add_message(self._channels[topic], heard, data, sent)

    @property
    def problem(self) -> OSError | None:
        """Error because of which data wait for the disk; None if none wait."""
        return self._stream.problem

    @property
    def size(self) -> int:
        """Bytes of the file, including those that wait."""
        return self._stream.tell()

    def close(self) -> None:
        """Write the remaining data and the index."""
        with self._lock, contextlib.closing(self._stream):
            self._writer.finish()  # type: ignore[no-untyped-call]


def write_recording(file: Path, messages: Iterable[tuple[int, str, Any]]) -> None:
    """Write a recording of messages, each as its time (ns since the epoch), the name of its topic, and the message.

    Raises OSError if the file exists or cannot be written.
    """
    from rclpy.serialization import serialize_message  # reading a recording does not need ROS

    from .topics import TOPICS, full_definition

    with contextlib.closing(RunWriter(file)) as writer:
        for now, name, message in messages:
            writer.add_topic(name, f'/{name}', TOPICS[name].type, full_definition(TOPICS[name].type))
            writer.add(name, serialize_message(message), now, now)


class _WholeWrites:
    """A new file that ends after a whole write, whatever fails. Failed writes are retried with the next one.

    ``problem`` is the error because of which writes wait. This is no stream of the standard library: MCAP's writer
    would wrap a raw one in its own buffer, and never flush that.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._file = open(file, 'xb', buffering=0, opener=open_private)  # noqa: SIM115 - see close
        self._size = 0
        self._taken = 0  # bytes, including those that wait
        self._waiting: deque[bytes] = deque()
        self._refusal: OSError | None = None
        self.problem: OSError | None = None

    def write(self, data: bytes) -> int:
        if self._refusal is not None:  # permanent: the index would refer to missing data
            raise self._refusal
        self._waiting.append(data)
        self._taken += len(data)
        try:
            self._write_waiting()
        except OSError as error:
            if self._taken - self._size > MOST_WAITING:
                self._refusal = error
                raise
        return len(data)

    def tell(self) -> int:
        return self._taken

    def close(self) -> None:
        with self._file:
            self._write_waiting()

    def _write_waiting(self) -> None:
        try:
            while self._waiting:
                data = self._waiting[0]
                self._file.seek(self._size)
                written = 0
                while written < len(data):
                    written += self._file.write(data[written:])
                self._size += written
                self._waiting.popleft()
        except OSError as error:
            self.problem = error
            self._file.truncate(self._size)
            raise
        self.problem = None


def recover_run(file: Path, whole: Path) -> int:
    """Copy all messages that can be read from ``file`` into the new file ``whole``, which gets an index; return their
    number.

    Raises:
        UsageError: ``file`` cannot be read or has no messages, or ``whole`` cannot be written.
    """
    messages = read_run(file)
    first = next(messages, None)
    if first is None:
        raise UsageError(f'{file}: has no messages of a run')
    number = 0
    try:
        with contextlib.closing(RunWriter(whole)) as writer:
            for one in itertools.chain([first], messages):
                writer.add_topic(one.topic, one.resolved, one.type, one.definition)
                writer.add(one.topic, one.data, one.time, one.sent)
                number += 1
    except OSError as error:
        raise UsageError(f'{whole}: cannot be written: {error.strerror or error}') from error
    return number


def read_run(file: Path, at_damage: Callable[[], object] = lambda: None) -> Iterator[Recorded]:
    """Yield the messages of a file in the order of the file. If it is cut off or damaged, call ``at_damage`` there, and
    end.

    Raises UsageError if the file cannot be read, is not an MCAP file, or has a chunk of more than MOST_RECORD bytes or
    with an unknown compression.
    """
    try:
        with open(file, 'rb', opener=open_regular) as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise UsageError(f'{file}: is not an MCAP file')
            stream.seek(0)
            yield from _messages(_sound(_unpacked(stream), at_damage))
    except OSError as error:
        raise UsageError(f'{file}: cannot be read: {error.strerror or error}') from error


def going_on(messages: Iterable[Recorded]) -> Iterator[Recorded]:
    """Yield messages with times that go on where the clock of the recorder was set back.

    Those of one topic are in their order. Others may be far behind in the file, because the recorder or its disk stood
    still; so one that is early waits for a further one, which shows whether the clock was set.
    """
    latest: dict[str, int] = {}  # by topic
    newest = ahead = 0
    waiting: list[Recorded] = []
    for one in messages:
        waiting.append(one)
        time = one.time + ahead
        if time < latest.get(one.topic, 0) - SET_BACK:
            ahead = newest - waiting[0].time
        elif time < newest - SET_BACK:
            continue
        for known in waiting:
            latest[known.topic] = known.time + ahead
            newest = max(newest, latest[known.topic])
            yield _ahead_by(ahead, known)
        waiting.clear()
    yield from (_ahead_by(ahead, known) for known in waiting)


def _ahead_by(shift: int, one: Recorded) -> Recorded:
    """Return a message as of a later time, ns. A sender has the same clock, or another one, which is then off."""
    return replace(one, time=one.time + shift, sent=one.sent + shift * (one.sent > 0)) if shift else one


def _messages(records: Iterator[object]) -> Iterator[Recorded]:
    schemas: dict[int, tuple[str, str]] = {}  # name and definition
    channels: dict[int, Channel] = {}
    for record in records:
        if isinstance(record, Schema):
            schemas[record.id] = record.name, record.data.decode('utf-8', 'replace')
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            schema = schemas.get(channel.schema_id)
            topic = channel.metadata.get(RELATIVE_NAME)
            if topic is not None and schema is not None:
                yield Recorded(topic, channel.topic, *schema, record.data, record.log_time, record.publish_time)


def _unpacked(stream: IO[bytes]) -> Iterator[object]:
    """Yield the records of a file, including those in chunks.

    The size of a decompressed chunk is bounded, because a chunk of some kB may expand to any size. A damaged file may
    raise any exception.
    """
    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=MOST_RECORD)
    for record in reader.records:
        if isinstance(record, Chunk):
            data = _decompressed(record)
            yield from breakup_chunk(replace(record, compression='', data=data), validate_crc=True)
        else:
            yield record


def _decompressed(chunk: Chunk) -> bytes:
    if not chunk.compression:
        return chunk.data
    if chunk.compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as plain:
            data = plain.read(MOST_RECORD + 1)
    elif chunk.compression == 'lz4':
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=MOST_RECORD + 1)
    else:
        raise UsageError(f'chunks are compressed by {short_repr(chunk.compression)}, and not by zstd or lz4')
    if len(data) > MOST_RECORD:
        raise UsageError(f'a chunk has more than {MOST_RECORD // 10**6} MB; write the file anew with smaller chunks')
    return bytes(data)


def _sound(records: Iterator[object], at_damage: Callable[[], object]) -> Iterator[object]:
    """Yield the records until reading one raises an exception, which damage may cause; then call ``at_damage``."""
    try:
        yield from records
    except (OSError, UsageError):
        raise
    except Exception:
        at_damage()
