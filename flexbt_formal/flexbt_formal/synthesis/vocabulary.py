# SPDX-License-Identifier: BSD-3-Clause
"""Names of activations, outcomes and memory in formulas, and the reading of valuations.

Either each capability ``a`` has an activation ``a_a`` and its outcomes ``a_c``, ``a_f`` (the first letters of
``completed``, ``failure``, as many as make them different), or (*parsed*) an integer ``capability`` says which one is
active, and the outcomes are inputs by their full names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

CAPABILITY: Final = 'capability'


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names of a system. ``outcomes`` are the normalized outcomes that each capability can have; ``ends`` the
    outcomes of the machine and the propositions for them; ``numbers`` those of capabilities where they are parsed."""

    outcomes: Mapping[str, tuple[str, ...]]
    suffixes: Mapping[str, str]
    ends: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, int] | None = None

    def active(self, capability: str, *, primed: bool = False) -> str:
        """Return the proposition that a capability is active."""
        prime = "'" if primed else ''
        if self.numbers is not None:
            return f'({CAPABILITY}{prime}={self.numbers[capability]})'
        return f'{capability}_a{prime}'

    def arrives(self, capability: str, outcome: str) -> str:
        """Return the proposition that an outcome of a capability arrives with the next step."""
        if self.numbers is not None:
            return f"({self.active(capability)} & {outcome}')"
        return f"{capability}_{self.suffixes[outcome]}'"

    def active_in(self, values: Mapping[str, int]) -> tuple[str, ...]:
        """Return the capabilities that are active in a valuation."""
        if self.numbers is not None:
            return tuple(one for one, number in self.numbers.items() if values.get(CAPABILITY) == number)
        return tuple(one for one in self.outcomes if values.get(f'{one}_a'))

    def arrived_in(self, values: Mapping[str, int], capability: str) -> tuple[str, ...]:
        """Return the outcomes of a capability that inputs tell, given that it was active."""
        return tuple(one for one in self.outcomes[capability] if values.get(self.input_of(capability, one)))

    def input_of(self, capability: str, outcome: str) -> str:
        """Return the input that reports an outcome."""
        return outcome if self.numbers is not None else f'{capability}_{self.suffixes[outcome]}'

    def ends_in(self, values: Mapping[str, int]) -> tuple[str, ...]:
        """Return the outcomes of the machine that are reached in a valuation."""
        return tuple(outcome for outcome, proposition in self.ends.items() if values.get(proposition))

    def is_own(self, name: str) -> bool:
        """Return whether a variable is an activation, an outcome of a capability, or one of the machine, or tells that
        a capability was given up, or is owed."""
        own = (
            {f'{capability}_{kind}' for capability in self.outcomes for kind in 'axp'}
            | set(self.ends.values())
            | {CAPABILITY}
        )
        told = {self.input_of(capability, one) for capability, outcomes in self.outcomes.items() for one in outcomes}
        return name in own or name in told


def suffixes(outcomes: Sequence[str]) -> dict[str, str]:
    """Return the beginning of each outcome that no other one has: its first letter, where that suffices."""
    found = {}
    for outcome in outcomes:
        lengths = range(1, len(outcome) + 1)
        taken = [other for other in outcomes if other != outcome]
        found[outcome] = next(
            (outcome[:n] for n in lengths if not any(other.startswith(outcome[:n]) for other in taken)), outcome
        )
    return found
