# SPDX-License-Identifier: BSD-3-Clause
"""The result of each waypoint of a mission, as the branch main of Nav2 keeps it on the blackboard."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from typing import Any, Final

import nav2_msgs.msg
from geometry_msgs.msg import PoseStamped

from flexbt_server.trees.ros_ports import WaypointStatus

PENDING: Final = 0
COMPLETED: Final = 1
SKIPPED: Final = 2
FAILED: Final = 3


def pending(goals: Iterable[PoseStamped]) -> list[Any]:
    """Return the statuses at the start of a mission."""
    return [WaypointStatus(waypoint_index=index, waypoint_pose=goal) for index, goal in enumerate(goals)]


def missed(index: int, pose: PoseStamped, error_code: int, error_msg: str) -> Any:
    """Return a missed waypoint as FollowWaypoints reports it: MissedWaypoint in jazzy, WaypointStatus in main.


    ``error_code`` comes from navigate_to_pose.
    """
    if hasattr(nav2_msgs.msg, 'MissedWaypoint'):
        return nav2_msgs.msg.MissedWaypoint(index=index, goal=pose, error_code=error_code)
    return WaypointStatus(
        waypoint_status=FAILED, waypoint_index=index, waypoint_pose=pose, error_code=error_code, error_msg=error_msg
    )


def concluded(statuses: Iterable[Any], *, succeeded: bool) -> list[Any]:
    """Return the statuses of a mission that has ended: pending waypoints get the outcome of the mission."""
    ended = [copy.copy(one) for one in statuses]
    for one in ended:
        if one.waypoint_status == PENDING:
            one.waypoint_status = COMPLETED if succeeded else FAILED
    return ended


def mark(statuses: Sequence[Any], goals: Iterable[PoseStamped], status: int) -> list[Any]:
    """Return the statuses with ``status`` in the first pending one of each goal.

    Raises:
        LookupError: a goal has no pending status.
    """
    marked = list(statuses)
    for goal in goals:
        for index, one in enumerate(marked):
            if one.waypoint_status == PENDING and one.waypoint_pose == goal:
                marked[index] = copy.copy(one)
                marked[index].waypoint_status = status
                break
        else:
            at = goal.pose.position
            raise LookupError(f'no pending waypoint status is that of the goal at ({at.x:g}, {at.y:g})')
    return marked
