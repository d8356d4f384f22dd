# SPDX-License-Identifier: BSD-3-Clause
"""The memory of the alerts on disk: things and undelivered calls survive a crash and a power loss.

SQLite writes each step as one transaction, and syncs it. While the disk refuses (it is full), the program goes on in
memory, and writes everything once the disk takes it.
"""

from __future__ import annotations

import fcntl
import json
import os
import sqlite3
import time
from collections.abc import Iterable
from contextlib import closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final

from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_console.errors import ConsoleError, RefusedError, UsageError
from flexbt_core.values.text_files import open_private

from .escalation import Call, Escalation, Thing

DEFAULT_FILE: Final = f'{USER_DIRECTORY}/alerts.db'
BUSY_SECONDS: Final = 2.0
"""Time for which a write waits for another process, s."""

SEND_SECONDS: Final = 30.0
"""Time after which a process that sends ends itself, s."""

_TABLES: Final = (
    'CREATE TABLE IF NOT EXISTS things (id INTEGER PRIMARY KEY, value TEXT NOT NULL)',
    'CREATE TABLE IF NOT EXISTS calls (id INTEGER PRIMARY KEY, value TEXT NOT NULL)',
    'CREATE TABLE IF NOT EXISTS robots (id INTEGER PRIMARY KEY, value TEXT NOT NULL)',
    'CREATE TABLE IF NOT EXISTS acknowledgments (thing INTEGER PRIMARY KEY, operator TEXT NOT NULL)',
)


def connect(file: Path) -> sqlite3.Connection:
    """Open the file; only its user may read a new one. Raises sqlite3.Error and OSError."""
    os.close(open_private(file, os.O_RDWR | os.O_CREAT))
    connection = sqlite3.connect(file, timeout=BUSY_SECONDS)
    connection.execute('PRAGMA synchronous = EXTRA')
    for table in _TABLES:
        connection.execute(table)
    return connection


