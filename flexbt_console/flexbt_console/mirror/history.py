# SPDX-License-Identifier: BSD-3-Clause
"""The past of a mirror: what it has received, compressed and bounded, to show it as it was at any time."""

from __future__ import annotations

import heapq
import io
import pickle
import threading
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from operator import itemgetter
from typing import Any, Final, NamedTuple

from flexbt_core.clock.clock import ManualClock

from .mirror import Mirror
from .records import GridMap

HISTORY_BYTES: Final = 64_000_000
"""Bytes of the past of one robot, at most; what is oldest is forgotten."""

CHUNK_BYTES: Final = 1_000_000
CHUNK_CALLS: Final = 500
"""Bytes, and messages, after which a chunk is compressed; to show a moment, at most one chunk is read."""

MOST_SCANS: Final = 600
"""Latest scans that are kept: they are large, change all the time, and cannot be compressed."""


class _Chunk(NamedTuple):
    """What the mirror had at ``begin``, after the call of the number ``first``, and then received. ``map`` is kept
    beside ``data``, which lacks it."""

    begin: float
    first: int
    data: bytes
    map: GridMap | None


class History:
    """The past of ``mirror`` from now on, in seconds on the mirror's clock. Thread-safe."""

    def __init__(self, mirror: Mirror, most_bytes: int = HISTORY_BYTES) -> None:
        self._mirror = mirror
        self._most_bytes = most_bytes
        self._lock = threading.Lock()
        self._chunks: deque[_Chunk] = deque()
        self._begin, self._map, self._open = 0.0, mirror.view().surroundings.map, io.BytesIO()
        self._bytes = self._calls = self._first = self._head = 0  # _first call and _head (bytes) of the open chunk
        self._scans: deque[tuple[float, int, bytes]] = deque(maxlen=MOST_SCANS)
        mirror.add_reader(self._note)

    @property
    def begin(self) -> float:
        """The earliest time that can be shown."""
        with self._lock:
            return self._chunks[0].begin if self._chunks else self._begin

    @property
    def bytes(self) -> int:
        """Memory that the past takes."""
        with self._lock:
            return self._bytes + self._open.tell() + sum(len(scan) for _, _, scan in self._scans)

    def moment(self, time: float) -> Mirror:
        """Return the mirror as it was at a time, or at :attr:`begin` if that is later. It stands still."""
        with self._lock:
            found = next((one for one in reversed(self._chunks) if one.begin <= time), None)
            if time >= self._begin or not self._chunks:
                begin, first, data, map = self._begin, self._first, self._open.getvalue(), self._map
            else:
                begin, first, data, map = found or self._chunks[0]
                data = zlib.decompress(data)
            scan = next((one for at, number, one in reversed(self._scans) if at <= time and number > first), None)
        stream = io.BytesIO(data)
        contents, clock = _loaded(stream), ManualClock(begin)
        mirror = Mirror.of({**contents, '_surroundings': replace(contents['_surroundings'], map=map)}, clock)
        scans = [_loaded(io.BytesIO(scan))] if scan is not None else []
        for (now, _), method, arguments in heapq.merge(_calls(stream), scans, key=itemgetter(0)):
            if now > time:
                break
            clock.set(now)
            getattr(mirror, method)(*arguments)
        clock.set(max(time, begin))
        return mirror

    def _note(self, now: float, method: str, arguments: tuple[Any, ...]) -> None:
        with self._lock:
            self._calls += 1
            call = pickle.dumps(((now, self._calls), method, arguments))
            if method == 'receive_scan':
                self._scans.append((now, self._calls, call))
                return
            if method:
                self._open.write(call)
            most = self._head + max(CHUNK_BYTES, self._head)
            if not method or self._open.tell() > most or self._calls - self._first > CHUNK_CALLS:
                self._begin_chunk(now)

    def _begin_chunk(self, now: float) -> None:
        if self._open.tell():
            chunk = _Chunk(self._begin, self._first, zlib.compress(self._open.getvalue(), 1), self._map)
            self._bytes += self._size(chunk, self._chunks[-1].map if self._chunks else None)
            self._chunks.append(chunk)
        while self._bytes > self._most_bytes and self._chunks:
            gone = self._chunks.popleft()
            self._bytes -= self._size(gone, None)
            if self._chunks and self._chunks[0].map is gone.map is not None:  # it is still there
                self._bytes += len(gone.map.cells)
        contents = self._mirror.contents()
        self._begin, self._first, self._map, self._open = now, self._calls, contents['_surroundings'].map, io.BytesIO()
        contents['_surroundings'] = replace(contents['_surroundings'], map=None)
        self._head = self._open.write(pickle.dumps(contents))

    def _size(self, chunk: _Chunk, before: GridMap | None) -> int:
        """Return the bytes of a chunk, with those of its map unless it is that of the chunk ``before``."""
        return len(chunk.data) + (len(chunk.map.cells) if chunk.map is not None and chunk.map is not before else 0)


def _calls(stream: io.BytesIO) -> Iterator[tuple[tuple[float, int], str, tuple[Any, ...]]]:
    while stream.tell() < len(stream.getbuffer()):
        yield _loaded(stream)


def _loaded(stream: io.BytesIO) -> Any:
    return pickle.load(stream)  # noqa: S301 - own bytes, never received
