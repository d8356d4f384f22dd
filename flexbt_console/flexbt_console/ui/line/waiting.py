# SPDX-License-Identifier: BSD-3-Clause
"""What a command waits for is said, beside its answer: on standard error, and only when it takes long."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from flexbt_core.clock import Clock, watchdog
from flexbt_core.values import one_line

SILENT_SECONDS: Final = 1.0
"""For so long nobody wonders what is going on."""


def told_wait(clock: Clock, what: Callable[[], str], timeout: float) -> AbstractContextManager[None]:
    """Say what the block waits for, ``timeout`` seconds at most, when it takes longer than SILENT_SECONDS; nothing when
    ``what`` is '' then."""

    def tell() -> None:
        if wanted := what():
            tell_progress(f'waiting for {one_line(wanted)}, {timeout:g} s at most ...')

    return watchdog(clock, SILENT_SECONDS, tell)


def tell_progress(text: str) -> None:
    """Say a line that is no part of the answer."""
    print(text, file=sys.stderr, flush=True)
