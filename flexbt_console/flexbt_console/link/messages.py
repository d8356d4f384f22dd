# SPDX-License-Identifier: BSD-3-Clause
"""Messages of the operator link to records of the mirror, and commands to messages. The one place for both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any, Final, TypeVar

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseStamped
from std_msgs.msg import Header

from flexbt_common.values.entries import from_entry
from flexbt_common.values.message_fields import path_points, seconds_of
from flexbt_console.mirror import records
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import sanitize_for_message, short_repr
from flexbt_msgs.msg import (
    BehaviorArgument,
    BehaviorList,
    BehaviorStructure,
    BlackboardEntry,
    DecisionSubjects,
    ExecutiveCommand,
    ExecutiveEvents,
    ExecutiveLog,
    ExecutiveStatus,
    PlaceList,
    StopGuardStatus,
)

FARTHEST: Final = 1e9
"""Metres from the origin of a map that anything is taken for."""

E = TypeVar('E', bound=IntEnum)
N = TypeVar('N', int, float)


def snapshot_record(message: ExecutiveStatus) -> records.ExecutiveSnapshot:
    """Return the record of a status."""
    return records.ExecutiveSnapshot(
        executive_id=message.executive_id,
        sequence=message.sequence,
        heartbeat_period=message.heartbeat_period,
        state=known_constant(records.ExecutiveState, message.state),
        run_id=message.run_id,
        behavior=message.behavior,
        outcome=message.outcome,
        message=message.message,
        autonomy=message.autonomy,
        active_states=tuple(
            records.ActiveState(
                state.path,
                seconds_of(state.entered),
                tuple(state.activity),
                state.paused,
                tuple(state.not_paused),
                state.tree_run_id,
                _progress(state.progress[0]) if state.progress else None,
            )
            for state in message.active_states
        ),
        decisions=tuple(_decision(decision) for decision in message.decisions),
        results=tuple(
            records.CommandResult(result.command_id, known_constant(records.ResultCode, result.code), result.reason)
            for result in message.results
        ),
        peers=tuple(
            records.Peer(
                peer.name,
                peer.alive,
                seconds_of(peer.since),
                peer.ready,
                peer.late,
                peer.age,
                peer.problem,
                peer.expected,
            )
            for peer in message.peers
        ),
        robot_pose=_pose(message.robot_pose),
        pose_problem=message.pose_problem,
        locked=tuple(message.locked),
        breakpoints=tuple(message.breakpoints),
        autonomy_levels=tuple((entry.path, int(entry.level)) for entry in message.autonomy_levels),
        authority=message.authority,
        authority_requests=tuple(message.authority_requests),
        stamp=seconds_of(message.stamp),
    )


def guard_record(message: StopGuardStatus) -> records.StopGuard:
    """Return the record of what the stop guard says."""
    return records.StopGuard(
        tuple(result.command_id for result in message.results if result.code == records.ResultCode.APPLIED),
        message.holding,
        message.operator_id,
        tuple(message.going_on),
    )


def structure_record(message: BehaviorStructure) -> records.Structure:
    """Return the record of a state machine."""
    return records.Structure(
        run_id=message.run_id,
        behavior=message.behavior,
        states=tuple(
            records.StateStructure(
                path=state.path,
                kind=known_constant(records.StateKind, state.kind),
                type=state.type,
                children=tuple(state.children),
                outcomes=tuple(state.outcomes),
                targets=tuple(state.targets),
                autonomy=tuple(int(level) for level in state.autonomy),
            )
            for state in message.states
        ),
    )


def behaviors_record(message: BehaviorList) -> records.BehaviorList:
    """Return the record of a list of behaviors."""
    return records.BehaviorList(
        executive_id=message.executive_id,
        behaviors=tuple(
            records.Behavior(
                name=behavior.name,
                package=behavior.package,
                description=behavior.description,
                author=behavior.author,
                parameters=tuple(
                    records.BehaviorParameter(
                        parameter.name,
                        parameter.type,
                        parameter.default_value,
                        tuple(parameter.choices),
                        parameter.description,
                        parameter.label,
                        parameter.unit,
                        parameter.minimum,
                        parameter.maximum,
                    )
                    for parameter in behavior.parameters
                ),
                inputs=tuple(
                    records.BehaviorInput(known.key, known.type, known.description, known.needed)
                    for known in behavior.inputs
                ),
                error=behavior.error,
                machine=behavior.machine,
            )
            for behavior in message.behaviors
        ),
    )


def places_record(message: PlaceList) -> dict[str, records.FramedPose]:
    """Return the places that a robot knows, by name."""
    poses = ((place.name, _pose(place.pose)) for place in message.places)
    return {name: pose for name, pose in poses if name and pose is not None}


def log_record(message: ExecutiveLog) -> records.LogLine:
    """Return the record of a line of the log."""
    return records.LogLine(
        executive_id=message.executive_id,
        sequence=message.sequence,
        severity=known_constant(records.LogSeverity, message.severity),
        text=message.text,
        path=message.path,
        run_id=message.run_id,
        stamp=seconds_of(message.stamp),
    )


def event_records(message: ExecutiveEvents) -> list[records.ExecutiveEvent]:
    """Return the records of what has happened."""
    return [
        records.ExecutiveEvent(
            executive_id=message.executive_id,
            sequence=sequence,
            kind=known_constant(records.EventKind, event.kind),
            path=event.path,
            outcome=event.outcome,
            target=event.target,
            reason=event.reason,
            operator=event.operator_id,
            command=event.command,
            applied=event.applied,
            text=event.text,
            run_id=event.run_id,
            stamp=seconds_of(event.stamp),
        )
        for sequence, event in enumerate(message.events, message.first)
    ]


def subjects_record(message: DecisionSubjects) -> records.Subjects:
    """Return the record of what decisions are about."""
    return records.Subjects(
        executive_id=message.executive_id,
        subjects=tuple(
            records.Subject(one.id, one.number, tuple(map(_subject_value, one.entries)), tuple(one.notes))
            for one in message.subjects
        ),
    )


def _subject_value(entry: BlackboardEntry) -> records.SubjectValue:
    """Return a value with its points or its pose; one whose type is not installed here, or that is damaged, has only
    text."""
    try:
        if entry.type == 'nav_msgs/msg/Path' and entry.data:  # the same, and quicker
            return _path_value(entry, path_points(bytes(entry.data), len(entry.data))[1])
        value = from_entry(entry)
    except (FlexbtError, ValueError) as error:
        return records.SubjectValue(entry.key, entry.type, entry.text or str(error))
    listed = getattr(value, 'poses', value)
    if isinstance(listed, list) and (listed or listed is not value):
        poses = [one.pose if isinstance(one, PoseStamped) else one for one in listed]
        if all(isinstance(pose, Pose) for pose in poses):
            return _path_value(entry, [(pose.position.x, pose.position.y) for pose in poses])
    if isinstance(value, Pose):
        value = PoseStamped(header=Header(frame_id='map'), pose=value)
    found = _pose(value) if isinstance(value, PoseStamped) else None
    return records.SubjectValue(entry.key, entry.type, entry.text or short_repr(value), pose=found)


def _path_value(entry: BlackboardEntry, points: Sequence[tuple[float, float]]) -> records.SubjectValue:
    if all(is_length(x) and is_length(y) for x, y in points):
        return records.SubjectValue(entry.key, entry.type, '' if points else 'no poses', tuple(points))
    return records.SubjectValue(entry.key, entry.type, 'it has a point that is nowhere')


def command_message(record: records.OperatorCommand, now: float) -> ExecutiveCommand:
    """Return the message of a command; ``now`` is the time of this computer in seconds."""
    return ExecutiveCommand(
        id=record.id,
        stamp=Time(sec=int(now), nanosec=int(now % 1.0 * 1e9)),
        operator_id=sanitize_for_message(record.operator),
        kind=int(record.kind),
        executive_id=record.executive_id,
        run_id=record.run_id,
        decision_id=sanitize_for_message(record.decision_id),
        path=sanitize_for_message(record.path),
        outcome=sanitize_for_message(record.outcome),
        autonomy=int(record.autonomy),
        behavior=sanitize_for_message(record.behavior),
        arguments=[
            BehaviorArgument(name=sanitize_for_message(name), value=sanitize_for_message(value))
            for name, value in record.arguments
        ],
        inputs=[
            BlackboardEntry(
                key=sanitize_for_message(value.key),
                type=sanitize_for_message(value.type),
                text=sanitize_for_message(value.text),
            )
            for value in record.inputs
        ],
        grantee=sanitize_for_message(record.grantee),
        text=sanitize_for_message(record.text),
        reason=sanitize_for_message(record.reason),
        wait_queue=record.wait_queue,
        wait_interaction=record.wait_interaction,
    )


def _decision(message: Any) -> records.Decision:
    return records.Decision(
        id=message.id,
        kind=known_constant(records.DecisionKind, message.kind),
        path=message.path,
        outcome=message.outcome,
        outcomes=tuple(message.outcomes),
        required_autonomy=message.required_autonomy,
        prompt=message.prompt,
        input_type=message.input_type,
        input_choices=tuple(message.input_choices),
        since=seconds_of(message.since),
        subject=tuple(message.subject),
        subject_number=message.subject_number,
    )


def _progress(message: Any) -> records.DriveProgress:
    return records.DriveProgress(
        distance=_known(message.distance_remaining),
        time=_known(message.time_remaining),
        poses=_known(message.poses_remaining),
        recoveries=message.recoveries,
        goal=_pose(message.goal),
    )


def _known(value: N) -> N | None:
    return value if 0 <= value < math.inf else None


def _pose(message: Any) -> records.FramedPose | None:
    """None for one that is not known, or is none: a robot that is lost may send anything."""
    if not message.header.frame_id:
        return None
    position, q = message.pose.position, message.pose.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    if not (is_length(position.x) and is_length(position.y) and math.isfinite(yaw)):
        return None
    return records.FramedPose(position.x, position.y, yaw, message.header.frame_id)


def is_length(value: float) -> bool:
    """Return whether it can be a coordinate, m: finite, and not so large that nobody could draw it."""
    return abs(value) <= FARTHEST


def known_constant(constants: type[E], value: int) -> E:
    """Return a constant of a message; one that a newer sender may have added is the first of them, UNKNOWN or IDLE."""
    try:
        return constants(value)
    except ValueError:
        return constants(0)
