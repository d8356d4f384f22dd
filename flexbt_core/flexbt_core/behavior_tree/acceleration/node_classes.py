# SPDX-License-Identifier: BSD-3-Clause
"""Classes of nodes in which a store of the status is not a call.

In the plain classes ``status`` is a property, which runs post-conditions and tells observers. A node for which it has
nothing to do gets a class, derived from its own, in which ``status`` is the slot itself. In a tree that only writes a
status log its methods are those of ``inlining``. Nothing else differs.
"""

from __future__ import annotations

import types
from collections.abc import Callable, Sequence
from typing import Any, Final

from flexbt_core.behavior_tree.engine import Conditions, TreeNode, kept_by_class
from flexbt_core.behavior_tree.status_log import StatusLog

from .compact_log import marks_of
from .inlining import inlined_methods

Observers = Sequence[Callable[..., None]]

_SLOT: Final = vars(TreeNode)['_stored_status']


def plain_class(node_class: type[Any]) -> type[Any]:
    """The class of which this one may be a faster form."""
    plain: type[Any] = vars(node_class).get('plain_class', node_class)
    return plain


def stores_directly(node: TreeNode) -> bool:
    """Whether a store of the node's status is not a call."""
    node_class: Any = type(node)
    return node_class.status is _SLOT


def class_for(plain: Any, observers: Observers, conditions: Conditions | None) -> type[Any]:
    """The fastest class for a node of a tree with these observers."""
    halting = conditions is not None and conditions.halting
    if conditions is not None and conditions.completing and (observers or plain.running_at_completion is None):
        return plain
    if not observers:
        return direct_class(plain, halting)
    return logging_class(plain, halting) if _log_of(observers) is not None else plain


def fit(node: TreeNode) -> None:
    """Gives a node the class that suits what is around it."""
    context: Any = node.context
    conditions: Any = node.conditions
    context.log = _log_of(context.observers)
    if context.log is not None:
        node.marks = marks_of(node)
    node_class = class_for(plain_class(type(node)), context.observers, conditions)
    if node_class is not type(node):
        node.__class__ = node_class


def _log_of(observers: Observers) -> Any:
    """The log to which everything is written, if nobody else observes the tree."""
    return observers[0].log if len(observers) == 1 and isinstance(observers[0], StatusLog) else None


@kept_by_class
def direct_class(plain: type[Any], halting: bool) -> type[Any]:
    """``plain`` with the slot itself as status. A node of it that is ``halting`` has a script that runs then."""
    return _derived(plain, halting, {'status': _SLOT})


@kept_by_class
def logging_class(plain: type[Any], halting: bool) -> type[Any]:
    """``plain`` with methods that write to the log of the tree."""
    return _derived(plain, halting, inlined_methods(plain))


def _derived(plain: type[Any], halting: bool, members: dict[str, Any]) -> type[Any]:
    def fill(namespace: dict[str, Any]) -> None:
        namespace.update(
            members,
            __slots__=(),
            __module__=plain.__module__,
            __qualname__=plain.__qualname__,
            __doc__=plain.__doc__,
            plain_class=plain,
        )
        if not halting and 'halt_node' not in plain.__dict__:
            namespace['halt_node'] = members.get('halt', plain.halt)

    return types.new_class(plain.__name__, (plain,), exec_body=fill)
