# SPDX-License-Identifier: BSD-3-Clause
"""Watching the statuses of a tree at no cost to a tree that is not watched.

A node keeps its status in a slot that every ``execute`` writes directly. To watch it, the class of the *instance* is
exchanged for one that is derived from it and in which ``status`` is a property that tells the observer (its own
``observed_status``, if it has one); nothing else differs, and the callables by which parents tick it stay valid.
"""

from __future__ import annotations

import functools
import types
from typing import Any

from .node import TreeNode
from .status import NodeStatus

# The slot itself, below any property.
_SLOT: Any = vars(TreeNode)['status']
get_status = _SLOT.__get__
_set = _SLOT.__set__


def set_and_tell(node: TreeNode, status: NodeStatus) -> None:
    """Stores the status of a node, and tells the observer of the tree when it is another one than before."""
    previous = get_status(node)
    if previous is not status:
        _set(node, status)
        observer = node.context.on_transition
        if observer is not None:
            observer(node, previous, status)


_STATUS = property(get_status, set_and_tell, doc='The status; every change of it is told to the observer of the tree.')


@functools.cache
def _observed_class(node_class: type[TreeNode]) -> type[TreeNode]:
    def fill(namespace: dict[str, Any]) -> None:
        namespace.update(
            __slots__=(),
            __module__=node_class.__module__,
            __qualname__=node_class.__qualname__,
            __doc__=node_class.__doc__,
            status=getattr(node_class, 'observed_status', _STATUS),
        )

    return types.new_class(node_class.__name__, (node_class,), exec_body=fill)


def observe(node: TreeNode) -> None:
    """Tells every change of the node's status to ``context.on_transition`` from now on."""
    if not _is_observed(node):
        node.__class__ = _observed_class(type(node))


def unobserve(node: TreeNode) -> None:
    """Undoes :func:`observe`."""
    if _is_observed(node):
        node.__class__ = type(node).__bases__[0]


def _is_observed(node: TreeNode) -> bool:
    return isinstance(type(node).__dict__.get('status'), property)
