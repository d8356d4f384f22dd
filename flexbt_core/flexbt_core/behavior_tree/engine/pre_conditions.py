# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-conditions: scripts in attributes that any node may have.

``_failureIf``, ``_successIf``, ``_skipIf`` and ``_while`` are asked, in this order, before a node begins: the first of
them that is true (``_while``: false) decides the result, and the node is not ticked. While the node is RUNNING only
``_while`` is asked; when it is false, the node is halted and SKIPPED. ``_onSuccess`` or ``_onFailure``, and then
``_post``, run when the node completes, before its status is stored; also when a pre-condition has decided.
``_onHalted`` runs whenever the node was halted, whatever it did.

A node that has such scripts gets a class that is derived from its own, in which ``execute`` and ``halt`` take care of
them, and ``status`` when it is observed. All others pay nothing.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Mapping
from typing import Any, Final

from flexbt_core.behavior_tree.model.errors import ScriptError
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus
from flexbt_core.behavior_tree.observers.hooks import TickHooks
from flexbt_core.behavior_tree.observers.status_observer import get_status, set_and_tell, tells
from flexbt_core.behavior_tree.script.compiled_script import CompiledScript, gate_factory, kinds_of

from .node import Execute, TreeNode
from .post_conditions import NodeScript, PostConditions

# What a pre-condition has to be for it to decide, and the result then.
_DECISIONS: Final[Mapping[str, tuple[bool, NodeStatus]]] = {
    '_failureIf': (True, FAILURE),
    '_successIf': (True, SUCCESS),
    '_skipIf': (True, SKIPPED),
    '_while': (False, SKIPPED),
}
_COMPLETING: Final = ('_onSuccess', '_onFailure', '_post')


class Conditions:
    """The scripts of one node. ``execute`` ticks the node with them; what it is changes at times."""

    __slots__ = (
        '_bare',
        '_countdown',
        '_execute',
        '_halted',
        '_hooks',
        '_node',
        '_post',
        '_start',
        '_telling',
        'decided',
        'execute',
    )

    def __init__(self, node: TreeNode, scripts: Mapping[str, CompiledScript]) -> None:
        def bound(*attributes: str) -> tuple[NodeScript, ...]:
            return tuple(
                NodeScript(
                    attribute,
                    scripts[attribute].bind(node.blackboard, condition=attribute in _DECISIONS),
                    *_DECISIONS.get(attribute, (True, IDLE)),
                )
                for attribute in attributes
                if attribute in scripts
            )

        self._node = node
        self._start = bound(*_DECISIONS)
        self._post: PostConditions | None = None
        if any(attribute in scripts for attribute in _COMPLETING):
            completed = {SUCCESS: bound('_onSuccess', '_post'), FAILURE: bound('_onFailure', '_post')}
            self._post = PostConditions(node, completed, self._exchange)
        self._halted = bound('_onHalted')
        # The pre-condition because of which the node failed; None when it failed by itself.
        self.decided: NodeScript | None = None
        self._bare: Execute = node.execute
        self._hooks: TickHooks | None = None
        self._telling = False
        self._surround()

    def _surround(self) -> None:
        """Puts the scripts around the tick of the node, and around the hook before it."""
        tick = self._bare if self._hooks is None else self._hooks.before(self._node, self._bare)
        self._begin(tick if self._post is None else self._post.around(tick, self._telling))

    def _begin(self, execute: Execute) -> None:
        """Puts the pre-conditions before ``execute``."""
        self._execute: Execute = execute
        self._countdown = self._start[0].bound.script.warm_up if self._start else 0
        self.execute: Execute = self._decide_and_execute if self._start else execute

    def _exchange(self, execute: Execute) -> None:
        """Takes a faster ``execute``."""
        self._begin(execute)
        self._node.context.exchanged.append(self._node)

    def entry_point(self) -> Execute:
        """The callable by which the node is ticked, for its parent."""
        node = self._node
        around = node.context.hooks, node.bare_execute, tells(node)
        if around != (self._hooks, self._bare, self._telling):
            self._hooks, self._bare, self._telling = around
            self._surround()
        return self.execute

    # -- pre-conditions ----------------------------------------------------------------------------------------------

    def _decide_and_execute(self) -> NodeStatus:
        """Ticks the node after its pre-conditions; also for the code that is made of them, when that does not fit."""
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self._start[0].bound.script.warm_up
            self._specialize()
        status = self._node.status
        asked = self._start
        if status is not IDLE and status is not SKIPPED:
            asked = self._while if status is RUNNING else ()
        for place, script in enumerate(asked, len(self._start) - len(asked)):
            try:
                decided = script.bound.run() is script.decisive
            except ScriptError as error:
                raise script.fault(self._node, error) from error
            if decided:
                return self.decide(place)
        self.decided = None
        return self._execute()

    @property
    def _while(self) -> tuple[NodeScript, ...]:
        """The pre-condition that is asked while the node is RUNNING; it is the last one."""
        return self._start[-1:] if self._start[-1].attribute == '_while' else ()

    def decide(self, place: int) -> NodeStatus:
        """The result that this pre-condition gives. The node completes with it, or is halted when it was RUNNING."""
        script = self._start[place]
        node, result = self._node, script.result
        post = self._post
        if post is not None:
            post.decided()
        if result is not SKIPPED:
            self.decided = script if result is FAILURE else None
            if post is not None:
                post.run(result)
            node.status = result
        elif node.status is RUNNING:
            node.halt()
        return result

    def _specialize(self) -> None:
        """Makes code for the pre-conditions and what their entries hold now, if there is such code."""
        execute: Execute = self._decide_and_execute
        entries = {name: entry for script in self._start for name, entry in script.bound.entries.items()}
        variables = kinds_of(entries)
        if variables is not None:
            factory = gate_factory(
                [script.bound.script for script in self._start],
                [script.decisive for script in self._start],
                variables,
                ongoing=bool(self._while),
                forgetful=self._start[0].result is FAILURE,
            )
            if factory is not None:
                found = list(entries.values())
                types = [entry.type for entry in found]
                execute = factory(found, types, self._decide_and_execute, self._node, self._execute, self)
        if execute != self.execute:
            self.execute = execute
            self._node.context.exchanged.append(self._node)

    # -- post-conditions ---------------------------------------------------------------------------------------------

    def complete(self, status: NodeStatus) -> None:
        """Runs the scripts for the node's completing with this status, once in a tick."""
        if self._post is not None:
            self._post.complete(status)

    def halted(self) -> None:
        """Runs the script for the node's having been halted."""
        for script in self._halted:
            try:
                script.bound.run()
            except ScriptError as error:
                raise script.fault(self._node, error) from error


