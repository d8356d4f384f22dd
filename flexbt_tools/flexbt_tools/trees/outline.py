# SPDX-License-Identifier: BSD-3-Clause
"""Trees as lists of nodes, parents first: what their text and their pictures are made of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from flexbt_common.pictures import DrawnNode, NodeShape
from flexbt_core.behavior_tree import NodeDefinition, NodeKind, PortDirection, TreeDefinition, TreeKey, TreeLibrary
from flexbt_core.values import hint, one_line, shown
from flexbt_tools.errors import UsageError

from .stand_ins import UNKNOWN_PORT, is_of_unknown_kind

_ARROWS: Final = {None: '=', PortDirection.INPUT: '=', PortDirection.OUTPUT: '→', PortDirection.INOUT: '↔'}
_ASCII_ARROWS: Final = {**_ARROWS, PortDirection.OUTPUT: '->', PortDirection.INOUT: '<->'}

PORTS: Final = ('given', 'all', 'none')
"""Which ports and conditions of a node are shown: those that the file gives, also the defaults of ports, or none."""


@dataclass(frozen=True, slots=True)
class Item:
    """A node in its place. ``parent`` is the position of its parent in the list, None for the root of the tree;
    ``last`` tells that no sibling follows it. ``tree`` has the definition of the node."""

    node: NodeDefinition
    tree: TreeDefinition
    depth: int
    parent: int | None
    last: bool

    @property
    def kind(self) -> NodeKind:
        return self.node.manifest.kind

    @property
    def type(self) -> str:
        """The ID of the node type; of a sub-tree that of the tree."""
        return self.node.tree_id or self.node.manifest.id

    @property
    def name(self) -> str:
        """The name that the file gives to the node; '' when it gives none."""
        return '' if self.node.name == self.type else self.node.name

    def direction(self, port: str) -> PortDirection | None:
        """The direction of a port; None when it is not known, as for those of a sub-tree."""
        declared = self.node.manifest.ports.get(port)
        return None if declared is None or declared is UNKNOWN_PORT else declared.direction

    def attributes(self, ports: str, *, ascii_only: bool = False) -> list[str]:
        """Ports as ``input=text`` and ``output→{key}``, and conditions; ``ports`` is one of :data:`PORTS`."""
        if ports == 'none':
            return []
        shown = []
        arrows = _ASCII_ARROWS if ascii_only else _ARROWS
        for port, value in self.node.values.items():
            if ports == 'all' or port in self.node.offsets:
                shown.append(f'{one_line(port)}{arrows[self.direction(port)]}{_quoted(value.text)}')
        if self.node.autoremap:
            shown.append('_autoremap')
        shown += [f'{name}={_quoted(script.text)}' for name, script in self.node.conditions.items()]
        return shown


def _quoted(text: str) -> str:
    shown = one_line(text)
    return f'"{shown}"' if not shown or ' ' in shown or '"' in shown else shown


def items_of(library: TreeLibrary, key: TreeKey, *, expand: bool) -> Iterator[Item]:
    """The nodes of a tree, in the order in which the engine makes them; with ``expand`` also those of sub-trees."""
    tree = library.definition(key)
    stack: list[tuple[NodeDefinition, TreeKey, TreeDefinition, int, int | None, bool]] = [
        (tree.root, key, tree, 0, None, True)
    ]
    position = 0
    while stack:
        node, owner, tree, depth, parent, last = stack.pop()
        yield Item(node, tree, depth, parent, last)
        if expand and node.tree_id is not None:
            target = library.find(node.tree_id, owner.file)
            assert target is not None
            inner = library.definition(target)
            stack.append((inner.root, target, inner, depth + 1, position, True))
        for child in reversed(node.children):
            stack.append((child, owner, tree, depth + 1, position, child is node.children[-1]))
        position += 1


def drawn_nodes(items: Iterable[Item], ports: str) -> list[DrawnNode]:
    """The nodes as a picture shows them; ``ports`` as in :meth:`Item.attributes`."""
    return [DrawnNode(item.type, item.name, item.parent, _shape(item), item.attributes(ports)) for item in items]


def _shape(item: Item) -> NodeShape:
    return NodeShape.UNKNOWN if is_of_unknown_kind(item.node.manifest) else NodeShape(item.kind.value)


def is_main(library: TreeLibrary, key: TreeKey) -> bool:
    return library.documents[key.file].main == key.id


def find_tree(library: TreeLibrary, id: str) -> TreeKey:
    """The tree of this ID. Raises UsageError."""
    key = library.find(id)
    if key is None:
        known = library.tree_ids()
        remedy = hint(id, known, f'; there are: {", ".join(known)}')
        raise UsageError(f'there is no tree {shown(id)}{remedy}')
    return key
