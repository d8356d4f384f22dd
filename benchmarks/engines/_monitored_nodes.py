# SPDX-License-Identifier: BSD-3-Clause
"""A leaf for monitors.py: RUNNING for so many ticks, each of which the clock of the tree asks for."""

from __future__ import annotations

from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.ports import INT, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.skills.skill import Skill


class Busy(StatefulAction):
    """Works for ``ticks``."""

    ports = {'ticks': input_port(INT)}
    skill = Skill.of(resources=['base'])
    __slots__ = ('_left',)

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._left = 0

    def on_start(self) -> NodeStatus:
        self._left = self.get_input('ticks')
        return self.on_running()

    def on_running(self) -> NodeStatus:
        self._left -= 1
        if self._left <= 0:
            return NodeStatus.SUCCESS
        self.wake_at(self.clock.now())
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        """Nothing was begun elsewhere."""


def register(registry: NodeRegistry) -> None:
    registry.register_classes([Busy])
