# SPDX-License-Identifier: BSD-3-Clause
"""A machine that was synthesized: states, where their outcomes lead, and why they are there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class MachinePart:
    """A capability as it is carried out in a state: the class with its parameters, and the userdata of both."""

    capability: str
    state_class: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    outcomes: tuple[str, ...] = ()
    reads: Mapping[str, str] = field(default_factory=dict)
    writes: Mapping[str, str] = field(default_factory=dict)
    retry_on: tuple[str, ...] = ()

    @property
    def remapping(self) -> dict[str, str]:
        """Keys of the class that have another name in the machine."""
        return {key: name for key, name in {**self.reads, **self.writes}.items() if key != name}


@dataclass(frozen=True, slots=True)
class MachineState:
    """A state. Several ``parts`` are active at once; their outcomes are then joined, one of each, by ``combinations``.

    ``nodes`` are those of the strategy that the state stands for, ``holds`` what is known in all of them.
    """

    name: str
    parts: tuple[MachinePart, ...]
    transitions: Mapping[str, str]
    autonomy: Mapping[str, int]
    nodes: tuple[int, ...] = ()
    holds: tuple[str, ...] = ()
    combinations: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SynthesizedMachine:
    """States by their names in the order in which they are reached; the first one begins.

    ``attempts`` is how often a state with ``retry_on`` is entered at most. ``keys`` is the userdata that has to be
    there from the beginning.
    """

    name: str
    outcomes: tuple[str, ...]
    states: Mapping[str, MachineState]
    attempts: int = 1
    keys: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def initial(self) -> str:
        """The state that begins."""
        return next(iter(self.states))

    def edges(self) -> Iterator[tuple[str, str, str]]:
        """State, outcome and target of each transition."""
        for state in self.states.values():
            for outcome, target in state.transitions.items():
                yield state.name, outcome, target
