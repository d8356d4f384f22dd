# SPDX-License-Identifier: BSD-3-Clause
"""Which decision the operator was looking at when the typing began, so that no answer reaches another one."""

from __future__ import annotations

from typing import Final

from flexbt_core.clock import Clock

REACTION_SECONDS: Final = 0.4
"""A key that is pressed sooner than this after a decision took the place of another was meant for the other.

So it is also when there was nothing in between for no longer than this: who presses Enter twice answers once.
"""


class ShownDecision:
    """Binds each typed line to the decision that was on the screen at its first key."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._shown: str | None = None
        self._left_at: float | None = None
        self._replaced_at: float | None = None
        self._bound: str | None = None
        self._typing = False
        self._hasty = False

    @property
    def shown(self) -> str | None:
        """Identifier of the decision on the screen."""
        return self._shown

    def drawn(self, decision_id: str | None) -> None:
        """The screen shows this decision now."""
        if decision_id == self._shown:
            return
        now = self._clock.now()
        if self._shown is not None:
            self._left_at = now
        is_replaced = self._left_at is not None and now - self._left_at < REACTION_SECONDS
        self._replaced_at = now if is_replaced and decision_id is not None else None
        self._shown = decision_id

    def known(self, decision_id: str) -> None:
        """The screen shows this decision now, for which the operator has asked."""
        self._shown, self._left_at, self._replaced_at = decision_id, None, None

    def typed(self, text: str) -> None:
        """The line reads so now; the first character of a line binds it."""
        if not text:
            self._typing = False
        elif not self._typing:
            self._typing = True
            self._bound = self._shown
            since = None if self._replaced_at is None else self._clock.now() - self._replaced_at
            self._hasty = since is not None and since < REACTION_SECONDS

    @property
    def bound(self) -> tuple[str | None, bool]:
        """The decision that the line is bound to, and whether its typing began too soon to be meant."""
        return (self._bound, self._hasty) if self._typing else (self._shown, False)

    def take(self) -> tuple[str | None, bool]:
        """What the line, which is finished, is bound to."""
        bound = self.bound
        self._typing = False
        return bound
