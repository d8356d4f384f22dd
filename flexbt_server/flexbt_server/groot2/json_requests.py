# SPDX-License-Identifier: BSD-3-Clause
"""The JSON in requests of Groot2, parsed and converted as in BehaviorTree.CPP, with its error texts.

Numbers are cut to the width of the field, and booleans count as numbers, as in BehaviorTree.CPP's JSON library.
"""

from __future__ import annotations

import json
import math
from typing import Any, Final, NoReturn

from flexbt_core.values.json_data import load_json

_NAMES: Final = {
    type(None): 'null',
    dict: 'object',
    list: 'array',
    str: 'string',
    bool: 'boolean',
    int: 'number',
    float: 'number',
}


class RequestError(Exception):
    """An invalid request; the text is the error that the client gets."""


def parse(data: bytes) -> Any:
    """Return the document. Raises RequestError."""
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise _parse_error(1, error.start + 1, 'invalid string: ill-formed UTF-8 byte') from error
    try:
        return load_json(text, parse_constant=_no_constant, parse_float=_finite)
    except json.JSONDecodeError as error:
        raise _parse_error(error.lineno, error.colno, f'syntax error while parsing value - {error.msg}') from error
    except RecursionError as error:
        raise _parse_error(1, 1, 'the document is nested too deep') from error
    except ValueError as error:  # for example an integer with thousands of digits
        raise _parse_error(1, 1, str(error)) from error


def _parse_error(line: int, column: int, reason: str) -> RequestError:
    return RequestError(f'[json.exception.parse_error.101] parse error at line {line}, column {column}: {reason}')


def _no_constant(name: str) -> NoReturn:
    raise _parse_error(1, 1, f'syntax error while parsing value - invalid literal {name}')


def _finite(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise RequestError(f"[json.exception.out_of_range.406] number overflow parsing '{text[:40]}'")
    return value


def member(document: Any, name: str) -> Any:
    """Return a member of an object. Raises RequestError."""
    if not isinstance(document, dict):
        raise RequestError(f'[json.exception.type_error.304] cannot use at() with {_NAMES[type(document)]}')
    if name not in document:
        raise RequestError(f"[json.exception.out_of_range.403] key '{name}' not found")
    return document[name]


def unsigned_16(value: Any) -> int:
    """Return an unsigned 16-bit number. Raises RequestError."""
    return _number(value) & 0xFFFF


def signed_32(value: Any) -> int:
    """Return a signed 32-bit number. Raises RequestError."""
    return ((_number(value) + 0x80000000) & 0xFFFFFFFF) - 0x80000000


def boolean(value: Any) -> bool:
    """Return true or false. Raises RequestError."""
    return bool(_typed(value, bool, 'boolean'))


def string(value: Any) -> str:
    """Return a text. Raises RequestError."""
    return str(_typed(value, str, 'string'))


def _number(value: Any) -> int:
    return int(_typed(value, int | float, 'number'))


def _typed(value: Any, kind: Any, wanted: str) -> Any:
    if not isinstance(value, kind):
        raise RequestError(f'[json.exception.type_error.302] type must be {wanted}, but is {_NAMES[type(value)]}')
    return value
