# SPDX-License-Identifier: BSD-3-Clause
"""Conditions of Nav2 on the time that has passed, by the clock of the tree, and on what was heard."""

from __future__ import annotations

from typing import Any, Final

from flexbt_core.behavior_tree.engine import Condition, NodeConfig
from flexbt_core.behavior_tree.model import (
    BOOL,
    DOUBLE,
    FAILURE,
    IDLE,
    SUCCESS,
    Example,
    NodeStatus,
    cast,
    input_port,
)

_SECONDS: Final = input_port(DOUBLE, default='1.0', description='s')


class TimeExpired(Condition):
    """SUCCESS whenever ``seconds`` have passed; the first tick after IDLE only begins to count.

    Below nodes that set it to IDLE, such as a ReactiveSequence with a child that is RUNNING, it begins anew in each
    tick. It asks for a wake-up when the time is over.
    """

    __slots__ = ('_start',)

    ports = {'seconds': _SECONDS}
    example = Example(
        '<Fallback><TimeExpired seconds="2"/><AlwaysSuccess/></Fallback>',
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._start = 0.0

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        seconds: float = self.get_input('seconds')
        begins = self.status is IDLE
        # The comparison is the one of the wake-up time: a difference of times could round to less than the period.
        expired = not begins and now >= self._start + seconds
        if begins or expired:
            self._start = now
        self.wake_at(self._start + seconds)
        return SUCCESS if expired else FAILURE


class PathExpiringTimer(Condition):
    """SUCCESS when the path on the blackboard has been the same for ``seconds``, and whenever they have passed again.

    The first tick of the tree's life only begins to count. It asks for a wake-up when the time is over.
    """

    __slots__ = ('_first', '_path', '_start')

    ports = {
        'seconds': _SECONDS,
        'path': input_port(optional=True, description='the path'),
    }
    example = Example('<PathExpiringTimer seconds="10" path="{path}"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._first = True
        self._path: Any = None
        self._start = 0.0

    def tick(self) -> NodeStatus:
        path = self.get_input_or('path', None)
        now = self.clock.now()
        # The blackboard gives the same object until it is written again: no comparison of hundreds of poses.
        if self._first or (path is not self._path and path != self._path):
            self._start = now
        self._path = path
        end = self._start + self.get_input('seconds')
        first, self._first = self._first, False
        if first or now < end:
            self.wake_at(end)
            return FAILURE
        self._start = now
        return SUCCESS


class InitialPoseReceived(Condition):
    """SUCCESS when the entry says that a first pose of the robot was received."""

    __slots__ = ()

    ports = {
        'initial_pose_received': input_port(
            BOOL, optional=True, description='whether it was; by default the entry [initial_pose_received]'
        )
    }
    example = Example('<InitialPoseReceived/>', ticks=(SUCCESS,), before={'initial_pose_received': True})

    def tick(self) -> NodeStatus:
        if self.port_text('initial_pose_received') is None:
            received = cast(self.blackboard.get_or('initial_pose_received', False), BOOL)
        else:
            received = self.get_input_or('initial_pose_received', False)
        return SUCCESS if received else self.fail('no first pose of the robot was received')


NODES: Final = (TimeExpired, PathExpiringTimer, InitialPoseReceived)
