# SPDX-License-Identifier: BSD-3-Clause
"""Typed values as messages and as text."""

from .decision_subject import subject_fields, subject_message
from .entries import (
    Encoding,
    ValueType,
    check_value,
    from_entry,
    message_type_name,
    resolve_type,
    text_to_value,
    to_entry,
    value_to_text,
)
from .limits import LONG_TEXT, MACHINE_TEXT, MESSAGE, check_limits, length_of, make_sendable
from .pose_lists import fewer_poses, path_points, poses_of, set_poses
from .times import duration_message, seconds_of, time_message, time_of_nanoseconds
from .value_text import from_plain
from .value_types import PRIMITIVES, type_name

__all__ = [
    'LONG_TEXT',
    'MACHINE_TEXT',
    'MESSAGE',
    'PRIMITIVES',
    'Encoding',
    'ValueType',
    'check_limits',
    'check_value',
    'duration_message',
    'fewer_poses',
    'from_entry',
    'from_plain',
    'length_of',
    'make_sendable',
    'message_type_name',
    'path_points',
    'poses_of',
    'resolve_type',
    'seconds_of',
    'set_poses',
    'subject_fields',
    'subject_message',
    'text_to_value',
    'time_message',
    'time_of_nanoseconds',
    'to_entry',
    'type_name',
    'value_to_text',
]
