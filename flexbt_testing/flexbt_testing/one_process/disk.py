# SPDX-License-Identifier: BSD-3-Clause
"""The disk of the robots of a world: full, slow, hung, and what is left on it after a loss of power.

Files are real ones, in the directories of the world. What is opened by :func:`os.open`, written by :func:`os.write`
and synced by :func:`os.fsync` passes here. So does what programs write by :func:`open` and :class:`pathlib.Path`: in a
world they are those that Python has in Python (``_pyio``), above these functions. What compiled code writes, such as
SQLite, never waits for the disk.
"""

from __future__ import annotations

import _pyio  # type: ignore[import-not-found]
import builtins
import errno
import io
import os
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from .boundary import BOUNDARY
from .scheduler import SCHEDULER, Process

_WRITES: Final = os.O_WRONLY | os.O_RDWR


@dataclass(eq=False)
class _File:
    """A file, whatever its name is, and what of it is on the disk for sure."""

    synced: bytes = b''


class Disk:
    """The disk of the current world.

    It knows a file from when a program opens it for writing; what it had then is on the disk. Later, content is on the
    disk once the file was synced, and a new name, another file of that name, or none, once the directory was.
    """

    __slots__ = ('_files', '_goes', '_on_disk', '_space', '_users', 'delay')

    def begin(self) -> None:
        """Begin with a disk that is fast and large, and on which everything is."""
        self.delay = 0.0
        """Time that a sync takes, s."""
        self._space: int | None = None
        self._goes = threading.Event()
        self._goes.set()
        self._files: dict[Path, _File] = {}
        self._on_disk: dict[Path, _File | None] = {}
        self._users: dict[Path, Process] = {}

    def move(self, before: Path, after: Path) -> None:
        """Find the files of a directory in another one, into which a fork has copied them."""
        tables: tuple[dict[Path, Any], ...] = (self._files, self._on_disk, self._users)
        for table in tables:
            for path in [path for path in table if path.is_relative_to(before)]:
                table[after / path.relative_to(before)] = table.pop(path)

    def fill(self, leaving: int = 0) -> None:
        """Let only this many bytes more be written, until :meth:`clear`."""
        self._space = leaving

    def clear(self) -> None:
        """Let any number of bytes be written."""
        self._space = None

    def hang(self) -> None:
        """Let no write and no sync return before :meth:`go_on`."""
        self._goes.clear()

    def go_on(self) -> None:
        """Answer again."""
        self._goes.set()

    @property
    def users(self) -> list[Process]:
        """The processes that have files, in the order of the files."""
        return list(dict.fromkeys(self._users.values()))

    def lose(self, process: Process) -> None:
        """Leave of the files of a process that has ended what is on the disk, and of the rest what the seed draws.

        What was appended, or written anew, is lost, whole, or cut anywhere. What was created, replaced, renamed or
        removed is so or not; a file that was renamed has one of its names.
        """
        names: list[tuple[Path, _File | None, _File | None, bytes]] = []
        joined: dict[_File, _File] = {}

        def first(file: _File) -> _File:
            return first(joined[file]) if file in joined else file

        for path in [path for path, user in self._users.items() if user is process]:
            del self._users[path]
            before, file = self._on_disk.pop(path), self._files.pop(path)
            if not path.exists():
                names.append((path, before, None, b''))
                continue
            names.append((path, before, file, path.read_bytes()))
            path.unlink()
            if before is not None and first(before) is not first(file):  # they change places together
                joined[first(before)] = first(file)
        is_new: dict[_File, bool] = {}
        for path, before, now, written in names:
            either = now or before
            is_now = either is not None and is_new.setdefault(first(either), SCHEDULER.random.random() < 0.5)
            kept = now if is_now else before
            if kept is not None:
                path.write_bytes(_left(kept.synced, written if kept is now else kept.synced))

    # -- what programs call

    def open(self, real: Callable[..., int], path: Any, flags: int, *rest: Any, **options: Any) -> int:
        if flags & _WRITES and not options.get('dir_fd'):
            self._meet(path)
        return real(path, flags, *rest, **options)

    def replace(self, real: Callable[..., None], source: Any, target: Any) -> None:
        before, after = self._meet(source), self._meet(target)
        real(source, target)
        if before is not None and after is not None:
            self._files[after] = self._files[before]

    def write(self, real: Callable[[int, Any], int], descriptor: int, data: Any) -> int:
        if _path(descriptor) not in self._files:
            return real(descriptor, data)
        self._goes.wait()
        if self._space is None:
            return real(descriptor, data)
        if self._space == 0 < len(data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        count = real(descriptor, data[: self._space])
        self._space -= count
        return count

    def sync(self, _real: Callable[[int], None], descriptor: int) -> None:
        self._goes.wait()
        if self.delay:
            SCHEDULER.sleep(self.delay)
        path = _path(descriptor)
        if path in self._files:
            self._files[path].synced = path.read_bytes()
        for file in self._on_disk:
            if file.parent == path:
                self._on_disk[file] = self._files[file] if file.exists() else None

    def _meet(self, name: Any) -> Path | None:
        """Note a file that a program opens or renames. Return its full name, None if it is a pipe or the like."""
        path = Path(os.path.realpath(name))
        if path.exists() and not path.is_file():
            return None
        if not path.exists():
            self._files[path] = _File()
            self._on_disk.setdefault(path, None)
        elif path not in self._files:
            self._files[path] = self._on_disk[path] = _File(path.read_bytes())
        self._users[path] = SCHEDULER.current.process
        return path


def _left(synced: bytes, written: bytes) -> bytes:
    """Return what is left of the content of a file, as the seed draws it."""
    least = len(synced) if written.startswith(synced) else 0
    cut = written[: SCHEDULER.random.randint(least, len(written))]
    return SCHEDULER.random.choice((synced, cut, written))


def _path(descriptor: int) -> Path:
    return Path(os.readlink(f'/proc/self/fd/{descriptor}'))  # noqa: PTH115 - of a pipe, too


DISK: Final = Disk()


def install() -> None:
    """Let the programs of worlds, not the tests, use the disk."""

    def on_disk(real: Callable[..., Any], stand_in: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *a, **k: stand_in(real, *a, **k) if BOUNDARY.is_inside else real(*a, **k)

    def open_file(file: Any, mode: str = 'r', *rest: Any, **options: Any) -> Any:
        is_on_disk = BOUNDARY.is_inside and not set(mode).isdisjoint('wax+')
        return (_pyio.open if is_on_disk else real_open)(file, mode, *rest, **options)

    _pyio.Lock = threading.Lock  # of a writer, which waits for the disk with it
    real_open = builtins.open
    builtins.open = io.open = open_file
    shutil._USE_CP_SENDFILE = False  # type: ignore[attr-defined]  # which would copy files past os.write
    stand_ins: dict[str, Callable[..., Any]] = {
        'open': DISK.open,
        'rename': DISK.replace,
        'replace': DISK.replace,
        'write': DISK.write,
        'fsync': DISK.sync,
        'fdatasync': DISK.sync,
    }
    for name, stand_in in stand_ins.items():
        setattr(os, name, on_disk(getattr(os, name), stand_in))
    DISK.begin()
