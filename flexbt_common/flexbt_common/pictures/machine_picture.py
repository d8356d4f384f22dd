# SPDX-License-Identifier: BSD-3-Clause
"""A state machine as a graph of boxes, and as a picture in Graphviz's language or in Mermaid's.

A container has an entry and an end for each outcome, so that each transition leads from one point to another: from a
state, or an end of a container, to a state, or the entry of a container, or an end of the container around it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from .markup import DOT_HEAD, LINE_STYLES, MARK_STYLES, MERMAID_HEAD, dot_text, mermaid_text
from .tree_picture import DrawnNode, dot_tree, mermaid_tree

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
        """Name of the state, without its path."""
        return self.path.rpartition('/')[2]


@dataclass(frozen=True)
class Edge:
    """A transition, or without an outcome the edge from the entry of a container to its initial state."""

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
        """The label, with the kind of container unless it is a plain machine."""
        return self.state.label + (f' ({self.state.kind})' if self.state.kind != 'machine' else '')

    @property
    def entry(self) -> str:
        """The point where it begins."""
        return f'{self.id}in'

    def all_edges(self) -> Iterator[Edge]:
        """Yield the edges of the container and of those in it."""
        yield from self.edges
        for inner in self.boxes:
            if isinstance(inner, MachineBox):
                yield from inner.all_edges()


def machine_graph(states: Sequence[DrawnState]) -> MachineBox:
    """Return the graph of a machine. ``states`` are depth first, from the root. Names have the positions in this list:
    ``s3`` is a state, ``s3o0`` the transition of its outcome 0, ``m1`` a container. Transitions without a target are
    left out.
    """
    places = {state.path: place for place, state in enumerate(states)}

    def box(place: int) -> MachineBox:
        state = states[place]
        made = MachineBox(f'm{place}', state, {name: f'm{place}out{n}' for n, name in enumerate(state.outcomes)})
        inside = state.path.rstrip('/') + '/'
        labels = [label for label in dict.fromkeys(state.children) if label and '/' not in label]  # of any sender
        children = [places[inside + label] for label in labels if inside + label in places]
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


# A state machine as a picture, the trees of its states included: in Graphviz's language or in Mermaid's.

BEGIN: Final = '●'
"""Before the title of a machine: there it begins."""


def machine_as_dot(graph: MachineBox, title: str) -> Iterator[str]:
    """Yield the picture in the language of Graphviz, from the initial state down.

    Elements have identifiers: ``s3`` is the state at position 3 of the structure, ``m1`` the frame of a container,
    ``s3o0`` the transition of an outcome.
    """
    yield from DOT_HEAD
    yield from _dot_machine(graph, title)
    for edge in graph.all_edges():
        kind = f'level{max(0, min(3, edge.autonomy))}'
        line = LINE_STYLES[kind]
        label = f', label={dot_text([f" {edge.label}"])}' if edge.outcome else ''
        yield (
            f'  {edge.start} -> {edge.end} [id={edge.id}, class={kind if edge.outcome else "begin"}, '
            f'style={line.style}, penwidth={line.width}, color="{line.light}", fontcolor="{line.light}", '
            f'fontsize=12{label}]'
        )
    yield '}'


def _dot_machine(box: MachineBox, title: str) -> Iterator[str]:
    yield f'  subgraph cluster_{box.id} {{'
    # The title is where the container is entered: transitions begin and end there, and none crosses it.
    yield f'    id={box.id}; label=""; style=rounded'
    heading = f'label={dot_text([f"{BEGIN} {title}"])}, fontsize=13, margin="0.06,0.03", height=0.3'
    yield f'    {box.entry} [shape=plaintext, id={box.entry}, class=entry, style="", {heading}]'
    for inner in box.boxes:
        yield from _dot_state(inner) if isinstance(inner, StateBox) else _dot_machine(inner, inner.title)
    for outcome, point in box.ends.items():
        yield (
            f'    {point} [shape=box, style="rounded,filled", class=Outcome, '
            f'fillcolor="{MARK_STYLES["Outcome"].light}", label={dot_text([outcome])}]'
        )
    yield '  }'


def _dot_state(box: StateBox) -> Iterator[str]:
    state = box.state
    # The title of the tree is in the label of its state: no transition can cross it there.
    tree = [f'runs tree {state.tree.title}'] if state.tree else []
    label = dot_text([state.label, f'({state.type})', *state.why, *tree])
    node = (
        f'    {box.id} [shape=box, id={box.id}, class=State, fillcolor="{MARK_STYLES["State"].light}", label={label}]'
    )
    if state.tree is None:
        yield node
        return
    yield f'  subgraph cluster_{box.id} {{'
    yield '    label=""; style=dashed'
    yield node
    yield from dot_tree(f'{box.id}t', state.tree.nodes)
    yield f'    {box.id} -> {box.id}t0 [class=branch, arrowhead=none, style=dashed]'
    yield '  }'


def machine_as_mermaid(graph: MachineBox, title: str) -> Iterator[str]:
    """Yield the picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    yield from _mermaid_machine(graph, title)
    for edge in graph.all_edges():
        label = f'|"{mermaid_text([edge.label])}"|' if edge.outcome else ''
        yield f'  {edge.start} -->{label} {edge.end}'


def _mermaid_machine(box: MachineBox, title: str) -> Iterator[str]:
    yield f'  subgraph {box.id}["{mermaid_text([title])}"]'
    yield f'    {box.entry}((" "))'
    for inner in box.boxes:
        yield from _mermaid_state(inner) if isinstance(inner, StateBox) else _mermaid_machine(inner, inner.title)
    for outcome, point in box.ends.items():
        yield f'    {point}(["{mermaid_text([outcome])}"]):::Outcome'
    yield '  end'


def _mermaid_state(box: StateBox) -> Iterator[str]:
    state = box.state
    yield f'    {box.id}["{mermaid_text([state.label, f"({state.type})", *state.why])}"]:::State'
    if state.tree is not None:
        yield f'    subgraph {box.id}g["{mermaid_text([state.tree.title])}"]'
        yield from mermaid_tree(f'{box.id}t', state.tree.nodes)
        yield '    end'
        yield f'    {box.id} -.-> {box.id}t0'
