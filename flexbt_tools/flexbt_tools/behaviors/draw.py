# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool draw``: a behavior as a picture, the trees of its states included."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Final

from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode
from flexbt_tools.pictures import graphs as pictures
from flexbt_tools.pictures.graphs import DOT_HEAD, MERMAID_HEAD, dot_text, dot_tree, mermaid_text, mermaid_tree

from . import built_behavior as behaviors
from . import used_trees as trees
from .graph import MachineBox, StateBox, all_edges, graph_of
from .show import built
from .used_trees import UsedTrees

# Of a transition by the autonomy level that it requires; the colours are those of FlexBE.
_COLOURS: Final = {-1: '#555555', 0: '#555555', 1: '#2060c0', 2: '#208040', 3: '#c03030'}


def dot_lines(graph: MachineBox, title: str, *, with_ports: bool) -> Iterator[str]:
    """The picture in the language of Graphviz."""
    yield from DOT_HEAD
    yield from _dot_machine(graph, title, with_ports)
    for edge in all_edges(graph):
        colour = _COLOURS[edge.autonomy]
        label = f', label={dot_text([edge.label])}' if edge.outcome else ''
        yield f'  {edge.start} -> {edge.end} [color="{colour}", fontcolor="{colour}", fontsize=9{label}]'
    yield '}'


def _dot_machine(box: MachineBox, title: str, with_ports: bool) -> Iterator[str]:
    yield f'  subgraph cluster_{box.id} {{'
    yield f'    label={dot_text([title])}; style=rounded'
    yield f'    {box.entry} [shape=circle, label="", width=0.15, fillcolor="#333333"]'
    for outcome, point in box.ends.items():
        yield f'    {point} [shape=box, style="rounded,filled", fillcolor="#dddddd", label={dot_text([outcome])}]'
    for state in box.states:
        yield from _dot_state(state, with_ports)
    for inner in box.machines:
        yield from _dot_machine(inner, inner.title, with_ports)
    yield '  }'


def _dot_state(state: StateBox, with_ports: bool) -> Iterator[str]:
    label = dot_text([state.definition.label, f'({type(state.definition.state).__name__})'])
    node = f'    {state.id} [shape=box, fillcolor="#fff3c4", label={label}]'
    if not state.tree:
        yield node
        return
    yield f'  subgraph cluster_{state.id} {{'
    yield f'    label={dot_text([state.tree_id])}; style=dashed'
    yield node
    yield from dot_tree(f'{state.id}t', state.tree, with_ports=with_ports)
    yield f'    {state.id} -> {state.id}t0 [style=dashed]'
    yield '  }'


def mermaid_lines(graph: MachineBox, title: str, *, with_ports: bool) -> Iterator[str]:
    """The picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    yield '  classDef state fill:#fff3c4,stroke:#555'
    yield '  classDef outcome fill:#dddddd,stroke:#555'
    yield from _mermaid_machine(graph, title, with_ports)
    for edge in all_edges(graph):
        label = f'|"{mermaid_text([edge.label])}"|' if edge.outcome else ''
        yield f'  {edge.start} -->{label} {edge.end}'


def _mermaid_machine(box: MachineBox, title: str, with_ports: bool) -> Iterator[str]:
    yield f'  subgraph {box.id}["{mermaid_text([title])}"]'
    yield f'    {box.entry}((" "))'
    for outcome, point in box.ends.items():
        yield f'    {point}(["{mermaid_text([outcome])}"]):::outcome'
    for state in box.states:
        yield from _mermaid_state(state, with_ports)
    for inner in box.machines:
        yield from _mermaid_machine(inner, inner.title, with_ports)
    yield '  end'


def _mermaid_state(state: StateBox, with_ports: bool) -> Iterator[str]:
    label = mermaid_text([state.definition.label, f'({type(state.definition.state).__name__})'])
    yield f'    {state.id}["{label}"]:::state'
    if state.tree:
        yield f'    subgraph {state.id}g["{mermaid_text([state.tree_id])}"]'
        yield from mermaid_tree(f'{state.id}t', state.tree, with_ports=with_ports)
        yield '    end'
        yield f'    {state.id} -.-> {state.id}t0'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('name', metavar='NAME', help='installed behavior')
    behaviors.add_arguments(parser)
    pictures.add_arguments(parser)
    parser.add_argument('--no-trees', action='store_true', help='only the state machine')
    parser.add_argument('--expand', action='store_true', help='sub-trees in their place')
    parser.add_argument('--ports', action='store_true', help='also the ports that the tree files give')
    trees.add_arguments(parser)
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    behavior = built(options)
    assert behavior.machine is not None
    used = UsedTrees()
    if not options.no_trees:
        used = trees.used_trees(behavior.machine, options.trees, arguments.registry(options, allow_unknown=True))
    graph = graph_of(behavior.machine, used, expand=options.expand)
    pictures.write(
        options,
        lambda: dot_lines(graph, behavior.name, with_ports=options.ports),
        lambda: mermaid_lines(graph, behavior.name, with_ports=options.ports),
    )
    return ExitCode.OK
