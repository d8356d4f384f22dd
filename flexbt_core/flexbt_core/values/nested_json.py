# SPDX-License-Identifier: BSD-3-Clause
"""JSON from others, whose nesting must not use up the stack.

Python's parser calls itself for each level and stops at the recursion limit. That limit is one for the whole process,
and is raised by whoever runs deep trees; then a text of brackets would end the process.
"""

from __future__ import annotations

import json
import re
from typing import Any, Final

MAX_DEPTH: Final = 500
"""Levels of objects and lists in each other that are read at most."""

_STRING_OR_BRACKET: Final = re.compile(r'"(?:[^"\\]|\\.)*+"?|[\[{]|[\]}]', re.DOTALL)


def load_json(text: str, **options: Any) -> Any:
    """``json.loads``.

    Raises:
        ValueError: the text is no JSON.
        RecursionError: it is nested deeper than MAX_DEPTH.
    """
    if text.count('[') + text.count('{') > MAX_DEPTH:
        _check_depth(text)
    return json.loads(text, **options)


def _check_depth(text: str) -> None:
    depth = 0
    for match in _STRING_OR_BRACKET.finditer(text):
        character = match.group()[0]
        if character in '[{':
            depth += 1
            if depth > MAX_DEPTH:
                raise RecursionError(f'nested more than {MAX_DEPTH} deep')
        elif character != '"':
            depth -= 1
