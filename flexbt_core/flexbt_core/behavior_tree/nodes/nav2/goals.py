# SPDX-License-Identifier: BSD-3-Clause
"""The nodes of Nav2 that ask whether the goal has changed, and what they share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from flexbt_core.behavior_tree.engine import Condition, Decorator, NodeConfig, TreeNode
from flexbt_core.behavior_tree.model import (
    FAILURE,
    IDLE,
    RUNNING,
    SUCCESS,
    Example,
    NodeStatus,
    Port,
    input_port,
)

GOAL_PORTS: Final[Mapping[str, Port]] = {
    'goal': input_port(optional=True, description='goal pose; by default the entry [goal]'),
    'goals': input_port(optional=True, description='poses to pass; by default the entry [goals]'),
}


def read_goals(node: TreeNode, latched: tuple[Any, Any]) -> tuple[Any, Any]:
    """Goal and goals: by the ports, else by the entries of these names, else as they were ``latched`` before."""
    return _read(node, 'goal', latched[0]), _read(node, 'goals', latched[1])


def _read(node: TreeNode, port: str, latched: Any) -> Any:
    if node.port_text(port) is None:
        return node.blackboard.get_or(port, latched)
    return node.get_input_or(port, latched)


class GoalUpdated(Condition):
    """SUCCESS, once, when the goal differs from the one of the tick before.

    The first tick after the node was set to IDLE only remembers the goal. So it never fires directly below a reactive
    node with a child that is RUNNING, which sets it to IDLE in every tick; Nav2's recovery branch is such a case.
    """

    __slots__ = ('_latched',)

    ports = GOAL_PORTS
    example = Example('<GoalUpdated/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._latched: tuple[Any, Any] = (None, None)

    def tick(self) -> NodeStatus:
        current = read_goals(self, self._latched)
        changed = self.status is not IDLE and current != self._latched
        self._latched = current
        return SUCCESS if changed else FAILURE


class GlobalUpdatedGoal(Condition):
    """SUCCESS in the first tick of the tree's life, and whenever the goal differs from the one of the tick before."""

    __slots__ = ('_first', '_latched')

    ports = GOAL_PORTS
    example = Example('<GlobalUpdatedGoal/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._first = True
        self._latched: tuple[Any, Any] = (None, None)

    def tick(self) -> NodeStatus:
        current = read_goals(self, self._latched)
        changed = self._first or current != self._latched
        self._first = False
        self._latched = current
        return SUCCESS if changed else FAILURE


class GoalUpdatedController(Decorator):
    """Ticks the child at first, whenever the goal has changed, and as long as it is RUNNING; RUNNING otherwise."""

    __slots__ = ('_latched', '_updated')

    ports = GOAL_PORTS
    example = Example('<GoalUpdatedController><AlwaysSuccess/></GoalUpdatedController>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._latched: tuple[Any, Any] = (None, None)
        self._updated = False

    def tick(self) -> NodeStatus:
        current = read_goals(self, self._latched)
        if not self.active or current != self._latched:
            self._updated = True
        self._latched = current
        self.status = RUNNING
        if self._updated or self.child.status is RUNNING:
            self._updated = False
            return self.tick_child()
        return RUNNING


NODES: Final = (GoalUpdatedController, GoalUpdated, GlobalUpdatedGoal)
