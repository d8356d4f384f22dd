# SPDX-License-Identifier: BSD-3-Clause
"""What an executive numbers, such as the lines of its log: put in order, each once, however it arrives."""

from __future__ import annotations

import bisect
from collections import OrderedDict
from typing import Final, Generic, Protocol, TypeVar

REMEMBERED_EXECUTIVES: Final = 3
"""Starts of the executive of which something is remembered."""


class Numbered(Protocol):
    """It belongs to one start of the executive, and has a number in it."""

    @property
    def executive_id(self) -> str:
        """ExecutiveStatus.executive_id."""

    @property
    def sequence(self) -> int:
        """One more than that of the one before."""


N = TypeVar('N', bound=Numbered)


class NumberedList(Generic[N]):
    """The latest of what was numbered, ``length`` of each start of the executive."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._known: OrderedDict[str, list[N]] = OrderedDict()

    def add(self, one: N) -> bool:
        """Take one in; False when it is there already, or too old."""
        known = self._known.setdefault(one.executive_id, [])
        place = bisect.bisect_left(known, one.sequence, key=lambda old: old.sequence)
        if place < len(known) and known[place].sequence == one.sequence:
            return False
        if place == 0 and len(known) >= self._length:
            return False
        known.insert(place, one)
        del known[: -self._length]
        while len(self._known) > REMEMBERED_EXECUTIVES:
            self._known.popitem(last=False)
        return True

    def of(self, executive_id: str) -> list[N]:
        """Those of one start of the executive, in their order."""
        return self._known.get(executive_id, [])

    def latest(self, count: int) -> tuple[N, ...]:
        """The latest in their order, those of an earlier executive first."""
        known = [one for of_executive in self._known.values() for one in of_executive]
        return tuple(known[-count:]) if count > 0 else ()
