# SPDX-License-Identifier: BSD-3-Clause
"""Trees as a picture, in Graphviz's language or in Mermaid's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexbt_core.behavior_tree import TreeKey
from flexbt_tools.trees import Item

from .markup import DOT_HEAD, MERMAID_HEAD, dot_text, dot_tree, mermaid_text, mermaid_tree

Graphs = Sequence[tuple[TreeKey, Sequence[Item]]]
"""The trees of a picture."""


def trees_as_dot(graphs: Graphs, *, ports: str) -> Iterator[str]:
    """The picture in the language of Graphviz."""
    yield from DOT_HEAD
    for number, (key, items) in enumerate(graphs):
        yield f'  subgraph cluster_{number} {{'
        yield f'    label={dot_text([key.id])}'
        yield from dot_tree(f't{number}n', items, ports=ports)
        yield '  }'
    yield '}'


def trees_as_mermaid(graphs: Graphs, *, ports: str) -> Iterator[str]:
    """The picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    for number, (key, items) in enumerate(graphs):
        yield f'  subgraph t{number}["{mermaid_text([key.id])}"]'
        yield from mermaid_tree(f't{number}n', items, ports=ports)
        yield '  end'
