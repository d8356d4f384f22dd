# SPDX-License-Identifier: BSD-3-Clause
"""Definitions of message types as MCAP files carry them, so that a reader needs no ROS."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from ament_index_python.packages import get_package_share_directory

_SEPARATOR: Final = '=' * 80
_FIELD: Final = re.compile(r'^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[a-z]\w*', re.MULTILINE)
_CONSTANT: Final = re.compile(r'^\S+\s+[A-Z]\w*\s*=')
_PRIMITIVES: Final = frozenset(
    {'bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring'}
    | {f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)}
)


def full_definition(type: str) -> str:
    """The text of a message definition and of all that it consists of, in the encoding ``ros2msg`` of MCAP.

    ``type`` is a name such as ``nav_msgs/msg/Path`` of an installed package. Raises OSError or LookupError when its
    definition is not there.
    """
    parts = [_text(type)]
    known = [type]
    for one in known:
        for inner in _types_in(one):
            if inner not in known:
                known.append(inner)
                parts.append(f'{_SEPARATOR}\nMSG: {inner.replace("/msg/", "/")}\n{_text(inner)}')
    return '\n'.join(parts)


def fields_of(definition: str) -> list[str]:
    """The lines of a definition that say how its messages are written: all but comments, constants and spaces."""
    lines = (' '.join(line.split('#')[0].split()) for line in definition.splitlines())
    return [line for line in lines if line and not _CONSTANT.match(line)]


def _types_in(type: str) -> list[str]:
    package = type.partition('/')[0]
    plain = re.sub(r'#.*', '', _text(type))
    names = dict.fromkeys(match for match in _FIELD.findall(plain) if match not in _PRIMITIVES)
    return [
        f'{first}/msg/{rest.removeprefix("msg/")}' if rest else f'{package}/msg/{first}'
        for first, _, rest in (name.partition('/') for name in names)
    ]


def _text(type: str) -> str:
    package, _, name = type.partition('/msg/')
    return (Path(get_package_share_directory(package)) / 'msg' / f'{name}.msg').read_text(encoding='utf-8')
