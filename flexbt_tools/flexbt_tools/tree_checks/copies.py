# SPDX-License-Identifier: BSD-3-Clause
"""What is likely left over from a copy: a node that is called what another one is, or that is there twice in a row."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Final

from flexbt_core.behavior_tree import NodeDefinition, NodeKind, NodeManifest, NodeRegistry, TreeLibrary

from .diagnostics import MISNAMED, TWICE, Diagnostic

_LEAVES: Final = (NodeKind.ACTION, NodeKind.CONDITION)
_IN_ORDER: Final = frozenset(('Sequence', 'ReactiveSequence', 'SequenceWithMemory', 'SequenceStar', 'PipelineSequence'))
"""Controls that go on to the next child after a success: in a Fallback, the same again is another attempt."""


def copies(library: TreeLibrary, registry: NodeRegistry) -> Iterator[Diagnostic]:
    """A finding for each of them."""
    trees = {_letters(key.id): key.id for key in library.tree_keys()}
    used = (node.manifest for key in library.tree_keys() for node in library.definition(key).nodes())
    leaves = {_letters(one.id): one for one in (*registry, *used) if one.kind in _LEAVES}
    for key in library.tree_keys():
        tree = library.definition(key)
        looks: dict[int, int] = {}
        _look(tree.root, looks, {})
        for node in tree.nodes():
            if meant := _meant(node, trees, leaves):
                yield Diagnostic(MISNAMED, tree.error(node, f'{meant}: is that the one that is meant?'))
            if node.manifest.id in _IN_ORDER:
                for first, second in pairwise(node.children):
                    if looks[id(first)] == looks[id(second)]:
                        yield Diagnostic(TWICE, tree.error(second, 'it is there twice in a row, with the same ports'))


def _meant(node: NodeDefinition, trees: Mapping[str, str], leaves: Mapping[str, NodeManifest]) -> str:
    """What a node is, and what its name says; '' when that is no other type or tree, or one of other ports."""
    name = _letters(node.name)
    if _letters(node.tree_id or node.manifest.id).endswith(name):
        return ''
    if node.tree_id is not None:
        return f'it runs the tree [{node.tree_id}], and there is a tree [{trees[name]}]' if name in trees else ''
    other = leaves.get(name) if node.manifest.kind in _LEAVES else None
    if other is None or not node.values.keys() <= other.ports.keys():
        return ''
    return f'it is a [{node.manifest.id}], and there is a node type [{other.id}]'


def _letters(name: str) -> str:
    """A name without what is written in one way or another."""
    return re.sub(r'[\W_]', '', name).casefold()


def _look(node: NodeDefinition, looks: dict[int, int], numbers: dict[object, int]) -> int:
    """A number for everything that a file says of a node, and of those in it; kept in ``looks`` by the ``id`` of each,
    and in ``numbers`` by what is said."""
    ports = sorted((port, value.key, value.text) for port, value in node.values.items())
    conditions = sorted((name, script.text) for name, script in node.conditions.items())
    children = tuple(_look(one, looks, numbers) for one in node.children)
    said = node.manifest.id, node.tree_id, node.name, repr(ports), tuple(conditions), children
    looks[id(node)] = numbers.setdefault(said, len(numbers))
    return looks[id(node)]
