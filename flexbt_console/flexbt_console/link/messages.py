# SPDX-License-Identifier: BSD-3-Clause
"""Convert messages of the operator link to records of the mirror, and commands to messages.

The records declare the fields. :data:`RECORDS` and :data:`FIELDS` add what differs from the messages.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from itertools import starmap
from typing import Any, Final, TypeVar, get_args, get_origin, get_type_hints

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose, PoseStamped
from std_msgs.msg import Header

from flexbt_common.values.entries import from_entry
from flexbt_common.values.message_fields import options_message, path_points, seconds_of, yaw_of_quaternion
from flexbt_common.values.queue_options import QueueOptions
from flexbt_console.mirror import records
from flexbt_console.mirror.trees import MirroredNode, StatusChange, TreeNodes, TreeReport
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import sanitize_for_message, short_repr
from flexbt_msgs import msg
from flexbt_msgs.action import SynthesizeBehavior
from flexbt_msgs.srv import GetTreeBlackboard

FARTHEST: Final = 1e9
"""Maximum accepted distance from the origin of a map, m."""

E = TypeVar('E', bound=IntEnum)
N = TypeVar('N', int, float)


RECORDS: Final[Mapping[type, type]] = {
    GetTreeBlackboard.Response: records.TreeBlackboard,
    SynthesizeBehavior.Result: records.Synthesis,
    msg.ActiveState: records.ActiveState,
    msg.BehaviorInput: records.BehaviorInput,
    msg.BehaviorList: records.BehaviorList,
    msg.BehaviorManifest: records.Behavior,
    msg.BehaviorParameter: records.BehaviorParameter,
    msg.BehaviorStructure: records.Structure,
    msg.CommandResult: records.CommandResult,
    msg.DecisionSubject: records.Subject,
    msg.DecisionSubjects: records.Subjects,
    msg.ExecutiveEvent: records.ExecutiveEvent,
    msg.ExecutiveLog: records.LogLine,
    msg.ExecutiveStatus: records.ExecutiveSnapshot,
    msg.MissionQueue: records.MissionQueue,
    msg.PeerStatus: records.Peer,
    msg.PendingDecision: records.Decision,
    msg.Progress: records.DriveProgress,
    msg.QueueEntry: records.QueueEntry,
    msg.QueueOptions: QueueOptions,
    msg.StateStructure: records.StateStructure,
    msg.TreeBreakpoint: records.TreeBreakpoint,
    msg.TreeHold: records.TreeHold,
    msg.TreeNode: MirroredNode,
    msg.TreeStatus: TreeReport,
    msg.TreeStatusChange: StatusChange,
    msg.TreeStructure: TreeNodes,
    msg.UserdataScope: records.UserdataScope,
}
"""The records of messages. Their fields have the names of the message's fields."""

FIELDS: Final[Mapping[type, Mapping[str, str]]] = {
    GetTreeBlackboard.Response: {'tree': 'behavior_tree'},
    msg.BehaviorParameter: {'default': 'default_value'},
    msg.DecisionSubject: {'decision_id': 'id', 'values': 'entries'},
    msg.ExecutiveCommand: {'operator': 'operator_id'},
    msg.ExecutiveEvent: {'operator': 'operator_id'},
    msg.Progress: {'distance': 'distance_remaining', 'time': 'time_remaining', 'poses': 'poses_remaining'},
    msg.QueueEntry: {'operator': 'operator_id'},
    msg.TreeBreakpoint: {'tree': 'behavior_tree', 'operator': 'operator_id'},
    msg.TreeHold: {'tree': 'behavior_tree', 'operator': 'operator_id'},
    msg.TreeStructure: {'tree': 'behavior_tree', 'structure': 'number'},
    msg.UserdataScope: {'values': 'entries'},
}
"""Fields of a record that have another name in the message."""


