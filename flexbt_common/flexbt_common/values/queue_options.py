# SPDX-License-Identifier: BSD-3-Clause
"""The options of an entry of the mission queue, as executives and consoles know them (QueueOptions.msg)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class OnFailure(IntEnum):
    """QueueOptions.on_failure."""

    UNKNOWN = 0
    HOLD = 1
    CONTINUE = 2
    RETRY = 3
    DROP = 4


@dataclass(frozen=True, slots=True)
class QueueOptions:
    """When an entry of the mission queue runs, how often, and what follows a failure.

    ``battery`` is a charge from 0 to 1, negative for any. ``count`` 0 is no end. Times and ``interval`` in s,
    ``distance`` in m.
    """

    priority: int = 0
    battery: float = -1.0
    not_before: float = 0.0
    window: str = ''
    place: str = ''
    distance: float = 0.0
    count: int = 1
    interval: float = 0.0
    on_failure: OnFailure = OnFailure.HOLD
    retries: int = 0
    wanted: tuple[str, ...] = ()
