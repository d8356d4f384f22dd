# SPDX-License-Identifier: BSD-3-Clause
"""A state of the night watch: find what is not on the map."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan

from flexbt_core.state_machine import EventState, UserData

OCCUPIED = 65
"""Percent from which a cell of the map counts as occupied."""

TOLERANCE = 0.25
"""A beam that ends so near to something on the map has hit that, m."""

BEAMS = 5
"""So many beams have to end elsewhere: fewer may be noise."""

THERE = 0.5
"""A robot so near to a place is there, m: twice what the controller leaves of the way."""


class CompareScanState(EventState):
    """
    Compare a scan with the map: what stands round the robot that is not on the map?

    -- reach        float       How far from the robot it counts, m

    ># map          nav_msgs/OccupancyGrid      The map
    ># goal         geometry_msgs/PoseStamped   The place from which it is looked
    ># pose         geometry_msgs/PoseStamped   Where the robot is on the map
    ># scan         sensor_msgs/LaserScan       What it sees

    #> finding      geometry_msgs/PoseStamped   Where that is, if there is something; the place, if it is beside

    <= found                    There is something; the operator is told where.
    <= clear                    Everything that is seen is on the map.
    <= elsewhere                The robot is not at that place: it was driven away meanwhile.
    <= beside                   Nor is it the next time: it does not get there, as where something stands on the place.
    """

    is_instant = True

    def __init__(self, reach: float = 2.0) -> None:
        super().__init__(
            outcomes=['found', 'clear', 'elsewhere', 'beside'],
            input_keys=['map', 'goal', 'pose', 'scan'],
            output_keys=['finding'],
            desired_rate=None,
        )
        self._reach = reach
        self._missed: PoseStamped | None = None

    def execute(self, userdata: UserData) -> str:
        goal, missed = userdata.goal, self._missed
        self._missed = None
        frames = [message.header.frame_id for message in (userdata.map, goal, userdata.pose)]
        if len(set(frames)) > 1:
            raise ValueError(f'map, goal and pose have to be in one frame; they are in {", ".join(map(repr, frames))}')
        place, here = goal.pose.position, userdata.pose.pose.position
        away = math.hypot(here.x - place.x, here.y - place.y)
        if away > THERE and goal != missed:
            self._missed = goal
            self.log_info(f'the robot is {away:.1f} m from where it shall look: it was driven away meanwhile')
            return 'elsewhere'
        if away > THERE:
            userdata.finding = goal
            self.log_warn(f'the robot is {away:.1f} m from where it shall look, again: something may stand there')
            return 'beside'
        points = unexpected_points(userdata.map, userdata.pose, userdata.scan, self._reach)
        if len(points) < BEAMS:
            return 'clear'
        x, y = points.mean(axis=0)
        finding = PoseStamped(header=userdata.pose.header)
        finding.pose.position.x, finding.pose.position.y = float(x), float(y)
        userdata.finding = finding
        self.log_warn(f'{len(points)} beams end at something that is not on the map, near ({x:.1f}, {y:.1f})')
        return 'found'


def unexpected_points(
    grid: OccupancyGrid, pose: PoseStamped, scan: LaserScan, reach: float
) -> NDArray[np.float64]:  # fmt: skip
    """Ends of beams in the map, m, as rows [x, y]: those within ``reach`` (m) that are not near an occupied cell."""
    ranges = np.asarray(scan.ranges, dtype=float)
    yaw = 2.0 * math.atan2(pose.pose.orientation.z, pose.pose.orientation.w)
    angles = yaw + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    seen = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= reach)
    ends = np.stack([np.cos(angles[seen]), np.sin(angles[seen])], axis=1) * ranges[seen, None]
    ends += pose.pose.position.x, pose.pose.position.y

    info = grid.info
    cells = np.asarray(grid.data, dtype=np.int8).reshape(info.height, info.width) >= OCCUPIED
    rows, columns = np.nonzero(cells)
    origin = np.array([info.origin.position.x, info.origin.position.y])
    walls = origin + (np.stack([columns, rows], axis=1) + 0.5) * info.resolution
    near = walls[np.hypot(*(walls - (pose.pose.position.x, pose.pose.position.y)).T) <= reach + TOLERANCE]
    if not len(near) or not len(ends):
        return ends
    distances = np.hypot(*np.moveaxis(ends[:, None, :] - near[None, :, :], 2, 0)).min(axis=1)
    return np.asarray(ends[distances > TOLERANCE])