def record_of(message: Any, **more: Any) -> Any:
    """Return the record of a message. ``more`` are the fields that another message has.

    A list of events becomes a list of records, places become poses by name.
    """
    kind: Any = type(message)
    if kind in _SPECIAL:
        return _SPECIAL[kind](message)
    values = {name: convert(getattr(message, field)) for name, field, convert in _fields(kind)}
    return RECORDS[kind](**values, **more)


@functools.cache
def _fields(message: type) -> tuple[tuple[str, str, Callable[[Any], Any]], ...]:
    """Return the name, the name in the message, and the conversion of each field of a record."""
    renamed, record = FIELDS.get(message, {}), RECORDS[message]
    types: dict[str, str] = message.get_fields_and_field_types()  # type: ignore[attr-defined]
    found = []
    for name, hint in get_type_hints(record).items():
        field = renamed.get(name, name)
        if field in types:
            convert = _conversion(hint)
            if 'builtin_interfaces/Time' in types[field]:
                convert = seconds_of if hint is float else _times
            found.append((name, field, convert))
    return tuple(found)


def _conversion(hint: Any) -> Callable[[Any], Any]:
    """Return the function that converts a field of the message to the value of the record's field."""
    if hint in _CONVERSIONS:
        return _CONVERSIONS[hint]
    if isinstance(hint, type) and issubclass(hint, IntEnum):
        return functools.partial(known_constant, hint)
    if dataclasses.is_dataclass(hint):
        return record_of
    if get_origin(hint) in (tuple, Sequence):
        one = get_args(hint)[0]
        convert = record_of if dataclasses.is_dataclass(one) else _conversion(one)
        return tuple if convert is _same else lambda messages: tuple(map(convert, messages))
    return _same


def _same(value: Any) -> Any:
    return value


def _times(stamps: Any) -> tuple[float, ...]:
    return tuple(map(seconds_of, stamps))


def _first_record(messages: Any) -> Any:
    return record_of(messages[0]) if messages else None


def _levels(messages: Any) -> tuple[tuple[str, int], ...]:
    return tuple((one.path, one.level) for one in messages)


def _arguments(messages: Any) -> tuple[tuple[str, str], ...]:
    return tuple((one.name, one.value) for one in messages)


def _inputs(messages: Any) -> tuple[records.InputValue, ...]:
    return tuple(records.InputValue(one.key, one.type, one.text) for one in messages)


def _tree_entry(message: msg.BlackboardWrites) -> records.TreeEntry:
    writes = zip(message.writers, map(seconds_of, message.stamps), message.values, strict=False)
    known = (message.scope, message.key, message.type, message.text, message.count)
    return records.TreeEntry(*known, tuple(starmap(records.EntryWrite, writes)))


def _guard(message: msg.StopGuardStatus) -> records.StopGuard:
    return records.StopGuard(
        tuple(result.command_id for result in message.results if result.code == records.ResultCode.APPLIED),
        message.holding,
        message.operator_id,
        tuple(message.going_on),
    )


def _places(message: msg.PlaceList) -> dict[str, records.FramedPose]:
    poses = ((place.name, _pose(place.pose)) for place in message.places)
    return {name: pose for name, pose in poses if name and pose is not None}


def _events(message: msg.ExecutiveEvents) -> list[records.ExecutiveEvent]:
    return [
        record_of(event, executive_id=message.executive_id, sequence=sequence)
        for sequence, event in enumerate(message.events, message.first)
    ]


def _subject_value(entry: msg.BlackboardEntry) -> records.SubjectValue:
    """Return a value with its points or its pose; one whose type is not installed here, or that is damaged, has only
    text."""
    try:
        if entry.type == 'nav_msgs/msg/Path' and entry.data:  # the same, and quicker
            return _path_value(entry, *path_points(bytes(entry.data), len(entry.data)))
        value = from_entry(entry)
    except (FlexbtError, ValueError) as error:
        return records.SubjectValue(entry.key, entry.type, entry.text or str(error))
    listed = getattr(value, 'poses', value)
    if isinstance(listed, list) and (listed or listed is not value):
        poses = [one.pose if isinstance(one, PoseStamped) else one for one in listed]
        if all(isinstance(pose, Pose) for pose in poses):
            frames = [one.header.frame_id for one in (value, *listed) if hasattr(one, 'header')]
            points = [(pose.position.x, pose.position.y) for pose in poses]
            return _path_value(entry, next(iter(frames), ''), points)
    if isinstance(value, Pose):
        value = PoseStamped(header=Header(frame_id='map'), pose=value)
    found = _pose(value) if isinstance(value, PoseStamped) else None
    return records.SubjectValue(entry.key, entry.type, entry.text or short_repr(value), pose=found)


