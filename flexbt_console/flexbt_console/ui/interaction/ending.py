# SPDX-License-Identifier: BSD-3-Clause
"""How what runs in an event loop is told to end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol


class EndingLoop(Protocol):
    """See :meth:`flexbt_console.ui.terminal_watch.TerminalWatch.ending_loop`."""

    def __call__(self, end: Callable[[], object]) -> AbstractContextManager[None]:
        """In the context, signals that end the process have the event loop call ``end``."""
