# SPDX-License-Identifier: BSD-3-Clause
"""The event log: the actions of operators and of the robot with their times, as lines of JSON that are only appended.

A file is ``<node>.jsonl``, where ``<node>`` is the name of the executive with its namespace; by default in a directory
for its ROS domain, so that no two executives share one. When it has its full size it becomes ``<node>.1.jsonl``, and so
on up to a number of files. A separate thread writes, so that nobody waits for the disk. Events wait for one that hangs,
is full or fails, and are written in their order when that is possible; each reason is reported once, until something is
written again. Events above the maximum that may wait are counted. A line that a crash has cut off is ended before the
next one.

Each line is an object with ``time`` (seconds of wall time since the epoch), ``stamp`` (seconds on the node's clock),
``steady`` (seconds on a clock that nobody sets, since the computer was booted), ``event``, and what belongs to the
event:

==============  ========================================================================================================
executive       ``state`` 'started' or 'ended', ``executive``
started         a run: ``run``, ``behavior``, ``arguments``, ``inputs`` (keys), ``autonomy``, ``by``
resumed         a run goes on after the executive was restarted: ``run``, ``behavior``, ``by``
refused         it could not be built: ``run``, ``behavior``, ``why``
skills          what the skills of the states say that the run may contradict: ``run``, ``skills`` by path (see
                :func:`claims`)
entered         a state: ``run``, ``path``
left            a state or machine: ``run``, ``path``, ``outcome``, ``target``, ``reason``
waiting         for the operator: ``run``, ``decision``, ``path``, ``kind``, ``outcome``, ``outcomes``, ``required``,
                ``prompt``
decided         a decision waits no longer, whatever became of it: ``run``, ``decision``
switched        the run goes on with another behavior: ``run``, ``behavior``, ``arguments``, ``by``
fault           ``run``, ``path``, ``text``
stopping        a run: ``run``, ``why``
ended           a run: ``run``, ``behavior``, ``outcome``, ``message``
command         of an operator, a note too: the fields of ExecutiveCommand that are set (of a long value 1,000
                characters), ``effect`` 'applied', 'refused' or 'ignored', ``why``
authority       ``holder``, ``requests``, ``text``
operator        ``text``: consoles came or went, and what was done about it
lost            ``number`` of events that are missing here
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

from flexbt_common.values.message_fields import seconds_of
from flexbt_core.clock.clock import Clock
from flexbt_core.clock.work_thread import watchdog
from flexbt_core.values.text_files import open_private

if TYPE_CHECKING:
    from flexbt_common.runtime.ros_clock import RosClock

EVENT_LOG_SIZE: Final = 10_000_000
"""Bytes of a file before the next one is begun."""

EVENT_LOG_FILES: Final = 5
"""Files that are kept, the one that is being written included."""

MOST_WAITING: Final = 20_000
"""Events that may wait for the disk, those included that it is to write now; more of them are lost, and counted."""

STUCK_SECONDS: Final = 2.0
"""Time that the disk may take for the waiting events before it is reported, s."""

RETRY_SECONDS: Final = 0.5
"""Time between two attempts to write to a disk that has failed, s."""

_MOST_AT_ONCE: Final = 100
"""Events of one attempt."""

_CLOSE_SECONDS: Final = 0.3


class EventLog:
    """A log that appends events to a file; from any thread.

    ``on_problem`` is called on the writing thread, or that of ``steady``: with a text when the file cannot be written,
    or not for a further reason, and with '' when it can be again. Without ``file`` nothing is kept. ``clock`` gives the
    time stamps.
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
        self._lost = 0  # events after those that wait, which are not noted yet
        self._lacking = 0  # total of lost events that were not reported yet
        self._is_closed = False
        self._may_be_cut = True  # the last line of the file
        self._problems: set[object] = set()  # reported since something was written
        self._thread = threading.Thread(target=self._write_all, name='event_log', daemon=True)
        if file is not None:
            self._thread.start()

    def add(self, event: str, **fields: Any) -> None:
        """Write an event with plain values: texts, numbers, lists and mappings."""
        if self._file is None:
            return
        stamp = round(seconds_of(self._clock.stamp()), 6)
        with self._changed:
            entry = _entry(stamp, event, fields)  # here, so that the lines are in the order of their times
            if len(self._waiting) >= MOST_WAITING:
                self._lost += 1
                self._lacking += 1
            else:
                self._note_lost(entry)
                self._waiting.append(entry)
                self._changed.notify()

    def close(self) -> None:
        """Write what waits, for a limited time; nothing is written afterwards."""
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
        """Write the first of those that wait; gives whether that was possible."""
        try:
            with watchdog(self._steady, STUCK_SECONDS, self._tell_stuck):
                self._append(events)
        except Exception as error:  # any error: no other thread writes
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
        """One that cannot be written is reported, and recorded as lost."""
        try:
            text = json.dumps(event, ensure_ascii=False, default=str)
        except Exception as error:  # whatever a value does that does not let itself be written
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
        """Append events, and take each that is written from those that wait. When the file is full the others wait.

        Raises OSError where a line does not fit onto the disk; nothing is left of it. Lines are made one by one: a full
        disk costs only that of the first.
        """
        assert self._file is not None  # else there is no thread
        self._file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        size = self._file.stat().st_size if self._file.exists() else 0
        lines = map(self._line, events)
        first = next(lines)
        if size and size + len(first) > self._size:
            self._rotate()
        # Opened each time: moving or deleting the file does not end the log.
        with open(self._file, 'ab', buffering=0, opener=open_private) as file:
            if self._may_be_cut and _is_cut(self._file):
                file.write(b'\n')
            for line in chain((first,), lines):
                begin = file.tell()
                if begin and begin + len(line) > self._size:
                    break
                self._may_be_cut = True
                try:
                    rest = line
                    while rest:  # when not all fits, the rest tells why
                        rest = rest[file.write(rest) :]
                except OSError:
                    with suppress(OSError):  # else the next line ends it
                        file.truncate(begin)
                    raise
                self._may_be_cut = False
                self._waiting.popleft()

    def _rotate(self) -> None:
        """Only as far as a number is free: a rotation that has failed is done again without a loss."""
        assert self._file is not None
        oldest = next((age for age in range(1, self._files) if not rotated(self._file, age).exists()), self._files)
        for age in range(oldest, 0, -1):
            rotated(self._file, age - 1).replace(rotated(self._file, age))
        rotated(self._file, self._files).unlink(missing_ok=True)


def _entry(stamp: float, event: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    now, steady = time.time(), time.clock_gettime(time.CLOCK_BOOTTIME)  # together: their difference shows a step
    return {'time': round(now, 6), 'stamp': stamp, 'steady': round(steady, 6), 'event': event, **fields}


def _lost_event(number: int, before: Mapping[str, Any]) -> dict[str, Any]:
    """Return the event that reports the number of events lost before another one."""
    return {name: before[name] for name in ('time', 'stamp', 'steady')} | {'event': 'lost', 'number': number}


def _is_cut(file: Path) -> bool:
    """Return whether the last line of a file has no end."""
    with file.open('rb') as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(0, size - 1))
        return stream.read() not in (b'', b'\n')


def newest_log(directory: Path) -> Path | None:
    """Return the most recently written event log below a directory; None if it contains none."""
    logs = [file for file in directory.rglob('*.jsonl') if not Path(file.stem).suffix.removeprefix('.').isdigit()]
    return max(logs, key=lambda file: file.stat().st_mtime_ns, default=None)


def rotated(file: Path, number: int) -> Path:
    """Return the file that was written ``number`` files before."""
    return file if number == 0 else file.with_name(f'{file.stem}.{number}{file.suffix}')
