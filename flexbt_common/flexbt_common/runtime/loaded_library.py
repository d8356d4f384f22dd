# SPDX-License-Identifier: BSD-3-Clause
"""Functions of the libraries below rclpy, which are loaded with it."""

from __future__ import annotations

import ctypes
import os
from typing import Any

__all__ = ['loaded_function']


def loaded_function(library: str, name: str, result: Any, *arguments: Any, is_short: bool = False) -> Any:
    """A public function of rcl, rcutils, rmw_fastrtps or Fast DDS, by its name in the library that is loaded.

    One that ``is_short`` keeps the lock of the interpreter, as rclpy's own calls do: to get it back may take longer.

    Raises:
        OSError: the library is not loaded.
        AttributeError: it has no such function.
    """
    function = (ctypes.PyDLL if is_short else ctypes.CDLL)(library, mode=os.RTLD_NOLOAD)[name]
    function.argtypes, function.restype = arguments, result
    return function
