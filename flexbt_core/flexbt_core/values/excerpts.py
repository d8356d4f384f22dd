# SPDX-License-Identifier: BSD-3-Clause
"""Enough of a value of unknown origin to recognise it in a message to people, and never more."""

from __future__ import annotations

import reprlib
from enum import Enum
from itertools import islice
from typing import Any, Final

MOST: Final = 80
"""Characters of a value in a message."""
_GAP: Final = ' ... '


def excerpt(text: str, most: int = MOST) -> str:
    """``text``, of which the middle is left out where it has more than ``most`` characters."""
    if len(text) <= most:
        return text
    end = most // 3
    return f'{text[: most - end - len(_GAP)]}{_GAP}{text[-end:]}'


def shown(value: object) -> str:
    """``value`` as Python writes it, in :data:`MOST` characters at most. Never raises; a large one takes no time."""
    try:
        return excerpt(_Repr().repr(value))
    except Exception:  # an integer of too many digits, code of others
        return f'a {type(value).__name__} that cannot be shown'


class _Repr(reprlib.Repr):
    """Writes one value, so much of it that :func:`shown` leaves out the rest: each part has a character at least.

    Messages of ROS and what is derived from a collection or a text are written part by part, too.
    """

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = self.maxstring = self.maxother = self.maxlong = MOST
        self.maxlist = self.maxtuple = self.maxdeque = self.maxarray = MOST // 3
        self.maxdict = self.maxset = self.maxfrozenset = MOST // 3
        self._left = MOST

    def repr1(self, x: Any, level: int) -> str:
        self._left -= 1
        return super().repr1(x, level) if self._left >= 0 else '...'

    # They sort what they are given.
    def repr_dict(self, x: dict[Any, Any], level: int) -> str:
        return super().repr_dict(dict(islice(x.items(), self.maxdict + 1)), level)

    def repr_set(self, x: set[Any], level: int) -> str:
        return super().repr_set(set(islice(x, self.maxset + 1)), level)

    def repr_frozenset(self, x: frozenset[Any], level: int) -> str:
        return super().repr_frozenset(frozenset(islice(x, self.maxfrozenset + 1)), level)

    def repr_bytes(self, x: Any, level: int) -> str:
        return self.repr_str(x, level)

    repr_bytearray = repr_bytes

    def repr_instance(self, x: Any, level: int) -> str:
        kind = type(x)
        if hasattr(kind, 'get_fields_and_field_types') and not isinstance(x, type):
            fields = islice(kind.get_fields_and_field_types(), self.maxdict)
            parts = ', '.join(f'{name}={self.repr1(getattr(x, name), level - 1)}' for name in fields)
            return f'{kind.__module__.rpartition(".")[0]}.{kind.__name__}({parts})'
        base: Any = next((base for base in _PARTED if isinstance(x, base)), None)
        if base is None or isinstance(x, Enum):
            return excerpt(repr(x), self.maxother)
        parts = getattr(self, f'repr_{base.__name__}')(x, level)
        return str(parts) if kind.__repr__ is base.__repr__ else f'{kind.__name__}({parts})'


_PARTED: Final = (str, bytes, bytearray, list, tuple, dict, set, frozenset)
