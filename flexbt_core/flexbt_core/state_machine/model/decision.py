# SPDX-License-Identifier: BSD-3-Clause
"""What waits for the operator."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class DecisionKind(Enum):
    """Kinds of decisions; the values are the constants of PendingDecision."""

    TRANSITION = 1
    CHOICE = 2


@dataclass(frozen=True, slots=True)
class Decision:
    """A decision of a run.

    ``id`` is unique in the run, ``path`` the state or machine that waits, ``outcome`` the one that is wanted or
    suggested ('' for none), ``outcomes`` those that may be chosen, ``required`` the autonomy level that ``outcome``
    requires (-1 without one), ``since`` the time of the run's clock when it came up.
    """

    id: str
    kind: DecisionKind
    path: str
    outcome: str
    outcomes: tuple[str, ...]
    required: int
    prompt: str
    since: float
