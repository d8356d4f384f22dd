# SPDX-License-Identifier: BSD-3-Clause
"""Numbers in data from others."""

from __future__ import annotations

import math


def finite_number(value: object) -> float | None:
    """A finite number, also one that YAML 1.1 takes for text, such as the 1e-16 that map_saver writes; else None."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None
