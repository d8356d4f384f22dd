# SPDX-License-Identifier: BSD-3-Clause
"""The event log: an append-only file of JSON lines with the actions of operators and of the robot, and their times.

The file is ``<node>.jsonl``, where ``<node>`` is the name of the executive with its namespace. By default it is in a
directory of the ROS domain, so that no two executives share a file. A full file is renamed to ``<node>.1.jsonl``, and
so on, up to a maximum number of files.

A separate thread writes, so that no caller waits for the disk. While the disk hangs, is full or fails, events wait, and
are written in order as soon as possible. Each reason is reported once until a write succeeds. Events beyond the maximum
that may wait are lost and counted. If a crash has cut off the last line, it is ended before the next line is written.

Each line is an object with ``time`` (seconds of wall time since the epoch), ``stamp`` (seconds on the node's clock),
``steady`` (seconds since boot, on a clock that cannot be set), ``event``, and the fields of the event:

==============  ========================================================================================================
executive       ``state`` 'started' or 'ended', ``executive``
started         a run began: ``run``, ``behavior``, ``arguments``, ``inputs`` (keys), ``autonomy``, ``by``
resumed         a run continues after a restart of the executive: ``run``, ``behavior``, ``by``
refused         a run could not start: ``run``, ``behavior``, ``why``
skills          claims of the states' skills that the run may contradict: ``run``, ``skills`` by path (see
                :func:`claims`)
entered         a state was entered: ``run``, ``path``
left            a state or machine was left: ``run``, ``path``, ``outcome``, ``target``, ``reason``
waiting         a decision waits for the operator: ``run``, ``decision``, ``path``, ``kind``, ``outcome``,
                ``outcomes``, ``required``, ``prompt``
decided         a decision no longer waits, for any reason: ``run``, ``decision``
switched        the run continues with another behavior: ``run``, ``behavior``, ``arguments``, ``by``
fault           ``run``, ``path``, ``text``
violation       a monitor has found one: ``run``, ``property``, ``path`` (of a state or a node of a tree), ``text``
stopping        a stop of a run was requested: ``run``, ``why``
ended           a run ended: ``run``, ``behavior``, ``outcome``, ``message``
command         a command or note of an operator: the fields of ExecutiveCommand that are set (at most 1,000
                characters of a value), ``effect`` 'applied', 'refused' or 'ignored', ``why``
queue           the mission queue is held or released, or an entry has ended: ``entry`` (0 for all), ``text``
synthesis       a synthesis has ended: ``name``, ``goals``, ``operator``, ``outcome``, ``message``, ``seconds``
authority       ``holder``, ``requests``, ``text``
operator        ``text``: consoles connected or disconnected, and the reaction of the executive
lost            ``number`` of events that are missing at this place
==============  ========================================================================================================
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from flexbt_common.files import INCIDENTS
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.clock.clock import Clock
from flexbt_core.clock.work_thread import watchdog
from flexbt_core.values.text_files import open_private, write_whole

if TYPE_CHECKING:
    from flexbt_common.runtime.ros_clock import RosClock

EVENT_LOG_SIZE: Final = 10_000_000
"""Maximum bytes of a file; then a new one is begun."""

EVENT_LOG_FILES: Final = 5
"""Number of files that are kept, including the current one."""

MOST_WAITING: Final = 20_000
"""Maximum number of events that wait for the disk, including those being written. More are lost, and counted."""

STUCK_SECONDS: Final = 2.0
"""Time after which a write that has not returned is reported, s."""

RETRY_SECONDS: Final = 0.5
"""Time between two attempts to write after the disk has failed, s."""

_MOST_AT_ONCE: Final = 100
"""Maximum number of events per write."""

_CLOSE_SECONDS: Final = 0.3


class EventLog:
    """A log that appends events to a file; from any thread.

    ``on_problem`` is called on the writing thread or on that of ``steady``: with a text for each new reason why the
    file cannot be written, and with '' when it can be written again. Without ``file`` nothing is written. ``clock``
    provides the time stamps.
    """

    def __init__(
        self,
        file: Path | None,
        clock: RosClock,
        steady: Clock,
        on_problem: Callable[[str], None],
        size: int = EVENT_LOG_SIZE,
        files: int = EVENT_LOG_FILES,
    ) -> None:
        self._file = file
        self._clock = clock
        self._steady = steady
        self._on_problem = on_problem
        self._size = size
        self._files = files
        self._changed = threading.Condition()
        self._waiting: deque[dict[str, Any]] = deque()
        self._lost = 0  # events lost after the waiting ones, not noted in the log yet
        self._lacking = 0  # lost events in total, not reported yet
        self._is_closed = False
        self._may_be_cut = True  # the last line of the file may lack its end
        self._problems: set[object] = set()  # kinds reported since the last successful write
        self._thread = threading.Thread(target=self._write_all, name='event_log', daemon=True)
        if file is not None:
            self._thread.start()

    def add(self, event: str, **fields: Any) -> None:
        """Add an event with plain values: strings, numbers, lists and mappings."""
        if self._file is None:
            return
        stamp = round(seconds_of(self._clock.stamp()), 6)
        with self._changed:
            entry = _entry(stamp, event, fields)  # with the lock, so that the lines are in the order of their times
            if len(self._waiting) >= MOST_WAITING:
                self._lost += 1
                self._lacking += 1
            else:
                self._note_lost(entry)
                self._waiting.append(entry)
                self._changed.notify()

    def close(self) -> None:
        """Write the waiting events, for a limited time. Later events are dropped."""
        if self._file is not None:
            with self._changed:
                self._is_closed = True
                self._changed.notify()
            self._thread.join(_CLOSE_SECONDS)

    def _note_lost(self, before: Mapping[str, Any]) -> None:
        if self._lost:
            self._waiting.append(_lost_event(self._lost, before))
            self._lost = 0

    # -- the thread that writes ---------------------------------------------------------------------------------------

    def _write_all(self) -> None:
        while True:
            with self._changed:
                if self._problems:
                    self._changed.wait_for(lambda: self._is_closed, RETRY_SECONDS)
                self._changed.wait_for(lambda: self._waiting or self._is_closed)
                if not self._waiting:
                    return
                events = list(islice(self._waiting, _MOST_AT_ONCE))
                is_last = self._is_closed
            if not self._write(events) and is_last:
                number = len(self._waiting) + self._lacking
                self._on_problem(f'the event log {self._file} lacks the last {number} events: it cannot be written')
                return

    def _write(self, events: Sequence[dict[str, Any]]) -> bool:
        """Write the oldest waiting events. Return True if that was possible."""
        try:
            with watchdog(self._steady, STUCK_SECONDS, self._tell_stuck):
                self._append(events)
        except Exception as error:  # any error, since no other thread would continue writing
            kind = '' if isinstance(error, OSError) else f'{type(error).__name__}: '
            self._tell(
                (type(error), getattr(error, 'errno', None)),
                f'the event log {self._file} cannot be written: {kind}{error}; up to {MOST_WAITING} events wait for it',
            )
            return False
        stamp = round(seconds_of(self._clock.stamp()), 6)
        with self._changed:
            self._note_lost(_entry(stamp, '', {}))
            lacking, self._lacking = self._lacking, 0
        if lacking:
            self._on_problem(f'the event log {self._file} lacks {lacking} events: more than {MOST_WAITING} had to wait')
        if lacking or self._problems:
            self._problems.clear()
            self._on_problem('')
        return True

    def _line(self, event: dict[str, Any]) -> bytes:
        """Return the line of an event. Report an event that cannot be written, and record it as lost."""
        try:
            text = json.dumps(event, ensure_ascii=False, default=str)
        except Exception as error:  # a value may raise anything when converted
            why = f'{type(error).__name__}: {error}'
            self._tell(type(error), f'the event log {self._file} lacks an event {event["event"]!r}: {why}')
            text = json.dumps(_lost_event(1, event))
        return f'{text}\n'.encode('utf-8', 'backslashreplace')

    def _tell_stuck(self) -> None:
        self._tell(
            TimeoutError,
            f'the event log {self._file} has not been written for {STUCK_SECONDS:g} s, the disk does not answer; up to '
            f'{MOST_WAITING} events wait for it',
        )

    def _tell(self, kind: object, problem: str) -> None:
        if kind not in self._problems:
            self._problems.add(kind)
            self._on_problem(problem)

    def _append(self, events: Sequence[dict[str, Any]]) -> None:
        """Append events, and remove each written one from the queue. Stop when the file is full; the others wait.

        Each line is made when it is written, so that a full disk costs the work for only one line.

        Raises:
            OSError: a line does not fit onto the disk. The part of it that was written is removed.
        """
        assert self._file is not None  # otherwise no thread runs
        self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        size = self._file.stat().st_size if self._file.exists() else 0
        lines = map(self._line, events)
        first = next(lines)
        if size and size + len(first) > self._size:
            self._rotate()
        # Open the file each time, so that the log continues after the file was moved or deleted.
        with open(self._file, 'ab', buffering=0, opener=open_private) as file:
            if self._may_be_cut and _is_cut(self._file):
                file.write(b'\n')
            for line in chain((first,), lines):
                begin = file.tell()
                if begin and begin + len(line) > self._size:
                    break
                self._may_be_cut = True
                try:
                    write_whole(file.fileno(), line)
                except OSError:
                    with suppress(OSError):  # if it fails, the next write ends the cut line
                        file.truncate(begin)
                    raise
                self._may_be_cut = False
                self._waiting.popleft()

    def _rotate(self) -> None:
        """Rename the files, up to the first free number, so that repeating a failed rotation loses no file."""
        assert self._file is not None
        oldest = next((age for age in range(1, self._files) if not rotated(self._file, age).exists()), self._files)
        for age in range(oldest, 0, -1):
            rotated(self._file, age - 1).replace(rotated(self._file, age))
        rotated(self._file, self._files).unlink(missing_ok=True)


def _entry(stamp: float, event: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    now, steady = time.time(), time.clock_gettime(time.CLOCK_BOOTTIME)  # together, to detect steps
    return {'time': round(now, 6), 'stamp': stamp, 'steady': round(steady, 6), 'event': event, **fields}


def _lost_event(number: int, before: Mapping[str, Any]) -> dict[str, Any]:
    """Return the event that records a number of events lost before another one."""
    return {name: before[name] for name in ('time', 'stamp', 'steady')} | {'event': 'lost', 'number': number}


def _is_cut(file: Path) -> bool:
    """Return whether the last line of a file lacks its line end."""
    with file.open('rb') as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - 1))
        return stream.read() not in (b'', b'\n')


def newest_log(directory: Path) -> Path | None:
    """Return the most recently written event log below a directory; None if it contains none. Copies in incidents do
    not count, unless the directory is one."""
    logs = [
        file
        for file in directory.rglob('*.jsonl')
        if not Path(file.stem).suffix.removeprefix('.').isdigit()
        and Path(INCIDENTS).name not in file.relative_to(directory).parts
    ]
    return max(logs, key=lambda file: file.stat().st_mtime_ns, default=None)


def rotated(file: Path, number: int) -> Path:
    """Return the name of a log file after ``number`` rotations."""
    return file if number == 0 else file.with_name(f'{file.stem}.{number}{file.suffix}')
