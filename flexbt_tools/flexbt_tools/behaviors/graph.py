# SPDX-License-Identifier: BSD-3-Clause
"""A behavior as a graph: boxes in boxes for its machines, and the trees that its states run.

A machine has an entry and an end for each outcome, so that each transition leads from one point to another: from a
state, or an end of a machine, to a state, or the entry of a machine, or an end of the machine around it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from flexbt_core.state_machine import AUTONOMY_NAMES, MachineDefinition, StateDefinition, StateKind, Transition
from flexbt_tools.trees import Item, items_of

from .used_trees import UsedTrees


@dataclass(frozen=True)
class Edge:
    """A transition, or (without an outcome) what begins with its machine."""

    start: str
    end: str
    outcome: str = ''
    autonomy: int = -1

    @property
    def label(self) -> str:
        """The outcome, and the level that it requires."""
        level = f' ({AUTONOMY_NAMES[self.autonomy]})' if self.autonomy > 0 else ''
        return f'{self.outcome}{level}'


@dataclass(frozen=True)
class StateBox:
    """A leaf; ``tree`` are the nodes of the tree that it runs, if any, which is called ``tree_id``."""

    id: str
    definition: StateDefinition
    tree_id: str = ''
    tree: Sequence[Item] = ()


@dataclass
class MachineBox:
    """A machine: ``ends`` has the point of each of its outcomes."""

    id: str
    definition: MachineDefinition
    ends: Mapping[str, str] = field(default_factory=dict)
    states: list[StateBox] = field(default_factory=list)
    machines: list[MachineBox] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Its label, and what kind of container it is when it is no plain machine."""
        kind = self.definition.kind
        return self.definition.label + (f' ({kind.name.lower()})' if kind is not StateKind.MACHINE else '')

    @property
    def entry(self) -> str:
        """The point where it begins."""
        return f'{self.id}in'


_NO_TREES: Final = UsedTrees()


def graph_of(machine: MachineDefinition, trees: UsedTrees = _NO_TREES, *, expand: bool = False) -> MachineBox:
    """The graph of a machine; with ``expand`` sub-trees stand in their place."""
    keys = {use.path: use.key for use in trees.uses if use.key is not None}
    count = iter(range(1_000_000_000))

    def box(definition: MachineDefinition) -> MachineBox:
        id = f'm{next(count)}'
        ends = {outcome: f'{id}out{index}' for index, outcome in enumerate(definition.outcomes)}
        made = MachineBox(id, definition, ends)
        entries: dict[str, str] = {}
        exits: dict[str, Mapping[str, str]] = {}
        for label, child in definition.children.items():
            if isinstance(child, MachineDefinition):
                inner = box(child)
                made.machines.append(inner)
                entries[label], exits[label] = inner.entry, inner.ends
            else:
                key = keys.get(child.path)
                tree = list(items_of(trees.library, key, expand=expand)) if key is not None else []
                state = StateBox(f's{next(count)}', child, key.id if key is not None else '', tree)
                made.states.append(state)
                entries[label], exits[label] = state.id, dict.fromkeys(child.outcomes, state.id)
        begins = entries if definition.kind is StateKind.CONCURRENCY else [definition.initial]
        made.edges += [Edge(made.entry, entries[label]) for label in begins]
        for label, child in definition.children.items():
            for outcome, transition in child.transitions.items():
                end = _end(transition, entries, ends)
                if end is not None:
                    made.edges.append(Edge(exits[label][outcome], end, outcome, transition.autonomy))
        return made

    return box(machine)


def _end(transition: Transition, entries: Mapping[str, str], ends: Mapping[str, str]) -> str | None:
    if transition.state is not None:
        return entries[transition.state]
    return None if transition.outcome is None else ends[transition.outcome]


def all_edges(box: MachineBox) -> Iterator[Edge]:
    """The edges of a machine and of those in it."""
    yield from box.edges
    for inner in box.machines:
        yield from all_edges(inner)
