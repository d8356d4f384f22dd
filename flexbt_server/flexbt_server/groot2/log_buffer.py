# SPDX-License-Identifier: BSD-3-Clause
"""Logs of a tree (see ``observers``) that are read later, maybe by another thread, and that know the times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from flexbt_core.behavior_tree import Log


class LogBuffer:
    """A log. While it is ``timed``, each mark is followed by the complement of the time of writing it, by ``now`` (ns).

    One thread writes; any may take.
    """

    def __init__(self, now: Callable[[], int], *, timed: bool = False) -> None:
        self.timed = timed
        self._marks: list[int] = []
        add = self._marks.append

        def append(mark: int, /) -> None:
            add(mark)
            if self.timed:
                add(~now())

        self.append = append

    def __len__(self) -> int:
        return len(self._marks)

    def take(self) -> list[int]:
        """What was written since the last call."""
        count = len(self._marks)  # the tree may go on meanwhile
        marks = self._marks[:count]
        del self._marks[:count]
        return marks


class TeeLog:
    """Writes every mark to several logs."""

    def __init__(self, logs: Sequence[Log]) -> None:
        appends = tuple(log.append for log in logs)

        def append(mark: int, /) -> None:
            for append in appends:
                append(mark)

        self.append = append
