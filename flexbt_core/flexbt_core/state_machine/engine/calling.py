# SPDX-License-Identifier: BSD-3-Clause
"""Which callback of which state is being called."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(eq=False, slots=True)  # a frozen one takes three times as long to make, which is done for each call
class Calling:
    """One call of a callback: the same object as long as it has not returned, and never equal to another call."""

    path: str
    callback: str
