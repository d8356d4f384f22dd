# SPDX-License-Identifier: BSD-3-Clause
"""Which children can never be ticked: from what the nodes before them can give."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from operator import or_
from typing import Final, NamedTuple

from flexbt_core.behavior_tree import (
    NodeDefinition,
    NodeStatus,
    SyncAction,
    TreeDefinition,
    TreeKey,
    TreeLibrary,
    TreeNode,
)
from flexbt_core.behavior_tree.model import FAILURE, RUNNING, SKIPPED, SUCCESS
from flexbt_core.behavior_tree.nodes import actions, conditionals, decorators, reactive, script_nodes, sequences, timing
from flexbt_tools.trees import sub_trees_first

from .diagnostics import UNREACHABLE, Diagnostic

Results = frozenset[NodeStatus]
"""What a tick may give."""

ANYTHING: Final[Results] = frozenset((SUCCESS, FAILURE, RUNNING, SKIPPED))
_NOTHING: Final[Results] = frozenset()
_FAILURE: Final = frozenset((FAILURE,))
_RUNNING: Final = frozenset((RUNNING,))
_SKIPPED: Final = frozenset((SKIPPED,))

Rule = Callable[[NodeDefinition, Sequence[Results]], tuple[Results, Sequence[bool]]]
"""From a node and what its children may give: what it may give, and which of them may be ticked."""


def _row(passing: NodeStatus) -> Rule:
    """The next child is ticked when one gives ``passing`` or is skipped; anything else is the result."""

    def rule(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
        reached: list[bool] = []
        results = _NOTHING
        goes_on = True
        for child in children:
            reached.append(goes_on)
            if goes_on:
                results |= child - {passing, SKIPPED}
                goes_on = passing in child or SKIPPED in child
        if goes_on:
            results |= reduce(or_, children, _NOTHING) & {passing}
            results |= _SKIPPED if all(SKIPPED in child for child in children) else _NOTHING
        return results, reached

    return rule


def _yielding(rule: Rule) -> Rule:
    """A node that may be RUNNING between two children."""

    def yielding(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
        results, reached = rule(node, children)
        return results | _RUNNING, reached

    return yielding


def _mapped(success: NodeStatus, failure: NodeStatus, skipped: NodeStatus = SKIPPED, more: Results = _NOTHING) -> Rule:
    """A decorator that exchanges the results of its child."""
    exchange = {SUCCESS: success, FAILURE: failure, SKIPPED: skipped, RUNNING: RUNNING}

    def rule(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
        return more | {exchange[result] for result in children[0]}, (True,)

    return rule


def _repeating(port: str, repeated: NodeStatus) -> Rule:
    """A decorator that begins its child anew after ``repeated``, as often as ``port`` says; -1: without end."""

    def rule(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
        count = node.values[port].literal
        others = children[0] - {repeated}
        again = _RUNNING if repeated in children[0] else _NOTHING
        if count == -1:
            return others | again, (True,)
        if isinstance(count, int):
            return (children[0] | again, (True,)) if count > 0 else (frozenset((repeated,)), (False,))
        # Not known: with 0 the result is as if it had been repeated enough.
        return others | again | {repeated}, (True,)

    return rule


def _limited(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
    """A decorator that fails when its child takes too long."""
    return children[0] | (_FAILURE if RUNNING in children[0] else _NOTHING), (True,)


def _choice(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
    """The first child decides between the second and the third, if there is one."""
    condition, then, *others = children
    reached = [True, SUCCESS in condition, *(FAILURE in condition for _ in others)]
    results = (condition & _RUNNING) | (then if reached[1] else _NOTHING)
    otherwise = others[0] if others else _FAILURE
    return results | (otherwise if FAILURE in condition else _NOTHING), reached


def _always(*results: NodeStatus) -> Rule:
    return lambda node, children: (frozenset(results), ())


_IN_SEQUENCE: Final = _row(SUCCESS)
_IN_FALLBACK: Final = _row(FAILURE)

_RULES: Final[Mapping[type[TreeNode], Rule]] = {
    sequences.Sequence: _IN_SEQUENCE,
    sequences.SequenceWithMemory: _IN_SEQUENCE,
    reactive.ReactiveSequence: _IN_SEQUENCE,
    sequences.AsyncSequence: _yielding(_IN_SEQUENCE),
    sequences.Fallback: _IN_FALLBACK,
    reactive.ReactiveFallback: _IN_FALLBACK,
    sequences.AsyncFallback: _yielding(_IN_FALLBACK),
    conditionals.IfThenElse: _choice,
    conditionals.WhileDoElse: _choice,
    decorators.Inverter: _mapped(FAILURE, SUCCESS),
    decorators.ForceSuccess: _mapped(SUCCESS, SUCCESS),
    decorators.ForceFailure: _mapped(FAILURE, FAILURE),
    decorators.KeepRunningUntilFailure: _mapped(RUNNING, FAILURE, RUNNING),
    decorators.Repeat: _repeating('num_cycles', SUCCESS),
    decorators.RetryUntilSuccessful: _repeating('num_attempts', FAILURE),
    timing.Delay: _mapped(SUCCESS, FAILURE, more=_RUNNING),
    timing.Timeout: _limited,
    timing.Sleep: _always(RUNNING, SUCCESS),
    actions.AlwaysSuccess: _always(SUCCESS),
    actions.AlwaysFailure: _always(FAILURE),
    actions.UnsetBlackboard: _always(SUCCESS),
    script_nodes.Script: _always(SUCCESS),
}
"""What is known of nodes. Of any other, all is possible; so is of one that derives from them."""

_CONDITIONS: Final = {'_failureIf': FAILURE, '_successIf': SUCCESS, '_skipIf': SKIPPED, '_while': SKIPPED}
"""What a pre-condition may give in place of its node."""


class NeverTicked(NamedTuple):
    """Children of a node, from ``first`` to before ``end``, that cannot be reached: child ``cause`` gives ``only``."""

    tree: TreeDefinition
    parent: NodeDefinition
    first: int
    end: int
    cause: int
    only: Results


def unreachable_children(library: TreeLibrary) -> Iterator[Diagnostic]:
    """A finding for each row of children that cannot be reached."""
    for row in never_ticked(library):
        more = row.end - row.first - 1
        others = '' if more == 0 else ', nor is the one after it' if more == 1 else f', nor are the {more} after it'
        given = ' or '.join(result.name for result in sorted(row.only))
        cause = row.parent.children[row.cause].label
        message = f'it is never ticked{others}: {cause} gives only {given}'
        yield Diagnostic(UNREACHABLE, row.tree.error(row.parent.children[row.first], message))


def never_ticked(library: TreeLibrary) -> Iterator[NeverTicked]:
    """The children that cannot be reached, of all trees."""
    known: dict[TreeKey, Results] = {}
    for key in sub_trees_first(library):
        tree = library.definition(key)
        results: dict[int, Results] = {}
        for node in reversed(list(tree.nodes())):
            if node.tree_id is not None:
                target = library.find(node.tree_id, key.file)
                own = ANYTHING if target is None else known[target]
            else:
                children = [results[id(child)] for child in node.children]
                rule = _rule(node)
                own, reached = rule(node, children)
                if False in reached:
                    first = reached.index(False)
                    end = reached.index(True, first) if True in reached[first:] else len(reached)
                    # Those that choose do so by their first child, all others by the one before.
                    cause = 0 if rule is _choice else first - 1
                    yield NeverTicked(tree, node, first, end, cause, children[cause])
            results[id(node)] = own | {
                result for attribute, result in _CONDITIONS.items() if attribute in node.conditions
            }
        known[key] = results[id(tree.root)]


def _rule(node: NodeDefinition) -> Rule:
    rule = _RULES.get(node.manifest.node_class, _unknown)
    # A wrong number of children of those that choose is an error when they are ticked.
    return _unknown if rule is _choice and len(node.children) not in (2, 3) else rule


def _unknown(node: NodeDefinition, children: Sequence[Results]) -> tuple[Results, Sequence[bool]]:
    synchronous = issubclass(node.manifest.node_class, SyncAction)
    return ANYTHING - _RUNNING if synchronous else ANYTHING, (True,) * len(children)
