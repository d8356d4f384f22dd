# SPDX-License-Identifier: BSD-3-Clause
"""Functions compiled by numba, where it is installed. It is optional, and what they compute is the same without.

numba is imported when the first of them is needed, which takes some tenths of a second, and keeps what it has compiled;
compiling takes some seconds on the first use of a computer.
"""

from __future__ import annotations

import functools
import importlib
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from types import FunctionType
from typing import Any


@functools.cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any] | None:
    """A function compiled, which leaves the interpreter to other threads; None without numba.

    The functions of its module that it calls are compiled along. ``FLEXBT_ACCELERATION=0`` leaves numba out, too.
    """
    numba: Any = None
    if os.environ.get('FLEXBT_ACCELERATION', '1') != '0':
        with suppress(ImportError):
            numba = importlib.import_module('numba')
    if numba is None:
        return None
    function = _with_compiled(function)
    made: Callable[..., Any]
    try:
        made = numba.njit(nogil=True, cache=True)(function)
    except RuntimeError as error:  # there is no directory to keep it in
        logging.getLogger(__name__).warning(
            'numba compiles %s anew in each process, as it cannot keep it: %s; NUMBA_CACHE_DIR names a directory where '
            'it can', function.__name__, error,
        )  # fmt: skip
        made = numba.njit(nogil=True)(function)
    return made


def _with_compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, or one that calls the compiled ones instead of those of its module."""
    assert isinstance(function, FunctionType)
    there = function.__globals__
    called = [there.get(name) for name in function.__code__.co_names]
    own = [one for one in called if isinstance(one, FunctionType) and one.__module__ == function.__module__]
    if not own:
        return function
    made = FunctionType(function.__code__, there | {one.__name__: compiled(one) for one in own}, function.__name__)
    made.__qualname__ = function.__qualname__
    return made