def _path_value(entry: msg.BlackboardEntry, frame: str, points: Sequence[tuple[float, float]]) -> records.SubjectValue:
    if all(is_length(x) and is_length(y) for x, y in points):
        text = '' if points else 'no poses'
        return records.SubjectValue(entry.key, entry.type, text, tuple(points), frame or 'map')
    return records.SubjectValue(entry.key, entry.type, 'it has a point that is nowhere')


def command_message(record: records.OperatorCommand, now: float) -> msg.ExecutiveCommand:
    """Return the message of a command; ``now`` is the time of this computer in seconds."""
    message = msg.ExecutiveCommand(stamp=Time(sec=int(now), nanosec=int(now % 1.0 * 1e9)))
    for field in dataclasses.fields(record):
        if field.name == 'stops':
            continue
        name = FIELDS[msg.ExecutiveCommand].get(field.name, field.name)
        setattr(message, name, _sendable(getattr(record, field.name)))
    return message


def _sendable(value: Any) -> Any:
    match value:
        case str():
            return sanitize_for_message(value)
        case IntEnum():
            return int(value)
        case records.InputValue(key, type, text):
            return msg.BlackboardEntry(key=_sendable(key), type=_sendable(type), text=_sendable(text))
        case QueueOptions():
            return options_message(value)
        case (str(name), str(text)):
            return msg.BehaviorArgument(name=_sendable(name), value=_sendable(text))
        case tuple():
            return [_sendable(one) for one in value]
    return value


def _known(value: N) -> N | None:
    return value if 0 <= value < math.inf else None


def _pose(message: Any) -> records.FramedPose | None:
    """Return None for an unknown or invalid value: a faulty robot may send anything."""
    if not message.header.frame_id:
        return None
    position, yaw = message.pose.position, yaw_of_quaternion(message.pose.orientation)
    if not (is_length(position.x) and is_length(position.y) and math.isfinite(yaw)):
        return None
    return records.FramedPose(position.x, position.y, yaw, message.header.frame_id)


def _incidents(message: Any) -> tuple[records.IncidentReport, ...]:
    """Return the incidents that a black box reports."""
    return tuple(
        records.IncidentReport(one.name, next((value.value for value in one.values), ''), one.message)
        for one in message.status
    )


def is_length(value: float) -> bool:
    """Return whether the number can be a coordinate, m: finite, and small enough to draw."""
    return abs(value) <= FARTHEST


def known_constant(constants: type[E], value: int) -> E:
    """Return a constant of a message; one that a newer sender may have added is the first of them, UNKNOWN or IDLE."""
    try:
        return constants(value)
    except ValueError:
        return constants(0)


_CONVERSIONS: Final[Mapping[Any, Callable[[Any], Any]]] = {
    float | None: _known,
    int | None: _known,
    records.FramedPose | None: _pose,
    records.DriveProgress | None: _first_record,
    tuple[tuple[str, int], ...]: _levels,
    tuple[tuple[str, str], ...]: _arguments,
    tuple[records.InputValue, ...]: _inputs,
}
"""Conversions by the type of a record's field, where the message has it in another form."""

_SPECIAL: Final[Mapping[type, Callable[[Any], Any]]] = {
    DiagnosticArray: _incidents,
    msg.BlackboardEntry: _subject_value,
    msg.BlackboardWrites: _tree_entry,
    msg.ExecutiveEvents: _events,
    msg.PlaceList: _places,
    msg.StopGuardStatus: _guard,
}
"""Messages whose records are not made field by field."""
