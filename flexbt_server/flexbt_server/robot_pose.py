# SPDX-License-Identifier: BSD-3-Clause
"""The robot's pose, and how far it is from the end of a path: for the feedback of running trees."""

from __future__ import annotations

import itertools
import math
from typing import Any

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_common.node_runtime import NodeRuntime

UNKNOWN_DISTANCE = -1.0


class RobotPose:
    """The last message of the pose topic; ``latest`` has an empty frame until there is one."""

    def __init__(self, runtime: NodeRuntime, topic: str) -> None:
        self.latest = PoseStamped()
        runtime.node.create_subscription(PoseStamped, topic, self._on_pose, 1)

    def _on_pose(self, pose: PoseStamped) -> None:
        self.latest = pose


def distance_along(path: Any, pose: PoseStamped) -> float:
    """Metres along ``path`` from its pose nearest to ``pose`` to its end; negative when either is unknown."""
    if not isinstance(path, Path) or not path.poses or not pose.header.frame_id:
        return UNKNOWN_DISTANCE
    here = (pose.pose.position.x, pose.pose.position.y)
    points = [(stamped.pose.position.x, stamped.pose.position.y) for stamped in path.poses]
    nearest = min(range(len(points)), key=lambda index: math.dist(points[index], here))
    ahead = points[nearest:]
    return math.dist(here, ahead[0]) + sum(math.dist(a, b) for a, b in itertools.pairwise(ahead))
