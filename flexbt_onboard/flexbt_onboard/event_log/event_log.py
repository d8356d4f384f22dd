# SPDX-License-Identifier: BSD-3-Clause
"""The event log: who did what and when, and what the robot did, as lines of JSON that are only ever appended.

A file is ``<node>.jsonl``, where ``<node>`` is the name of the executive with its namespace; by default in a directory
for its ROS domain, so that no two executives share one. When it has its full size it becomes ``<node>.1.jsonl``, and so
on up to a number of files.
A thread of its own writes, so that nobody waits for the disk; that it hangs is told, and events wait. What cannot be
written is counted, and each reason told once, until something is written again. A disk that was full leaves a line that
is cut off, and an empty one when it goes on.

Each line is an object with ``time`` (seconds of wall time since the epoch), ``stamp`` (seconds on the node's clock),
``event``, and what belongs to the event:

==============  ========================================================================================================
executive       ``state`` 'started' or 'ended', ``executive``
started         a run: ``run``, ``behavior``, ``arguments``, ``inputs`` (keys), ``autonomy``, ``by``
resumed         a run goes on after the executive was restarted: ``run``, ``behavior``, ``by``
refused         it could not be built: ``run``, ``behavior``, ``why``
skills          what the skills of the states say that the run may contradict: ``run``, ``skills`` by path (see
                :func:`flexbt_core.skills.claims`)
entered         a state: ``run``, ``path``
left            a state or machine: ``run``, ``path``, ``outcome``, ``target``, ``reason``
waiting         for the operator: ``run``, ``decision``, ``path``, ``kind``, ``outcome``, ``outcomes``, ``required``,
                ``prompt``
decided         a decision waits no longer, whatever became of it: ``run``, ``decision``
switched        the run goes on with another behavior: ``run``, ``behavior``, ``arguments``, ``by``
fault           ``run``, ``path``, ``text``
stopping        a run: ``run``, ``why``
ended           a run: ``run``, ``behavior``, ``outcome``, ``message``
command         of an operator, a note too: the fields of ExecutiveCommand that are set, ``effect`` 'applied', 'refused'
                or 'ignored', ``why``
authority       ``holder``, ``requests``, ``text``
operator        ``text``: consoles came or went, and what was done about it
lost            ``number`` of events that could not be written before this one
==============  ========================================================================================================
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final

from flexbt_common.values import seconds_of
from flexbt_core.clock import Clock, told_when_late

if TYPE_CHECKING:
    from flexbt_common.runtime import RosClock

EVENT_LOG_SIZE: Final = 10_000_000
"""Bytes of a file before the next one is begun."""

EVENT_LOG_FILES: Final = 5
"""Files that are kept, the one that is being written included."""

MOST_WAITING: Final = 20_000
"""Events that may wait for a disk that is slow, those included that it is to write now; more of them are lost, and
counted."""

STUCK_SECONDS: Final = 2.0
"""A disk that takes longer than this for what waits is told."""

_CLOSE_SECONDS: Final = 0.3


class EventLog:
    """Appends events to a file; from any thread.

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
        self._queue: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
        self._lock = threading.Lock()
        self._lost = 0
        self._problems: set[object] = set()  # that were told since something was written
        self._in_hand = 0
        self._thread = threading.Thread(target=self._write_all, name='event_log', daemon=True)
        if file is not None:
            self._thread.start()

    def add(self, event: str, **fields: Any) -> None:
        """Write an event with plain values: texts, numbers, lists and mappings."""
        if self._file is None:
            return
        if self._in_hand + self._queue.qsize() >= MOST_WAITING:
            self._lose(1)
            return
        stamp = self._clock.stamp()
        seconds = round(seconds_of(stamp), 6)
        self._queue.put({'time': round(time.time(), 6), 'stamp': seconds, 'event': event, **fields})

    def close(self) -> None:
        """Write what waits, for a limited time; nothing is written afterwards."""
        if self._file is not None:
            self._queue.put(None)
            self._thread.join(_CLOSE_SECONDS)

    def _write_all(self) -> None:
        is_open = True
        while is_open:
            batch = [self._queue.get()]
            try:
                while len(batch) < MOST_WAITING:
                    batch.append(self._queue.get_nowait())
            except Empty:
                pass
            if None in batch:
                is_open = False
                batch = batch[: batch.index(None)]
            if batch:
                self._in_hand = len(batch)
                self._write([event for event in batch if event is not None])
                self._in_hand = 0

    def _write(self, events: list[dict[str, Any]]) -> None:
        with self._lock:
            lost, self._lost = self._lost, 0
        first = events[0]
        lines = [{'time': first['time'], 'stamp': first['stamp'], 'event': 'lost', 'number': lost}] if lost else []
        lines += events
        try:
            text = ''.join(json.dumps(event, ensure_ascii=False, default=str) + '\n' for event in lines)
            # A line that a full disk has cut off ends here.
            with told_when_late(self._steady, STUCK_SECONDS, self._tell_stuck):
                self._append(('\n' if self._problems else '') + text)
        except Exception as error:  # not of the disk alone: a value may not let itself be written
            self._lose(lost + len(events))
            kind = '' if isinstance(error, OSError) else f'{type(error).__name__}: '
            self._tell(
                (type(error), getattr(error, 'errno', None)),
                f'the event log {self._file} cannot be written: {kind}{error}; going on without it',
            )
            return
        if self._problems:
            self._problems.clear()
            self._on_problem('')

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

    def _lose(self, number: int) -> None:
        with self._lock:
            self._lost += number

    def _append(self, text: str) -> None:
        assert self._file is not None  # else there is no thread
        data = text.encode('utf-8', 'backslashreplace')
        self._file.parent.mkdir(parents=True, exist_ok=True)
        if self._file.exists() and self._file.stat().st_size + len(data) > self._size:
            self._rotate()
        # Opened for each batch: whoever moves or deletes the file does not end the log.
        with self._file.open('ab', buffering=0) as file:
            while data:  # when not all fits, the rest tells why
                data = data[file.write(data) :]

    def _rotate(self) -> None:
        assert self._file is not None
        rotated(self._file, self._files - 1).unlink(missing_ok=True)
        for number in range(self._files - 1, 0, -1):
            younger = rotated(self._file, number - 1)
            if younger.exists():
                younger.replace(rotated(self._file, number))


def newest_log(directory: Path) -> Path | None:
    """The event log below a directory to which something was added last; None when there is none."""
    logs = [file for file in directory.rglob('*.jsonl') if not Path(file.stem).suffix.removeprefix('.').isdigit()]
    return max(logs, key=lambda file: file.stat().st_mtime_ns, default=None)


def rotated(file: Path, number: int) -> Path:
    """The file that was written ``number`` files before."""
    return file if number == 0 else file.with_name(f'{file.stem}.{number}{file.suffix}')
