# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-conditions: scripts in attributes that any node may have.

``_failureIf``, ``_successIf``, ``_skipIf`` and ``_while`` are evaluated in this order before a node begins: the first
that is true (``_while``: false) decides the result, and the node is not ticked. While the node is RUNNING only
``_while`` is evaluated; when it is false, the node is halted and SKIPPED. ``_onSuccess`` or ``_onFailure``, and then
``_post``, run when the node completes, before its status is stored; also when a pre-condition has decided.
``_onHalted`` runs whenever the node was halted, in any status.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from flexbt_core.behavior_tree.model.definition import ParsedScript
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, ScriptError
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus

from .context import Tick
from .node import TreeNode

# What a pre-condition has to be for it to decide, and the result then.
_DECISIONS: Final[Mapping[str, tuple[bool, NodeStatus]]] = {
    '_failureIf': (True, FAILURE),
    '_successIf': (True, SUCCESS),
    '_skipIf': (True, SKIPPED),
    '_while': (False, SKIPPED),
}
# With what the node completes when a post-condition runs, in the order in which they run.
_COMPLETIONS: Final[Mapping[str, tuple[NodeStatus, ...]]] = {
    '_onSuccess': (SUCCESS,),
    '_onFailure': (FAILURE,),
    '_post': (SUCCESS, FAILURE),
}


class NodeScript:
    """A script of a node, and the attribute that it is in."""

    __slots__ = ('_node', 'attribute', 'bound', 'text')

    def __init__(self, node: TreeNode, attribute: str, script: ParsedScript) -> None:
        self._node = node
        self.attribute = attribute
        self.text = script.text
        self.bound = script.bind(node.blackboard, condition=attribute in _DECISIONS)

    def __str__(self) -> str:
        return f'[{self.text}] of {self.attribute} holds'

    def run(self) -> bool | None:
        """Run it. Raises NodeExecutionError."""
        try:
            return self.bound.run()
        except ScriptError as error:
            raise self.fault(error) from error

    def fault(self, error: ScriptError) -> NodeExecutionError:
        """Return the error of the node whose script has failed."""
        reason = f'{self.attribute}: {error.reason}'
        return self._node.fault(ScriptError(error.script, error.offset, reason, is_absent=error.is_absent))


class _PreCondition(NodeScript):
    """A script that is evaluated before a tick of the node: its decision replaces the tick."""

    __slots__ = ('_decides', '_decisive', '_ongoing', '_tick', 'result')

    def __init__(
        self, node: TreeNode, attribute: str, script: ParsedScript, decides: Callable[[_PreCondition], NodeStatus]
    ) -> None:
        super().__init__(node, attribute, script)
        self._decides = decides
        self._decisive, self.result = _DECISIONS[attribute]
        self._ongoing = attribute == '_while'

    def before(self, tick: Tick) -> Tick:
        """Return ``tick`` with the question before it."""
        self._tick = tick
        return self._ask_and_tick

    def _ask_and_tick(self) -> NodeStatus:
        node = self._node
        node.decided_by = None
        status = node.stored_status
        if status is IDLE or status is SKIPPED or (status is RUNNING and self._ongoing):
            # What is in a slot is fetched first here and below: Python is slower to call it at once.
            run = self.bound.run
            try:
                holds = run()
            except ScriptError as error:
                raise self.fault(error) from error
            if holds is self._decisive:
                return self._decides(self)
        tick = self._tick
        return tick()


class _PostCondition(NodeScript):
    """A script that runs when the node completes."""

    __slots__ = ('_tick', 'statuses')

    def __init__(self, node: TreeNode, attribute: str, script: ParsedScript) -> None:
        super().__init__(node, attribute, script)
        self.statuses = _COMPLETIONS[attribute]

    def after(self, tick: Tick) -> Tick:
        """Return ``tick`` with the script after it, for nodes whose result is not observed before that."""
        self._tick = tick
        return self._tick_and_run

    def _tick_and_run(self) -> NodeStatus:
        node = self._node
        before = node.stored_status
        tick = self._tick
        status = tick()
        if status in self.statuses:
            run = self.bound.run
            try:
                run()
            except ScriptError as error:
                node.status = RUNNING if node.running_at_completion else before
                raise self.fault(error) from error
        return status


class Conditions:
    """The scripts of one node."""

    __slots__ = ('_halted', '_inner', '_node', '_post', '_pre', 'pending')

    def __init__(self, node: TreeNode, scripts: Mapping[str, ParsedScript]) -> None:
        self._node = node
        self._pre = [_PreCondition(node, one, scripts[one], self._decide) for one in _DECISIONS if one in scripts]
        self._post = [_PostCondition(node, one, scripts[one]) for one in _COMPLETIONS if one in scripts]
        self._halted = NodeScript(node, '_onHalted', scripts['_onHalted']) if '_onHalted' in scripts else None
        self.pending = False
        """True if the post-conditions are still to be run in this tick."""

    @property
    def run_at_store(self) -> bool:
        """True if the post-conditions run when the node stores its result; if unobserved, they run after the tick."""
        node = self._node
        return bool(self._post) and bool(node.context.observers or node.running_at_completion is None)

    def around(self, tick: Tick) -> Tick:
        """Return ``tick`` with the conditions around it."""
        if self.run_at_store:
            self._inner = tick
            tick = self._tick_and_complete
        else:
            for post in self._post:
                tick = post.after(tick)
        for pre in reversed(self._pre):
            tick = pre.before(tick)
        return tick

    def _decide(self, script: _PreCondition) -> NodeStatus:
        """Complete the node with the result that this pre-condition gives, or halt it when it was RUNNING."""
        node, result = self._node, script.result
        if result is not SKIPPED:
            node.decided_by = script if result is FAILURE else None
            self.complete(result)
            node.status = result
        elif node.stored_status is RUNNING:
            node.halt_node()
        return result

    def _tick_and_complete(self) -> NodeStatus:
        self.pending = True
        status = self._inner()
        if self.pending:
            if status is SUCCESS or status is FAILURE:
                # Only when the result stood already, and was not stored again.
                self.complete(status)
            self.pending = False
        return status

    def complete(self, status: NodeStatus) -> None:
        """Run the scripts for the node's completing with this status, before it is stored: when one raises, the node
        has not completed."""
        self.pending = False
        for script in self._post:
            if status in script.statuses:
                script.run()

    def halted(self) -> None:
        """Run the script for the node's having been halted."""
        if self._halted is not None:
            self._halted.run()
