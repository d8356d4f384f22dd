# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool draw``: trees as a picture, by Graphviz, or as its source or that of Mermaid."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence

from flexbt_core.behavior_tree import TreeKey
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode
from flexbt_tools.pictures import graphs as pictures
from flexbt_tools.pictures.graphs import DOT_HEAD, MERMAID_HEAD, dot_text, dot_tree, mermaid_text, mermaid_tree

from . import outline
from .files import read_library
from .outline import Item, items_of

Graphs = Sequence[tuple[TreeKey, Sequence[Item]]]
"""The trees of a picture."""


def dot_lines(graphs: Graphs, *, with_ports: bool) -> Iterator[str]:
    """The picture in the language of Graphviz."""
    yield from DOT_HEAD
    for number, (key, items) in enumerate(graphs):
        yield f'  subgraph cluster_{number} {{'
        yield f'    label={dot_text([key.id])}'
        yield from dot_tree(f't{number}n', items, with_ports=with_ports)
        yield '  }'
    yield '}'


def mermaid_lines(graphs: Graphs, *, with_ports: bool) -> Iterator[str]:
    """The picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    for number, (key, items) in enumerate(graphs):
        yield f'  subgraph t{number}["{mermaid_text([key.id])}"]'
        yield from mermaid_tree(f't{number}n', items, with_ports=with_ports)
        yield '  end'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_file(parser)
    outline.add_arguments(parser)
    pictures.add_arguments(parser)
    parser.add_argument('--ports', action='store_true', help='also the ports that the file gives')
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    library = read_library([options.file], arguments.registry(options, allow_unknown=True))
    graphs = [
        (key, list(items_of(library, key, expand=options.expand))) for key in outline.chosen_trees(library, options)
    ]
    pictures.write(
        options,
        lambda: dot_lines(graphs, with_ports=options.ports),
        lambda: mermaid_lines(graphs, with_ports=options.ports),
    )
    return ExitCode.OK