def add_conditions(node: TreeNode, scripts: Mapping[str, CompiledScript]) -> None:
    """Gives the node these pre- and post-conditions, by attribute. While the tree is being built, and once."""
    node._conditions = Conditions(node, scripts)
    completing = any(attribute in scripts for attribute in _COMPLETING)
    tells = completing and node.running_first is None
    node.__class__ = _class_with_conditions(type(node), completing, tells, '_onHalted' in scripts)


@functools.cache
def _class_with_conditions(node_class: type[TreeNode], completing: bool, tells: bool, halting: bool) -> type[TreeNode]:
    def failure_cause(self: TreeNode) -> TreeNode | None:
        return None if self._conditions.decided is not None else node_class.failure_cause(self)

    def failure_reason(self: TreeNode) -> str:
        decided = self._conditions.decided
        if decided is None:
            return node_class.failure_reason(self)
        return f'{self.id}: [{decided.bound.script.text}] of {decided.attribute} holds'

    def halt(self: TreeNode) -> None:
        node_class.halt(self)
        self._conditions.halted()

    def fill(namespace: dict[str, Any]) -> None:
        namespace.update(
            __slots__=(),
            __module__=node_class.__module__,
            __qualname__=node_class.__qualname__,
            __doc__=node_class.__doc__,
            execute=property(lambda self: self._conditions.entry_point()),
            bare_execute=node_class.execute,
            failure_cause=failure_cause,
            failure_reason=failure_reason,
        )
        if completing:
            namespace['observed_status'] = _OBSERVED_STATUS
        if halting:
            namespace['halt'] = halt

    bases = (_Telling, node_class) if tells else (node_class,)
    return types.new_class(node_class.__name__, bases, exec_body=fill)


def _complete_and_tell(node: TreeNode, status: NodeStatus) -> None:
    if status is SUCCESS or status is FAILURE:
        node._conditions.complete(status)
    set_and_tell(node, status)


_OBSERVED_STATUS = property(get_status, _complete_and_tell)


class _Telling:
    """Makes a node run its post-conditions when it stores its result, observed or not."""

    __slots__ = ()

    status = _OBSERVED_STATUS
