# SPDX-License-Identifier: BSD-3-Clause
"""Enough of a value of unknown origin to recognise it in a message to people, and never more."""

from __future__ import annotations

import reprlib
from typing import Final

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
        return excerpt(_REPR.repr(value))
    except Exception:  # an integer of too many digits, code of others
        return f'a {type(value).__name__} that cannot be shown'


class _Repr(reprlib.Repr):
    """Takes so much of texts and of collections that :func:`shown` leaves out the rest."""

    def __init__(self) -> None:
        super().__init__()
        self.maxstring = self.maxother = self.maxlong = MOST
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = self.maxfrozenset = MOST // 3


_REPR: Final = _Repr()
