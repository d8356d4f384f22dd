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
from typing import Any


@functools.cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any] | None:
    """A function compiled, which leaves the interpreter to other threads; None without numba.

    ``FLEXBT_ACCELERATION=0`` leaves numba out, too.
    """
    numba: Any = None
    if os.environ.get('FLEXBT_ACCELERATION', '1') != '0':
        with suppress(ImportError):
            numba = importlib.import_module('numba')
    if numba is None:
        return None
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
