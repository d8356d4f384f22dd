# SPDX-License-Identifier: BSD-3-Clause
"""Who sends the picture: the first that was heard, as long as it is there and heard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from flexbt_common.runtime import UNKNOWN_WRITER

_LOOK_SECONDS: Final = 0.2
_MOST_REPLACED: Final = 64


class ExecutiveSender:
    """Tells the messages of the executive from those that others write under its topics.

    One that is silent is replaced by the next that is heard: it may have been started again, and the middleware needs
    long to see that a process was killed. When it is heard once more, it was late, and is the executive again.

    ``is_there`` says whether a participant of the domain still publishes statuses, ``is_silent`` whether the one that
    is shown should have been heard again by now; ``now`` is in seconds. ``on_replaced`` is called when a status comes
    from another one than those before.
    """

    def __init__(
        self,
        is_there: Callable[[bytes], bool],
        is_silent: Callable[[], bool],
        now: Callable[[], float],
        on_replaced: Callable[[], object],
    ) -> None:
        self._participant = UNKNOWN_WRITER
        self._replaced: list[bytes] = []  # one after the other, by the next or by the one that is heard
        self._is_there = is_there
        self._is_silent = is_silent
        self._now = now
        self._on_replaced = on_replaced
        self._there_until = now()

    def has_sent(self, participant: bytes, *, is_status: bool = False) -> bool:
        """Whether what a participant has sent is the executive's. Only a status makes another one the executive."""
        if UNKNOWN_WRITER in (participant, self._participant) or participant == self._participant:
            is_its = True
        elif participant in self._replaced:
            is_its = is_status
        else:
            is_its = self._is_silent() or not self._is_still_there()
        if is_its and is_status:
            self._follow(participant)
        return is_its

    def _follow(self, participant: bytes) -> None:
        before, self._participant = self._participant, participant
        if participant == before or before == UNKNOWN_WRITER:
            return
        if participant in self._replaced:
            del self._replaced[self._replaced.index(participant) :]
        elif len(self._replaced) < _MOST_REPLACED:
            self._replaced.append(before)
        self._there_until = self._now()
        self._on_replaced()

    def _is_still_there(self) -> bool:
        """Looked for some times a second, however many messages come: it takes as long as a message."""
        if self._now() < self._there_until:
            return True
        is_there = self._is_there(self._participant)
        self._there_until = self._now() + (_LOOK_SECONDS if is_there else 0.0)
        return is_there
