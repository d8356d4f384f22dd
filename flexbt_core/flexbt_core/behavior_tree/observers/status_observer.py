# SPDX-License-Identifier: BSD-3-Clause
"""Watching the statuses of a tree at no cost to a tree that is not watched.

A node keeps its status in a slot that every ``execute`` writes directly. To watch it, the class of the *instance* is
exchanged for one that is derived from it and in which ``status`` is a property that logs every change (its own
``observed_status``, if it has one). The methods of the engine log without that property, see ``inlining``. Nothing else
differs, and the callables by which parents tick the node stay valid.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Iterable, Sequence
from typing import Any

from flexbt_core.behavior_tree.acceleration.inlining import inlined_methods
from flexbt_core.behavior_tree.engine.context import TransitionObserver
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.model.status import IDLE, NodeStatus

from .status_log import Log, LogReader, TellingLog, marks_of

# The slot itself, below any property.
_SLOT: Any = vars(TreeNode)['status']
get_status = _SLOT.__get__
_set = _SLOT.__set__


def tells(node: TreeNode) -> bool:
    """Whether a store of the node's status is a call."""
    node_class: Any = type(node)
    return node_class.status is not _SLOT


def set_and_tell(node: TreeNode, status: NodeStatus) -> None:
    """Stores the status of a node, and logs it when the tree is watched and it is another one than before."""
    if get_status(node) is not status:
        _set(node, status)
        log = node.context.log
        if log is not None:
            log.append(node.marks[status])


_STATUS = property(get_status, set_and_tell, doc='The status; every change of it is logged.')


@functools.cache
def _observed_class(node_class: type[TreeNode]) -> type[TreeNode]:
    own_status = getattr(node_class, 'observed_status', None)

    def fill(namespace: dict[str, Any]) -> None:
        if own_status is None:
            namespace.update(inlined_methods(node_class))
        namespace.update(
            __slots__=(),
            __module__=node_class.__module__,
            __qualname__=node_class.__qualname__,
            __doc__=node_class.__doc__,
            status=own_status or _STATUS,
            stored=_SLOT,
        )

    return types.new_class(node_class.__name__, (node_class,), exec_body=fill)


def _plain_class(node_class: type[TreeNode]) -> type[TreeNode]:
    return node_class.__bases__[0] if 'stored' in vars(node_class) else node_class


def prepare(node_classes: Iterable[type[TreeNode]]) -> None:
    """Does what the first tree with nodes of these classes that is watched would have to wait for: about 0.1 s."""
    for node_class in node_classes:
        _observed_class(node_class)


def make_observed(node_class: type[TreeNode], config: NodeConfig) -> TreeNode:
    """A node that is observed from the beginning, to be watched before it is ticked.

    If it has a ``__dict__``, its methods are faster than those of one whose class was exchanged (Python 3.11).
    """
    node: TreeNode = object.__new__(_observed_class(node_class))
    _set(node, IDLE)
    node_class.__init__(node, config)
    return node


def watch(nodes: Sequence[TreeNode], log: Log | None, on_transition: TransitionObserver | None) -> None:
    """Writes every change of the status of these nodes, those of a tree, to ``log``, and tells it to ``on_transition``.

    Not while another thread ticks the tree. The tree has to fetch the callables anew by which the nodes are ticked.
    """
    context = nodes[0].context
    if on_transition is not None:
        log = _telling(nodes, on_transition, log)
    for node in nodes:
        node_class = _plain_class(type(node))
        if log is not None:
            node.marks = marks_of(node)
            node_class = _observed_class(node_class)
        if node_class is not type(node):
            node.__class__ = node_class
    context.log = log
    context.exchanged += nodes


def _telling(nodes: Sequence[TreeNode], on_transition: TransitionObserver, log: Log | None) -> TellingLog:
    def transition(uid: int, before: int, after: int) -> tuple[TreeNode, NodeStatus, NodeStatus]:
        return nodes[uid - 1], NodeStatus(before), NodeStatus(after)

    return TellingLog(LogReader(nodes, transition), lambda change: on_transition(*change), log)
