# SPDX-License-Identifier: BSD-3-Clause
"""Port types for ROS messages: their text in XML, their JSON, and stand-ins for messages of Nav2's main branch."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import nav2_msgs.msg
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from nav2_msgs.msg import Route
from nav_msgs.msg import Path
from std_msgs.msg import Header

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values.entries import text_to_value, value_to_text
from flexbt_common.values.message_fields import time_of_nanoseconds
from flexbt_common.values.value_types import ValueType, message_type_name, resolve_type
from flexbt_core.behavior_tree.model.blackboard_json import JsonObject, JsonTypes
from flexbt_core.behavior_tree.model.errors import ConversionError
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, STRING, PortType
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr


@dataclass
class _TrackingFeedback:
    """The position of the robot on its path; lengths in m, speed in m/s."""

    header: Header = field(default_factory=Header)
    position_tracking_error: float = 0.0
    """Distance from the path, m; positive to the left of it."""
    heading_tracking_error: float = 0.0
    """Angle from the direction of the path to that of the robot, rad, -pi to pi."""
    current_path_index: int = 0
    robot_pose: PoseStamped = field(default_factory=PoseStamped)
    distance_to_goal: float = 0.0
    speed: float = 0.0
    remaining_path_length: float = 0.0


@dataclass
class _WaypointStatus:
    """The state of a waypoint."""

    waypoint_status: int = 0
    waypoint_index: int = 0
    waypoint_pose: PoseStamped = field(default_factory=PoseStamped)
    error_code: int = 0
    error_msg: str = ''


TrackingFeedback: Final[Any] = getattr(nav2_msgs.msg, 'TrackingFeedback', _TrackingFeedback)
WaypointStatus: Final[Any] = getattr(nav2_msgs.msg, 'WaypointStatus', _WaypointStatus)


# Port types for ROS messages, and their text in XML.
#
# The ``;`` forms are Nav2's: a pose is ``stamp in ns; frame; x; y; z; qx; qy; qz; qw``. Any message can be written as
# ``json:{...}``, with the fields that differ from their defaults.

_POSE_FIELDS: Final = 9
_PATH_HEADER_FIELDS: Final = 2


def message_type(message: type[Any], from_pieces: Callable[[list[str]], Any] | None = None) -> PortType:
    """Return the port type of a message class. ``from_pieces`` reads the fields of a ``;`` text."""
    name = message_type_name(message)
    return PortType(name, message, 'object', _reader(name, from_pieces))


def _reader(name: str, from_pieces: Callable[[list[str]], Any] | None) -> Callable[[str], Any]:
    def from_text(text: str) -> Any:
        if text.startswith('json:'):
            try:
                return text_to_value(text.removeprefix('json:'), name)
            except FlexbtError as error:
                raise ConversionError(str(error)) from error
        if from_pieces is None:
            raise ConversionError(
                f'{short_repr(text)} is not a {name}; write json:{{...}}, or use a blackboard key {{key}}'
            )
        try:
            return from_pieces([piece.strip() for piece in text.split(';')])
        except ValueError as error:
            raise ConversionError(f'{short_repr(text)} is not a {name}: {error}') from error

    return from_text


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
    if pieces == ['']:
        return []
    if len(pieces) % _POSE_FIELDS:
        raise ValueError(f'{len(pieces)} fields; expected nine for each pose')
    return [_pose(pieces[start : start + _POSE_FIELDS]) for start in range(0, len(pieces), _POSE_FIELDS)]


def _path(pieces: list[str]) -> Path:
    if len(pieces) < _PATH_HEADER_FIELDS:
        raise ValueError(f'{len(pieces)} fields; expected stamp;frame and nine for each pose')
    path = Path(poses=_poses(pieces[_PATH_HEADER_FIELDS:]))
    path.header.stamp = time_of_nanoseconds(int(pieces[0]))
    path.header.frame_id = pieces[1]
    return path


POSE_STAMPED: Final = message_type(PoseStamped, _pose)
PATH: Final = message_type(Path, _path)
DURATION: Final = message_type(Duration)
_POSES: Final = f'{POSE_STAMPED.name}[]'
POSES: Final = PortType(_POSES, list, 'object', _reader(_POSES, _poses), element=POSE_STAMPED)
ROUTE: Final = message_type(Route)
TRACKING_FEEDBACK: Final = PortType('nav2_msgs/msg/TrackingFeedback', TrackingFeedback)
_WAYPOINT_STATUS: Final = PortType('nav2_msgs/msg/WaypointStatus', WaypointStatus)
WAYPOINT_STATUSES: Final = PortType(f'{_WAYPOINT_STATUS.name}[]', list, element=_WAYPOINT_STATUS)


def array_type(resolved: ValueType) -> PortType:
    """Return the type of entries for an array: an empty list does not show that of its elements."""
    if resolved.message is not None:
        element = message_type(resolved.message)
    else:
        element = {'string[]': STRING, 'bool[]': BOOL}.get(resolved.name, DOUBLE)
    return PortType(resolved.name, list, element=element)


# ROS messages in the JSON of blackboards: any installed message, under its name.


class RosJsonTypes(JsonTypes):
    """The JSON types for all messages, and for the classes of ``others``.

    The fields of a message are those of :func:`value_to_text`, without loss.
    """

    def __init__(self, others: JsonTypes | None = None) -> None:
        super().__init__()
        self._others = others if others is not None else JsonTypes()

    def of_class(self, python_type: type[Any]) -> JsonObject | None:
        if hasattr(python_type, 'get_fields_and_field_types'):
            return _message(message_type_name(python_type))
        return super().of_class(python_type) or self._others.of_class(python_type)

    def of_name(self, name: str) -> JsonObject | None:
        resolved = _resolved(name)
        if resolved is not None and resolved.message is not None and not resolved.is_array:
            return _message(resolved.name)
        return super().of_name(name) or self._others.of_name(name)

    def port_type(self, name: str) -> PortType | None:
        known = super().port_type(name) or self._others.port_type(name)
        if known is None:
            resolved = _resolved(name)
            if resolved is not None and resolved.is_array:
                known = array_type(resolved)
        return known


def _resolved(name: str) -> ValueType | None:
    try:
        return resolve_type(name)
    except UnknownTypeError:
        return None


@functools.cache
def _message(name: str) -> JsonObject:
    message = resolve_type(name).message
    assert message is not None

    def to_json(value: Any) -> dict[str, Any]:
        try:
            fields: dict[str, Any] = json.loads(value_to_text(value, name))
        except FlexbtError as error:
            raise ConversionError(str(error)) from error
        return fields

    def from_json(fields: dict[str, Any]) -> Any:
        try:
            return text_to_value(json.dumps(fields), name)
        except FlexbtError as error:
            raise ConversionError(str(error)) from error

    return JsonObject(name, message_type(message), to_json, from_json)
