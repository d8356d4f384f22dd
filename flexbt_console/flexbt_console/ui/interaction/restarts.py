# SPDX-License-Identifier: BSD-3-Clause
"""That the executive of a robot is not the one that was there before, with which its run may have gone."""

from __future__ import annotations

from flexbt_console.mirror import View
from flexbt_console.present import Line, Tone

RESTARTED = Line('the executive was restarted; the first line says what runs now', Tone.WARNING)


class Restarts:
    """What was seen of one robot so far."""

    def __init__(self) -> None:
        self._known = ''

    def told(self, view: View) -> list[str]:
        """What is to be told of this view."""
        before, self._known = self._known, view.snapshot.executive_id if view.snapshot is not None else self._known
        return [RESTARTED] if before not in ('', self._known) else []
