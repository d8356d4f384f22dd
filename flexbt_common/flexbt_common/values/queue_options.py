# SPDX-License-Identifier: BSD-3-Clause
"""An entry of the mission queue and its options, as executives and consoles know them (QueueEntry.msg)."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any


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


@dataclass(frozen=True)
class QueueEntry:
    """An entry of the queue. ``added`` and ``due`` are times on the executive's clock, s."""

    number: int
    behavior: str
    options: QueueOptions = field(default_factory=QueueOptions)
    arguments: tuple[tuple[str, str], ...] = ()
    inputs: tuple[Any, ...] = ()
    autonomy: int = 0
    operator: str = ''
    added: float = 0.0
    revision: int = 0
    runs: int = 0
    failures: int = 0
    outcome: str = ''
    message: str = ''
    due: float = 0.0
