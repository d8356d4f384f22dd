# SPDX-License-Identifier: BSD-3-Clause
"""Text files: untrusted ones are read with bounds, own ones are written atomically.

Opening a pipe waits for its other end, and a device may never end: :func:`open_regular` refuses both.
:func:`open_private` creates a file for what people said.
"""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path
from typing import Final

MOST_BYTES: Final = 10_000_000


class TextFileError(OSError):
    """A file cannot be read as text; the message is the reason, without the file name."""


def file_problem(error: OSError) -> str:
    """Return the file and the reason of an error, for a message; without Python's number."""
    reason = error.strerror or str(error)
    return reason if error.filename is None else f'{error.filename}: {reason}'


def read_text(file: str | Path, most: int = MOST_BYTES) -> str:
    """Return the text (UTF-8, with or without a byte order mark) of a regular file of at most ``most`` bytes.

    Never waits: pipes, devices and directories are refused.

    Raises:
        TextFileError: the file cannot be read, is longer, or is not text.
    """
    try:
        with open(file, 'rb', opener=open_regular) as content:
            data = content.read(most + 1)
    except TextFileError:
        raise
    except (OSError, ValueError) as error:  # a name with NUL is a ValueError
        raise TextFileError(getattr(error, 'strerror', None) or str(error)) from error
    if len(data) > most:
        raise TextFileError(f'it is longer than {most} bytes; this is not a file of this kind')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise TextFileError(f'byte {error.start + 1} is not UTF-8; this is not text') from error


def write_text(file: str | Path, text: str) -> None:
    """Write a whole file (UTF-8). If that fails, for example on a full disk, an existing file stays unchanged.

    A new file replaces the old one, which must be writable, and gets its permissions. A link stays a link to the file.
    A pipe or device, and any name below ``/dev``, is written to directly.

    Raises:
        OSError: the file cannot be written; the error names it.
    """
    file = Path(file)
    if file.is_relative_to('/dev') or (file.exists() and not file.is_file()):
        file.write_text(text, encoding='utf-8')
        return
    old = Path(os.path.realpath(file))
    fresh = old.with_name(f'.{os.urandom(8).hex()}.tmp')
    try:
        descriptor = os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        try:
            write_whole(descriptor, text.encode())
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
        if old.exists():
            os.close(os.open(old, os.O_WRONLY))  # refuse to replace a write-protected file
            fresh.chmod(stat.S_IMODE(old.stat().st_mode))
        fresh.replace(old)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from error
    finally:
        with contextlib.suppress(OSError):
            fresh.unlink()


def version_of(file: Path) -> tuple[int, ...]:
    """Return numbers that change when a file is written, replaced, or gets other permissions; () if it is not there."""
    try:
        known = file.stat()
    except OSError:
        return ()
    return known.st_mtime_ns, known.st_ctime_ns, known.st_ino, known.st_size


def write_whole(descriptor: int, data: bytes) -> None:
    """Write data to a file. Raises OSError if not all of it fits onto the disk; the file has a part of it then."""
    while data:
        data = data[os.write(descriptor, data) :]


def open_regular(file: str | Path, flags: int, mode: int = 0o666) -> int:
    """Return the descriptor of a regular file like :func:`os.open`, but never wait. An ``opener`` for :func:`open`.

    Raises:
        TextFileError: the file is a pipe, device or directory.
        OSError: the file cannot be opened.
    """
    descriptor = os.open(file, flags | os.O_NONBLOCK | os.O_CLOEXEC, mode)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        what = 'a directory' if stat.S_ISDIR(mode) else 'a pipe or device'
        raise TextFileError(f'it is {what}; give a regular file')
    return descriptor


def open_private(file: str | Path, flags: int) -> int:
    """Open an own file for what people said, like :func:`open_regular`. Only the user may read a new one.

    Does not follow a symbolic link: others with write access could use it to overwrite another file of the user.
    """
    return open_regular(file, flags | os.O_NOFOLLOW, 0o600)
