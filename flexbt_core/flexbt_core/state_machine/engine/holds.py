# SPDX-License-Identifier: BSD-3-Clause
"""What of a run stands still: all of it while it is paused, and what is apart from a container that has priority."""

from __future__ import annotations

from flexbt_core.state_machine.model.definition import are_apart, is_inside


class Holds:
    """Of one run, by the paths of its states and machines.

    ``focus`` is the priority container for which everything else stands still. ``are_news`` until the states have been
    told whether they stand still.
    """

    __slots__ = ('_claims', 'are_news', 'focus', 'is_paused')

    def __init__(self) -> None:
        self.is_paused = False
        self.focus: str | None = None
        self.are_news = False
        self._claims: list[str] = []  # of priority containers, each inside the one before

    def set_paused(self, is_paused: bool) -> None:
        """Let everything stand still, or go on."""
        self.is_paused = is_paused
        self.are_news = True

    def claim(self, path: str) -> None:
        """Let everything stand still that is apart from a priority container."""
        self._set_claims([*self._claims, path])

    def release(self, path: str) -> None:
        """Nothing of what is in a state or machine has priority any more."""
        if self._claims:
            self._set_claims([claim for claim in self._claims if not is_inside(claim, path)])

    def is_held(self, path: str) -> bool:
        """Whether a state or machine stands still."""
        return self.is_paused or (self.focus is not None and are_apart(path, self.focus))

    def _set_claims(self, claims: list[str]) -> None:
        self._claims = claims
        focus = claims[-1] if claims else None
        if focus != self.focus:
            self.focus = focus
            self.are_news = True
