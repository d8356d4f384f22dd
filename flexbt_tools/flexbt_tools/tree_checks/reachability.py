# SPDX-License-Identifier: BSD-3-Clause
"""Checks for children that can never be ticked because of the results of other nodes, or never end in time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeDefinition, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.outcomes import Earliest, OneOf, Outcomes, Results, TimeLimit
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus
from flexbt_core.skills.library import SkillLibrary
from flexbt_tools.trees.files import sub_trees_first

from .diagnostics import TOO_SHORT, UNREACHABLE, Diagnostic
from .resources import skill_of

_ANYTHING: Final = OneOf((SUCCESS, FAILURE, RUNNING, SKIPPED))
_ANYTHING_AT_ONCE: Final = OneOf((SUCCESS, FAILURE, SKIPPED))

_CONDITIONS: Final = {'_failureIf': FAILURE, '_successIf': SUCCESS, '_skipIf': SKIPPED, '_while': SKIPPED}
"""Results that pre-conditions may return in place of their nodes."""


class NeverTicked(NamedTuple):
    """Unreachable children of a node, from ``first`` up to but not including ``end``.

    The cause is that child ``cause`` returns ``only``. Without a ``cause``, the ports of the node make them
    unreachable.
    """

    tree: TreeDefinition
    parent: NodeDefinition
    first: int
    end: int
    cause: int | None
    only: Results


def unreachable_children(library: TreeLibrary) -> Iterator[Diagnostic]:
    """Yield a finding for each row of unreachable children."""
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
    """Yield the unreachable children of all trees."""
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
    """Return the rule of the node's class; if it has none, or the node is incomplete, one that allows anything."""
    declared = node.manifest.outcomes
    if declared is not None and not incompleteness(node):
        return declared
    is_at_once = node.manifest.kind is NodeKind.CONDITION or issubclass(node.manifest.node_class, SyncAction)
    return _ANYTHING_AT_ONCE if is_at_once else _ANYTHING


def incompleteness(node: NodeDefinition) -> str:
    """Return why the node cannot be ticked with its children; '' if it can."""
    node_class = node.manifest.node_class
    return node_class.incompleteness(len(node.children)) if issubclass(node_class, ControlNode) else ''


# -- time --------------------------------------------------------------------------------------------------------------


def least_times(library: TreeLibrary, skills: SkillLibrary) -> dict[TreeKey, float]:
    """Return the minimum time until each tree succeeds, s; infinity if it never does."""
    return {
        key: earliest[id(tree.root)].results.get(SUCCESS, math.inf) for key, tree, earliest in _times(library, skills)
    }


def short_limits(library: TreeLibrary, skills: SkillLibrary) -> Iterator[Diagnostic]:
    """Yield a finding for each time limit that expires before its child can succeed, or before a part of it begins."""
    for _, tree, earliest in _times(library, skills):
        last: dict[int, float] = {}  # latest time at which a node inside begins
        for node in reversed(list(tree.nodes())):
            begins = zip(node.children, earliest[id(node)].begins, strict=True)
            last[id(node)] = max((at + last[id(one)] for one, at in begins if at < math.inf), default=0.0)
            rule = _rule(node)
            if not isinstance(rule, TimeLimit):
                continue
            [child] = node.children
            results = earliest[id(child)].results
            limit = rule.limit(node.values, results)
            success = results.get(SUCCESS, math.inf)
            if limit is None or '_successIf' in node.conditions:
                continue
            if limit <= success < math.inf:
                label, time = max(_waits(child, earliest), key=lambda one: one[1])
                took = f'{label} takes {time:g} s' if time >= limit else f'what is in it takes {success:g} s at least'
                message = f'it can never succeed: {took}, and is ended after {limit:g} s'
                yield Diagnostic(TOO_SHORT, tree.error(node, message))
            elif limit <= last[id(child)]:
                late, begin = next(one for one in _begins(child, 0.0, earliest) if limit <= one[1] < math.inf)
                before = f'{node.label} ends after {limit:g} s, and what is before it takes {begin:g} s'
                yield Diagnostic(TOO_SHORT, tree.error(late, f'it is never ticked: {before}'))


def _times(
    library: TreeLibrary, skills: SkillLibrary
) -> Iterator[tuple[TreeKey, TreeDefinition, Mapping[int, Earliest]]]:
    """Yield all trees, with the earliest times of each node by its ``id``.

    A leaf without a rule is treated as in a proof: it succeeds after the time in its skill, or fails at once.
    """
    known: dict[TreeKey, Mapping[NodeStatus, float]] = {}
    for key in sub_trees_first(library):
        tree = library.definition(key)
        earliest: dict[int, Earliest] = {}
        for node in reversed(list(tree.nodes())):
            target = library.find(node.tree_id, key.file) if node.tree_id is not None else None
            skill = skill_of(node, skills) if node.manifest.outcomes is None else None
            if target is not None:
                own = Earliest(known[target], ())
            elif skill is not None:
                own = Earliest({SUCCESS: skill.duration[0], FAILURE: 0.0}, ())
            else:
                own = _rule(node).earliest(node.values, [earliest[id(child)].results for child in node.children])
            at_once = {result: 0.0 for attribute, result in _CONDITIONS.items() if attribute in node.conditions}
            earliest[id(node)] = own._replace(results={**own.results, **at_once})
        known[key] = earliest[id(tree.root)].results
        yield key, tree, earliest


def _waits(node: NodeDefinition, earliest: Mapping[int, Earliest]) -> Iterator[tuple[str, float]]:
    """Yield the nodes that take time themselves, with their times.

    Leaves and sub-trees take time until they succeed; other nodes until their first child begins.
    """
    own = earliest[id(node)]
    if node.children:
        yield node.label, own.begins[0]
        for child in node.children:
            yield from _waits(child, earliest)
    else:
        yield node.label, own.results.get(SUCCESS, 0.0)


def _begins(
    node: NodeDefinition, begin: float, earliest: Mapping[int, Earliest]
) -> Iterator[tuple[NodeDefinition, float]]:
    """Yield the descendants of a node that begins at ``begin``, with their earliest times, in the order of the file."""
    ahead = [(node, begin)]
    while ahead:
        parent, begin = ahead.pop()
        children = [
            (child, begin + after) for child, after in zip(parent.children, earliest[id(parent)].begins, strict=True)
        ]
        yield from children
        ahead += reversed(children)
