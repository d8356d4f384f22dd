# SPDX-License-Identifier: BSD-3-Clause
"""The two ways in which FlexBE's flexible states hand several values to a function.

FlexBE's documentation says "a list" for both states, its code passes keywords in one and a list in the other. Here
a function gets what its parameters can take, so that either reading works; the state says which it prefers.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any


def takes_keywords(function: Callable[..., Any], keys: Sequence[str]) -> bool:
    """Whether it can be called with the keys as keywords."""
    return _binds(function, **dict.fromkeys(keys))


def takes_list(function: Callable[..., Any]) -> bool:
    """Whether it can be called with one list."""
    return _binds(function, [])


def _binds(function: Callable[..., Any], *args: Any, **keywords: Any) -> bool:
    try:
        inspect.signature(function).bind(*args, **keywords)
    except TypeError:
        return False
    except ValueError:  # a builtin that does not tell: all of those that are used so take one list
        return not keywords
    return True
