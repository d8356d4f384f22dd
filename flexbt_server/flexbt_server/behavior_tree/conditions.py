# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-conditions: scripts in attributes that any node may have.

``_failureIf``, ``_successIf``, ``_skipIf`` and ``_while`` are asked, in this order, before a node begins: the first of
them that is true (``_while``: false) decides the result, and the node is not ticked. While the node is RUNNING only
``_while`` is asked; when it is false, the node is halted and SKIPPED. ``_onSuccess`` or ``_onFailure``, and then
``_post``, run when the node completes, before its status is stored; also when a pre-condition has decided.
``_onHalted`` runs whenever the node was halted, whatever it did.

A node that has such scripts gets a class of its own, derived from the one that it has, in which ``execute``, ``halt``
and ``status`` take care of them. All others pay nothing.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from .errors import NodeExecutionError, ScriptError
from .node import TreeNode
from .observation import get_status, set_and_tell
from .script import BoundScript, CompiledScript
from .status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus

# What a pre-condition has to be for it to decide, and the result then.
_DECISIONS: Final[Mapping[str, tuple[bool, NodeStatus]]] = {
    '_failureIf': (True, FAILURE),
    '_successIf': (True, SUCCESS),
    '_skipIf': (True, SKIPPED),
    '_while': (False, SKIPPED),
}


class _Script(NamedTuple):
    """A script of a node, and the attribute that it is in. A pre-condition decides when it is ``decisive``."""

    attribute: str
    script: BoundScript
    decisive: bool
    result: NodeStatus


class Conditions:
    """The scripts of one node, and what has to be remembered of them from one step of a tick to the next."""

    __slots__ = ('decided', 'failure', 'halted', 'pending', 'running', 'start', 'success')

    def __init__(self, node: TreeNode, scripts: Mapping[str, CompiledScript]) -> None:
        def bound(*attributes: str) -> tuple[_Script, ...]:
            return tuple(
                _Script(
                    attribute,
                    scripts[attribute].bind(node.blackboard, condition=attribute in _DECISIONS),
                    *_DECISIONS.get(attribute, (True, IDLE)),
                )
                for attribute in attributes
                if attribute in scripts
            )

        self.start = bound(*_DECISIONS)
        self.running = bound('_while')
        self.success = bound('_onSuccess', '_post')
        self.failure = bound('_onFailure', '_post')
        self.halted = bound('_onHalted')
        # Whether the scripts of the completion are still to be run in this tick.
        self.pending = False
        # The pre-condition that decided the last result; None when the node did.
        self.decided: _Script | None = None

    def decide(self, node: TreeNode, scripts: tuple[_Script, ...]) -> _Script | None:
        """The first pre-condition that decides."""
        for script in scripts:
            try:
                if script.script.run() is script.decisive:
                    return script
            except ScriptError as error:
                raise _fault(node, script, error) from error
        return None

    def run(self, node: TreeNode, scripts: tuple[_Script, ...]) -> None:
        for script in scripts:
            try:
                script.script.run()
            except ScriptError as error:
                raise _fault(node, script, error) from error


def _fault(node: TreeNode, script: _Script, error: ScriptError) -> NodeExecutionError:
    return node.fault(ScriptError(error.script, error.offset, f'{script.attribute}: {error.reason}'))


def add_conditions(node: TreeNode, scripts: Mapping[str, CompiledScript]) -> None:
    """Gives the node these pre- and post-conditions, by attribute. While the tree is being built, and once."""
    conditions = Conditions(node, scripts)
    node._conditions = conditions
    node.__class__ = _class_with_conditions(
        type(node), bool(conditions.start), bool(conditions.success or conditions.failure), bool(conditions.halted)
    )


@functools.cache
def _class_with_conditions(node_class: type[TreeNode], pre: bool, completing: bool, halting: bool) -> type[TreeNode]:
    def fill(namespace: dict[str, Any]) -> None:
        namespace.update(
            __slots__=(),
            __module__=node_class.__module__,
            __qualname__=node_class.__qualname__,
            __doc__=node_class.__doc__,
        )
        execute: Callable[[Any], NodeStatus] = node_class.execute
        if completing:
            namespace['status'] = _COMPLETING_STATUS
            execute = _completing(execute)
        if pre:
            execute = _preceded(execute)
            namespace.update(_reasons(node_class))
        namespace['execute'] = execute
        if halting:
            namespace['halt'] = _halting(node_class.halt)

    return types.new_class(node_class.__name__, (node_class,), exec_body=fill)


def _preceded(execute: Callable[[Any], NodeStatus]) -> Callable[[Any], NodeStatus]:
    """``execute`` after the pre-conditions."""

    def execute_if(self: TreeNode) -> NodeStatus:
        conditions = self._conditions
        status = self.status
        if status is IDLE or status is SKIPPED:
            decided = conditions.decided = conditions.decide(self, conditions.start)
            if decided is not None:
                if decided.result is not SKIPPED:
                    conditions.pending = True
                    self.status = decided.result
                return decided.result
        elif status is RUNNING and conditions.running and conditions.decide(self, conditions.running) is not None:
            self.halt()
            return SKIPPED
        return execute(self)

    return execute_if


def _completing(execute: Callable[[Any], NodeStatus]) -> Callable[[Any], NodeStatus]:
    """``execute``, with the scripts of the completion run before the status is stored, and once."""

    def execute_and_complete(self: TreeNode) -> NodeStatus:
        conditions = self._conditions
        conditions.pending = True
        status = execute(self)
        if conditions.pending and (status is SUCCESS or status is FAILURE):
            # A result that stands since an earlier tick.
            self.status = status
        return status

    return execute_and_complete


def _complete(node: TreeNode, status: NodeStatus) -> None:
    """Stores a status. What completes the node stays undone when a script raises, as in BehaviorTree.CPP."""
    if status is SUCCESS or status is FAILURE:
        conditions = node._conditions
        if conditions.pending:
            conditions.pending = False
            conditions.run(node, conditions.success if status is SUCCESS else conditions.failure)
    set_and_tell(node, status)


_COMPLETING_STATUS = property(get_status, _complete, doc='The status; when it is stored, post-conditions run first.')


def _halting(halt: Callable[[Any], None]) -> Callable[[Any], None]:
    def halt_and_run(self: TreeNode) -> None:
        halt(self)
        self._conditions.run(self, self._conditions.halted)

    return halt_and_run


def _reasons(node_class: type[TreeNode]) -> dict[str, Any]:
    """Why a node failed, when a pre-condition decided that."""

    def failure_cause(self: TreeNode) -> TreeNode | None:
        return None if self._conditions.decided is not None else node_class.failure_cause(self)

    def failure_reason(self: TreeNode) -> str:
        decided = self._conditions.decided
        if decided is None:
            return node_class.failure_reason(self)
        return f'{self.id}: [{decided.script.text}] of {decided.attribute} holds'

    return {'failure_cause': failure_cause, 'failure_reason': failure_reason}
