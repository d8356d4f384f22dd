# SPDX-License-Identifier: BSD-3-Clause
"""The inner loops, compiled by numba where it is installed; it is optional, and what they compute is the same.

numba is imported when they are first needed, and keeps what it has compiled: on a computer's first start they take
some seconds, later a few tenths of one.
"""

from __future__ import annotations

import functools
import importlib
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from . import arrays, kernels


class Loops(NamedTuple):
    """The functions of :mod:`.kernels`. Compiled ones leave the interpreter to other threads."""

    squared_gaps: Callable[..., Any]
    regions: Callable[..., Any]
    search: Callable[..., Any]
    is_clear: Callable[..., Any]
    mean_cost: Callable[..., Any]
    trace: Callable[..., Any]


@functools.cache
def loops() -> Loops:
    """The compiled functions; with FLEXBT_ACCELERATION=0, or without numba, those that numpy and scipy have."""
    numba = None
    if os.environ.get('FLEXBT_ACCELERATION', '1') != '0':
        with suppress(ImportError):
            numba = importlib.import_module('numba')
    if numba is None:
        return Loops(*(getattr(arrays, name) for name in Loops._fields))
    return Loops(*(_compiled(numba, getattr(kernels, name)) for name in Loops._fields))


def _compiled(numba: Any, function: Callable[..., Any]) -> Callable[..., Any]:
    try:
        return numba.njit(nogil=True, cache=True)(function)
    except RuntimeError:  # there is no directory to keep it in
        return numba.njit(nogil=True)(function)
