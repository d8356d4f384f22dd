# SPDX-License-Identifier: BSD-3-Clause
"""What a process that sends needs of the memory on disk (:mod:`.store`): each message loads no more than this."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Final

from flexbt_core.values.text_files import open_private

BUSY_SECONDS: Final = 2.0
"""Time for which a write waits for another process, s."""

SEND_SECONDS: Final = 30.0
"""Time after which a process that sends ends itself, s."""

_TABLE: Final = 'CREATE TABLE IF NOT EXISTS memory (kind TEXT, id INTEGER, value TEXT, PRIMARY KEY (kind, id))'


def connect(file: Path) -> sqlite3.Connection:
    """Open the file; only its user may read a new one. Raises sqlite3.Error and OSError."""
    if not file.exists():
        os.close(open_private(file, os.O_RDWR | os.O_CREAT))
    connection = sqlite3.connect(file, timeout=BUSY_SECONDS)
    connection.execute('PRAGMA synchronous = EXTRA')
    connection.execute(_TABLE)
    return connection


def mark_delivered(file: Path, calls: Iterable[int]) -> bool:
    """Take delivered calls out of the file. Return whether that is on disk."""
    try:
        with closing(connect(file)) as connection, connection:
            connection.executemany("DELETE FROM memory WHERE kind = 'call' AND id = ?", [(one,) for one in calls])
    except (sqlite3.Error, OSError):
        return False
    return True
