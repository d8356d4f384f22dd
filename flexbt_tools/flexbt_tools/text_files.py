# SPDX-License-Identifier: BSD-3-Clause
"""Files of text that a command reads or writes as a whole."""

from __future__ import annotations

from flexbt_core import values
from flexbt_core.values import TextFileError

from .errors import UsageError


def read_text(file: str, most: int) -> str:
    """The text (UTF-8) of a file of at most ``most`` bytes. Raises UsageError when it cannot be read, or is longer."""
    try:
        return values.read_text(file, most)
    except TextFileError as error:
        raise UsageError(f'{file}: cannot be read: {error}') from error


def write_text(file: str, text: str) -> None:
    """Write a file as a whole. Raises UsageError when that cannot be; the one that was there stays then."""
    try:
        values.write_text(file, text)
    except OSError as error:
        raise UsageError(f'{file}: cannot be written: {error.strerror or error}') from error
