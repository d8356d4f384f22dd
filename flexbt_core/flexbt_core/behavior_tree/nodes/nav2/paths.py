# SPDX-License-Identifier: BSD-3-Clause
"""The decorator of Nav2 that compares paths. A path is anything with the fields of a nav_msgs/Path."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any, Final

from flexbt_core.behavior_tree.engine import Decorator, NodeConfig
from flexbt_core.behavior_tree.model import (
    DOUBLE,
    FAILURE,
    RUNNING,
    SUCCESS,
    Example,
    NodeStatus,
    input_port,
)


class PathLongerOnApproach(Decorator):
    """Ticks the child when the robot is close to its goal and gets a path that is much longer; SUCCESS otherwise.

    Close: the path before, to the same goal, was shorter than ``prox_len``. Much longer: more than ``length_factor``
    times that path, which stays the one to compare with as long as the child is RUNNING or skipped.
    """

    __slots__ = ('_first', '_new', '_old')

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
        self._first = True

    def tick(self) -> NodeStatus:
        self._new = self.get_input_or('path', self._new)
        old, new = _poses(self._old), _poses(self._new)
        if not old or not new or old[-1].pose != new[-1].pose:
            self._first = True
        self.status = RUNNING
        if not self._first and self._much_longer(old, new):
            status = self.tick_child()
            if status is SUCCESS or status is FAILURE:
                self._old = self._new
            return status
        self._old = self._new
        self._first = False
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
    """Metres along the path, over the ground."""
    points = [(pose.pose.position.x, pose.pose.position.y) for pose in poses]
    return sum(math.dist(one, other) for one, other in itertools.pairwise(points))


NODES: Final = (PathLongerOnApproach,)
