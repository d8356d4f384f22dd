# SPDX-License-Identifier: BSD-3-Clause
"""A state machine as a graph: boxes in boxes for its containers, and the trees that its states run.

A container has an entry and an end for each outcome, so that each transition leads from one point to another: from a
state, or an end of a container, to a state, or the entry of a container, or an end of the container around it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from .tree_picture import DrawnNode

AUTONOMY_NAMES = ('Off', 'Low', 'High', 'Full')


@dataclass(frozen=True)
class DrawnTree:
    """A tree that a state runs."""

    title: str
    nodes: Sequence[DrawnNode]


@dataclass(frozen=True)
class DrawnState:
    """A state or container, with the fields of flexbt_msgs/StateStructure; ``kind`` is the constant in lower case.

    ``why`` are lines about why it is there.
    """

    path: str
    kind: str
    type: str
    children: Sequence[str]
    outcomes: Sequence[str]
    targets: Sequence[str]
    autonomy: Sequence[int]
    tree: DrawnTree | None = None
    why: Sequence[str] = ()

    @property
    def label(self) -> str:
        """Its own name."""
        return self.path.rpartition('/')[2]


@dataclass(frozen=True)
class Edge:
    """A transition, or (without an outcome) what begins with its container."""

    id: str
    start: str
    end: str
    outcome: str = ''
    autonomy: int = -1

    @property
    def label(self) -> str:
        """The outcome, and the level that it requires."""
        level = f' ({AUTONOMY_NAMES[self.autonomy]})' if 0 < self.autonomy < len(AUTONOMY_NAMES) else ''
        return f'{self.outcome}{level}'


@dataclass(frozen=True)
class StateBox:
    """A leaf."""

    id: str
    state: DrawnState


@dataclass
class MachineBox:
    """A container: ``ends`` has the point of each of its outcomes."""

    id: str
    state: DrawnState
    ends: Mapping[str, str] = field(default_factory=dict)
    boxes: list[StateBox | MachineBox] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)

    @property
    def title(self) -> str:
        """Its label, and what kind of container it is when it is no plain machine."""
        return self.state.label + (f' ({self.state.kind})' if self.state.kind != 'machine' else '')

    @property
    def entry(self) -> str:
        """The point where it begins."""
        return f'{self.id}in'

    def all_edges(self) -> Iterator[Edge]:
        """The edges of the container and of those in it."""
        yield from self.edges
        for inner in self.boxes:
            if isinstance(inner, MachineBox):
                yield from inner.all_edges()


def machine_graph(states: Sequence[DrawnState]) -> MachineBox:
    """The graph of a machine: ``states`` depth first, the root first, whose position in it is the number in the names:
    ``s3`` is a state, ``s3o0`` the transition of its outcome 0, ``m1`` a container. What leads nowhere is left out.
    """
    places = {state.path: place for place, state in enumerate(states)}

    def box(place: int) -> MachineBox:
        state = states[place]
        made = MachineBox(f'm{place}', state, {name: f'm{place}out{n}' for n, name in enumerate(state.outcomes)})
        inside = state.path.rstrip('/') + '/'
        children = [places[inside + label] for label in state.children if inside + label in places]
        entries: dict[str, str] = {}
        for child in children:
            inner = StateBox(f's{child}', states[child]) if states[child].kind == 'state' else box(child)
            made.boxes.append(inner)
            entries[states[child].path] = inner.id if isinstance(inner, StateBox) else inner.entry
        begins = children if state.kind == 'concurrency' else children[:1]
        made.edges += [Edge(f'm{place}begin{n}', made.entry, entries[states[n].path]) for n in begins]
        for child, inner in zip(children, made.boxes, strict=True):
            for number, (outcome, target) in enumerate(
                zip(states[child].outcomes, states[child].targets, strict=False)
            ):
                end = made.ends.get(target[1:]) if target.startswith('=') else entries.get(target)
                if end is not None:
                    start = inner.id if isinstance(inner, StateBox) else inner.ends[outcome]
                    level = states[child].autonomy[number] if number < len(states[child].autonomy) else -1
                    made.edges.append(Edge(f's{child}o{number}', start, end, outcome, level))
        return made

    return box(0)
