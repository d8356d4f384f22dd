# SPDX-License-Identifier: BSD-3-Clause
"""The terminal of the prompt: it stays raw as long as the prompt goes on, and it may go away."""

from __future__ import annotations

import contextlib
import errno
import sys
from contextlib import AbstractContextManager
from typing import Final

from prompt_toolkit.input.vt100 import Vt100Input

_GONE: Final = frozenset({errno.EIO, errno.EBADF, errno.ENXIO, errno.EPIPE})


class RawInput(Vt100Input):
    """The keyboard of this process. It stays raw also while something is printed above the line.

    A key such as Ctrl-C at that moment is a key as ever. In a cooked terminal it would be a signal to every process
    that belongs to it, such as a demonstration that drives the robot.
    """

    def __init__(self) -> None:
        super().__init__(sys.stdin)

    def cooked_mode(self) -> AbstractContextManager[None]:
        """Nothing changes."""
        return contextlib.nullcontext()


def is_gone(error: BaseException | None) -> bool:
    """Whether this was raised because the terminal is not there any more."""
    return isinstance(error, OSError) and error.errno in _GONE
