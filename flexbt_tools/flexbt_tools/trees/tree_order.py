# SPDX-License-Identifier: BSD-3-Clause
"""How the trees of a library refer to each other."""

from __future__ import annotations

from collections.abc import Iterator

from flexbt_core.behavior_tree import NodeDefinition, TreeKey, TreeLibrary


def references(library: TreeLibrary, key: TreeKey) -> Iterator[tuple[NodeDefinition, TreeKey]]:
    """The sub-trees of a tree, and the trees that they mean."""
    for node in library.definition(key).nodes():
        if node.tree_id is not None:
            target = library.find(node.tree_id, key.file)
            assert target is not None, 'a library has no open references'
            yield node, target


def sub_trees_first(library: TreeLibrary) -> list[TreeKey]:
    """All trees, each after those that it refers to."""
    order: dict[TreeKey, None] = {}
    for start in library.tree_keys():
        path = [(start, references(library, start))] if start not in order else []
        while path:
            key, rest = path[-1]
            target = next((target for _, target in rest if target not in order), None)
            if target is None:
                order[key] = None
                path.pop()
            else:
                path.append((target, references(library, target)))
    return list(order)


def used_trees(library: TreeLibrary) -> set[TreeKey]:
    """The trees that are sub-trees of others. One that several documents have, by includes, is one tree."""
    targets = {target for key in library.tree_keys() for _, target in references(library, key)}
    places = {_place(library, target) for target in targets}
    return {key for key in library.tree_keys() if _place(library, key) in places}


def _place(library: TreeLibrary, key: TreeKey) -> tuple[str, int]:
    tree = library.definition(key)
    return tree.source.file, tree.offset


def roots(library: TreeLibrary) -> list[TreeKey]:
    """The trees that are run by themselves, if any: those that are no sub-trees, and the main ones of all files."""
    used = used_trees(library)
    mains = {TreeKey(document.file, document.main) for document in library.documents.values() if document.main}
    return [key for key in library.tree_keys() if key not in used or key in mains]
