# SPDX-License-Identifier: BSD-3-Clause
"""Lengths of time as messages."""

from __future__ import annotations

from builtin_interfaces.msg import Duration


def duration_message(seconds: float) -> Duration:
    """A length of time, s, to the nanosecond."""
    nanoseconds = round(seconds * 1e9)
    return Duration(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)
