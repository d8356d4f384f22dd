# SPDX-License-Identifier: BSD-3-Clause
"""A state of the demonstrations' own: tell the operator what a path is like."""

from __future__ import annotations

import itertools
import math

from nav_msgs.msg import Path

from flexbt_core.state_machine import EventState, UserData


class ShowPathState(EventState):
    """Log length and end of a path for the operator.

    -- no parameters

    ># path      nav_msgs/Path   the path to describe

    <= done      it was described
    <= empty     it has no poses
    """

    def __init__(self) -> None:
        super().__init__(outcomes=['done', 'empty'], input_keys=['path'])

    def execute(self, userdata: UserData) -> str:
        return self.describe(userdata.path)

    def describe(self, path: Path) -> str:
        """Tell the operator what the path is like, and give the outcome."""
        if not path.poses:
            self.log_warn('The path has no poses.')
            return 'empty'
        points = [(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]
        length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
        x, y = points[-1]
        self.log_info(f'Path of {length:.1f} m in {len(points)} poses, which ends at ({x:.2f}, {y:.2f}).')
        return 'done'
