# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files of runs: written so that a crash costs the last few messages, read also when their end is missing."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from flexbt_console.errors import UsageError

from .definitions import full_definition

CHUNK: Final = 4096
"""Bytes that are compressed and written together, and may be lost in a crash: some ten pictures of the executive."""

_MAGIC: Final = b'\x89MCAP0\r\n'

RELATIVE_NAME: Final = 'flexbt_topic'
"""Key of a channel's metadata: the name of the topic in the namespace of its robot."""


@dataclass(frozen=True, slots=True)
class Recorded:
    """A message: its topic in the robot's namespace, its type with the full definition, its CDR bytes.

    ``time`` is when it was heard, in ns since the epoch.
    """

    topic: str
    type: str
    definition: str
    data: bytes
    time: int


class RunWriter:
    """Writes a file; may be used from several threads.

    Raises OSError when the file cannot be made, or not be written any more.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self._stream = file.open('xb', buffering=0)
        self._lock = threading.Lock()
        self._writer = Writer(self._stream, chunk_size=CHUNK)
        self._writer.start(profile='ros2', library='flexbt')
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add_topic(self, topic: str, resolved: str, type: str) -> None:
        """Make a topic known: its name in the robot's namespace, and the full one."""
        with self._lock:
            if type not in self._schemas:
                self._schemas[type] = self._writer.register_schema(type, 'ros2msg', full_definition(type).encode())
            self._channels[topic] = self._writer.register_channel(
                resolved, 'cdr', self._schemas[type], {RELATIVE_NAME: topic, 'offered_qos_profiles': ''}
            )

    def add(self, topic: str, data: bytes, heard: int, sent: int) -> None:
        """Write a message; times in ns since the epoch."""
        with self._lock:
            self._writer.add_message(self._channels[topic], heard, data, sent)

    def close(self) -> None:
        """Write what is left, and the index."""
        with self._lock, self._stream:
            self._writer.finish()  # type: ignore[no-untyped-call]


def read_run(file: Path) -> Iterator[Recorded]:
    """The messages of a file in the order in which they were heard; ends where the file was cut off or damaged.

    Raises UsageError when it is no MCAP file.
    """
    try:
        with file.open('rb') as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise UsageError(f'{file}: is no MCAP file')
            stream.seek(0)
            yield from _messages(StreamReader(stream).records)
    except OSError as error:
        raise UsageError(f'{file}: cannot be read: {error.strerror or error}') from error


def _messages(records: Iterator[object]) -> Iterator[Recorded]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    while (record := _next(records)) is not None:
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            schema = schemas.get(channel.schema_id)
            topic = channel.metadata.get(RELATIVE_NAME)
            if topic is not None and schema is not None:
                definition = schema.data.decode('utf-8', 'replace')
                yield Recorded(topic, schema.name, definition, record.data, record.log_time)


def _next(records: Iterator[object]) -> object | None:
    """The next record; None at the end, and where the file is damaged, from which any exception may follow."""
    try:
        return next(records, None)
    except OSError:
        raise
    except Exception:
        return None
