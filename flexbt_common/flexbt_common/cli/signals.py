# SPDX-License-Identifier: BSD-3-Clause
"""Signals that a part of a program handles for a while."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator


@contextlib.contextmanager
def restored_signals(*numbers: int) -> Iterator[None]:
    """After the context, these signals do what they did before it. On the main thread."""
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
