# SPDX-License-Identifier: BSD-3-Clause
"""A behavior as a picture, the trees of its states included: in Graphviz's language or in Mermaid's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from flexbt_tools.pictures import DOT_HEAD, MERMAID_HEAD, dot_text, dot_tree, mermaid_text, mermaid_tree

from .graph import MachineBox, StateBox, all_edges

# Of a transition by the autonomy level that it requires; the colours are those of FlexBE.
_COLOURS: Final = {-1: '#555555', 0: '#555555', 1: '#2060c0', 2: '#208040', 3: '#c03030'}


def behavior_as_dot(graph: MachineBox, title: str, *, ports: str) -> Iterator[str]:
    """The picture in the language of Graphviz."""
    yield from DOT_HEAD
    yield from _dot_machine(graph, title, ports)
    for edge in all_edges(graph):
        colour = _COLOURS[edge.autonomy]
        label = f', label={dot_text([edge.label])}' if edge.outcome else ''
        yield f'  {edge.start} -> {edge.end} [color="{colour}", fontcolor="{colour}", fontsize=9{label}]'
    yield '}'


def _dot_machine(box: MachineBox, title: str, ports: str) -> Iterator[str]:
    yield f'  subgraph cluster_{box.id} {{'
    yield f'    label={dot_text([title])}; style=rounded'
    yield f'    {box.entry} [shape=circle, label="", width=0.15, fillcolor="#333333"]'
    for outcome, point in box.ends.items():
        yield f'    {point} [shape=box, style="rounded,filled", fillcolor="#dddddd", label={dot_text([outcome])}]'
    for state in box.states:
        yield from _dot_state(state, ports)
    for inner in box.machines:
        yield from _dot_machine(inner, inner.title, ports)
    yield '  }'


def _dot_state(state: StateBox, ports: str) -> Iterator[str]:
    label = dot_text([state.definition.label, f'({type(state.definition.state).__name__})'])
    node = f'    {state.id} [shape=box, fillcolor="#fff3c4", label={label}]'
    if not state.tree:
        yield node
        return
    yield f'  subgraph cluster_{state.id} {{'
    yield f'    label={dot_text([state.tree_id])}; style=dashed'
    yield node
    yield from dot_tree(f'{state.id}t', state.tree, ports=ports)
    yield f'    {state.id} -> {state.id}t0 [style=dashed]'
    yield '  }'


def behavior_as_mermaid(graph: MachineBox, title: str, *, ports: str) -> Iterator[str]:
    """The picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    yield '  classDef state fill:#fff3c4,stroke:#555'
    yield '  classDef outcome fill:#dddddd,stroke:#555'
    yield from _mermaid_machine(graph, title, ports)
    for edge in all_edges(graph):
        label = f'|"{mermaid_text([edge.label])}"|' if edge.outcome else ''
        yield f'  {edge.start} -->{label} {edge.end}'


def _mermaid_machine(box: MachineBox, title: str, ports: str) -> Iterator[str]:
    yield f'  subgraph {box.id}["{mermaid_text([title])}"]'
    yield f'    {box.entry}((" "))'
    for outcome, point in box.ends.items():
        yield f'    {point}(["{mermaid_text([outcome])}"]):::outcome'
    for state in box.states:
        yield from _mermaid_state(state, ports)
    for inner in box.machines:
        yield from _mermaid_machine(inner, inner.title, ports)
    yield '  end'


def _mermaid_state(state: StateBox, ports: str) -> Iterator[str]:
    label = mermaid_text([state.definition.label, f'({type(state.definition.state).__name__})'])
    yield f'    {state.id}["{label}"]:::state'
    if state.tree:
        yield f'    subgraph {state.id}g["{mermaid_text([state.tree_id])}"]'
        yield from mermaid_tree(f'{state.id}t', state.tree, ports=ports)
        yield '    end'
        yield f'    {state.id} -.-> {state.id}t0'
