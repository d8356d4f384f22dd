# SPDX-License-Identifier: BSD-3-Clause
"""Trees as lists of nodes, as text and as JSON."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any, Final, NamedTuple

from flexbt_common.pictures.tree_picture import DrawnNode, NodeShape
from flexbt_core.behavior_tree.engine.node import node_path
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.behavior_tree.model.ports import PortDirection
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_tools.errors import UsageError

from .stand_ins import UNKNOWN_PORT, is_of_unknown_kind

_ARROWS: Final = {None: '=', PortDirection.INPUT: '=', PortDirection.OUTPUT: '→', PortDirection.INOUT: '↔'}
_ASCII_ARROWS: Final = {**_ARROWS, PortDirection.OUTPUT: '->', PortDirection.INOUT: '<->'}

PORTS: Final = ('given', 'all', 'none')
"""Choices for the ports and conditions to show: those in the file, also port defaults, or none."""


@dataclass(frozen=True, slots=True)
class Item:
    """A node and its position in the outline.

    ``parent`` is the index of its parent in the list, None for the root of the tree. ``last`` is true if no sibling
    follows it. ``tree`` is the tree that defines the node.
    """

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
        """ID of the node type, or of the tree for a sub-tree."""
        return self.node.tree_id or self.node.manifest.id

    @property
    def name(self) -> str:
        """Name of the node in the file; '' if it has none."""
        return '' if self.node.name == self.type else self.node.name

    def direction(self, port: str) -> PortDirection | None:
        """Return the direction of a port; None if it is unknown, as for the ports of a sub-tree."""
        declared = self.node.manifest.ports.get(port)
        return None if declared is None or declared is UNKNOWN_PORT else declared.direction

    def attributes(self, ports: str, *, ascii_only: bool = False) -> list[str]:
        """Return ports as ``input=text`` and ``output→{key}``, and conditions; ``ports`` is one of :data:`PORTS`."""
        if ports == 'none':
            return []
        shown = []
        arrows = _ASCII_ARROWS if ascii_only else _ARROWS
        for port, value in self.node.values.items():
            if ports == 'all' or port in self.node.places:
                shown.append(f'{one_line(port)}{arrows[self.direction(port)]}{_quoted(value.text)}')
        if self.node.autoremap:
            shown.append('_autoremap')
        shown += [f'{name}={_quoted(script.text)}' for name, script in self.node.conditions.items()]
        return shown


def _quoted(text: str) -> str:
    shown = one_line(text)
    return f'"{shown}"' if not shown or ' ' in shown or '"' in shown else shown


def items_of(library: TreeLibrary, key: TreeKey, *, expand: bool) -> Iterator[Item]:
    """Yield the nodes of a tree, in the order in which the engine creates them.

    With ``expand``, include the nodes of sub-trees.
    """
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


def node_places(library: TreeLibrary, key: TreeKey) -> dict[str, LoadError]:
    """Return the places in files of the nodes of a tree and its sub-trees, by the paths of the nodes in a run."""
    return {path: item.tree.error(item.node, '') for path, item in run_items(library, key)}


def run_items(library: TreeLibrary, key: TreeKey) -> Iterator[tuple[str, Item]]:
    """Yield the nodes of a tree and its sub-trees with their paths in a run."""
    scopes: list[str] = []  # of each node: the path of the sub-tree that contains it
    paths: list[str] = []
    items = list(items_of(library, key, expand=True))
    for uid, item in enumerate(items, 1):
        parent = item.parent
        is_first = parent is not None and items[parent].kind is NodeKind.SUBTREE
        scopes.append('' if parent is None else paths[parent] if is_first else scopes[parent])
        paths.append(node_path(scopes[-1], item.type, item.node.name, uid))
        yield paths[-1], item


def drawn_nodes(items: Iterable[Item], ports: str) -> list[DrawnNode]:
    """Return the nodes for a picture; ``ports`` as in :meth:`Item.attributes`."""
    return [DrawnNode(item.type, item.name, item.parent, _shape(item), item.attributes(ports)) for item in items]


def _shape(item: Item) -> NodeShape:
    return NodeShape.UNKNOWN if is_of_unknown_kind(item.node.manifest) else NodeShape(item.kind.value)


def is_main(library: TreeLibrary, key: TreeKey) -> bool:
    return library.documents[key.file].main == key.id


def find_tree(library: TreeLibrary, id: str) -> TreeKey:
    """Return the tree with this ID. Raises UsageError if it does not exist."""
    key = library.find(id)
    if key is None:
        known = library.tree_ids()
        remedy = did_you_mean(id, known, f'; there are: {", ".join(known)}')
        raise UsageError(f'there is no tree {short_repr(id)}{remedy}')
    return key


# Trees as text, and as JSON.


class _Lines(NamedTuple):
    """Characters that draw the branches of a tree."""

    child: str
    last_child: str
    past: str
    past_last: str


_UNICODE: Final = _Lines('├─ ', '└─ ', '│  ', '   ')
_ASCII: Final = _Lines('|- ', '`- ', '|  ', '   ')


def tree_lines(items: Iterable[Item], ports: str, *, ascii_only: bool, width: int) -> Iterator[str]:
    """Yield a line for each node, wrapped to at most ``width`` characters.

    ``ports`` as in :meth:`.Item.attributes`.
    """
    lines = _ASCII if ascii_only else _UNICODE
    # Margin before the children of each node on the path to the current one.
    margins: list[str] = []
    all_items = list(items)
    for item, following in zip_longest(all_items, all_items[1:]):
        del margins[max(item.depth - 1, 0) :]
        margin = ''.join(margins)
        if item.depth:
            branch = lines.last_child if item.last else lines.child
            margins.append(lines.past_last if item.last else lines.past)
        else:
            branch = ''
        below = ''.join(margins) + (lines.past if following and following.depth > item.depth else lines.past_last)
        words = [_title(item), *item.attributes(ports, ascii_only=ascii_only)]
        first, *others = _wrapped(words, max(width - len(below), _LEAST_WIDTH))
        yield f'{margin}{branch}{first}'
        yield from (f'{below}{other}' for other in others)


_LEAST_WIDTH: Final = 40
"""Minimum width of a node in a line, characters, at any depth."""


def _wrapped(words: Iterable[str], width: int) -> Iterator[str]:
    """Yield the words in lines; break a word that is longer than a line."""
    line = ''
    for word in words:
        if line and len(line) + 2 + len(word) > width:
            yield line
            line = ''
        if len(word) > width:
            *rows, word = textwrap.wrap(word, width, break_on_hyphens=False, subsequent_indent='  ')
            yield from rows
        line = f'{line}  {word}' if line else word
    yield line


def _title(item: Item) -> str:
    sub_tree = 'SubTree ' if item.kind is NodeKind.SUBTREE else ''
    name = f' "{one_line(item.name)}"' if item.name else ''
    return f'{sub_tree}{one_line(item.type)}{name}'


def tree_as_json(library: TreeLibrary, key: TreeKey, *, expand: bool) -> dict[str, Any]:
    """Return a tree as a list of nodes, parents first; ``parent`` is the index in it."""
    tree = library.definition(key)
    return {
        'id': key.id,
        'file': tree.source.file,
        'line': tree.source.position(tree.offset)[0],
        'main': is_main(library, key),
        'nodes': [_node_as_json(item) for item in items_of(library, key, expand=expand)],
    }


def _node_as_json(item: Item) -> dict[str, Any]:
    line, column = item.tree.source.position(item.node.offset)
    return {
        'parent': item.parent,
        'depth': item.depth,
        'kind': item.kind.value,
        'type': item.type,
        'name': item.node.name,
        'ports': {
            port: {
                'direction': direction.value if (direction := item.direction(port)) else None,
                'text': value.text,
                'key': value.key,
                'given': port in item.node.places,
            }
            for port, value in item.node.values.items()
        },
        'autoremap': item.node.autoremap,
        'conditions': {attribute: script.text for attribute, script in item.node.conditions.items()},
        'file': item.tree.source.file,
        'line': line,
        'column': column,
    }
