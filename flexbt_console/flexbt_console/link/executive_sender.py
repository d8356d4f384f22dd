# SPDX-License-Identifier: BSD-3-Clause
"""Who sends the picture: the first that was heard, as long as it is there and heard."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from itertools import takewhile
from typing import Final

from flexbt_common.runtime import UNKNOWN_WRITER

RETURN_SECONDS: Final = 15.0
"""For so long one that was replaced is still expected: its computer was busy, or its process was stopped."""

_LOOK_SECONDS: Final = 0.2
_MOST_REPLACED: Final = 16


class Succession(Enum):
    """Of which participant a status is. INSTEAD: of the executive; those before were of one that was not, or others
    were taken for the executive's before it was known."""

    SAME = 'same'
    NEXT = 'next'
    INSTEAD = 'instead'


class ExecutiveSender:
    """Tells the messages of the executive from those that others write under its topics.

    One that is silent is replaced by the next whose status is heard: it may have been started again, and the middleware
    needs long to see that a process was killed. When it is heard once more soon, it was late, and is the executive
    again. One that answers a STOP, which the one that is heard has not, is the executive.

    ``is_there`` says whether a participant of the domain still publishes statuses, ``is_silent`` whether the one that
    is shown should have been heard again by now; ``now`` is in seconds.
    """

    def __init__(
        self, is_there: Callable[[bytes], bool], is_silent: Callable[[], bool], now: Callable[[], float]
    ) -> None:
        self._participant = UNKNOWN_WRITER
        self._early: set[bytes] = set()  # who was heard before the executive was known
        self._replaced: dict[bytes, float] = {}  # until when each may return, in their order
        self._is_there = is_there
        self._is_silent = is_silent
        self._now = now
        self._there_until = now()

    def has_sent(self, participant: bytes) -> bool:
        """Whether what a participant has sent is the executive's, as far as is known."""
        if self._participant == UNKNOWN_WRITER and len(self._early) < _MOST_REPLACED:
            self._early.add(participant)
        if UNKNOWN_WRITER in (participant, self._participant) or participant == self._participant:
            return True
        if self._now() < self._replaced.get(participant, 0.0):
            return True
        return self._is_silent() or not self._is_still_there()

    def follow(self, participant: bytes, *, answers: bool = False) -> Succession:
        """A participant has sent a status that is the executive's, or that ``answers`` a STOP in its place."""
        before, self._participant = self._participant, participant
        if before == UNKNOWN_WRITER:
            return Succession.INSTEAD if self._early - {participant} else Succession.SAME
        if participant in (before, UNKNOWN_WRITER):
            return Succession.SAME
        now = self._now()
        self._there_until = now
        self._replaced = {one: until for one, until in self._replaced.items() if now < until}
        if answers or participant in self._replaced:  # those that came after it were in its place
            self._replaced = dict(takewhile(lambda entry: entry[0] != participant, self._replaced.items()))
            return Succession.INSTEAD
        if len(self._replaced) < _MOST_REPLACED:
            self._replaced[before] = now + RETURN_SECONDS
        return Succession.NEXT

    def _is_still_there(self) -> bool:
        """Looked for some times a second, however many messages come: it takes as long as a message."""
        if self._now() < self._there_until:
            return True
        is_there = self._is_there(self._participant)
        self._there_until = self._now() + (_LOOK_SECONDS if is_there else 0.0)
        return is_there
