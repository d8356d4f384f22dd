# SPDX-License-Identifier: BSD-3-Clause
"""The journal and its line format.

The journal has everything that the executive must know after a crash. It is on disk before consoles and programs see
the effects.

The file ``<node>.journal`` is append-only. It is replaced as a whole when it has grown, when it was moved or removed,
and after the disk has failed. If a crash has cut off its end, all complete lines are valid. A file that is corrupt in
another way is saved as ``<node>.<time>.corrupt``, and its readable lines are used.

A separate thread writes, so that a disk that is slow or hangs delays only callers that wait until their records are
durable (:meth:`Journal.when_durable`).
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import threading
import time
import zlib
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final
from weakref import WeakSet, WeakValueDictionary

from flexbt_core.clock.clock import Clock
from flexbt_core.clock.work_thread import watchdog
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import open_private, write_whole
from flexbt_msgs.msg import CommandResult
from flexbt_onboard.errors import OnboardError

from .queue_entries import QueueState, is_change

REMEMBERED_COMMANDS: Final = 4096
"""Number of latest commands that are remembered, so that a resend after a restart is not applied again."""

STUCK_SECONDS: Final = 2.0
"""Time after which a write that has not returned is reported, and callers no longer wait for it, s."""

RETRY_SECONDS: Final = 0.5
"""Time between two attempts to write after the disk has failed, s."""

_LARGEST: Final = 1_000_000
"""Size above which the file is rewritten, bytes, or four times its size after the last rewrite if that is more."""

_MOST_WAITING: Final = 1000
"""Maximum number of lines that wait for the disk. Beyond it, and while the disk fails or hangs, the resulting state is
written instead: each line may have megabytes of userdata."""

_CLOSE_SECONDS: Final = 0.3
_OPEN_SECONDS: Final = 5.0

JournaledResult = tuple[str, int, str]
"""Id, code (CommandResult) and reason of a command."""

Callback = Callable[[], object]


@dataclass
class JournalState:
    """The state that the lines describe.

    ``begin`` is the run that has begun and not ended, and ``position`` its last position. ``autonomy`` is the level for
    the next run, if an operator has set one. ``commands`` are the decided commands: code and reason by id. ``queue`` is
    the mission queue.
    """

    begin: dict[str, Any] | None = None
    position: Any = None
    autonomy: int | None = None
    commands: OrderedDict[str, tuple[int, str]] = field(default_factory=OrderedDict)
    queue: QueueState = field(default_factory=QueueState)

    def apply(self, line: JournalLine) -> None:
        """Update the state with a line."""
        # Ignore lines of a run that has ended: it was stopped while its thread was moving or switching.
        is_of_run = self.begin is not None and line.get('run') == self.begin['run']
        if 'begin' in line and (is_of_run or 'run' not in line):
            self.begin, self.position = line['begin'], None
        if is_of_run and 'position' in line:
            self.position = line['position']
        if is_of_run and 'end' in line:
            self.begin = self.position = None
        if 'autonomy' in line:
            self.autonomy = line['autonomy']
        self.queue = self.queue.after(line.get('queue', {}))
        for command_id, code, reason in line.get('commands', ()):
            self.commands[command_id] = (code, reason)
            self.commands.move_to_end(command_id)
        while len(self.commands) > REMEMBERED_COMMANDS:
            self.commands.popitem(last=False)

    def lines(self) -> list[JournalLine]:
        """Return the smallest list of lines that describes the same state."""
        commands = [[command_id, code, reason] for command_id, (code, reason) in self.commands.items()]
        lines: list[JournalLine] = [{'commands': commands}] if commands else []
        if self.autonomy is not None:
            lines.append({'autonomy': self.autonomy})
        lines += [{'queue': change} for change in self.queue.changes()]
        if self.begin is not None:
            lines.append({'begin': self.begin})
            if self.position is not None:
                lines.append({'run': self.begin['run'], 'position': self.position})
        return lines


_closing: WeakValueDictionary[Path, threading.Thread] = WeakValueDictionary()
"""The writing threads of closed journals of this process. Each holds its file until a slow disk has answered."""


def await_closed(file: Path | None) -> None:
    """Wait for a limited time until the last write of a closed journal of this process is on disk.

    Raises:
        OnboardError: the write has not returned in this time.
    """
    if file is not None and (before := _closing.get(file)) is not None:
        before.join(_OPEN_SECONDS)
        if before.is_alive():
            raise _unusable(
                file,
                'the disk still holds up the last write of the journal before this one; wait for it, or name a '
                'directory on another disk',
            )


_held: Final[WeakSet[Journal]] = WeakSet()


def _release_in_child() -> None:
    """Release the journals in a forked process.

    Otherwise a process that a state has forked would hold the lock after the executive is killed, and the next
    executive could not open the journal.
    """
    for journal in tuple(_held):
        journal.release_files()


os.register_at_fork(after_in_child=_release_in_child)


class Journal:
    """The journal of one executive, held by one process at a time. From any thread.

    ``on_problem`` is called once for each reason why the journal cannot be written, and with '' when it can be written
    again. In between the executive continues, but would not know later events after a crash. The call comes before the
    callbacks for records that are not durable. Without ``file``, nothing is written and everything counts as durable.
    """

    def __init__(self, file: Path | None, on_problem: Callable[[str], None], clock: Clock) -> None:
        """Open the journal. ``clock`` measures the wall time that the disk takes.

        Raises:
            OnboardError: the directory cannot be used, the file cannot be read, or another process has the journal.
        """
        self.state = JournalState()
        self.corruption = ''
        """Text for the operator about corruption of the file; '' if the file is intact."""
        self.torn = ''
        """Text for the operator about a last line that a crash cut off; '' for none."""
        self._on_problem = on_problem
        self._clock = clock
        self._changed = threading.Condition()
        self._lines: list[JournalLine] = []
        self._appended, self._durable = 1, 0  # line counts; the first rewrite is one
        self._waiting: deque[tuple[int, Callback]] = deque()  # with the number of lines that must be durable before
        self._is_anew = True  # the file has to be rewritten
        self._problems: set[object] = set()  # kinds reported since the last write
        self._is_closed = False
        self._count = self._size = self._least_size = 0
        self._descriptor = self._guard = -1
        self.is_kept = file is not None
        """True if the journal has a file."""
        if file is None:
            self._is_closed = True
            return
        self.file = file
        await_closed(file)
        try:
            self._take_guard()
            if file.exists():
                with open(file, 'rb', opener=open_private) as content:
                    self._read(content.read())
        except OSError as error:
            self.release_files()
            raise _unusable(file, error) from error
        self._thread = threading.Thread(target=self._write_all, name='journal', daemon=True)
        self._thread.start()

    def append(self, commands: Sequence[JournaledResult] = (), **line: Any) -> None:
        """Append a line with the given parts. After :meth:`close`, lines are dropped."""
        if commands:
            line['commands'] = [list(command) for command in commands]
        with self._changed:
            if self._is_closed:
                return  # an abandoned run at the end of the process, or no file
            self.state.apply(line)
            self._lines.append(line)
            self._appended += 1
            if self._problems or len(self._lines) > _MOST_WAITING:
                self._lines.clear()
                self._is_anew = True
            self._changed.notify()

    def when_durable(self, then: Callback) -> None:
        """Call ``then`` once all lines appended so far survive a crash and a power loss.

        If they do already, call it at once; otherwise it is called later on the writing thread. If the journal cannot
        be written, it is also called, after ``on_problem``.
        """
        with self._changed:
            if self._durable < self._appended and not self._problems and not self._is_closed:
                self._waiting.append((self._appended, then))
                return
        then()

    def sync(self, within: float) -> bool:
        """Wait up to ``within`` seconds for the callback of :meth:`when_durable`. Return True if it came."""
        done = threading.Event()
        self.when_durable(done.set)
        return done.wait(within)

    def close(self) -> None:
        """Write the waiting lines and release the journal for other processes. Wait for a limited time."""
        if not self.is_kept:
            return
        _closing[self.file] = self._thread
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join(_CLOSE_SECONDS)

    def _read(self, data: bytes) -> None:
        found = read_journal(data)
        for line in found.lines:
            self.state.apply(line)
        if found.torn:
            self.torn = (
                f'the last line of the journal {self.file} was cut off when the executive ended ({found.torn} bytes): '
                'what it said had not been told to anybody'
            )
        if found.corruption:
            aside = self.file.with_suffix(f'.{datetime.fromtimestamp(time.time(), UTC):%Y%m%dT%H%M%S%f}.corrupt')
            try:
                os.link(self.file, aside)  # loses nothing if the process ends here, and needs no space
            except OSError:
                self.file.replace(aside)  # not every file system supports links
            self.corruption = (
                f'the journal {self.file} is corrupt: {found.corruption}. It is kept as {aside}; {len(found.lines)} '
                'lines of it count: a run that was interrupted may not be known, or be known at an earlier state'
            )

    # -- the thread that writes ---------------------------------------------------------------------------------------

    def _write_all(self) -> None:
        try:
            self._write_until_closed()
        finally:
            self.release_files()

    def _write_until_closed(self) -> None:
        while True:
            with self._changed:
                if self._problems:
                    self._changed.wait_for(lambda: self._is_closed, RETRY_SECONDS)
                self._changed.wait_for(lambda: self._durable < self._appended or self._is_closed)
                if self._durable == self._appended:
                    return
                lines, self._lines = self._lines, []
                appended, is_anew = self._appended, self._is_anew or self._size > max(_LARGEST, 4 * self._least_size)
                if is_anew:
                    lines = self.state.lines()
                self._is_anew = False
            problem, kind = '', None
            try:
                with watchdog(self._clock, STUCK_SECONDS, self._tell_stuck):
                    if is_anew:
                        self._write_anew(lines)
                    else:
                        self._write(lines)
            except Exception as error:
                # Catch everything: if this thread ended, all callers that wait for durable records would wait forever.
                name = '' if isinstance(error, OSError) else f'{type(error).__name__}: '
                problem = f'the journal {self.file} cannot be written: {name}{error}; a crash now would lose the run'
                kind = type(error), getattr(error, 'errno', None)
            self._tell(kind, problem)
            with self._changed:
                if not problem:
                    self._durable = appended
                else:
                    self._is_anew = True
                    if self._is_closed:
                        return
            self._release()

    def _tell_stuck(self) -> None:
        self._tell(
            TimeoutError,
            f'the journal {self.file} has not been written for {STUCK_SECONDS:g} s, the disk does not answer; what is '
            'shown from now on would be lost in a crash',
        )
        self._release()

    def _tell(self, kind: object, problem: str) -> None:
        """Report each kind of problem once. ``kind`` None and ``problem`` '' mean that the journal was written."""
        told = {kind} | self._problems if problem else set()
        if told != self._problems:
            self._on_problem(problem)
            with self._changed:
                self._problems = told

    def _release(self) -> None:
        """Call the waiting callbacks whose lines are durable; call all of them after a problem was reported."""
        while True:
            with self._changed:
                if not self._waiting or (self._waiting[0][0] > self._durable and not self._problems):
                    return
                _, then = self._waiting.popleft()
            then()

    def _write(self, lines: Sequence[JournalLine]) -> None:
        try:
            is_there = os.path.samestat(os.stat(self.file), os.fstat(self._descriptor))  # noqa: PTH116
        except FileNotFoundError:
            is_there = False
        if not is_there:
            raise OSError('the file was moved or removed')
        data = b''.join(encode_line(self._count + number, line) for number, line in enumerate(lines))
        write_whole(self._descriptor, data)
        os.fdatasync(self._descriptor)
        self._count += len(lines)
        self._size += len(data)

    def _write_anew(self, lines: Sequence[JournalLine]) -> None:
        """Replace the file atomically with one that describes the same state."""
        self._take_guard()
        data = b''.join([encode_head(), *(encode_line(number, line) for number, line in enumerate(lines, 1))])
        fresh = self.file.with_suffix('.fresh')
        fresh.unlink(missing_ok=True)  # left by a killed process, or a link to a file that must not be written
        descriptor = open_private(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND)
        try:
            write_whole(descriptor, data)
            os.fsync(descriptor)
            fresh.replace(self.file)
            directory = os.open(self.file.parent, os.O_RDONLY)
            try:
                os.fsync(directory)
            finally:
                os.close(directory)
        except OSError:
            os.close(descriptor)
            raise
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor, self._count, self._size, self._least_size = descriptor, len(lines) + 1, len(data), len(data)

    def _take_guard(self) -> None:
        """Lock the journal against other processes. Lock it again if the directory was removed since."""
        guard = self.file.with_suffix('.lock')
        if self._guard >= 0 and guard.exists() and os.path.samestat(guard.stat(), os.fstat(self._guard)):
            return
        guard.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = open_private(guard, os.O_RDWR | os.O_CREAT)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            if not isinstance(error, BlockingIOError):  # for example, a file system without locks
                raise
            raise OSError(
                'it is in use by another executive of the same name; give them directories of their own, or names'
            ) from None
        if self._guard >= 0:
            os.close(self._guard)
        self._guard = descriptor
        _held.add(self)

    def release_files(self) -> None:
        """Close the files without writing, which releases the lock for other processes."""
        for descriptor in (self._descriptor, self._guard):
            if descriptor >= 0:
                os.close(descriptor)
        self._descriptor = self._guard = -1


def _unusable(file: Path, why: object) -> OnboardError:
    return OnboardError(f'parameter journal_directory: {file} cannot be used: {why}')


# The format of the lines, and the reading of a file that may be corrupt.
#
# A line consists of the CRC-32 of the rest of the line as eight hexadecimal digits, its number, and a JSON object,
# separated by spaces. The first line, number 0, is the head, ``{"format": 3}``. The others have some of these keys:
#
# - ``begin``: a run has begun, or continues with another behavior. The value is the request of the executive. Its
#   ``entry`` is the number of the entry of the mission queue that it runs; it is missing without one.
# - ``position``: the position from which the machine of the run ``run`` can continue.
# - ``end``: the run ``run`` has ended, or will not continue. The value is the reason.
# - ``autonomy``: the level for the next run that an operator has set; null for the level of the parameter.
# - ``queue``: a change of the mission queue (:mod:`.queue_entries`).
# - ``commands``: lists of id, code and reason of the commands that were decided together with the rest of the line.
#
# Each line is self-contained, so that the lines after a corrupt one are usable.

FORMAT: Final = 3
"""Version of the format. Version 1 had neither head nor numbers, version 2 no queue."""

_READABLE: Final = (2, FORMAT)

JournalLine = dict[str, Any]

_MOST_TOLD: Final = 5
"""Maximum number of problems of a file that are listed individually."""

_MOST_PROBLEMS: Final = 10_000
"""Number of corrupt lines after which reading stops, since the start of the executive waits for it."""

_LONGEST_NAME: Final = 4096
_LONGEST_TEXT: Final = 2_000_000
"""Maximum characters of names, and of arguments and inputs. No command can have longer ones."""

_MOST_PATHS: Final = 10_000
"""Maximum number of paths in a part of a position."""


@dataclass(frozen=True)
class FoundJournal:
    """The contents of a journal file: its lines, and its problems."""

    lines: Sequence[JournalLine] = ()
    corruption: str = ''
    """Damage that a crash cannot cause; '' for none."""
    torn: int = 0
    """Bytes of an incomplete last line, such as a crash leaves."""


def encode_line(number: int, content: JournalLine) -> bytes:
    """Return a line of the file as bytes, with checksum and number."""
    text = b'%d %s' % (number, json.dumps(content, ensure_ascii=True, separators=(',', ':')).encode())
    return b'%08x %s\n' % (zlib.crc32(text), text)


def encode_head() -> bytes:
    """Return the first line of a file."""
    return encode_line(0, {'format': FORMAT})


def read_journal(data: bytes) -> FoundJournal:
    """Read the contents of a file. Never raise: use every intact line, in the order of the numbers."""
    *raw_lines, rest = data.split(b'\n')
    found: dict[int, JournalLine] = {}
    problems: list[str] = []
    version: Any = None
    expected = 0
    for place, raw in enumerate(raw_lines, 1):
        try:
            number, content = _decode(raw)
            if number == 0:
                version = content.get('format')
                if version not in _READABLE:
                    return FoundJournal(corruption=_of_format(version))
            elif problem := _problem_of(content):
                raise ValueError(problem)
            if number in found:
                raise ValueError(f'has the number {number}, as one before')
        except ValueError as error:
            problems.append(f'line {place} {error}')
            if len(problems) >= _MOST_PROBLEMS:
                problems.append(f'nothing was read after line {place}')
                break
            continue
        if number != expected:
            problems.append(f'line {place} has the number {number}, not {expected}')
        found[number], expected = content, number + 1
    if raw_lines and version is None:
        if not found:
            return FoundJournal(corruption=_of_format(1 if _is_of_format_1(raw_lines[0]) else None))
        if not problems:
            problems.append('it has no head')
    elif not data:
        problems.append('it is empty')
    elif not raw_lines and not encode_head().startswith(data):  # for example zeros, after a power loss
        return FoundJournal(corruption=_of_format(None))
    found.pop(0, None)
    return FoundJournal([found[number] for number in sorted(found)], _told(problems), len(rest))


def _decode(raw: bytes) -> tuple[int, JournalLine]:
    """Return number and content of a line. Raise ValueError with a predicate, such as "has no number"."""
    checksum, _, text = raw.partition(b' ')
    if checksum != b'%08x' % zlib.crc32(text):
        raise ValueError('does not have the checksum that it gives')
    number, _, encoded = text.partition(b' ')
    if not number.isdigit() or len(number) > len(str(2**63)):
        raise ValueError('has no number')
    try:
        content = json.loads(encoded)
    except (ValueError, RecursionError) as error:
        raise ValueError(f'is not JSON: {error}') from None
    if not isinstance(content, dict):
        raise ValueError('is not an object')
    return int(number), content


def _of_format(version: Any) -> str:
    if version is None:
        return 'it does not begin as a journal does'
    return f'it is of format {short_repr(version)}, and this version of FlexBT reads formats 2 to {FORMAT}'


def _is_of_format_1(raw: bytes) -> bool:
    checksum, _, text = raw.partition(b' ')
    return text.startswith(b'{') and checksum == b'%08x' % zlib.crc32(text)


def _told(problems: Sequence[str]) -> str:
    more = [f'{len(problems) - _MOST_TOLD} more', problems[-1]] if len(problems) > _MOST_TOLD else []
    return '; '.join([*problems[:_MOST_TOLD], *more])


def _problem_of(content: JournalLine) -> str:
    """Return why an object is not a line of a journal; '' if it is."""
    for name, value in content.items():
        is_fit = _is_fit(name, value)
        if is_fit is None:
            return f'has {short_repr(name)}, which is not known'
        if not is_fit:
            return f'has a {name} that cannot be: {short_repr(value)}'
    if 'run' not in content and not content.keys().isdisjoint({'position', 'end'}):
        return 'does not say which run it is about'
    return ''


def _is_fit(name: str, value: Any) -> bool | None:
    """Return whether a part of a line is valid; None for an unknown part."""
    match name, value:
        case 'run', _:
            return _is_name(value)
        case 'begin', {
            'run': run,
            'behavior': behavior,
            'by': by,
            'autonomy': level,
            'arguments': given,
            'inputs': inputs,
        }:
            are_told = all(map(_is_name, (run, behavior, by))) and _is_level(level)
            are_arguments = _is_list_of(given, _is_name, _is_text)
            are_inputs = _is_list_of(inputs, _is_name, _is_name, _is_text, _is_base64)
            return are_told and are_arguments and are_inputs and type(value.get('entry', 0)) is int
        # Check the parts that consoles see before the run resumes. Resuming checks the rest.
        case 'position', {'active': _, 'coming': _, 'levels': dict(levels), 'locked': _, 'breakpoints': _}:
            paths = (value[part] for part in ('active', 'coming', 'levels', 'locked', 'breakpoints'))
            return all(map(_are_paths, paths)) and all(map(_is_level, levels.values()))
        case 'end', _:
            return isinstance(value, str)
        case 'autonomy', _:
            return value is None or _is_level(value)
        case 'queue', _:
            return is_change(value)
        case 'commands', _:
            return _is_list_of(value, _is_name, _is_code, lambda reason: isinstance(reason, str))
        case 'begin' | 'position', _:
            return False
    return None


def _is_text(value: Any, longest: int = _LONGEST_TEXT) -> bool:
    """Return whether a string is allowed in a ROS message. JSON also allows lone surrogates."""
    return isinstance(value, str) and len(value) <= longest and value.encode('utf-8', 'replace').decode() == value


def _is_name(value: Any) -> bool:
    return _is_text(value, _LONGEST_NAME)


def _are_paths(value: Any) -> bool:
    return isinstance(value, list | dict) and len(value) <= _MOST_PATHS and all(map(_is_name, value))


def _is_level(value: Any) -> bool:
    return type(value) is int and Autonomy.Off <= value <= Autonomy.Full


def _is_code(value: Any) -> bool:
    return type(value) is int and value in (CommandResult.APPLIED, CommandResult.REFUSED)


def _is_base64(value: Any) -> bool:
    try:
        base64.b64decode(value, validate=True)
    except (TypeError, ValueError):
        return False
    return isinstance(value, str)


def _is_list_of(value: Any, *checks: Callable[[Any], bool]) -> bool:
    """Return whether a value is a list of lists, each with one valid item for each check."""
    return isinstance(value, list) and all(
        isinstance(one, list)
        and len(one) == len(checks)
        and all(is_fit(item) for is_fit, item in zip(checks, one, strict=True))
        for one in value
    )
