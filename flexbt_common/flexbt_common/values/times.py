# SPDX-License-Identifier: BSD-3-Clause
"""Points and lengths of time as messages, to the nanosecond, and in seconds."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Duration, Time

_SECOND = 1_000_000_000


def seconds_of(message: Any) -> float:
    """A Time or Duration, s."""
    return float(message.sec) + float(message.nanosec) * 1e-9


def time_message(seconds: float) -> Time:
    """A point of time, s."""
    return time_of_nanoseconds(round(seconds * 1e9))


def time_of_nanoseconds(nanoseconds: int) -> Time:
    """A point of time, ns."""
    whole, rest = divmod(nanoseconds, _SECOND)
    return Time(sec=whole, nanosec=rest)


def duration_message(seconds: float) -> Duration:
    """A length of time, s."""
    whole, rest = divmod(round(seconds * 1e9), _SECOND)
    return Duration(sec=whole, nanosec=rest)
