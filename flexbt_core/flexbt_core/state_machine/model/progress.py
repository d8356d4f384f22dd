# SPDX-License-Identifier: BSD-3-Clause
"""How far what a state does has come, as figures for the operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Progress:
    """What a state knows of its work; what it does not know is negative, '' or None.

    ``tree_run_id`` names the run of the tree that works for it; ``distance`` in m, ``time`` in s and ``poses`` (goal
    poses) are what is left; ``recoveries`` were started. ``goal`` is where the robot drives to, a PoseStamped.
    """

    tree_run_id: str = ''
    distance: float = -1.0
    time: float = -1.0
    poses: int = -1
    recoveries: int = 0
    goal: Any = None

    @property
    def is_known(self) -> bool:
        """Whether there is more to be said than which tree it is."""
        return self != Progress(self.tree_run_id)
