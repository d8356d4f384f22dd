# SPDX-License-Identifier: BSD-3-Clause
"""Decorators of Nav2 that limit how often their child begins."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine import Decorator, NodeConfig
from flexbt_core.behavior_tree.model import DOUBLE, FAILURE, RUNNING, SUCCESS, Example, NodeStatus, input_port


class RateController(Decorator):
    """Begins the child ``hz`` times a second at most; RUNNING in between. A RUNNING child is ticked every time.

    The period counts from the last success of the child. Unlike Nav2's, which knows only the machine's clock, it goes
    by the clock of the tree, so simulated time speeds it up; it asks for a wake-up when the period is over.
    """

    __slots__ = ('_first', '_period', '_start')

    ports = {'hz': input_port(DOUBLE, default='10.0', description='rate in 1/s')}
    example = Example(
        '<RateController hz="2"><Script code="n += 1"/></RateController>',
        ticks=(SUCCESS,),
        before={'n': 0},
        after={'n': 1},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._period = 0.0
        self._start = 0.0
        self._first = True

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        if not self.active:
            hz: float = self.get_input('hz')
            if not hz > 0.0:
                raise ValueError(f'port [hz] has to be a positive rate, not {hz}')
            self._period = 1.0 / hz
            self._start = now
            self._first = True
        self.status = RUNNING
        # The comparison is the one of the wake-up time: a difference of times could round to less than the period.
        if not self._first and self.child.status is not RUNNING and now < self._start + self._period:
            self.wake_at(self._start + self._period)
            return RUNNING
        self._first = False
        status = self.tick_child()
        if status is SUCCESS:
            self._start = now
            self.wake_at(now + self._period)
        return status

    def on_halt(self) -> None:
        self.cancel_wake()


class SingleTrigger(Decorator):
    """Runs the child once; FAILURE from then on, until the node is set to IDLE."""

    __slots__ = ('_armed',)

    example = Example(
        """
        <KeepRunningUntilFailure>
          <Inverter><SingleTrigger><AlwaysFailure/></SingleTrigger></Inverter>
        </KeepRunningUntilFailure>
        """,
        ticks=(RUNNING, RUNNING),
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._armed = True

    def tick(self) -> NodeStatus:
        if not self.active:
            self._armed = True
        self.status = RUNNING
        if not self._armed:
            return FAILURE
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self._armed = False
        return status

    def failure_reason(self) -> str:
        if self._child_failed:
            return super().failure_reason()
        return f'{self.id}: the child [{self.child.path}] had its one run before'


NODES: Final = (RateController, SingleTrigger)
