# SPDX-License-Identifier: BSD-3-Clause
"""Who sends the picture: the first that was heard, as long as it is there and heard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from flexbt_common.runtime import UNKNOWN_WRITER

_LOOK_SECONDS: Final = 0.2


class ExecutiveSender:
    """Tells the messages of the executive from those that others write under its topics.

    ``is_there`` says whether a participant of the domain still publishes statuses, ``is_silent`` whether the one that
    is shown should have been heard again by now; ``now`` is in seconds.
    """

    def __init__(
        self, is_there: Callable[[bytes], bool], is_silent: Callable[[], bool], now: Callable[[], float]
    ) -> None:
        self._participant = UNKNOWN_WRITER
        self._is_there = is_there
        self._is_silent = is_silent
        self._now = now
        self._there_until = now()

    def has_sent(self, participant: bytes, *, is_status: bool = False) -> bool:
        """Whether what a participant has sent is the executive's. Only a status makes another one the executive."""
        if UNKNOWN_WRITER in (participant, self._participant) or participant == self._participant:
            is_its = True
        else:
            is_its = self._is_silent() or not self._is_still_there()
        if is_its and is_status:
            self._participant = participant
        return is_its

    def _is_still_there(self) -> bool:
        """Looked for some times a second, however many messages come: it takes as long as a message."""
        if self._now() < self._there_until:
            return True
        is_there = self._is_there(self._participant)
        self._there_until = self._now() + (_LOOK_SECONDS if is_there else 0.0)
        return is_there
