# SPDX-License-Identifier: BSD-3-Clause
"""Trees in Graphviz's language and in Mermaid's, and text in both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from flexbt_core.behavior_tree import NodeKind
from flexbt_core.values import one_line
from flexbt_tools.trees import Item

# Shape in Graphviz; brackets of the shape in Mermaid; colour of the inside.
_SHAPES: Final[Mapping[NodeKind, tuple[str, str, str]]] = {
    NodeKind.CONTROL: ('box', '["|"]', '#dce6f5'),
    NodeKind.DECORATOR: ('hexagon', '{{"|"}}', '#ece3f3'),
    NodeKind.SUBTREE: ('box3d', '[["|"]]', '#f5ead0'),
    NodeKind.ACTION: ('ellipse', '(["|"])', '#e1f0dc'),
    NodeKind.CONDITION: ('diamond', '{"|"}', '#f8e0dc'),
}

# What else stands for itself in a label of Mermaid: within a line, and at its beginning.
_PLAIN: Final = (' _-.,:/()=→↔{}', '_({')

DOT_HEAD: Final = (
    'digraph {',
    '  graph [ordering=out, newrank=true, remincross=false, fontname="Helvetica", color="#999999"]',
    '  node [style=filled, color="#555555", fontname="Helvetica", fontsize=11]',
    '  edge [color="#555555", arrowsize=0.6]',
)

MERMAID_HEAD: Final = (
    'flowchart TD',
    *(f'  classDef {kind.value} fill:{colour},stroke:#555' for kind, (_, _, colour) in _SHAPES.items()),
)


def dot_tree(prefix: str, items: Sequence[Item], *, ports: str) -> Iterator[str]:
    """The nodes and edges of a tree in Graphviz's language; its nodes are called ``prefix`` and a number from 0.

    ``ports`` as in :meth:`flexbt_tools.trees.Item.attributes`.
    """
    siblings: dict[int, list[str]] = {}
    for position, item in enumerate(items):
        shape, _, colour = _SHAPES[item.kind]
        label = dot_text(_label(item, ports))
        yield f'    {prefix}{position} [shape={shape}, fillcolor="{colour}", label={label}]'
        if item.parent is not None:
            yield f'    {prefix}{item.parent} -> {prefix}{position}'
            siblings.setdefault(item.parent, []).append(f'{prefix}{position}')
    # The order of children means something. Beside other edges, "ordering" alone does not keep it.
    for children in siblings.values():
        if len(children) > 1:
            yield f'    {{ rank=same; {" -> ".join(children)} [style=invis] }}'


def mermaid_tree(prefix: str, items: Sequence[Item], *, ports: str) -> Iterator[str]:
    """The nodes and edges of a tree in Mermaid's language; its nodes are called ``prefix`` and a number from 0."""
    for position, item in enumerate(items):
        opening, closing = _SHAPES[item.kind][1].split('|')
        label = f'{opening}{mermaid_text(_label(item, ports))}{closing}'
        yield f'    {prefix}{position}{label}:::{item.kind.value}'
        if item.parent is not None:
            yield f'    {prefix}{item.parent} --> {prefix}{position}'


def _label(item: Item, ports: str) -> list[str]:
    lines = [item.name, f'({item.type})'] if item.name else [item.type]
    return lines + item.attributes(ports)


def dot_text(lines: Sequence[str]) -> str:
    """Lines as a quoted label of Graphviz."""
    # Graphviz reads entities in a label, so the ampersand is one.
    shown = (one_line(line).replace('&', '&amp;').replace('\\', '\\\\').replace('"', '\\"') for line in lines)
    text = '\\n'.join(shown)
    return f'"{text}"'


def mermaid_text(lines: Sequence[str]) -> str:
    """Lines as the inside of a quoted label of Mermaid."""
    return '<br/>'.join(_mermaid_line(one_line(line)) for line in lines)


def _mermaid_line(line: str) -> str:
    # All that means something to Mermaid, or to HTML and Markdown in it, as its number.
    return ''.join(
        character
        if character.isalpha() or (index and character.isdigit()) or character in _PLAIN[index == 0]
        else f'#{ord(character)};'
        for index, character in enumerate(line)
    )
