# SPDX-License-Identifier: BSD-3-Clause
"""JSON and numbers from untrusted sources, with bounds.

Python's parser calls itself for each level and stops at the recursion limit. That limit is one for the whole process,
and is raised by programs that run deep trees; then a text of brackets would end the process.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any, Final

MAX_JSON_DEPTH: Final = 500
"""Levels of objects and lists in each other that are read at most."""

_STRING_OR_BRACKET: Final = re.compile(r'"(?:[^"\\]|\\.)*+"?|[\[{]|[\]}]', re.DOTALL)


def load_json(text: str, **options: Any) -> Any:
    """``json.loads``.

    Raises:
        ValueError: the text is not JSON.
        RecursionError: it is nested deeper than MAX_DEPTH.
    """
    if text.count('[') + text.count('{') > MAX_JSON_DEPTH:
        _check_depth(text)
    return json.loads(text, **options)


def _check_depth(text: str) -> None:
    depth = 0
    for match in _STRING_OR_BRACKET.finditer(text):
        character = match.group()[0]
        if character in '[{':
            depth += 1
            if depth > MAX_JSON_DEPTH:
                raise RecursionError(f'nested more than {MAX_JSON_DEPTH} deep')
        elif character != '"':
            depth -= 1


# Numbers in data from others.


def finite_number(value: object) -> float | None:
    """Return a finite number, also one that YAML 1.1 takes for text, such as the 1e-16 that map_saver writes; else
    None."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None
