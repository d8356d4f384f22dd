# SPDX-License-Identifier: BSD-3-Clause
"""What a machine is, apart from any run of it: immutable, checked, and fit to be drawn and sent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from .event_state import EventState

PREEMPTED: Final = 'preempted'
"""Outcome of a run that was stopped. Reserved: no state and no machine declares it."""

ERROR: Final = 'error'
"""Outcome of a run that ended by a fault which no state could take. Reserved as well."""

ROOT_PATH: Final = '/'


class StateKind(Enum):
    """Kinds of nodes; the values are the constants of StateStructure."""

    STATE = 1
    MACHINE = 2


@dataclass(frozen=True, slots=True)
class Transition:
    """Where an outcome leads: to the sibling ``state``, or to the outcome ``outcome`` of the machine.

    ``autonomy`` is the level that it requires, -1 when none was declared.
    """

    state: str | None
    outcome: str | None
    autonomy: int


@dataclass(frozen=True, slots=True)
class StateDefinition:
    """A leaf. ``remap`` maps its keys to those of its machine."""

    path: str
    label: str
    state: EventState
    transitions: Mapping[str, Transition]
    remap: Mapping[str, str]

    @property
    def outcomes(self) -> tuple[str, ...]:
        return self.state.outcomes


@dataclass(frozen=True, slots=True)
class MachineDefinition:
    """A machine. ``transitions`` and ``remap`` are those that its parent gives it; empty for the root."""

    path: str
    label: str
    outcomes: tuple[str, ...]
    input_keys: tuple[str, ...]
    output_keys: tuple[str, ...]
    defaults: Mapping[str, Any]
    children: Mapping[str, StateDefinition | MachineDefinition]
    initial: str
    transitions: Mapping[str, Transition]
    remap: Mapping[str, str]
    type_name: str

    def nodes(self) -> Iterator[StateDefinition | MachineDefinition]:
        """This machine and everything in it, depth first, in the order of the children."""
        yield self
        for child in self.children.values():
            if isinstance(child, MachineDefinition):
                yield from child.nodes()
            else:
                yield child

    def structure(self) -> list[StructureEntry]:
        """All nodes as the operator's station wants them."""
        return [_entry(node) for node in self.nodes()]


@dataclass(frozen=True, slots=True)
class StructureEntry:
    """One node, with the fields of flexbt_msgs/msg/StateStructure."""

    path: str
    kind: StateKind
    type_name: str
    children: tuple[str, ...]
    outcomes: tuple[str, ...]
    targets: tuple[str, ...]
    autonomy: tuple[int, ...]


def child_path(parent: str, label: str) -> str:
    """Path of a child."""
    return f'{parent.rstrip("/")}/{label}'


def _entry(node: StateDefinition | MachineDefinition) -> StructureEntry:
    is_machine = isinstance(node, MachineDefinition)
    parent = node.path.rpartition('/')[0] or ROOT_PATH
    transitions = [node.transitions.get(outcome) for outcome in node.outcomes]
    return StructureEntry(
        path=node.path,
        kind=StateKind.MACHINE if is_machine else StateKind.STATE,
        type_name=node.type_name if isinstance(node, MachineDefinition) else type(node.state).__name__,
        children=tuple(node.children) if isinstance(node, MachineDefinition) else (),
        outcomes=node.outcomes,
        targets=tuple(
            '' if one is None else f'={one.outcome}' if one.state is None else child_path(parent, one.state)
            for one in transitions
        ),
        autonomy=tuple(-1 if one is None else one.autonomy for one in transitions),
    )
