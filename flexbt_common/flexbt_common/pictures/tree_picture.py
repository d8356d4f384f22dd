# SPDX-License-Identifier: BSD-3-Clause
"""Trees as a picture, in Graphviz's language or in Mermaid's."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

from .markup import DOT_HEAD, MARK_STYLES, MERMAID_HEAD, dot_text, mermaid_text

MOST_CHARACTERS: Final = 40
"""Maximum number of characters of a line of a label; a longer one is folded."""

MOST_ABREAST: Final = 40
"""Maximum number of leaves of a tree that is drawn top-down. A tree with more grows to the right, its leaves below each
other; otherwise it would be many times wider than high, and unreadable."""


class NodeShape(Enum):
    """The sort of a node of a tree; the value is the class of its element in a picture."""

    CONTROL = 'Control'
    DECORATOR = 'Decorator'
    SUBTREE = 'SubTree'
    ACTION = 'Action'
    CONDITION = 'Condition'
    UNKNOWN = 'Unknown'
    """A leaf that is not known to be an action or a condition."""


# Shape in Graphviz; brackets of the shape in Mermaid.
_SHAPES: Final[Mapping[NodeShape, tuple[str, str]]] = {
    NodeShape.CONTROL: ('shape=box', '["|"]'),
    NodeShape.DECORATOR: ('shape=hexagon, margin="0.06,0.02"', '{{"|"}}'),
    NodeShape.SUBTREE: ('shape=box3d, margin="0.16,0.1"', '[["|"]]'),
    NodeShape.ACTION: ('shape=box, style="rounded,filled"', '(["|"])'),
    NodeShape.CONDITION: ('shape=ellipse, margin="0.06,0.02"', '{"|"}'),
    NodeShape.UNKNOWN: ('shape=box, style="rounded,filled,dashed"', '(["|"])'),
}

SYMBOLS: Final[Mapping[str, str]] = {
    **dict.fromkeys(('Sequence', 'SequenceWithMemory', 'SequenceStar', 'AsyncSequence', 'ReactiveSequence'), '→'),
    **dict.fromkeys(('PipelineSequence', 'NonblockingSequence'), '→'),
    **dict.fromkeys(('Fallback', 'AsyncFallback', 'ReactiveFallback'), '?'),
    **dict.fromkeys(('Parallel', 'ParallelAll'), '⇉'),
    'RecoveryNode': '↺',
}
"""By the registered type of a control: the symbols of Colledanchise and Ögren, Behavior Trees in Robotics and AI."""


@dataclass(frozen=True, slots=True)
class DrawnNode:
    """A node of a tree: ``parent`` is the position of its parent in the list, None for the root; ``name`` is empty
    if it has none; ``attributes`` are further lines of its label."""

    type: str
    name: str
    parent: int | None
    shape: NodeShape
    attributes: Sequence[str] = ()

    def label(self, *, is_low: bool = False) -> list[str]:
        """Its label, in lines; an ``is_low`` one has the type behind the name."""
        symbol = SYMBOLS.get(self.type, '')
        own = f'{symbol} {self.name or self.type}'.strip()
        texts = [own, f'({self.type})'] if self.name else [own]
        if is_low:
            texts = ['  '.join(texts)]
        return [line for text in (*texts, *self.attributes) for line in _folded(text)]


_JOINTS: Final = tuple(map(re.compile, (' ', r'[→=](?=.)|.(?={)', r'[/_.,:;-](?=.)|[a-z](?=[A-Z])')))
"""Places at which a line may be broken, the best first."""


def _folded(text: str) -> list[str]:
    """Return the text folded into lines, none of them nearly empty."""
    rows = []
    while len(text) > MOST_CHARACTERS:
        head = text[: MOST_CHARACTERS + 1]
        ends = (
            [found.end() for found in joints.finditer(head) if found.start() < MOST_CHARACTERS] for joints in _JOINTS
        )
        place = next((found[-1] for found in ends if found and found[-1] > MOST_CHARACTERS // 3), MOST_CHARACTERS)
        rows.append(text[:place].rstrip(' '))
        text = text[place:].lstrip(' ')
    return [*rows, text]


Trees = Sequence[tuple[str, Sequence[DrawnNode]]]
"""The trees of a picture with their titles."""


def trees_as_dot(trees: Trees) -> Iterator[str]:
    """Yield the picture in the language of Graphviz; the element of node n of tree m has the identifier ``tMnN``."""
    yield from DOT_HEAD
    grows_right = any(_leaves(nodes) > MOST_ABREAST for _, nodes in trees)
    if grows_right:
        yield '  rankdir=LR; ranksep=0.5; nodesep=0.04; node [height=0.2, margin="0.08,0.02"]'
    for number, (title, nodes) in enumerate(trees):
        yield f'  subgraph cluster_{number} {{'
        yield f'    label={dot_text([title])}'
        yield from dot_tree(f't{number}n', nodes, grows_right=grows_right)
        yield '  }'
    yield '}'


def _leaves(nodes: Sequence[DrawnNode]) -> int:
    return len(nodes) - len({node.parent for node in nodes} - {None})


def trees_as_mermaid(trees: Trees) -> Iterator[str]:
    """Yield the picture in the language of Mermaid."""
    yield from MERMAID_HEAD
    for number, (title, nodes) in enumerate(trees):
        yield f'  subgraph t{number}["{mermaid_text([title])}"]'
        yield from mermaid_tree(f't{number}n', nodes)
        yield '  end'


def dot_tree(prefix: str, nodes: Sequence[DrawnNode], *, grows_right: bool = False) -> Iterator[str]:
    """Yield the nodes and edges of a tree in Graphviz's language; its nodes are called ``prefix`` and a number from 0.

    ``grows_right``: the last one first, for a graph that grows to the right, in which Graphviz begins at the bottom.
    """
    siblings: dict[int, list[str]] = {}
    order = range(len(nodes))
    for position in reversed(order) if grows_right else order:
        node = nodes[position]
        name = f'{prefix}{position}'
        shape, _ = _SHAPES[node.shape]
        kind = node.shape.value
        colour = MARK_STYLES[kind].light
        label = dot_text(node.label(is_low=grows_right))
        yield f'    {name} [{shape}, id={name}, class={kind}, fillcolor="{colour}", label={label}]'
        if node.parent is not None:
            yield f'    {prefix}{node.parent} -> {name} [class=branch, arrowhead=none]'
            siblings.setdefault(node.parent, []).append(name)
    # The order of children matters. With other edges, "ordering" alone does not keep it.
    for children in siblings.values():
        if len(children) > 1:
            yield f'    {{ rank=same; {" -> ".join(children)} [style=invis] }}'


def mermaid_tree(prefix: str, nodes: Sequence[DrawnNode]) -> Iterator[str]:
    """Yield the nodes and edges of a tree in Mermaid's language; its nodes are called ``prefix`` and a number from
    0."""
    for position, node in enumerate(nodes):
        opening, closing = _SHAPES[node.shape][1].split('|')
        yield f'    {prefix}{position}{opening}{mermaid_text(node.label())}{closing}:::{node.shape.value}'
        if node.parent is not None:
            yield f'    {prefix}{node.parent} --> {prefix}{position}'
