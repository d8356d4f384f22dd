# SPDX-License-Identifier: BSD-3-Clause
"""Which callback of which state is being called."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, eq=False, slots=True)
class Calling:
    """One call of a callback: the same object as long as it has not returned, and never equal to another call."""

    path: str
    callback: str
