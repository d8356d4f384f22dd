# SPDX-License-Identifier: BSD-3-Clause
"""Values of parameters: from what an operator wrote, or a YAML file has, to the type that the behavior declares."""

from __future__ import annotations

import re
from typing import Any, Final

from flexbt_common.runtime import resolve_file
from flexbt_core.errors import FlexbtError
from flexbt_core.values import load_yaml, read_text, shown
from flexbt_onboard.errors import ParameterError

YAML_PREFIX: Final = '/YAML:'
"""FlexBE's mark of an argument, in front of its name, whose value is a file and a key in it."""

_TRUE: Final = frozenset({'true', 'yes', 'on', '1'})
_FALSE: Final = frozenset({'false', 'no', 'off', '0'})
_FILE: Final = re.compile(r'(?P<file>[\w.-]+/[\w./-]+\.ya?ml)(?::(?P<key>\S*))?')


def converted(name: str, value: Any, like: Any) -> Any:
    """``value`` as a value of the type of ``like``; an int for a bool, or the reverse, is not one.

    Raises:
        ParameterError: it cannot be converted without loss.
    """
    if type(value) is type(like):
        return value
    try:
        if isinstance(like, bool):
            return _bool(value)
        if isinstance(like, int):
            return _int(value)
        if isinstance(like, float):
            return float(value)
        if isinstance(like, dict | list):
            return _structure(value, type(like))
        return str(value) if isinstance(like, str) else value
    except (TypeError, ValueError, OverflowError) as error:
        kind = type(like).__name__
        raise ParameterError(f'parameter {name!r}: {shown(value)} is not a value of type {kind}: {error}') from None


def from_yaml_file(name: str, text: str) -> Any:
    """The content of a YAML file: ``package/relative/path.yaml``, or a key in it after a colon.

    Raises:
        ParameterError: no such file in an installed package, no YAML, or no such key.
    """
    found = _FILE.fullmatch(text.strip())
    if found is None:
        raise ParameterError(f'parameter {name!r}: {text!r} is no package/relative/path.yaml, with or without :KEY')
    try:
        content = load_yaml(read_text(resolve_file(found['file'])), aliases=True)
    except (FlexbtError, OSError, ValueError) as error:
        raise ParameterError(f'parameter {name!r}: {error}') from None
    key = found['key']
    if not key:
        return content
    if not isinstance(content, dict) or key not in content:
        raise ParameterError(f'parameter {name!r}: {found["file"]} has no key {key!r}')
    return content[key]


def is_yaml_file(text: str) -> bool:
    """Whether a text names a YAML file of a package."""
    return _FILE.fullmatch(text.strip()) is not None


def _bool(value: Any) -> bool:
    word = str(value).strip().lower()
    if word not in _TRUE | _FALSE:
        raise ValueError('write true or false')
    return word in _TRUE


def _int(value: Any) -> int:
    number = float(value) if isinstance(value, str) and not re.fullmatch(r'\s*[+-]?\d+\s*', value) else value
    if int(number) != float(number):
        raise ValueError('write a whole number')
    return int(number)


def _structure(value: Any, kind: type[Any]) -> Any:
    content = load_yaml(value) if isinstance(value, str) else value
    if not isinstance(content, kind):
        example = '[1, 2]' if kind is list else '{name: 1}'
        raise ValueError(f'it is a {type(content).__name__}; write {example}')
    return content
