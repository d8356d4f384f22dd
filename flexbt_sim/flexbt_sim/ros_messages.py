# SPDX-License-Identifier: BSD-3-Clause
"""Between the plain values of this package and ROS messages."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid, Path

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import MAX_RESOLUTION, MIN_RESOLUTION, OccupancyMap, Pose, wrap


def quaternion(yaw: float) -> Quaternion:
    """A heading, rad."""
    return Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))


def pose_message(pose: Pose) -> PoseMessage:
    """A pose in the plane."""
    message = PoseMessage()
    message.position.x, message.position.y = float(pose.x), float(pose.y)
    message.orientation = quaternion(pose.yaw)
    return message


def stamped(pose: Pose, frame: str, stamp: Time) -> PoseStamped:
    """A pose in a frame at a time."""
    message = PoseStamped(pose=pose_message(pose))
    message.header.frame_id = frame
    message.header.stamp = stamp
    return message


def transform(parent: str, child: str, pose: Pose, stamp: Time) -> TransformStamped:
    """Where a frame is in another at a time."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp
    message.transform.translation.x, message.transform.translation.y = float(pose.x), float(pose.y)
    message.transform.rotation = quaternion(pose.yaw)
    return message


def pose_of(message: PoseMessage) -> Pose:
    """A pose in the plane, from a message. A quaternion of any length will do; one of all zeros means heading 0."""
    q = message.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)
    return Pose(float(message.position.x), float(message.position.y), wrap(yaw))


def path_message(poses: Iterable[Pose], frame: str, stamp: Time) -> Path:
    """A path."""
    path = Path(poses=[stamped(pose, frame, stamp) for pose in poses])
    path.header.frame_id = frame
    path.header.stamp = stamp
    return path


def grid_info(corner: Pose, resolution: float, size: tuple[int, int], stamp: Time) -> MapMetaData:
    """Of a grid: the pose of its lower left corner, the size of a cell, m, its columns and rows."""
    return MapMetaData(
        map_load_time=stamp,
        resolution=float(resolution),
        width=size[0],
        height=size[1],
        origin=pose_message(corner),
    )


def grid_message(world: OccupancyMap, frame: str, stamp: Time) -> OccupancyGrid:
    """A map."""
    grid = OccupancyGrid(info=grid_info(world.origin, world.resolution, (world.width, world.height), stamp))
    grid.header.frame_id = frame
    grid.header.stamp = stamp
    grid.data.frombytes(world.cells.tobytes())
    return grid


def map_of(grid: OccupancyGrid) -> OccupancyMap:
    """A map, from a message.

    Raises:
        SimulationError: the message contradicts itself, or says nothing.
    """
    info, origin = grid.info, pose_of(grid.info.origin)
    if not info.width * info.height == len(grid.data) > 0:
        raise SimulationError(f'a map of {info.width} x {info.height} cells came with {len(grid.data)} of them')
    if not MIN_RESOLUTION <= info.resolution <= MAX_RESOLUTION or not origin.is_place:
        raise SimulationError(
            f'a map with cells of {info.resolution:g} m at {tuple(origin)} is no map; '
            f'cells have {MIN_RESOLUTION:g} to {MAX_RESOLUTION:g} m'
        )
    cells = numpy.frombuffer(grid.data, numpy.int8).reshape(info.height, info.width)
    return OccupancyMap(cells, float(info.resolution), origin)
