# SPDX-License-Identifier: BSD-3-Clause
"""Numbers of things in messages to people."""

from __future__ import annotations


def counted(count: int, noun: str, plural: str = '') -> str:
    """``1 tree``, ``2 trees``; ``1 recovery``, ``2 recoveries`` where the plural is given."""
    return f'{count} {noun if count == 1 else plural or f"{noun}s"}'
