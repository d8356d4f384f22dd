# SPDX-License-Identifier: BSD-3-Clause
"""A state machine as a picture, the trees of its states included: in Graphviz's language or in Mermaid's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from .machine_graph import MachineBox, StateBox
from .markup import DOT_HEAD, LINES, MARKS, MERMAID_HEAD, dot_text, mermaid_text
from .tree_picture import dot_tree, mermaid_tree

BEGIN: Final = '●'
"""Before the title of a machine: there it begins."""


def machine_as_dot(graph: MachineBox, title: str) -> Iterator[str]:
    """The picture in the language of Graphviz, from the initial state down.

    Elements have identifiers: ``s3`` is the state at position 3 of the structure, ``m1`` the frame of a container,
    ``s3o0`` the transition of an outcome.
    """
    yield from DOT_HEAD
    yield from _dot_machine(graph, title)
    for edge in graph.all_edges():
        kind = f'level{max(0, min(3, edge.autonomy))}'
        line = LINES[kind]
        label = f', label={dot_text([f" {edge.label}"])}' if edge.outcome else ''
        yield (
            f'  {edge.start} -> {edge.end} [id={edge.id}, class={kind if edge.outcome else "begin"}, '
            f'style={line.style}, penwidth={line.width}, color="{line.light}", fontcolor="{line.light}", '
            f'fontsize=9{label}]'
        )
    yield '}'


def _dot_machine(box: MachineBox, title: str) -> Iterator[str]:
    yield f'  subgraph cluster_{box.id} {{'
    # The title is where the container is entered: transitions begin and end there, and none crosses it.
    yield f'    id={box.id}; label=""; style=rounded'
    heading = f'label={dot_text([f"{BEGIN} {title}"])}, fontsize=13, margin="0.06,0.03", height=0.3'
    yield f'    {box.entry} [shape=plaintext, class=entry, style="", {heading}]'
    for inner in box.boxes:
        yield from _dot_state(inner) if isinstance(inner, StateBox) else _dot_machine(inner, inner.title)
    for outcome, point in box.ends.items():
        yield (
            f'    {point} [shape=box, style="rounded,filled", class=Outcome, fillcolor="{MARKS["Outcome"].light}", '
            f'label={dot_text([outcome])}]'
        )
    yield '  }'


def _dot_state(box: StateBox) -> Iterator[str]:
    state = box.state
    # The title of the tree is in the label of its state: no transition can cross it there.
    tree = [f'runs tree {state.tree.title}'] if state.tree else []
    label = dot_text([state.label, f'({state.type})', *state.why, *tree])
    node = f'    {box.id} [shape=box, id={box.id}, class=State, fillcolor="{MARKS["State"].light}", label={label}]'
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
    """The picture in the language of Mermaid."""
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
