# SPDX-License-Identifier: BSD-3-Clause
"""The last minutes of what is recorded, as a ring of files."""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Final

from rclpy.qos import DurabilityPolicy

from flexbt_console.errors import UsageError

from .run_file import RunWriter
from .topics import TOPICS

SEGMENTS: Final = 8
"""Parts of the ring."""

_TOLERANCE_NS: Final = 10**9
"""Time by which a file may begin later than now, ns."""

_RECORDS: Final = 'records '
"""What the file of the lock begins with, unless the black box ended properly."""


class Ring:
    """The last minutes of what is recorded, in files that each begin with what late subscribers would get.

    Thread-safe. Takes the place of a :class:`RunWriter` for a recorder, and raises nothing: what the disk does not take
    is lost, and :attr:`problem` says so.
    """

    def __init__(self, directory: Path, seconds: float, size: int, now_ns: Callable[[], int] = time.time_ns) -> None:
        """Use a directory that no other process uses.

        Raises:
            UsageError: it cannot be used, belongs to somebody else, or another black box uses it.
        """
        self._directory, self._seconds, self._most, self._now_ns = directory, seconds, size, now_ns
        self._lock = threading.RLock()
        self._topics: dict[str, tuple[str, str, str, str]] = {}
        self._latched: dict[str, deque[tuple[bytes, int, int]]] = {}
        self._held: dict[str, frozenset[str]] = {}
        self._writer: RunWriter | None = None
        self._current: Path | None = None
        self._rolls_at = 0
        self._full_at = 0.0
        self._is_closed = False
        self.problem: OSError | None = None
        try:
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            for own in (directory, directory.parent):
                if own.stat().st_uid != os.getuid() or own.stat().st_mode & 0o022:
                    raise UsageError(f'parameter ring: {own} can be changed by other users; choose another directory')
            self._lock_file = os.open(directory / 'lock', os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(self._lock_file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            known = os.pread(self._lock_file, 1000, 0).decode(errors='replace')
        except BlockingIOError:
            raise UsageError(f'{directory}: another black box of this robot uses it; end that one first') from None
        except OSError as error:
            raise UsageError(f'parameter ring: {directory} cannot be used: {error.strerror or error}') from error
        self.left = self._files() if known else []
        """Files of a black box that was killed."""
        self.noted = known.removeprefix(_RECORDS).strip()
        """What it had noted."""
        self.note(self.noted)

    def add_topic(self, topic: str, resolved: str, type: str, definition: str, depth: int = 0) -> None:
        """Add a topic as to a :class:`RunWriter`; ``depth``: messages that late subscribers get."""
        with self._lock:
            self._topics[topic] = topic, resolved, type, definition
            if depth or (topic in TOPICS and TOPICS[topic].qos.durability is DurabilityPolicy.TRANSIENT_LOCAL):
                self._latched[topic] = deque(maxlen=depth or TOPICS[topic].qos.depth)
            if self._writer is not None:
                self._writer.add_topic(*self._topics[topic])

    def add(self, topic: str, data: bytes, heard: int, sent: int) -> None:
        """Keep a message; times in ns since the epoch. One that has waited counts as heard when the file begins, at the
        earliest: only what late subscribers would get is older. After :meth:`close` it is not kept."""
        with self._lock:
            if self._is_closed:
                return
            now, is_ahead = self._now_ns(), self._is_ahead(self._current)
            if self._writer is None or is_ahead or now >= self._rolls_at or self._writer.size > self._full_at:
                self.roll()
            heard = max(min(heard, now), int(self._current.stem) if self._current else 0)
            if topic in self._latched:
                self._latched[topic].append((data, heard, sent))
            self._write(topic, data, heard, sent)

    @property
    def size(self) -> int:
        """Always 0: a ring has no end."""
        return 0

    def roll(self) -> None:
        """Begin a new file, and remove what is too old or too much."""
        with self._lock:
            self._end_file()
            if self._is_ahead(self._current):
                self._current, now = None, self._now_ns()
                for kept in self._latched.values():
                    known = [(data, now, sent) for data, _, sent in kept]
                    kept.clear()
                    kept.extend(known)
            begin = max(self._now_ns(), int(self._current.stem) + 1 if self._current else 0)
            self._rolls_at = begin + int(self._seconds / SEGMENTS * 1e9)
            self._current = self._directory / f'{begin:020d}.mcap'
            self._remove_old()
            try:
                self._writer = RunWriter(self._current)
                for one in self._topics.values():
                    self._writer.add_topic(*one)
            except OSError as error:
                self._writer, self.problem = None, error
                return
            for topic, kept in self._latched.items():
                for message in kept:
                    self._write(topic, *message)
            # What each file begins with does not count: it may be more than a file is to have, and the next has it too.
            self._full_at = (self._writer.size if self._writer is not None else 0) + self._most / SEGMENTS

    def files(self, since: float = 0.0) -> list[Path]:
        """Return the files that have anything later than ``since``, s since the epoch, oldest first: held ones may be
        much older. The last one may be that which is being written."""
        with self._lock:
            files = self._files()
        return [one for one, ends in zip(files, _ends(files), strict=True) if ends >= since * 1e9]

    def hold(self, holder: str, files: frozenset[str]) -> None:
        """Keep files, whatever their age, until they are released: held by nobody."""
        with self._lock:
            self._held[holder] = files

    def release(self, holder: str) -> None:
        """See :meth:`hold`."""
        with self._lock:
            self._held.pop(holder, None)

    def note(self, text: str) -> None:
        """Note one line for the black box after this one; it gets none if this one ends properly."""
        with contextlib.suppress(OSError):
            os.pwrite(self._lock_file, f'{_RECORDS}{text:<100}'.encode(), 0)

    @property
    def held_size(self) -> int:
        """Bytes of the files that are held."""
        with self._lock:
            held = frozenset().union(*self._held.values())
            return sum(_size(one) for one in self._files() if str(one) in held)

    def close(self, keep: bool) -> None:
        """End the file; remove all files unless they are still to be read."""
        with self._lock:
            self._is_closed = True
            self._end_file()
            if not keep:
                for one in self._files():
                    one.unlink(missing_ok=True)
            os.ftruncate(self._lock_file, 0)
            os.close(self._lock_file)

    def _write(self, topic: str, data: bytes, heard: int, sent: int) -> None:
        try:
            if self._writer is not None:
                self._writer.add(topic, data, heard, sent)
                self.problem = self._writer.problem
        except OSError as error:  # too much waits: go on with a new file
            self._writer, self.problem = None, error

    def _end_file(self) -> None:
        if self._writer is not None:
            with contextlib.suppress(OSError):  # it can be read without its end
                self._writer.close()
            self._writer = None

    def _files(self) -> list[Path]:
        return sorted(one for one in self._directory.glob('*.mcap') if one.stem.isdecimal())

    def _is_ahead(self, file: Path | None) -> bool:
        """Return whether a file is of a time that comes only later: the clock was set back."""
        return file is not None and int(file.stem) > self._now_ns() + _TOLERANCE_NS

    def _remove_old(self) -> None:
        held = frozenset().union(*self._held.values())
        oldest, left = self._now_ns() - int(self._seconds * 1e9), float(self._most)
        files = [one for one in self._files() if one != self._current]
        for one, ends in reversed(list(zip(files, _ends(files), strict=True))):
            is_ahead = self._is_ahead(one)
            left -= 0 if is_ahead else _size(one)
            if str(one) not in held and (is_ahead or ends < oldest or left < 0):
                with contextlib.suppress(OSError):
                    one.unlink()


def _ends(files: list[Path]) -> list[float]:
    """Return when each file ends, ns since the epoch: when the next one begins."""
    return [*(int(one.stem) for one in files[1:]), math.inf][: len(files)]


def _size(file: Path) -> int:
    """Return the size of a file, 0 if it is gone."""
    try:
        return file.stat().st_size
    except OSError:
        return 0
