# SPDX-License-Identifier: BSD-3-Clause
"""Conversions between values of the world and ROS messages: poses, paths and grids, and the faults of navigation
servers as the simulator announces them.
"""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped
from nav_msgs.msg import MapMetaData, OccupancyGrid, Path
from std_msgs.msg import String

from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import yaw_of_quaternion
from flexbt_core.values.text import short_repr
from flexbt_core.values.yaml_data import load_yaml
from flexbt_sim.world.faults import ServerFails, ServerFault, fault_parameters
from flexbt_sim.world.plane.geometry import Pose, wrap
from flexbt_sim.world.plane.occupancy_map import MAX_RESOLUTION, MIN_RESOLUTION, OccupancyMap
from flexbt_sim.world.specification import FaultModel

from .errors import SimulationError


def quaternion(yaw: float) -> Quaternion:
    """Return the quaternion of a heading, rad."""
    return Quaternion(z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))


def pose_message(pose: Pose) -> PoseMessage:
    """Return the message of a pose in the plane."""
    message = PoseMessage()
    message.position.x, message.position.y = float(pose.x), float(pose.y)
    message.orientation = quaternion(pose.yaw)
    return message


def stamped(pose: Pose, frame: str, stamp: Time) -> PoseStamped:
    """Return a pose in a frame at a time."""
    message = PoseStamped(pose=pose_message(pose))
    message.header.frame_id = frame
    message.header.stamp = stamp
    return message


def transform(parent: str, child: str, pose: Pose, stamp: Time) -> TransformStamped:
    """Return the transform from one frame to another at a time."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, stamp
    message.transform.translation.x, message.transform.translation.y = float(pose.x), float(pose.y)
    message.transform.rotation = quaternion(pose.yaw)
    return message


def pose_of(message: PoseMessage) -> Pose:
    """Return a pose in the plane, from a message. The quaternion need not be normalized; all zeros mean heading 0."""
    yaw = yaw_of_quaternion(message.orientation)
    return Pose(float(message.position.x), float(message.position.y), wrap(yaw))


def path_message(poses: Iterable[Pose], frame: str, stamp: Time) -> Path:
    """Return a path."""
    path = Path(poses=[stamped(pose, frame, stamp) for pose in poses])
    path.header.frame_id = frame
    path.header.stamp = stamp
    return path


def grid_info(corner: Pose, resolution: float, size: tuple[int, int], stamp: Time) -> MapMetaData:
    """Return the description of a grid: ``corner`` is its lower left one, cells are ``resolution`` m wide."""
    return MapMetaData(
        map_load_time=stamp,
        resolution=float(resolution),
        width=size[0],
        height=size[1],
        origin=pose_message(corner),
    )


def grid_message(world: OccupancyMap, frame: str, stamp: Time) -> OccupancyGrid:
    """Return a map."""
    grid = OccupancyGrid(info=grid_info(world.origin, world.resolution, (world.width, world.height), stamp))
    grid.header.frame_id = frame
    grid.header.stamp = stamp
    grid.data.frombytes(world.cells.tobytes())
    return grid


def map_of(grid: OccupancyGrid) -> OccupancyMap:
    """Return a map, from a message.

    Raises:
        SimulationError: the message contradicts itself, or says nothing.
    """
    info, origin = grid.info, pose_of(grid.info.origin)
    if not info.width * info.height == len(grid.data) > 0:
        raise SimulationError(f'a map of {info.width} x {info.height} cells came with {len(grid.data)} of them')
    if not MIN_RESOLUTION <= info.resolution <= MAX_RESOLUTION or not origin.is_place:
        raise SimulationError(
            f'a map with cells of {info.resolution:g} m at {tuple(origin)} is not a map; '
            f'cells have {MIN_RESOLUTION:g} to {MAX_RESOLUTION:g} m'
        )
    cells = numpy.frombuffer(grid.data, numpy.int8).reshape(info.height, info.width)
    return OccupancyMap(cells, float(info.resolution), origin)


# The simulator's announcement of faults to navigation servers: all of them, as YAML, each as in a world file:
# ``[{fault: server_fails, parameters: {server: spin, error_code: 703}}]``.


def action_type(server: str) -> Any:
    """Return the action type of a navigation server. It loads all of Nav2's actions, which takes a while."""
    actions = vars(importlib.import_module('nav2_msgs.action'))
    return next(one for name, one in actions.items() if name.lower() == server.replace('_', ''))


def check_fault(parameters: FaultModel) -> None:
    """Check that a server can execute a fault. Faults of others always pass.

    Raises:
        SimulationError: its action does not define the error code.
    """
    if not isinstance(parameters, ServerFails):
        return
    result = action_type(parameters.server).Result
    codes = {
        name: value for name in dir(result) if name.isupper() and isinstance(value := getattr(result, name), int)
    } or {'NONE': 0}
    if parameters.error_code not in codes.values():
        known = ', '.join(f'{code} ({name})' for name, code in sorted(codes.items(), key=lambda one: one[1]))
        raise SimulationError(
            f'{parameters.name}: error_code: {parameters.server} does not know {parameters.error_code}; it has {known}'
        )


def faults_message(faults: Iterable[ServerFault]) -> String:
    """Return the message that announces the current faults."""
    return String(data=json.dumps([{'fault': one.name, 'parameters': asdict(one)} for one in faults]))


def faults_of(message: String) -> list[ServerFault]:
    """Return the faults in a message.

    Raises:
        FlexbtError, YamlError: the message has no faults, or invalid ones.
    """
    check_limits(message)
    value = load_yaml(message.data)
    if not isinstance(value, list):
        raise SimulationError(f'expected a list of faults, got {short_repr(value)}')
    return [_fault(one) for one in value]


def _fault(value: Any) -> ServerFault:
    match value:
        case {'fault': str(name), 'parameters': dict(parameters)}:
            fault = fault_parameters(name, parameters)
            check_fault(fault)
            if isinstance(fault, ServerFault):
                return fault
    raise SimulationError(f'expected {{fault: NAME, parameters: {{server: ACTION}}}}, got {short_repr(value)}')
