# SPDX-License-Identifier: BSD-3-Clause
"""The values of the models: numbers, truths, texts, arrays (tuples) and records, none of which ever changes."""

from __future__ import annotations

from typing import Any


class Record(tuple[tuple[str, Any], ...]):
    """Members by their names, in order."""

    __slots__ = ()

    def get(self, name: str) -> Any:
        """Raises KeyError."""
        for key, value in self:
            if key == name:
                return value
        raise KeyError(f'there is no member {name!r}; there are {", ".join(key for key, _ in self)}')


def length(value: Any) -> int:
    """Of an array or a text; of a record that of its first member that has one. Raises TypeError."""
    if isinstance(value, Record):
        for _, held in value:
            if isinstance(held, tuple | str):
                return length(held)
        raise TypeError('this record has no array, so it has no length')
    if isinstance(value, tuple | str):
        return len(value)
    raise TypeError(f'{value!r} has no length')


def member(value: Any, name: str) -> Any:
    """A member of a record; of an array of records the array of that member. Raises KeyError or TypeError."""
    if isinstance(value, Record):
        if name == 'length' and all(key != name for key, _ in value):
            return length(value)
        return value.get(name)
    if name == 'length':
        return length(value)
    if isinstance(value, tuple):
        return tuple(member(one, name) for one in value)
    raise TypeError(f'{value!r} has no members, so no {name!r}')


def element(value: Any, index: Any) -> Any:
    """An element of an array, or a byte of a text. Raises IndexError or TypeError."""
    if isinstance(index, float) and index.is_integer():
        index = int(index)
    if isinstance(value, str):
        value = tuple(value.encode())
    if not isinstance(value, tuple) or isinstance(value, Record) or type(index) is not int:
        raise TypeError(f'{value!r} has no element {index!r}')
    if not 0 <= index < len(value):
        raise IndexError(f'there is no element {index}: the array has {len(value)}')
    return value[index]
