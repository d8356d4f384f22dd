# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-conditions that are one function with the code of their scripts, when they run often."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from flexbt_core.behavior_tree.engine import Conditions, NodeScript, Tick, TreeNode
from flexbt_core.behavior_tree.model import FAILURE, RUNNING, SUCCESS, Entry, NodeExecutionError, NodeStatus, Script

from .node_classes import stores_directly
from .specialized_scripts import (
    SpecializedBoundScript,
    SpecializedScript,
    kinds_of,
    post_conditions_factory,
    pre_conditions_factory,
)


class SpecializedConditions(Conditions):
    """The conditions of one node, and the tick function that is made of them; which that is changes at times."""

    __slots__ = (
        '_around',
        '_asking',
        '_asking_due',
        '_completing',
        '_completing_due',
        '_inner',
        '_ticking',
    )

    def __init__(self, node: TreeNode, scripts: Mapping[str, Script]) -> None:
        super().__init__(node, scripts)
        self._around: tuple[Any, ...] | None = None
        self._asking_due = _warm_up(self._pre)
        self._completing_due = _warm_up([script for side in self._post.values() for script in side])

    def around(self, tick: Tick) -> Tick:
        # The same tick in the same surroundings: the code that was made stays.
        around = (self._node.context.callbacks, type(self._node))
        if around != self._around:
            self._around = around
            self._inner = tick
            self._surround(self._bare_completing(tick) if self.completing else tick)
        return self._asking

    def _surround(self, completing: Tick) -> None:
        """Puts the pre-conditions before ``completing``."""
        self._completing = completing
        self._ticking = self._after_pre_conditions(completing)
        self._asking: Tick = self._ask_and_tick if self._pre else completing

    # -- pre-conditions ----------------------------------------------------------------------------------------------

    def _ask_and_tick(self) -> NodeStatus:
        """Ticks the node after its pre-conditions; also for the code that is made of them, when that does not fit."""
        self._asking_due -= 1
        if self._asking_due <= 0:
            self._asking_due = _warm_up(self._pre)
            self._specialize_asking()
        return self._ticking()

    def _specialize_asking(self) -> None:
        """Makes code for the pre-conditions and what their entries hold now, if there is such code."""
        asking: Tick = self._ask_and_tick
        entries = {name: entry for script in self._pre for name, entry in _bound(script).entries.items()}
        variables = kinds_of(entries)
        if variables is not None:
            factory = pre_conditions_factory(
                [_bound(script).script for script in self._pre],
                [script.decisive for script in self._pre],
                variables,
                ongoing=self.asks_while_running,
                forgetful=self._pre[0].result is FAILURE,
            )
            if factory is not None:
                found = list(entries.values())
                types = [entry.type for entry in found]
                asking = factory(found, types, self._ask_and_tick, self._node, self._completing, self)
        if asking != self._asking:
            self._asking = asking
            self._node.context.rewrapped.append(self._node)

    # -- post-conditions ---------------------------------------------------------------------------------------------

    def _bare_completing(self, tick: Tick) -> Tick:
        """``tick`` with the post-conditions. When the store of the result is no call, they run after it, and the status
        is put back when one raises."""
        node = self._node
        if not stores_directly(node):
            return self._before_post_conditions(tick)

        def tick_and_complete() -> NodeStatus:
            before = node.status
            status = tick()
            return self._complete_or_put_back(status, before) if status is SUCCESS or status is FAILURE else status

        return tick_and_complete

    def _complete_or_put_back(self, status: NodeStatus, before: NodeStatus) -> NodeStatus:
        """Runs the scripts; also for the code that is made of them, when that does not fit."""
        self._completing_due -= 1
        if self._completing_due <= 0:
            self._completing_due = _warm_up([script for side in self._post.values() for script in side])
            self._specialize_completing()
        try:
            self._run(status)
        except NodeExecutionError:
            self._node.status = RUNNING if self._node.running_at_completion else before
            raise
        return status

    def _specialize_completing(self) -> None:
        """Makes code for the scripts and what their entries hold now, as far as there is such code."""
        sides: list[list[SpecializedScript] | None] = []
        entries: dict[str, Entry] = {}
        for status in (SUCCESS, FAILURE):
            bound = [_bound(script) for script in self._post[status]]
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
        factory = post_conditions_factory(sides, variables)
        if factory is not None:
            types = [entry.type for entry in entries.values()]
            completing = factory(list(entries.values()), types, self._complete_or_put_back, self._node, self._inner)
            self._surround(completing)
            self._node.context.rewrapped.append(self._node)


def _bound(script: NodeScript) -> SpecializedBoundScript:
    """Scripts are made by the same acceleration."""
    bound: Any = script.bound
    return bound


def _warm_up(scripts: Sequence[NodeScript]) -> int:
    return max((_bound(script).script.warm_up for script in scripts), default=0)
