# SPDX-License-Identifier: BSD-3-Clause
"""The journal: what the executive has to know after a crash, on the disk before anybody is told of it.

The file ``<node>.journal`` holds lines that are only appended: the CRC-32 of the rest as eight hexadecimal digits, a
space, and an object of JSON. What a crash has cut off at the end is dropped when the file is opened. The file is
written anew, beside the old one and then in its place, when it has grown. Damage that no crash leaves, a whole line
that is wrong, is told, and the file is kept as ``<node>.corrupt``.

A line has some of these:

========  ==============================================================================================================
begin     a run has begun: its request, as the executive gave it
position  of the run: what the machine needs to go on from there
end       the run has ended, or will not go on: why
commands  lists of id, code and reason: commands that were decided with what else is in the line
========  ==============================================================================================================
"""

from __future__ import annotations

import fcntl
import json
import os
import threading
import zlib
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from flexbt_onboard.errors import OnboardError

REMEMBERED_COMMANDS: Final = 4096
"""Commands that are remembered, so that a resend after a restart is not applied again."""

_LARGEST: Final = 1_000_000
"""Bytes after which the file is written anew, unless what it has to hold is larger."""

Result = tuple[str, int, str]
"""Id, code (CommandResult) and reason of a command."""


@dataclass
class JournalState:
    """What the lines say: the run that has begun and not ended, where it was, and the commands that were decided."""

    begin: dict[str, Any] | None = None
    position: Any = None
    commands: OrderedDict[str, tuple[int, str]] = field(default_factory=OrderedDict)

    def apply(self, line: dict[str, Any]) -> None:
        """Take in a line."""
        if 'begin' in line:
            self.begin, self.position = line['begin'], None
        if 'position' in line:
            self.position = line['position']
        if 'end' in line:
            self.begin = self.position = None
        for command_id, code, reason in line.get('commands', ()):
            self.commands[command_id] = (code, reason)
            self.commands.move_to_end(command_id)
        while len(self.commands) > REMEMBERED_COMMANDS:
            self.commands.popitem(last=False)

    def lines(self) -> list[dict[str, Any]]:
        """The fewest lines that say the same."""
        commands = [[command_id, code, reason] for command_id, (code, reason) in self.commands.items()]
        lines: list[dict[str, Any]] = [{'commands': commands}] if commands else []
        if self.begin is not None:
            lines.append({'begin': self.begin})
            if self.position is not None:
                lines.append({'position': self.position})
        return lines


class Journal:
    """The journal of one executive, held by one process at a time. From any thread.

    ``on_problem`` is told, once, when it cannot be written any more, and '' when it can be again: the executive goes
    on, but would not know after a crash what happened from there on.
    """

    def __init__(self, file: Path, on_problem: Callable[[str], None]) -> None:
        """Open the journal.

        Raises:
            OnboardError: the directory cannot be written, or another process has the journal.
        """
        self.file = file
        self.state = JournalState()
        self.damage = ''
        """What the operator has to know of the file that was found; '' when all is well."""
        self._on_problem = on_problem
        self._lock = threading.Lock()
        self._has_problem = False
        self._unsynced = False
        self._size = 0
        self._descriptor = -1
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._guard = os.open(file.with_suffix('.lock'), os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise OnboardError(f'parameter journal_directory: {file} cannot be written: {error}') from error
        try:
            fcntl.flock(self._guard, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._guard)
            raise OnboardError(
                f'parameter journal_directory: {file} is in use by another executive of the same name; give them '
                'directories of their own, or names'
            ) from None
        try:
            if file.exists():
                self._read(file.read_bytes())
            self._write_anew()
        except OSError as error:
            self.close()
            raise OnboardError(f'parameter journal_directory: {file} cannot be written: {error}') from error

    def write(self, commands: Sequence[Result] = (), **line: Any) -> None:
        """Append a line with the given parts. It survives the death of the process at once, see :meth:`sync`.

        After :meth:`close` nothing is written.
        """
        if commands:
            line['commands'] = [list(command) for command in commands]
        with self._lock:
            if self._guard < 0:
                return  # closed: a run that was left behind at the end of the process
            self.state.apply(line)
            try:
                if self._has_problem or self._size > max(_LARGEST, 4 * self._least_size):
                    self._write_anew()  # the end of the old file may be a line that was cut off
                else:
                    self._append(encode_line(line))
                    self._unsynced = True
            except OSError as error:
                self._fail(error)
                return
            problem_is_over, self._has_problem = self._has_problem, False
        if problem_is_over:
            self._on_problem('')

    def sync(self) -> None:
        """What was written survives the loss of power as well, when this returns; called before anybody is told."""
        with self._lock:
            if not self._unsynced:
                return
            self._unsynced = False
            descriptor = os.dup(self._descriptor)
        # Without the lock: the disk may take its time, and the run goes on writing.
        try:
            os.fdatasync(descriptor)
        except OSError as error:
            with self._lock:
                self._fail(error)
        finally:
            os.close(descriptor)

    def close(self) -> None:
        """Give the journal up to another process."""
        self.sync()
        with self._lock:
            for descriptor in (self._descriptor, self._guard):
                if descriptor >= 0:
                    os.close(descriptor)
            self._descriptor = self._guard = -1

    def _read(self, data: bytes) -> None:
        lines, rest = read_lines(data)
        for line in lines:
            self.state.apply(line)
        if b'\n' in rest:
            corrupt = self.file.with_suffix('.corrupt')
            corrupt.write_bytes(data)
            self.damage = (
                f'the journal {self.file} is damaged after {len(lines)} lines, and what it said from there on is lost: '
                f'a run that was interrupted may not be known, or be known at an earlier state; it is kept as {corrupt}'
            )

    def _append(self, data: bytes) -> None:
        written = os.write(self._descriptor, data)
        self._size += written
        if written != len(data):
            raise OSError(f'{written} of {len(data)} bytes fit onto the disk')

    def _write_anew(self) -> None:
        """Replace the file by one that says the same: as a whole, or not at all."""
        data = b''.join(encode_line(line) for line in self.state.lines())
        fresh = self.file.with_suffix('.fresh')
        descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
        try:
            written = os.write(descriptor, data)
            if written != len(data):
                raise OSError(f'{written} of {len(data)} bytes fit onto the disk')
            os.fsync(descriptor)
            fresh.replace(self.file)
        except OSError:
            os.close(descriptor)
            raise
        directory = os.open(self.file.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor, self._size, self._least_size = descriptor, len(data), len(data)
        self._unsynced = False

    def _fail(self, error: OSError) -> None:
        # With the lock held: whoever is told must not come back here.
        if not self._has_problem:
            self._has_problem = True
            self._on_problem(f'the journal {self.file} cannot be written: {error}; a crash now would lose the run')


def encode_line(line: dict[str, Any]) -> bytes:
    """A line of the file."""
    text = json.dumps(line, ensure_ascii=True, separators=(',', ':')).encode()
    return b'%08x %s\n' % (zlib.crc32(text), text)


def read_lines(data: bytes) -> tuple[list[dict[str, Any]], bytes]:
    """The lines up to the first that is not whole, and the rest: what a crash has cut off, or a disk has corrupted."""
    lines: list[dict[str, Any]] = []
    size = 0
    for raw in data.split(b'\n')[:-1]:
        checksum, _, text = raw.partition(b' ')
        if checksum != b'%08x' % zlib.crc32(text):
            break
        lines.append(json.loads(text))
        size += len(raw) + 1
    return lines, data[size:]
