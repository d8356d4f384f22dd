# SPDX-License-Identifier: BSD-3-Clause
"""Autonomy levels, and pending decisions of the operator."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final


class Autonomy:
    """Autonomy levels: those that outcomes require, and those that the operator sets.

    A transition happens without the operator iff it requires a level *lower* than the current one. So at level Off
    no transition is automatic, and an outcome that requires Full always waits for the operator. (The rule and the
    names are FlexBE's.)
    """

    Inherit: Final = 0
    Off: Final = 0
    Low: Final = 1
    High: Final = 2
    Full: Final = 3


UNDECLARED: Final = -1
"""Level of an outcome that declares none: it passes at every level."""

AUTONOMY_NAMES: Final = {Autonomy.Off: 'Off', Autonomy.Low: 'Low', Autonomy.High: 'High', Autonomy.Full: 'Full'}


def is_autonomous(required: int, current: int) -> bool:
    """Return whether a transition that requires a level is automatic at the current one."""
    return required < current


def no_level(level: int) -> str:
    """Return the message that refuses a number as a level."""
    return f'autonomy {level} is none of the levels Off 0, Low 1, High 2, Full 3'


# Pending decisions.


class DecisionKind(Enum):
    """Kinds of decisions; the values are the constants of PendingDecision."""

    TRANSITION = 1
    CHOICE = 2


@dataclass(slots=True)  # not frozen: creating a frozen one takes three times as long
class Decision:
    """A decision of a run. Treat it as immutable.

    ``id`` is unique in the run. ``path`` is the state or machine that waits, ``outcome`` the outcome that it wants or
    suggests ('' for none), ``outcomes`` are the possible choices. ``required`` is the autonomy level that ``outcome``
    requires (-1 for none), ``since`` the time on the run's clock when the decision was requested.
    """

    id: str
    kind: DecisionKind
    path: str
    outcome: str
    outcomes: tuple[str, ...]
    required: int
    prompt: str
    since: float
