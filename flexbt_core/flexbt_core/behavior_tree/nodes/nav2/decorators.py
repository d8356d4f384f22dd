# SPDX-License-Identifier: BSD-3-Clause
"""Decorators of Nav2 that start their child by rate, by the robot's motion, or by the length of the path."""

from __future__ import annotations

import itertools
import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Final

from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import DOUBLE, STRING, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, RUNNING, SUCCESS, NodeStatus

from .conditions import GOAL_PORTS, read_goals


class RateController(Decorator):
    """Starts the child at most ``hz`` times a second; RUNNING in between. Ticks a RUNNING child at every tick.

    The period starts with the last success of the child, on the clock of the tree (Nav2: the machine's). The node
    requests a wake-up at its end.
    """

    __slots__ = ('_period', '_start')

    ports = {'hz': input_port(DOUBLE, default='10.0', description='rate in 1/s')}
    example = Example(
        '<RateController hz="2"><Script code="n += 1"/></RateController>',
        ticks=(SUCCESS,),
        before={'n': 0},
        after={'n': 1},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._period = self._start = 0.0

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        begins = not self.active
        if begins:
            hz: float = self.get_input('hz')
            if not hz > 0.0:
                raise ValueError(f'port [hz] has to be a positive rate, not {hz}')
            self._period = 1.0 / hz
            self._start = now
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        # Compare with the wake-up time: a difference of times could round to less than the period.
        if not begins and self.child.stored_status is not RUNNING and now < self._start + self._period:
            self.wake_at(self._start + self._period)
            return RUNNING
        status = self.tick_child()
        if status is SUCCESS:
            self._start = now
            self.wake_at(now + self._period)
        return status

    def on_halt(self) -> None:
        self.cancel_wake()


class SingleTrigger(Decorator):
    """Runs the child once; then FAILURE until the node is set to IDLE."""

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
        if self.stored_status is not RUNNING:
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


# Decorators of Nav2 that start their child as the robot moves. The host derives from them to provide the motion.

Position = tuple[float, ...]


class DistanceController(Decorator):
    """Starts the child whenever the robot has moved by ``distance``; RUNNING in between.

    The distance is the straight line from the robot's position at the last success of the child, or at the start of the
    node. Ticks a RUNNING child at every tick. While the position of the robot is unknown, halts the child and returns
    FAILURE.
    """

    __slots__ = ('_lost', '_start')

    ports = {
        'distance': input_port(DOUBLE, default='1.0', description='m'),
        'global_frame': input_port(STRING, optional=True, description="frame of the poses, if not the host's"),
        'robot_base_frame': input_port(STRING, optional=True, description="frame of the robot, if not the host's"),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._start: Position = ()
        self._lost = False

    @abstractmethod
    def position(self) -> Position | None:
        """Return the position of the robot, in m, always in the same frame; None if it is unknown."""

    def tick(self) -> NodeStatus:
        here = self.position()
        self._lost = here is None
        if here is None:
            self.halt_child()
            return FAILURE
        distance: float = self.get_input('distance')
        begins = not self.active or not self._start  # it may have failed before it knew a position
        if begins:
            self._start = here
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        moved_on = math.dist(self._start, here) >= distance
        if not (begins or moved_on or self.child.stored_status is RUNNING):
            return RUNNING
        status = self.tick_child()
        if status is SUCCESS:
            self._start = here
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: it is not known where the robot is' if self._lost else super().failure_reason()


class SpeedController(Decorator):
    """Starts the child at a rate that grows with the speed of the robot; RUNNING in between.

    The rate is ``min_rate`` at ``min_speed``, ``max_rate`` at ``max_speed``, and linear between them. The node updates
    it at the end of each period; the first period, and that after a change of the goal, is the shortest. It ticks a
    RUNNING child at every tick. It uses the clock of the tree, and requests a wake-up at the end of the period.
    """

    __slots__ = ('_latched', '_period', '_start')

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

    @abstractmethod
    def speed(self) -> float:
        """Return the speed of the robot over the ground, in m/s; 0.0 if it is unknown."""

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        goals = read_goals(self, self._latched)
        begins = not self.active or goals != self._latched
        if begins:
            self._latched = goals
            self._period = 1.0 / self._rate('max_rate')
            self._start = now
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        due = now >= self._start + self._period
        if due:
            self._period = 1.0 / self._scaled_rate()
            self._start = now
        self.wake_at(self._start + self._period)
        if due or begins or self.child.stored_status is RUNNING:
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
        if math.isnan(speed):  # of a broken odometry; the period would never end
            speed = 0.0
        share = (speed - least) / (most - least) if most > least else float(speed >= most)
        return max(min(slow + share * (fast - slow), fast), slow)

    def on_halt(self) -> None:
        self.cancel_wake()


# The decorator of Nav2 that compares paths. A path is anything with the fields of a nav_msgs/Path.


class PathLongerOnApproach(Decorator):
    """Ticks the child if the robot is close to its goal and its new path is much longer; SUCCESS otherwise.

    Close: the previous path, to the same goal, was shorter than ``prox_len``. Much longer: more than ``length_factor``
    times the previous path. The node keeps comparing with that path while the child is RUNNING or skipped.
    """

    __slots__ = ('_new', '_old')

    ports = {
        'path': input_port(optional=True, description='the path that is planned'),
        'prox_len': input_port(DOUBLE, default='3.0', description='length below which the robot is close, m'),
        'length_factor': input_port(DOUBLE, default='2.0', description='how many times longer is much longer'),
    }
    example = Example('<PathLongerOnApproach path="{path}" prox_len="3.0"><AlwaysSuccess/></PathLongerOnApproach>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._new: Any = None
        self._old: Any = None

    def tick(self) -> NodeStatus:
        self._new = self.get_input_or('path', self._new)
        old, new = _poses(self._old), _poses(self._new)
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        is_same_goal = bool(old and new) and old[-1].pose == new[-1].pose
        if is_same_goal and self._much_longer(old, new):
            status = self.tick_child()
            if status is SUCCESS or status is FAILURE:
                self._old = self._new
            return status
        self._old = self._new
        return SUCCESS

    def _much_longer(self, old: Sequence[Any], new: Sequence[Any]) -> bool:
        if len(old) == len(new):
            return False
        length = _length(old)
        close: bool = length < self.get_input('prox_len')
        longer: bool = _length(new) > self.get_input('length_factor') * length
        return close and longer


def _poses(path: Any) -> Sequence[Any]:
    poses: Sequence[Any] = () if path is None else path.poses
    return poses


def _length(poses: Sequence[Any]) -> float:
    """Return the length of the path over the ground, in m."""
    points = [(pose.pose.position.x, pose.pose.position.y) for pose in poses]
    return sum(math.dist(one, other) for one, other in itertools.pairwise(points))


NODES: Final = (
    RateController,
    SingleTrigger,
    PathLongerOnApproach,
)
