# SPDX-License-Identifier: BSD-3-Clause
"""Ticks that take longer than there is time for."""

from __future__ import annotations

import math
from collections.abc import Callable

from flexbt_core.behavior_tree import TreeKey


class Overruns:
    """Tells of ticks that take too long, once a second at most."""

    def __init__(self, key: TreeKey, period: float, tell: Callable[[str], None]) -> None:
        self._tree = key.id
        self._period = period
        self._tell = tell
        self._count = 0
        self._longest = 0.0
        self._silent_until = -math.inf

    def note(self, began: float, ended: float) -> None:
        """A tick took from ``began`` to ``ended``, s."""
        took = ended - began
        if took <= self._period:
            return
        self._count += 1
        self._longest = max(self._longest, took)
        if ended < self._silent_until:
            return
        self._tell(
            f'tree [{self._tree}]: {self._count} ticks took longer than the period of {self._period:.3f} s '
            f'(parameter tick_rate), the longest {self._longest:.3f} s; no leaf should block'
        )
        self._count, self._longest, self._silent_until = 0, 0.0, ended + 1.0
