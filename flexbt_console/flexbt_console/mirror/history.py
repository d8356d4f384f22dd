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
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any, Final

from flexbt_core.clock.clock import ManualClock

from .mirror import Change, Mirror
from .records import GridMap

HISTORY_BYTES: Final = 64_000_000
"""Bytes of the past of one robot, at most; what is oldest is forgotten. A quarter as much is for its scans."""

CHUNK_BYTES: Final = 1_000_000
CHUNK_CALLS: Final = 500
"""Bytes, and messages, of a chunk; to show a moment, at most one chunk is read."""

MOST_SCANS: Final = 600
"""Latest scans that are kept: they are large, change all the time, and cannot be compressed."""


@dataclass(slots=True, eq=False)
class _Chunk:
    """Contents of the mirror at ``begin``, after the call of the number ``first``, and then received; without map and
    scans. Or the cells of a ``map`` that was received then, which lacks them.

    ``contents`` come before ``data``, until these are compressed.
    """

    begin: float
    first: int
    data: bytes
    map: GridMap | None = None
    contents: dict[str, Any] | None = None
    is_compressed: bool = False

    def raw(self) -> bytes:
        if self.is_compressed:
            return zlib.decompress(self.data)
        return (b'' if self.contents is None else pickle.dumps(self.contents)) + self.data


class History:
    """The past of ``mirror`` from now on, in seconds on the mirror's clock. Thread-safe.

    Nothing large is written or compressed while the mirror, or this, is locked: a STOP would wait for it.
    """

    def __init__(self, mirror: Mirror, most_bytes: int = HISTORY_BYTES) -> None:
        self._mirror = mirror
        self._most_bytes = most_bytes
        self._lock = threading.Lock()
        self._chunks: deque[_Chunk] = deque()
        self._maps: deque[_Chunk] = deque()
        self._full: deque[_Chunk] = deque()  # those that are still to be compressed
        self._begin, self._open = 0.0, io.BytesIO()
        self._contents: dict[str, Any] = {}  # at _begin
        self._calls = self._first = self._head = 0  # _first call of the open chunk, and bytes of the latest contents
        self._scans: deque[tuple[float, int, bytes]] = deque(maxlen=MOST_SCANS)
        mirror.add_reader(self._note)
        mirror.add_listener(lambda change: None if change is Change.COMMAND else self._compress())

    @property
    def begin(self) -> float:
        """The earliest time that can be shown."""
        with self._lock:
            return self._begin_kept()

    @property
    def bytes(self) -> int:
        """Memory that the past takes."""
        with self._lock:
            return self._bytes() + self._open.tell() + self._scan_bytes()

    def limit(self, most_bytes: int) -> None:
        """Change how many bytes it may take; what is too much is forgotten."""
        with self._lock:
            self._most_bytes = most_bytes
            self._forget()

    def moment(self, time: float) -> Mirror:
        """Return the mirror as it was at a time, or at :attr:`begin` if that is later. It stands still."""
        with self._lock:
            time = max(time, self._begin_kept())
            chunk = _Chunk(self._begin, self._first, self._open.getvalue(), contents=self._contents)
            if time < chunk.begin:
                chunk = replace(next(one for one in reversed(self._chunks) if one.begin <= time))
            map = replace(next((one for one in reversed(self._maps) if one.begin <= time), self._maps[0]))
            scan = next((one for at, number, one in reversed(self._scans) if at <= time and number > chunk.first), None)
        stream = io.BytesIO(chunk.raw())
        contents, clock = _loaded(stream), ManualClock(chunk.begin)
        shown = map.map and replace(map.map, cells=map.raw())
        mirror = Mirror.of({**contents, '_surroundings': replace(contents['_surroundings'], map=shown)}, clock)
        scans = [_loaded(io.BytesIO(scan))] if scan is not None else []
        for (now, _), method, arguments in heapq.merge(_calls(stream), scans, key=itemgetter(0)):
            if now > time:
                break
            clock.set(now)
            getattr(mirror, method)(*arguments)
        clock.set(time)
        return mirror

    def _note(self, now: float, method: str, arguments: tuple[Any, ...]) -> None:
        with self._lock:
            self._calls += 1
            if method == 'receive_map':
                self._keep_map(now, arguments[0])
                return
            call = pickle.dumps(((now, self._calls), method, arguments))
            if method == 'receive_scan':
                self._scans.append((now, self._calls, call))
                while self._scan_bytes() > self._most_bytes // 4:
                    self._scans.popleft()
                return
            if method:
                self._open.write(call)
            most = max(CHUNK_BYTES, self._head)
            if not method or self._open.tell() > most or self._calls - self._first > CHUNK_CALLS:
                self._begin_chunk(now)

    def _keep_map(self, now: float, map: GridMap | None) -> None:
        if map is None:
            self._maps.append(_Chunk(now, self._calls, b''))
        else:
            self._maps.append(_Chunk(now, self._calls, map.cells, replace(map, cells=b'')))
            self._full.append(self._maps[-1])

    def _begin_chunk(self, now: float) -> None:
        contents = self._mirror.contents()
        if self._contents:
            self._chunks.append(_Chunk(self._begin, self._first, self._open.getvalue(), contents=self._contents))
            self._full.append(self._chunks[-1])
        else:
            self._keep_map(now, contents['_surroundings'].map)
        contents['_surroundings'] = replace(contents['_surroundings'], map=None)
        self._begin, self._first, self._open, self._contents = now, self._calls, io.BytesIO(), contents

    def _compress(self) -> None:
        """Compress what is full, on the thread that brought a message."""
        while self._full:
            with self._lock:
                if not self._full:  # another thread was faster
                    return
                chunk = self._full.popleft()
            raw = chunk.raw()
            data = zlib.compress(raw, 1)
            with self._lock:
                self._head = self._head if chunk.contents is None else len(raw) - len(chunk.data)
                chunk.data, chunk.contents, chunk.is_compressed = data, None, True
                self._forget()

    def _forget(self) -> None:
        """Forget what is too much once all is compressed: the oldest chunks, and the maps of before them."""
        left = 0 if self._full else self._most_bytes - self._bytes()
        while left < 0 and (self._chunks or len(self._maps) > 1):
            left += len((self._chunks or self._maps).popleft().data)
            begin = self._begin_kept()
            while len(self._maps) > 1 and self._maps[1].begin <= begin:
                left += len(self._maps.popleft().data)

    def _begin_kept(self) -> float:
        return self._chunks[0].begin if self._chunks else self._begin

    def _bytes(self) -> int:
        return sum(len(one.data) for one in (*self._chunks, *self._maps))

    def _scan_bytes(self) -> int:
        return sum(len(scan) for _, _, scan in self._scans)


def _calls(stream: io.BytesIO) -> Iterator[tuple[tuple[float, int], str, tuple[Any, ...]]]:
    while stream.tell() < len(stream.getbuffer()):
        yield _loaded(stream)


def _loaded(stream: io.BytesIO) -> Any:
    return pickle.load(stream)  # noqa: S301 - own bytes, never received
