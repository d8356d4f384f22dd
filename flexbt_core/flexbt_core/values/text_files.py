# SPDX-License-Identifier: BSD-3-Clause
"""Files of text from others, with bounds."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import Final

MOST_BYTES: Final = 10_000_000


class TextFileError(OSError):
    """A file cannot be read as text; says why, without its name."""


def read_text(file: str | Path, most: int = MOST_BYTES) -> str:
    """The text (UTF-8, with or without a byte order mark) of a regular file of at most ``most`` bytes.

    Never waits: a pipe is refused, as devices and directories are.

    Raises:
        TextFileError: it cannot be read, is longer, or is no text.
    """
    try:
        with open(file, 'rb', opener=_open) as content:
            if not stat.S_ISREG(os.fstat(content.fileno()).st_mode):
                raise TextFileError('it is a pipe or device; give a regular file')
            data = content.read(most + 1)
    except TextFileError:
        raise
    except (OSError, ValueError) as error:  # a name with NUL is a ValueError
        raise TextFileError(getattr(error, 'strerror', None) or str(error)) from error
    if len(data) > most:
        raise TextFileError(f'it is longer than {most} bytes; this is no file of this kind')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise TextFileError(f'byte {error.start + 1} is no UTF-8; this is no text') from error


def _open(name: str, flags: int) -> int:
    return os.open(name, flags | os.O_NONBLOCK)  # opening a pipe waits for its other end otherwise
