# SPDX-License-Identifier: BSD-3-Clause
"""Port types for ROS messages, and the texts by which XML may give them.

The ``;`` forms are those of Nav2: a pose is ``stamp in ns; frame; x; y; z; qx; qy; qz; qw``. Any message may be written
as ``json:{...}``, with the fields that differ from their defaults.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from nav2_msgs.msg import Route
from nav_msgs.msg import Path

from flexbt_common.values import message_type_name, text_to_value, time_of_nanoseconds
from flexbt_core.behavior_tree import ConversionError, PortType
from flexbt_core.errors import FlexbtError
from flexbt_core.values import shown

from .nav2_values import TrackingFeedback

_POSE_FIELDS: Final = 9
_PATH_HEADER_FIELDS: Final = 2


def message_type(message: type[Any], from_pieces: Callable[[list[str]], Any] | None = None) -> PortType:
    """Port type of a message class. ``from_pieces`` reads the fields of a ``;`` text."""
    name = message_type_name(message)

    def from_text(text: str) -> Any:
        if text.startswith('json:'):
            try:
                return text_to_value(text.removeprefix('json:'), name)
            except FlexbtError as error:
                raise ConversionError(str(error)) from error
        if from_pieces is None:
            raise ConversionError(f'{shown(text)} is not a {name}; write json:{{...}}, or use a blackboard key {{key}}')
        try:
            return from_pieces([piece.strip() for piece in text.split(';')])
        except ValueError as error:
            raise ConversionError(f'{shown(text)} is not a {name}: {error}') from error

    return PortType(name, message, 'object', from_text)


def _pose(pieces: list[str]) -> PoseStamped:
    if len(pieces) != _POSE_FIELDS:
        raise ValueError(f'{len(pieces)} fields; expected stamp;frame;x;y;z;qx;qy;qz;qw')
    pose = PoseStamped()
    pose.header.stamp = time_of_nanoseconds(int(pieces[0]))
    pose.header.frame_id = pieces[1]
    position, orientation = pose.pose.position, pose.pose.orientation
    position.x, position.y, position.z = map(float, pieces[2:5])
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, pieces[5:])
    return pose


def _poses(pieces: list[str]) -> list[PoseStamped]:
    if len(pieces) % _POSE_FIELDS:
        raise ValueError(f'{len(pieces)} fields; expected nine for each pose')
    return [_pose(pieces[start : start + _POSE_FIELDS]) for start in range(0, len(pieces), _POSE_FIELDS)]


def _path(pieces: list[str]) -> Path:
    path = Path(poses=_poses(pieces[_PATH_HEADER_FIELDS:]))
    path.header.stamp = time_of_nanoseconds(int(pieces[0]))
    path.header.frame_id = pieces[1]
    return path


def _poses_from_text(text: str) -> list[PoseStamped]:
    if text.startswith('json:'):
        try:
            return list(text_to_value(text.removeprefix('json:'), 'geometry_msgs/msg/PoseStamped[]'))
        except FlexbtError as error:
            raise ConversionError(str(error)) from error
    try:
        return _poses(text.split(';')) if text else []
    except ValueError as error:
        raise ConversionError(f'{shown(text)} is not a list of poses: {error}') from error


POSE_STAMPED: Final = message_type(PoseStamped, _pose)
PATH: Final = message_type(Path, _path)
DURATION: Final = message_type(Duration)
POSES: Final = PortType('geometry_msgs/msg/PoseStamped[]', list, 'object', _poses_from_text)
ROUTE: Final = message_type(Route)
TRACKING_FEEDBACK: Final = PortType('nav2_msgs/msg/TrackingFeedback', TrackingFeedback)
WAYPOINT_STATUSES: Final = PortType('nav2_msgs/msg/WaypointStatus[]', list)
