# SPDX-License-Identifier: BSD-3-Clause
"""Files of text that a command reads or writes as a whole."""

from __future__ import annotations

from pathlib import Path

from .errors import UsageError


def read_text(file: str, most: int) -> str:
    """The text (UTF-8) of a file of at most ``most`` bytes. Raises UsageError when it cannot be read, or is longer."""
    try:
        with Path(file).open('rb') as content:
            data = content.read(most + 1)
    except OSError as error:
        raise UsageError(f'{file}: cannot be read: {error.strerror or error}') from error
    if len(data) > most:
        raise UsageError(f'{file}: longer than {most} bytes; this is no file of this kind')
    try:
        return data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise UsageError(f'{file}: cannot be read: byte {error.start + 1} is no UTF-8; this is no text') from error


def write_text(file: str, text: str) -> None:
    """Write a file. Raises UsageError when that cannot be."""
    try:
        Path(file).write_text(text, encoding='utf-8')
    except OSError as error:
        raise UsageError(f'{file}: cannot be written: {error.strerror or error}') from error
