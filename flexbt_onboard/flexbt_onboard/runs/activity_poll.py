# SPDX-License-Identifier: BSD-3-Clause
"""When the active states of a run are asked what they are doing, which calls their code."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from .run_snapshot import ActiveLeaf, SnapshotSource


class ActivityPoll:
    """Asked for from any thread; the states are asked on the thread of the run."""

    def __init__(self) -> None:
        self._has_changed = False
        self._is_requested = False
        self._is_untold = False  # what was found when it was requested, and nothing had changed

    def changed(self) -> None:
        """What states are doing may be another thing now, which is to be shown."""
        self._has_changed = True

    def request(self) -> None:
        """The next status is to have what the states are doing then."""
        self._is_requested = True

    @property
    def is_due(self) -> bool:
        """Whether the states are to be asked."""
        return self._has_changed or self._is_requested

    def ask(self, source: SnapshotSource, before: tuple[ActiveLeaf, ...]) -> tuple[tuple[ActiveLeaf, ...], bool]:
        """The active states with what they say now, and whether that is to be shown at once.

        What is another thing each time that it is asked for, such as a time, is no event: the next status has it.
        """
        has_changed, self._has_changed, self._is_requested = self._has_changed, False, False
        active = source.asked(before)
        self._is_untold = self._is_untold or active != before
        is_shown = has_changed and self._is_untold
        self._is_untold = self._is_untold and not is_shown
        return active, is_shown


def not_paused_lines(before: Sequence[ActiveLeaf], now: Sequence[ActiveLeaf]) -> Iterator[str]:
    """For operators: what goes on although its state is paused, where that is new."""
    known = {leaf.path: leaf.not_paused for leaf in before}
    for leaf in now:
        if leaf.not_paused and leaf.not_paused != known.get(leaf.path):
            yield f'state {leaf.path} is paused, and yet goes on: {"; ".join(leaf.not_paused)}'
