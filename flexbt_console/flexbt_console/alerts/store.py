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
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flexbt_console.errors import ConsoleError, RefusedError, UsageError
from flexbt_core.values.text import one_line
from flexbt_core.values.text_files import open_private

from .delivered import SEND_SECONDS, connect
from .escalation import Call, Escalation, Thing


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
        except (sqlite3.DatabaseError, ValueError, TypeError, KeyError):
            self.set_aside = f'{file}.{time.time_ns()}.corrupt'
            for name in (file.name, f'{file.name}-journal'):
                with suppress(OSError):
                    file.with_name(name).replace(self.set_aside + name.removeprefix(file.name))
            self.memory = self._load()

    def _open(self) -> None:
        self._connection = connect(self.file)
        rows = self._connection.execute("SELECT * FROM memory WHERE kind != 'acknowledgment'").fetchall()
        self._saved = {(kind, number): text for kind, number, text in rows}

    def _load(self) -> Escalation:
        self._open()
        found: dict[str, dict[int, Any]] = {'thing': {}, 'call': {}, 'rest': {}}
        for (kind, number), text in self._saved.items():
            found[kind][number] = json.loads(text)
        things = {number: Thing(**one) for number, one in found['thing'].items()}
        calls = {number: Call(**one) for number, one in found['call'].items()}
        return Escalation(things, calls, **found['rest'].get(0, {}))

    def save(self, acknowledged: Iterable[int] = ()) -> str:
        """Write what has changed in the memory, and take out acknowledgments, in one transaction. Return why that was
        not possible, or ''."""
        memory = self.memory
        now = {('thing', number): json.dumps(asdict(thing)) for number, thing in memory.things.items()}
        now |= {('call', number): json.dumps(asdict(call)) for number, call in memory.calls.items()}
        now['rest', 0] = json.dumps({'last_id': memory.last_id, 'heard': memory.heard})
        changed = [(*key, text) for key, text in now.items() if self._saved.get(key) != text]
        gone = [*(self._saved.keys() - now.keys()), *(('acknowledgment', number) for number in acknowledged)]
        try:
            with self._connection:
                self._connection.executemany('REPLACE INTO memory VALUES (?, ?, ?)', changed)
                self._connection.executemany('DELETE FROM memory WHERE kind = ? AND id = ?', gone)
        except (sqlite3.Error, OSError) as error:
            with suppress(sqlite3.Error, OSError):  # the file may have been moved or removed
                self._open()
            return str(error)
        self._saved = now
        return ''

    def read(self, kind: str) -> dict[int, str]:
        """Return what is on disk: the undelivered ``call`` by number, or who has given an ``acknowledgment``, by thing.

        Raises:
            sqlite3.Error: it cannot be read.
        """
        return dict(self._connection.execute('SELECT id, value FROM memory WHERE kind = ?', (kind,)).fetchall())

    def close(self) -> None:
        """Release the file. Processes that still send hold it until they have ended."""
        self._connection.close()
        os.close(self.lock)

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


def acknowledge(file: Path, things: Sequence[int], operator: str) -> list[str]:
    """Acknowledge things, without any the only one, for the running program. Return what they are.

    Raises:
        ConsoleError: there is no such thing, or there are several; or the file cannot be used.
    """
    if not file.exists():
        raise UsageError(f'{file}: there is no such file; --state names the one of "console alerts"')
    try:
        with closing(connect(file)) as connection, connection:
            rows = connection.execute("SELECT id, value FROM memory WHERE kind = 'thing'").fetchall()
            known = {number: Thing(**json.loads(text)) for number, text in rows}
            texts = {number: one_line(f'{number}  {one.robot}: {one.text}') for number, one in known.items()}
            waiting = [number for number, one in known.items() if not one.acknowledged]
            if not things and len(waiting) != 1:
                listed = '\n'.join(texts[number] for number in waiting)
                raise RefusedError(f'name one of these:\n{listed}' if waiting else 'nothing waits for anybody')
            chosen = things or waiting
            if unknown := {*chosen} - {*known}:
                raise RefusedError(f'nothing is there with the number {min(unknown)}: it may be over')
            given = [('acknowledgment', number, operator) for number in chosen]
            connection.executemany('REPLACE INTO memory VALUES (?, ?, ?)', given)
            return [texts[number] for number in chosen]
    except (sqlite3.Error, OSError) as error:
        raise ConsoleError(f'{file}: {error}') from None


def _unusable(file: Path, error: Exception) -> UsageError:
    return UsageError(f'{file} cannot be used: {getattr(error, "strerror", None) or error}; --state names another file')