class Store:
    """The file, held by one program at a time, and by the processes that it has started to send."""

    def __init__(self, file: Path) -> None:
        """Open the file, and wait until what an earlier program has begun to send is sent.

        Raises:
            UsageError: it cannot be used.
            RefusedError: another program uses it.
        """
        self.file = file
        self.set_aside = ''
        """Name of a file that could not be read, and was renamed; '' for none."""
        self._saved: dict[str, dict[int, str]] = {}
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self.lock = open_private(file.with_name(f'{file.name}.lock'), os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise _unusable(file, error) from None
        self._take_lock()
        try:
            self.memory = self._load()
        except (sqlite3.OperationalError, OSError) as error:  # as a full disk
            raise _unusable(file, error) from None
        except (sqlite3.DatabaseError, ValueError, TypeError):
            self.set_aside = f'{file}.{time.time_ns()}.corrupt'
            for name in (file.name, f'{file.name}-journal'):
                with suppress(OSError):
                    file.with_name(name).replace(self.set_aside + name.removeprefix(file.name))
            self.memory = self._load()

    def _load(self) -> Escalation:
        self._connection = connect(self.file)
        self._saved = {table: self._rows(table) for table in ('things', 'calls', 'robots')}
        things = {number: Thing(**json.loads(text)) for number, text in self._saved['things'].items()}
        calls = {number: Call(**json.loads(text)) for number, text in self._saved['calls'].items()}
        (last,) = self._connection.execute('PRAGMA user_version').fetchone()
        heard = json.loads(self._saved['robots'].get(1, '{}'))
        return Escalation(things, calls, max(last, *things, *calls, 0), heard)

    def save(self) -> str:
        """Write what has changed in the memory, in one transaction. Return why it is not written, or ''."""
        memory = self.memory
        now = {
            'things': {number: json.dumps(asdict(thing)) for number, thing in memory.things.items()},
            'calls': {number: json.dumps(asdict(call)) for number, call in memory.calls.items()},
            'robots': {1: json.dumps(memory.heard)},
        }
        if now == self._saved:
            return ''
        try:
            with self._connection:
                for table, rows in now.items():
                    old = self._saved[table]
                    changed = [(number, text) for number, text in rows.items() if old.get(number) != text]
                    gone = [(number,) for number in old.keys() - rows.keys()]
                    self._connection.executemany(f'REPLACE INTO {table} VALUES (?, ?)', changed)  # noqa: S608
                    self._connection.executemany(f'DELETE FROM {table} WHERE id = ?', gone)  # noqa: S608
                self._connection.execute(f'PRAGMA user_version = {memory.last_id % 2**31}')
        except (sqlite3.Error, OSError) as error:
            return str(error)
        self._saved = now
        return ''

    def undelivered(self, calls: Iterable[int]) -> set[int]:
        """Return those of the calls that were written and that no process has taken out since."""
        try:
            return {*calls} & self._rows('calls').keys()
        except sqlite3.Error:
            return {*calls}

    def take_acknowledgments(self) -> dict[int, str]:
        """Return who has acknowledged which things since, and remove it once :meth:`save` has worked."""
        with suppress(sqlite3.Error):
            found = dict(self._connection.execute('SELECT thing, operator FROM acknowledgments').fetchall())
            return {int(thing): str(operator) for thing, operator in found.items()}
        return {}

    def drop_acknowledgments(self, things: Iterable[int]) -> None:
        """Remove acknowledgments that are written with their things."""
        with suppress(sqlite3.Error), self._connection:
            self._connection.executemany('DELETE FROM acknowledgments WHERE thing = ?', [(one,) for one in things])

    def close(self) -> None:
        """Release the file. Processes that still send hold it until they have ended."""
        self._connection.close()
        os.close(self.lock)

    def _rows(self, table: str) -> dict[int, str]:
        return dict(self._connection.execute(f'SELECT id, value FROM {table}').fetchall())  # noqa: S608

    def _take_lock(self) -> None:
        """Hold the file, whose processes may still be sending though the program is gone: they hold it, too."""
        end = time.monotonic() + SEND_SECONDS + 5.0
        while True:
            try:
                fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError:
                holder = os.pread(self.lock, 20, 0).decode(errors='replace').strip()
                if (holder.isdecimal() and Path(f'/proc/{holder}').exists()) or time.monotonic() > end:
                    os.close(self.lock)
                    raise RefusedError(
                        f'{self.file} is used by another "console alerts" (process {holder}); end that one, or give '
                        'this one another --state'
                    ) from None
                time.sleep(0.1)
        with suppress(OSError):  # the disk is full
            os.pwrite(self.lock, f'{os.getpid():<20}'.encode(), 0)


def mark_delivered(file: Path, calls: Iterable[int]) -> bool:
    """Take delivered calls out of the file. Return whether that is on disk."""
    try:
        with closing(connect(file)) as connection, connection:
            connection.executemany('DELETE FROM calls WHERE id = ?', [(one,) for one in calls])
    except (sqlite3.Error, OSError):
        return False
    return True


def acknowledge(file: Path, things: Iterable[int], operator: str) -> list[Thing]:
    """Acknowledge things, without any the only one, for the running program. Return them.

    Raises:
        ConsoleError: there is no such thing, or there are several; or the file cannot be used.
    """
    if not file.exists():
        raise UsageError(f'{file}: there is no such file; --state names the one of "console alerts"')
    try:
        with closing(connect(file)) as connection, connection:
            rows = connection.execute('SELECT value FROM things').fetchall()
            known = {thing.id: thing for thing in (Thing(**json.loads(text)) for (text,) in rows)}
            open_ones = [thing for thing in known.values() if not thing.acknowledged]
            if not (chosen := [*things]) and len(open_ones) != 1:
                listed = '\n'.join(f'{one.id}  {one.robot}: {one.text}' for one in open_ones)
                raise RefusedError(f'name one of these:\n{listed}' if open_ones else 'nothing waits for anybody')
            chosen = chosen or [open_ones[0].id]
            if unknown := [one for one in chosen if one not in known]:
                raise RefusedError(f'nothing is there with the number {unknown[0]}: it may be over')
            connection.executemany('REPLACE INTO acknowledgments VALUES (?, ?)', [(one, operator) for one in chosen])
            return [known[one] for one in chosen]
    except (sqlite3.Error, OSError) as error:
        raise ConsoleError(f'{file}: {error}') from None


def state_file(option: str) -> Path:
    """Return the file of an option ``--state``, or the default."""
    return home_path(option or DEFAULT_FILE)


def _unusable(file: Path, error: Exception) -> UsageError:
    return UsageError(f'{file} cannot be used: {getattr(error, "strerror", None) or error}; --state names another file')
