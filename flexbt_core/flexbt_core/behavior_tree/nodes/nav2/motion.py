# SPDX-License-Identifier: BSD-3-Clause
"""Decorators of Nav2 that begin their child as the robot moves. The host derives from them to say how it does."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

from flexbt_core.behavior_tree.engine import Decorator, NodeConfig
from flexbt_core.behavior_tree.model import DOUBLE, FAILURE, RUNNING, STRING, SUCCESS, NodeStatus, input_port

from .goals import GOAL_PORTS, read_goals

Position = tuple[float, ...]


class DistanceController(Decorator):
    """Begins the child whenever the robot has moved on by ``distance``; RUNNING in between.

    The distance is that of the straight line to where the robot was when the child succeeded last, or when the node
    began. A RUNNING child is ticked every time. FAILURE while it is not known where the robot is.
    """

    __slots__ = ('_first', '_lost', '_start')

    ports = {
        'distance': input_port(DOUBLE, default='1.0', description='m'),
        'global_frame': input_port(STRING, optional=True, description="frame of the poses, if not the host's"),
        'robot_base_frame': input_port(STRING, optional=True, description="frame of the robot, if not the host's"),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._start: Position = ()
        self._first = True
        self._lost = False

    @abstractmethod
    def position(self) -> Position | None:
        """Where the robot is, in m, always in the same frame; None when that is not known."""

    def tick(self) -> NodeStatus:
        here = self.position()
        self._lost = here is None
        if here is None:
            return FAILURE
        if not self.active:
            self._start = here
            self._first = True
        self.status = RUNNING
        moved_on = math.dist(self._start, here) >= self.get_input('distance')
        if not (self._first or moved_on or self.child.status is RUNNING):
            return RUNNING
        self._first = False
        status = self.tick_child()
        if status is SUCCESS:
            self._start = here
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: it is not known where the robot is' if self._lost else super().failure_reason()


class SpeedController(Decorator):
    """Begins the child the more often the faster the robot is; RUNNING in between.

    The rate is ``min_rate`` at ``min_speed``, ``max_rate`` at ``max_speed``, and in proportion between them. It is set
    whenever a period is over; the first period, and that after a change of the goal, is the shortest. A RUNNING child
    is ticked every time. The node goes by the clock of the tree, and asks for a wake-up when the period is over.
    """

    __slots__ = ('_first', '_latched', '_period', '_start')

    ports = {
        'min_rate': input_port(DOUBLE, default='0.1', description='rate at min_speed and below, 1/s'),
        'max_rate': input_port(DOUBLE, default='1.0', description='rate at max_speed and above, 1/s'),
        'min_speed': input_port(DOUBLE, default='0.0', description='m/s'),
        'max_speed': input_port(DOUBLE, default='0.5', description='m/s'),
        **GOAL_PORTS,
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._latched: tuple[Any, Any] = (None, None)
        self._period = self._start = 0.0
        self._first = True

    @abstractmethod
    def speed(self) -> float:
        """How fast the robot moves over the ground, in m/s; 0.0 when that is not known."""

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        goals = read_goals(self, self._latched)
        if not self.active or goals != self._latched:
            self._latched = goals
            self._period = 1.0 / self._rate('max_rate')
            self._start = now
            self._first = True
        self.status = RUNNING
        due = now >= self._start + self._period
        if due:
            self._period = 1.0 / self._scaled_rate()
            self._start = now
        self.wake_at(self._start + self._period)
        if due or self._first or self.child.status is RUNNING:
            self._first = False
            return self.tick_child()
        return RUNNING

    def _rate(self, port: str) -> float:
        rate: float = self.get_input(port)
        if not rate > 0.0:
            raise ValueError(f'port [{port}] has to be a positive rate, not {rate}')
        return rate

    def _scaled_rate(self) -> float:
        slow, fast = self._rate('min_rate'), self._rate('max_rate')
        least: float = self.get_input('min_speed')
        most: float = self.get_input('max_speed')
        speed = self.speed()
        share = (speed - least) / (most - least) if most > least else float(speed >= most)
        return max(min(slow + share * (fast - slow), fast), slow)

    def on_halt(self) -> None:
        self.cancel_wake()
