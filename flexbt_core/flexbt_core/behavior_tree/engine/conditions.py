# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-conditions: scripts in attributes that any node may have.

``_failureIf``, ``_successIf``, ``_skipIf`` and ``_while`` are asked, in this order, before a node begins: the first of
them that is true (``_while``: false) decides the result, and the node is not ticked. While the node is RUNNING only
``_while`` is asked; when it is false, the node is halted and SKIPPED. ``_onSuccess`` or ``_onFailure``, and then
``_post``, run when the node completes, before its status is stored; also when a pre-condition has decided.
``_onHalted`` runs whenever the node was halted, whatever it did.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.model.definition import ParsedScript, RunnableScript
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


class NodeScript(NamedTuple):
    """A script of a node, and the attribute that it is in. A pre-condition gives ``result`` when it is ``decisive``."""

    attribute: str
    text: str
    bound: RunnableScript
    decisive: bool = True
    result: NodeStatus = IDLE

    def __str__(self) -> str:
        return f'[{self.text}] of {self.attribute} holds'

    def run(self, node: TreeNode) -> bool | None:
        """Run it. Raises NodeExecutionError."""
        try:
            return self.bound.run()
        except ScriptError as error:
            raise self.fault(node, error) from error

    def fault(self, node: TreeNode, error: ScriptError) -> NodeExecutionError:
        """Return the error of the node whose script has failed."""
        reason = f'{self.attribute}: {error.reason}'
        return node.fault(ScriptError(error.script, error.offset, reason, is_absent=error.is_absent))


class Conditions:
    """The scripts of one node."""

    __slots__ = ('_halted', '_node', '_pending', '_post', '_pre')

    def __init__(self, node: TreeNode, scripts: Mapping[str, ParsedScript]) -> None:
        def bound(*attributes: str) -> tuple[NodeScript, ...]:
            return tuple(
                NodeScript(
                    attribute,
                    scripts[attribute].text,
                    scripts[attribute].bind(node.blackboard, condition=attribute in _DECISIONS),
                    *_DECISIONS.get(attribute, (True, IDLE)),
                )
                for attribute in attributes
                if attribute in scripts
            )

        self._node = node
        self._pre = bound(*_DECISIONS)
        self._post = {SUCCESS: bound('_onSuccess', '_post'), FAILURE: bound('_onFailure', '_post')}
        self._halted = bound('_onHalted')
        # Whether the post-conditions are still to be run in this tick.
        self._pending = False

    @property
    def completing(self) -> bool:
        """Whether there are scripts for a completion."""
        return any(self._post.values())

    @property
    def halting(self) -> bool:
        """Whether there is a script for a halt."""
        return bool(self._halted)

    def around(self, tick: Tick) -> Tick:
        """``tick`` with the conditions around it."""
        if self.completing:
            tick = self._before_post_conditions(tick)
        return self._after_pre_conditions(tick) if self._pre else tick

    # -- pre-conditions ----------------------------------------------------------------------------------------------

    def _after_pre_conditions(self, tick: Tick) -> Tick:
        node = self._node

        def ask_and_tick() -> NodeStatus:
            place = self._deciding()
            if place is not None:
                return self.decide(place)
            node.decided_by = None
            return tick()

        return ask_and_tick

    def _deciding(self) -> int | None:
        """Return the place of the first pre-condition that decides, of those that are to be asked now."""
        node = self._node
        status = node.status
        first = 0
        if status is RUNNING:
            first = len(self._pre) - self.asks_while_running
        elif status is not IDLE and status is not SKIPPED:
            return None
        for place, script in enumerate(self._pre[first:], first):
            if script.run(node) is script.decisive:
                return place
        return None

    @property
    def asks_while_running(self) -> bool:
        """Whether the last pre-condition is asked while the node is RUNNING, too."""
        return bool(self._pre) and self._pre[-1].attribute == '_while'

    def decide(self, place: int) -> NodeStatus:
        """Return the result that this pre-condition gives. The node completes with it, or is halted when it was
        RUNNING."""
        script = self._pre[place]
        node, result = self._node, script.result
        self._pending = False
        if result is not SKIPPED:
            node.decided_by = script if result is FAILURE else None
            self._run(result)
            node.status = result
        elif node.status is RUNNING:
            node.halt_node()
        return result

    # -- post-conditions ---------------------------------------------------------------------------------------------

    def _before_post_conditions(self, tick: Tick) -> Tick:
        def tick_and_complete() -> NodeStatus:
            self._pending = True
            status = tick()
            if status is SUCCESS or status is FAILURE:
                # Only when the result stood already, and was not stored again.
                self.complete(status)
            self._pending = False
            return status

        return tick_and_complete

    def complete(self, status: NodeStatus) -> None:
        """Run the scripts for the node's completing with this status, once in a tick. Before the status is stored:
        when one raises, the node has not completed."""
        if self._pending:
            self._pending = False
            self._run(status)

    def _run(self, status: NodeStatus) -> None:
        for script in self._post[status]:
            script.run(self._node)

    def halted(self) -> None:
        """Run the script for the node's having been halted."""
        for script in self._halted:
            script.run(self._node)
