# SPDX-License-Identifier: BSD-3-Clause
"""Machines outside a run: as written, and as a checked, immutable definition."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, ClassVar, Final

from flexbt_core.values.text import short_repr

from .autonomy import UNDECLARED
from .event_state import EventState
from .userdata import DefaultUserData, StateMachineError, check_names

PREEMPTED: Final = 'preempted'
"""Outcome of a run that was stopped. Reserved: no state or machine may declare it."""

ERROR: Final = 'error'
"""Outcome of a run that ended by a fault that no state handled. Reserved too."""

ROOT_PATH: Final = '/'


class StateKind(Enum):
    """Kinds of nodes; the values are the constants of StateStructure."""

    STATE = 1
    MACHINE = 2
    CONCURRENCY = 3
    PRIORITY = 4


@dataclass(frozen=True, slots=True)
class Transition:
    """A transition of an outcome: to the sibling ``state``, or to the outcome ``outcome`` of the machine.

    In a concurrency container it ends the child, and the conditions decide when the container ends. There ``outcome``
    is only drawn, and may be None. ``autonomy`` is the level that the transition requires, -1 if none was declared.
    """

    state: str | None
    outcome: str | None
    autonomy: int


@dataclass(frozen=True, slots=True)
class EndCondition:
    """A concurrency container ends by ``outcome`` when all ``children`` (label, outcome) have ended so."""

    outcome: str
    children: tuple[tuple[str, str], ...]

    def holds(self, ended: Mapping[str, str]) -> bool:
        """Return whether the condition holds; ``ended`` maps labels of ended children to their outcomes."""
        return all(ended.get(label) == outcome for label, outcome in self.children)


@dataclass(frozen=True, slots=True)
class StateDefinition:
    """A state in a machine. ``remap`` maps its keys to those of the machine."""

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
    """A machine or container. ``transitions`` and ``remap`` come from its parent; they are empty for the root.

    ``kind`` is MACHINE, PRIORITY or CONCURRENCY. For CONCURRENCY all children are active at once, ``conditions``
    define the end, and ``initial`` has no meaning.
    """

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
    kind: StateKind = StateKind.MACHINE
    conditions: tuple[EndCondition, ...] = ()

    @property
    def read_inputs(self) -> tuple[str, ...]:
        """Input keys that need a value: a descendant reads them, or the machine outputs them unchanged."""
        read, written = set[str](), set[str]()
        for child in self.children.values():
            inputs = child.read_inputs if isinstance(child, MachineDefinition) else child.state.input_keys
            outputs = child.output_keys if isinstance(child, MachineDefinition) else child.state.output_keys
            read.update(child.remap.get(key, key) for key in inputs)
            written.update(child.remap.get(key, key) for key in outputs)
        read.update(key for key in self.output_keys if key not in written)
        return tuple(key for key in self.input_keys if key in read)

    def outcome_of(self, ended: Mapping[str, str]) -> str | None:
        """Return the outcome by which a concurrency container ends after children have ended; None if it continues."""
        return next((one.outcome for one in self.conditions if one.holds(ended)), None)

    def nodes(self) -> Iterator[StateDefinition | MachineDefinition]:
        """Yield this machine and all descendants, depth first, in the order of the children."""
        yield self
        for child in self.children.values():
            if isinstance(child, MachineDefinition):
                yield from child.nodes()
            else:
                yield child

    def structure(self) -> list[StructureEntry]:
        """Return all nodes in the form of the messages for the operator."""
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
    """Return the path of a child."""
    return f'{parent.rstrip("/")}/{label}'


def is_inside(path: str, top: str) -> bool:
    """Return whether ``path`` is ``top`` or a descendant of it."""
    return path == top or path.startswith(top if top == ROOT_PATH else f'{top}/')


def are_apart(one: str, other: str) -> bool:
    """Return whether neither path contains the other."""
    return not is_inside(one, other) and not is_inside(other, one)


def _entry(node: StateDefinition | MachineDefinition) -> StructureEntry:
    parent = node.path.rpartition('/')[0] or ROOT_PATH
    transitions = [node.transitions.get(outcome) for outcome in node.outcomes]
    return StructureEntry(
        path=node.path,
        kind=node.kind if isinstance(node, MachineDefinition) else StateKind.STATE,
        type_name=node.type_name if isinstance(node, MachineDefinition) else node.state.type_name,
        children=tuple(node.children) if isinstance(node, MachineDefinition) else (),
        outcomes=node.outcomes,
        targets=tuple(_target(parent, one) for one in transitions),
        autonomy=tuple(-1 if one is None else one.autonomy for one in transitions),
    )


def _target(parent: str, transition: Transition | None) -> str:
    if transition is None or (transition.state is None and transition.outcome is None):
        return ''
    return f'={transition.outcome}' if transition.state is None else child_path(parent, transition.state)


# A machine as written, in any form: not checked, and not part of a run.


@dataclass(frozen=True)
class Child:
    """A state or machine in a machine.

    ``transitions`` maps its outcomes to labels of other children or to outcomes of the machine, ``autonomy`` maps its
    outcomes to the levels that they require, and ``remapping`` maps its keys to those of the machine.
    """

    label: str
    state: EventState | Machine
    transitions: Mapping[str, str] = field(default_factory=dict)
    autonomy: Mapping[str, int] = field(default_factory=dict)
    remapping: Mapping[str, str] = field(default_factory=dict)


class Machine:
    """A state machine, nested or not. Its first child is the initial one.

    ``autonomy`` is the level for outcomes of children that declare none. ``userdata`` holds the default of each key;
    ``machine.userdata.key = value`` adds more.
    """

    kind: ClassVar[StateKind] = StateKind.MACHINE

    def __init__(
        self,
        outcomes: Iterable[str] = (),
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
        *,
        children: Iterable[Child] = (),
        userdata: Mapping[str, Any] | None = None,
        autonomy: int = UNDECLARED,
    ) -> None:
        both = tuple(io_keys)
        self.outcomes: tuple[str, ...] = tuple(dict.fromkeys(outcomes))
        self.input_keys: tuple[str, ...] = tuple(dict.fromkeys((*input_keys, *both)))
        self.output_keys: tuple[str, ...] = tuple(dict.fromkeys((*output_keys, *both)))
        check_names(self, self.outcomes, (*self.input_keys, *self.output_keys))
        self.autonomy = autonomy
        self.userdata = DefaultUserData()
        self.children: list[Child] = []
        self.conditions: tuple[EndCondition, ...] = ()
        for key, value in (userdata or {}).items():
            self.userdata[key] = value
        for child in children:
            self.add_child(child)

    def add_child(self, child: Child) -> None:
        """Add a state or machine.

        Raises:
            StateMachineError: ``child`` holds neither of them.
        """
        given: Any = child.state
        if not isinstance(given, EventState | Machine):
            raise StateMachineError(
                f"cannot add '{child.label}': {short_repr(given)} is neither a state object nor a machine"
            )
        label: Any = child.label
        if not isinstance(label, str):
            raise StateMachineError(f'{short_repr(label)} cannot be a label: it is not text; in YAML, quote it')
        own = dict(child.transitions), dict(child.autonomy), dict(child.remapping)
        self.children.append(Child(child.label, child.state, *own))
