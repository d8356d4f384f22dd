# SPDX-License-Identifier: BSD-3-Clause
"""Why a decision has waited: its operator dealt with another one, had not noticed it, or was dealing with it.

The parts are those of the literature on how many robots one operator can serve (Cummings and Mitchell 2008, *Predicting
controller capacity in supervisory control of multiple UAVs*): wait times by queues, by loss of situation awareness, and
by interaction. An operator deals with a decision from the first key that is pressed while it is on the screen.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from math import fsum
from typing import Final

from flexbt_console.mirror import Command
from flexbt_core.clock import Clock

REMEMBERED: Final = 200
"""Spells of dealing with a decision."""


class Attention:
    """What the operator deals with, and since when, by the keys that are pressed."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._seen: dict[str, float] = {}
        self._spells: list[tuple[str, float, float]] = []
        self._current: tuple[str, float] | None = None

    def pending(self, decisions: Collection[str]) -> None:
        """These wait now, of any robot."""
        now = self._clock.now()
        self._seen = {one: self._seen.get(one, now) for one in decisions}

    def touched(self, decision: str) -> None:
        """A key was pressed while this decision was on the screen; '' is none."""
        if self._current is not None and self._current[0] == decision:
            return
        self._close()
        self._current = (decision, self._clock.now()) if decision else None

    def measured(self, command: Command) -> Command:
        """With why the decision that it answers has waited, for the report of the run."""
        if not command.decision_id:
            return command
        queue, interaction = self.answered(command.decision_id)
        return replace(command, wait_queue=queue, wait_interaction=interaction)

    def answered(self, decision: str) -> tuple[float, float]:
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
