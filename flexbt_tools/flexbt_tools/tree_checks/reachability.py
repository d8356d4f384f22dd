# SPDX-License-Identifier: BSD-3-Clause
"""Which children can never be ticked: from what the nodes before them can give."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from flexbt_core.behavior_tree import NodeDefinition, NodeKind, SyncAction, TreeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.engine import ControlNode
from flexbt_core.behavior_tree.model import FAILURE, RUNNING, SKIPPED, SUCCESS, OneOf, Outcomes, Results
from flexbt_tools.trees import sub_trees_first

from .diagnostics import UNREACHABLE, Diagnostic

_ANYTHING: Final = OneOf((SUCCESS, FAILURE, RUNNING, SKIPPED))
_ANYTHING_AT_ONCE: Final = OneOf((SUCCESS, FAILURE, SKIPPED))

_CONDITIONS: Final = {'_failureIf': FAILURE, '_successIf': SUCCESS, '_skipIf': SKIPPED, '_while': SKIPPED}
"""What a pre-condition may give in place of its node."""


class NeverTicked(NamedTuple):
    """Children of a node, from ``first`` to before ``end``, that cannot be reached: child ``cause`` gives ``only``.

    Without a ``cause``, because of the ports of the node.
    """

    tree: TreeDefinition
    parent: NodeDefinition
    first: int
    end: int
    cause: int | None
    only: Results


def unreachable_children(library: TreeLibrary) -> Iterator[Diagnostic]:
    """A finding for each row of children that cannot be reached."""
    for row in never_ticked(library):
        more = row.end - row.first - 1
        others = '' if more == 0 else ', nor is the one after it' if more == 1 else f', nor are the {more} after it'
        message = f'it is never ticked{others}: {_reason(row)}'
        yield Diagnostic(UNREACHABLE, row.tree.error(row.parent.children[row.first], message))


def _reason(row: NeverTicked) -> str:
    if row.cause is None:
        ports = ' and '.join(f'{name}="{value.text}"' for name, value in row.parent.values.items())
        return f'{row.parent.label} has {ports}'
    given = ' or '.join(result.name for result in sorted(row.only))
    return f'{row.parent.children[row.cause].label} gives only {given}'


def never_ticked(library: TreeLibrary) -> Iterator[NeverTicked]:
    """The children that cannot be reached, of all trees."""
    known: dict[TreeKey, Results] = {}
    for key in sub_trees_first(library):
        tree = library.definition(key)
        results: dict[int, Results] = {}
        for node in reversed(list(tree.nodes())):
            if node.tree_id is not None:
                target = library.find(node.tree_id, key.file)
                own = frozenset(_ANYTHING.results) if target is None else known[target]
            else:
                children = [results[id(child)] for child in node.children]
                rule = _rule(node)
                own, ticked = rule.possible(node.values, children)
                if False in ticked:
                    first = ticked.index(False)
                    end = ticked.index(True, first) if True in ticked[first:] else len(ticked)
                    cause = rule.deciding(node.values, first)
                    only = own if cause is None else children[cause]
                    yield NeverTicked(tree, node, first, end, cause, only)
            results[id(node)] = own | {
                result for attribute, result in _CONDITIONS.items() if attribute in node.conditions
            }
        known[key] = results[id(tree.root)]


def _rule(node: NodeDefinition) -> Outcomes:
    """What the class of the node declares, unless it is an error to tick it with the children that it has."""
    declared = node.manifest.outcomes
    if declared is not None and not incompleteness(node):
        return declared
    is_at_once = node.manifest.kind is NodeKind.CONDITION or issubclass(node.manifest.node_class, SyncAction)
    return _ANYTHING_AT_ONCE if is_at_once else _ANYTHING


def incompleteness(node: NodeDefinition) -> str:
    """Why the node cannot be ticked with the children that it has; '' when it can."""
    node_class = node.manifest.node_class
    return node_class.incompleteness(len(node.children)) if issubclass(node_class, ControlNode) else ''
