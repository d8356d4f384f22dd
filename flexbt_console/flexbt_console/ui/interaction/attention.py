# SPDX-License-Identifier: BSD-3-Clause
"""Why a decision has waited: its operator dealt with another one, had not noticed it, or was dealing with it.

The parts are those of the literature on how many robots one operator can serve (Cummings and Mitchell 2008, *Predicting
controller capacity in supervisory control of multiple UAVs*): wait times by queues, by loss of situation awareness, and
by interaction. An operator deals with a decision from the first key that is pressed while it is on the screen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import fsum
from typing import Final

from flexbt_console.mirror import Command, View
from flexbt_core.clock import Clock

REMEMBERED: Final = 200
"""Spells of dealing with a decision."""


Key = tuple[str, str]
"""A decision among those of all robots: the identifier of its executive, and its own."""


class Attention:
    """What the operator deals with, and since when, by the keys that are pressed."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._seen: dict[Key, float] = {}
        self._spells: list[tuple[Key, float, float]] = []
        self._current: tuple[Key, float] | None = None

    def pending(self, views: Iterable[View]) -> None:
        """What waits in these waits now."""
        now = self._clock.now()
        waiting = [key for view in views for one in view.decisions if (key := _key(view, one.id)) is not None]
        self._seen = {one: self._seen.get(one, now) for one in waiting}

    def touched(self, view: View, decision_id: str | None) -> None:
        """A key was pressed while this decision of the view was on the screen; None is none."""
        key = _key(view, decision_id)
        if self._current is not None and self._current[0] == key:
            return
        self._close()
        self._current = (key, self._clock.now()) if key is not None else None

    def measured(self, command: Command) -> Command:
        """With why the decision that it answers has waited, for the report of the run."""
        if not command.decision_id:
            return command
        queue, interaction = self.answered((command.executive_id, command.decision_id))
        return replace(command, wait_queue=queue, wait_interaction=interaction)

    def answered(self, decision: Key) -> tuple[float, float]:
        """Seconds in which others were dealt with while this one waited, and in which this one was."""
        self._close()
        now = self._clock.now()
        seen = self._seen.get(decision, now)
        queue = fsum(max(0.0, end - max(begin, seen)) for one, begin, end in self._spells if one != decision)
        return queue, fsum(end - begin for one, begin, end in self._spells if one == decision)

    def _close(self) -> None:
        if self._current is not None:
            decision, begin = self._current
            self._spells = [*self._spells[-REMEMBERED + 1 :], (decision, begin, self._clock.now())]
            self._current = None


def _key(view: View, decision_id: str | None) -> Key | None:
    return (view.snapshot.executive_id, decision_id) if decision_id and view.snapshot is not None else None
