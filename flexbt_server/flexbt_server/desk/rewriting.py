# SPDX-License-Identifier: BSD-3-Clause
"""Documents with other nodes in the place of some."""

from __future__ import annotations

from collections.abc import Callable

from flexbt_server.behavior_tree import NodeDefinition, TreeDefinition, TreeDocument

Change = Callable[[TreeDefinition, NodeDefinition], NodeDefinition]
"""What takes the place of a node of a tree, whose children have been exchanged already."""


def rewritten(document: TreeDocument, change: Change) -> TreeDocument:
    """The document with ``change`` applied to every node."""
    trees = {id: tree._replace(root=_rewritten(tree, change)) for id, tree in document.trees.items()}
    return document._replace(trees=trees)


def _rewritten(tree: TreeDefinition, change: Change) -> NodeDefinition:
    changed: dict[int, NodeDefinition] = {}
    # Parents come first in the order of the document: from its end, children are there when they are needed.
    for node in reversed(list(tree.nodes())):
        children = tuple(changed.pop(id(child)) for child in node.children)
        changed[id(node)] = change(tree, node._replace(children=children) if children else node)
    return changed[id(tree.root)]
