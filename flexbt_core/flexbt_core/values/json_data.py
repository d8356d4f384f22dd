# SPDX-License-Identifier: BSD-3-Clause
"""Bounded reading of JSON and numbers from untrusted sources.

Python's parser recurses for each level and stops at the recursion limit of the process. Programs that run deep trees
raise this limit; without a bound here, a text of brackets could then crash the process.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any, Final

MAX_JSON_DEPTH: Final = 500
"""Maximum nesting depth of objects and lists."""

_STRING_OR_BRACKET: Final = re.compile(r'"(?:[^"\\]|\\.)*+"?|[\[{]|[\]}]', re.DOTALL)


def load_json(text: str, **options: Any) -> Any:
    """Return the data of a JSON text; ``options`` are those of ``json.loads``.

    Raises:
        ValueError: the text is not JSON.
        RecursionError: the text is nested deeper than MAX_JSON_DEPTH.
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


# Numbers in untrusted data.


def finite_number(value: object) -> float | None:
    """Return a finite number, else None. Accepts numbers that YAML 1.1 reads as text, such as 1e-16 from
    map_saver."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None
