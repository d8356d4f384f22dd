# SPDX-License-Identifier: BSD-3-Clause
"""Post-conditions: the scripts that run when a node completes, before its status is stored; see ``conditions``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from flexbt_core.behavior_tree.model.blackboard import Entry
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, ScriptError
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeStatus
from flexbt_core.behavior_tree.script.compiled_script import BoundScript, CompiledScript, completion_factory, kinds_of

from .node import Execute, TreeNode


class NodeScript(NamedTuple):
    """A script of a node, and the attribute that it is in. A pre-condition decides when it is ``decisive``."""

    attribute: str
    bound: BoundScript
    decisive: bool = True
    result: NodeStatus = IDLE

    def fault(self, node: TreeNode, error: ScriptError) -> NodeExecutionError:
        """The error of the node whose script has failed."""
        return node.fault(ScriptError(error.script, error.offset, f'{self.attribute}: {error.reason}'))


class PostConditions:
    """The scripts for the completion of a node, by the status with which it completes."""

    __slots__ = ('_countdown', '_exchange', '_execute', '_node', '_pending', '_scripts', '_warm_up')

    def __init__(
        self,
        node: TreeNode,
        scripts: Mapping[NodeStatus, Sequence[NodeScript]],
        exchange: Callable[[Execute], None],
    ) -> None:
        """``exchange`` takes a faster callable for the one of :meth:`around`, which stays valid."""
        self._node = node
        self._scripts = scripts
        self._exchange = exchange
        self._warm_up = max(script.bound.script.warm_up for status in scripts for script in scripts[status])
        self._countdown = self._warm_up
        # Whether the scripts are still to be run in this tick.
        self._pending = False
        self._execute: Execute = node.execute

    def around(self, execute: Execute, telling: bool) -> Execute:
        """``execute`` with the scripts.

        When one raises, the node has not completed. A node that is observed, or of a class that does not say what it
        stores before its result, is ``telling`` the moment (:meth:`complete`). With others the status is put back.
        """
        node = self._node
        self._execute = execute

        def execute_and_tell() -> NodeStatus:
            self._pending = True
            status = execute()
            if self._pending and (status is SUCCESS or status is FAILURE):
                # The result stood already, and was not stored again.
                self.complete(status)
            return status

        def execute_and_complete() -> NodeStatus:
            before = node.status
            status = execute()
            return self._complete_or_put_back(status, before) if status is SUCCESS or status is FAILURE else status

        return execute_and_tell if telling else execute_and_complete

    def complete(self, status: NodeStatus) -> None:
        """Runs the scripts for the node's completing with this status, once in a tick."""
        if self._pending:
            self._pending = False
            self.run(status)

    def decided(self) -> None:
        """The node is not ticked, since a pre-condition has decided, whose result runs the scripts."""
        self._pending = False

    def run(self, status: NodeStatus) -> None:
        """Runs the scripts for this status."""
        for script in self._scripts[status]:
            try:
                script.bound.run()
            except ScriptError as error:
                raise script.fault(self._node, error) from error

    def _complete_or_put_back(self, status: NodeStatus, before: NodeStatus) -> NodeStatus:
        """Runs the scripts; also for the code that is made of them, when that does not fit."""
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self._warm_up
            self._specialize()
        try:
            self.run(status)
        except NodeExecutionError:
            self._node.status = RUNNING if self._node.running_first else before
            raise
        return status

    def _specialize(self) -> None:
        """Makes code for the scripts and what their entries hold now, as far as there is such code."""
        sides: list[list[CompiledScript] | None] = []
        entries: dict[str, Entry] = {}
        for status in (SUCCESS, FAILURE):
            bound = [script.bound for script in self._scripts[status]]
            found = {name: entry for one in bound for name, entry in one.entries.items()}
            # Two names of one entry: a local variable of the code could not stand for it.
            if kinds_of(found) is None or len(set(map(id, found.values()))) < len(found):
                sides.append(None)
            else:
                sides.append([one.script for one in bound])
                entries |= found
        variables = kinds_of(entries)
        if variables is None or not any(sides):
            return
        factory = completion_factory(sides, variables)
        if factory is not None:
            types = [entry.type for entry in entries.values()]
            self._exchange(
                factory(list(entries.values()), types, self._complete_or_put_back, self._node, self._execute)
            )
