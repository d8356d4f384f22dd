# SPDX-License-Identifier: BSD-3-Clause
"""Timeout, Delay and Sleep, the nodes that depend on time. They request a wake-up at their deadline."""

from __future__ import annotations

import math
from typing import Final

from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode, halt_child
from flexbt_core.behavior_tree.engine.parents import DecoratorNode
from flexbt_core.behavior_tree.model.blackboard import MISSING
from flexbt_core.behavior_tree.model.outcomes import Example, Exchanged, Lasting, TimeLimit
from flexbt_core.behavior_tree.model.ports import UNSIGNED, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeStatus


class Timeout(DecoratorNode):
    """Halts the child and returns FAILURE if the child is still RUNNING ``msec`` milliseconds after the first tick.

    0 means no limit. The node requests a wake-up at the deadline, and checks it in the first tick at or after it. If
    the child was skipped and is not RUNNING at that tick, the limit no longer applies, as in BehaviorTree.CPP.
    """

    __slots__ = ('_deadline', '_expired')

    ports = {'msec': input_port(UNSIGNED, description='limit in ms; 0: none')}
    outcomes = TimeLimit('msec')
    example = Example('<Timeout msec="100"><Sleep msec="500"/></Timeout>', ticks=(RUNNING, FAILURE))

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._deadline: float | None = None
        self._expired = False

    def execute(self) -> NodeStatus:
        msec: int = self.get_input('msec')
        if self._deadline is None:
            self._expired = False
            self.status = RUNNING
            if msec > 0:
                self._deadline = self.clock.now() + msec / 1000.0
                self.wake_at(self._deadline)
            else:
                self._deadline = math.inf
        elif self._deadline <= self.clock.now():
            if self.child.stored_status is RUNNING:
                halt_child(self.child)
                self._expired = True
                self._deadline = None
                self.status = FAILURE
                return FAILURE
            self._deadline = math.inf
        status = self._tick()
        if status is SUCCESS or status is FAILURE:
            self._stop()
            self.child.status = IDLE
            self.status = status
        return status

    def _stop(self) -> None:
        self.cancel_wake()
        self._deadline = None

    def halt(self) -> None:
        self._stop()
        super().halt()

    def failure_cause(self) -> TreeNode | None:
        return None if self._expired else self.child

    def failure_reason(self) -> str:
        if not self._expired:
            return super().failure_reason()
        return f'{self.id}: the time is up for the child [{self.child.path}] (msec="{self.port_text("msec")}")'


class Delay(DecoratorNode):
    """Waits once, ``delay_msec`` milliseconds, before it ticks the child. RUNNING meanwhile, for at least one tick."""

    __slots__ = ('_begun', '_delay')

    running_at_completion = False
    ports = {'delay_msec': input_port(UNSIGNED, description='time to wait in ms')}
    outcomes = Exchanged(waits=True, delay='delay_msec')
    example = Example('<Delay delay_msec="100"><AlwaysSuccess/></Delay>', ticks=(RUNNING, SUCCESS))

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._begun = False
        self._delay = MISSING

    def execute(self) -> NodeStatus:
        delay = self._delay.value
        if delay.__class__ is not int:
            delay = self.get_input('delay_msec')
            self._delay = self.ready_entry('delay_msec')
        if not self._begun:
            self._begun = True
            self.wake_at(self.clock.now() + delay / 1000.0)
            self.status = RUNNING
            return RUNNING
        if self in self.context.deadlines:
            # The delay had not elapsed when this tick began.
            self.status = RUNNING
            return RUNNING
        # The delay stays elapsed while the child runs.
        status = self._tick()
        if status is SUCCESS or status is FAILURE:
            self._begun = False
            self.child.status = IDLE
            self.status = status
        return status

    def halt(self) -> None:
        self.cancel_wake()
        self._begun = False
        super().halt()


class Sleep(StatefulAction):
    """RUNNING for ``msec`` milliseconds, then SUCCESS."""

    __slots__ = ('_deadline',)

    _deadline: float
    goes_on = ''  # it only waits

    ports = {'msec': input_port(UNSIGNED, description='time to sleep in ms')}
    outcomes = Lasting((RUNNING, SUCCESS), 'msec', 0.001)
    example = Example('<Sleep msec="100"/>', ticks=(RUNNING, SUCCESS))

    def on_start(self) -> NodeStatus:
        msec: int = self.get_input('msec')
        if msec == 0:
            return SUCCESS
        self._deadline = self.clock.now() + msec / 1000.0
        self.wake_at(self._deadline)
        return RUNNING

    def on_running(self) -> NodeStatus:
        return SUCCESS if self.clock.now() >= self._deadline else RUNNING

    def on_halted(self) -> None:
        pass


NODES: Final = (
    Timeout,
    Delay,
    Sleep,
)
