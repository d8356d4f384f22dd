# SPDX-License-Identifier: BSD-3-Clause
"""The loops over the cells of costmaps, compiled where numba is installed; what they compute is the same without."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

from flexbt_sim.world import compiled

from . import arrays, kernels


class Loops(NamedTuple):
    """The functions of :mod:`.kernels`. Compiled ones leave the interpreter to other threads."""

    squared_gaps: Callable[..., Any]
    regions: Callable[..., Any]
    search: Callable[..., Any]
    is_clear: Callable[..., Any]
    nearest: Callable[..., Any]
    mean_cost: Callable[..., Any]
    trace: Callable[..., Any]


@functools.cache
def loops() -> Loops:
    """The compiled functions; with FLEXBT_ACCELERATION=0, or without numba, those that numpy and scipy have."""
    return Loops(*(compiled(getattr(kernels, name)) or getattr(arrays, name) for name in Loops._fields))
