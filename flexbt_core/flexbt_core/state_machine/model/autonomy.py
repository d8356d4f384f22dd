# SPDX-License-Identifier: BSD-3-Clause
"""Autonomy levels, and the decisions that wait for the operator."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final


class Autonomy:
    """Levels, both of what an outcome requires and of what the operator allows.

    A transition happens without the operator iff the level that it requires is *lower* than the current one. So at
    level Off nothing happens alone, and an outcome that requires Full always waits for the operator. (The rule and
    the names are FlexBE's.)
    """

    Inherit: Final = 0
    Off: Final = 0
    Low: Final = 1
    High: Final = 2
    Full: Final = 3


UNDECLARED: Final = -1
"""Level required by an outcome for which none was declared: it passes at every level."""

AUTONOMY_NAMES: Final = {Autonomy.Off: 'Off', Autonomy.Low: 'Low', Autonomy.High: 'High', Autonomy.Full: 'Full'}


def is_autonomous(required: int, current: int) -> bool:
    """Return whether a transition that requires a level happens alone at the current one."""
    return required < current


def no_level(level: int) -> str:
    """Return why a number is refused as a level."""
    return f'autonomy {level} is none of the levels Off 0, Low 1, High 2, Full 3'


# What waits for the operator.


class DecisionKind(Enum):
    """Kinds of decisions; the values are the constants of PendingDecision."""

    TRANSITION = 1
    CHOICE = 2


@dataclass(slots=True)  # to make a frozen one takes three times as long
class Decision:
    """A decision of a run. Nobody changes it.

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
