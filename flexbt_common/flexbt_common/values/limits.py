# SPDX-License-Identifier: BSD-3-Clause
"""Size limits of messages from other processes. The middleware carries texts and lists of any length.

Every text and list of every message has a bound: that of :data:`LIMITS`, or else TEXT and LIST. So a field that is
added later has one too.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.serialization import deserialize_message
from rosidl_parser.definition import AbstractSequence, AbstractString, AbstractWString, Array, BasicType, NamespacedType

from flexbt_common.errors import LimitExceededError
from flexbt_core.values.text import sanitize_for_message, short_repr

from .value_types import class_of_slot

TEXT: Final = 1_000
"""Characters of a text that :data:`LIMITS` does not name: of a name, a key, a frame, an identifier."""
_TOLD: Final = 60
"""Maximum number of characters of the note how much of a text is left out; see :func:`sanitize_for_message`."""
LIST: Final = 1_000
"""Elements of a list that it does not name."""
LONG_TEXT: Final = 50_000
"""Characters of a text for people that an executive sends, such as a trace or the problems of a machine; the middle of
a longer one is left out, and the note about that may make it a little longer."""
MACHINE_TEXT: Final = 20_000
"""Characters of a synthesized machine that an executive shows to operators; it keeps 100 of them, and shows all."""
_HEADER_BYTES: Final = 4
MESSAGE: Final = 17_000_000
"""Characters, bytes and elements of one message together: of the largest map with its metadata."""

LIMITS: Final[Mapping[str, int]] = {
    'flexbt_msgs/BlackboardEntry.text': 1_000_000,
    'flexbt_msgs/BlackboardEntry.data': 8_000_000,
    'flexbt_msgs/BehaviorArgument.value': 100_000,
    'flexbt_msgs/BtLoad_Goal.files': 200,
    'flexbt_msgs/BtLoad_Goal.files[]': 4_096,  # PATH_MAX of Linux
    'flexbt_msgs/BtLoad_Goal.xml': 8_000_000,  # the parameter max_file_size of the BT server counts as well
    'flexbt_msgs/BtExecute_Goal.goals': 10_000,
    'flexbt_msgs/BtExecute_Goal.behavior_tree': 4_096,  # it may be a file
    'flexbt_msgs/TreeStructure.nodes': 100_000,  # a file may have 65,535, and a running tree may get more
    'flexbt_msgs/TreeNode.path': 100_000,  # the names of all that a node is in
    'flexbt_msgs/TreeBreakpoint.path': 4_096,
    'flexbt_msgs/TreeHold.path': 100_000,
    'flexbt_msgs/ControlTree_Request.node': 4_096,
    'flexbt_msgs/BlackboardWrites.scope': 100_000,
    'flexbt_msgs/BlackboardWrites.writers[]': 100_000,
    'flexbt_msgs/GetTreeBlackboard_Response.entries': 10_000,
    'flexbt_msgs/TreeStatus.statuses': 100_000,
    'flexbt_msgs/TreeStatus.changes': 10_000,
    'flexbt_msgs/SynthesizeBehavior_Goal.capabilities': 1_000_000,
    'flexbt_msgs/SynthesizeBehavior_Goal.goals[]': 20_000,
    'flexbt_msgs/SynthesizeBehavior_Goal.initial_conditions[]': 20_000,
    'flexbt_msgs/SynthesizeBehavior_Goal.system': 4_096,
    'flexbt_msgs/SynthesizeBehavior_Goal.specification': 4_096,
    # What a console takes of an executive, which cuts texts that are longer (LONG_TEXT, make_sendable).
    'flexbt_msgs/ExecutiveStatus.message': 2 * LONG_TEXT,
    'flexbt_msgs/ExecutiveStatus.active_states': 10_000,
    'flexbt_msgs/ExecutiveStatus.decisions': 10_000,
    'flexbt_msgs/ExecutiveStatus.locked': 10_000,
    'flexbt_msgs/ExecutiveStatus.locked[]': 100_000,
    'flexbt_msgs/ExecutiveStatus.breakpoints': 10_000,
    'flexbt_msgs/ExecutiveStatus.breakpoints[]': 100_000,
    'flexbt_msgs/ExecutiveStatus.autonomy_levels': 10_000,
    'flexbt_msgs/ActiveState.path': 100_000,
    'flexbt_msgs/ActiveState.not_paused[]': 100_000,
    'flexbt_msgs/AutonomyLevel.path': 100_000,
    'flexbt_msgs/CommandResult.reason': 2 * LONG_TEXT,
    'flexbt_msgs/PendingDecision.path': 100_000,
    'flexbt_msgs/PendingDecision.prompt': 20_000,
    'flexbt_msgs/DecisionSubjects.subjects': 10_000,
    'flexbt_msgs/PeerStatus.problem': 10_000,
    'flexbt_msgs/BehaviorStructure.states': 100_000,
    'flexbt_msgs/StateStructure.path': 100_000,
    'flexbt_msgs/StateStructure.children': 10_000,
    'flexbt_msgs/BehaviorList.behaviors': 10_000,
    'flexbt_msgs/BehaviorManifest.description': 100_000,
    'flexbt_msgs/BehaviorManifest.error': 100_000,
    'flexbt_msgs/BehaviorManifest.machine': MACHINE_TEXT,
    'flexbt_msgs/BehaviorParameter.default_value': 100_000,
    'flexbt_msgs/BehaviorParameter.description': 100_000,
    'flexbt_msgs/PlaceList.places': 10_000,
    'flexbt_msgs/ExecutiveEvents.events': 10_000,
    'flexbt_msgs/ExecutiveEvent.path': 100_000,
    'flexbt_msgs/ExecutiveEvent.outcome': 2_000,  # cut after 1,000, as the others, with a note of what is left out
    'flexbt_msgs/ExecutiveEvent.target': 2_000,
    'flexbt_msgs/ExecutiveEvent.reason': 2_000,
    'flexbt_msgs/ExecutiveEvent.operator_id': 2_000,
    'flexbt_msgs/ExecutiveEvent.command': 2_000,
    'flexbt_msgs/ExecutiveEvent.decision_id': 2_000,
    'flexbt_msgs/ExecutiveEvent.text': 2_000,
    'flexbt_msgs/ExecutiveLog.path': 100_000,
    'flexbt_msgs/ExecutiveLog.text': 2 * LONG_TEXT,
    # Every status has the input requests that wait.
    'flexbt_msgs/OperatorInput_Goal.prompt': 1_000,
    'flexbt_msgs/OperatorInput_Goal.type': 256,
    'flexbt_msgs/OperatorInput_Goal.choices': 100,
    'flexbt_msgs/OperatorInput_Goal.choices[]': 256,
    'flexbt_msgs/OperatorInput_Goal.asker': 4_096,
    'flexbt_msgs/DecisionSubject.entries': 20,
    'flexbt_msgs/DecisionSubject.notes': 100,
    'flexbt_msgs/RobotPlan.x': 10_000,
    'flexbt_msgs/RobotPlan.y': 10_000,
    'flexbt_msgs/SetFault_Request.parameters': 10_000,
    'nav2_msgs/ComputePathThroughPoses_Goal.goals': 10_000,
    'nav2_msgs/NavigateThroughPoses_Goal.poses': 10_000,
    'nav2_msgs/NavigateThroughPoses_Goal.behavior_tree': 4_096,  # it may be a file
    'nav2_msgs/NavigateToPose_Goal.behavior_tree': 4_096,
    'nav2_msgs/FollowWaypoints_Goal.poses': 10_000,
    'nav_msgs/Goals.goals': 10_000,  # also the poses of goals in Nav2's branch main
    'nav_msgs/Path.poses': 20_000,  # 1 km of 5 cm
    'sensor_msgs/LaserScan.ranges': 100_000,
    'sensor_msgs/LaserScan.intensities': 100_000,
    'simulation_interfaces/SpawnEntity_Request.resource_string': 100_000,
    'simulation_interfaces/SpawnEntity_Request.uri': 4_096,
    'nav2_msgs/LoadMap_Request.map_url': 4_096,
    'nav_msgs/OccupancyGrid.data': 16_000_000,  # as many cells as maps from files may have
}
"""The bounds that differ, by type and field; of a list of texts, ``field[]`` is that of each text."""

_Check = Callable[[Any, str], int]
"""A function that checks a value and returns its length; the path is for the error."""


def deserialize(data: bytes, message_type: Any) -> Any:
    """Return the message of these CDR bytes. Use this for bytes of others instead of rclpy's function: that of Cyclone
    DDS ends the process if they are fewer than those of the header (DDSI-RTPS 10.2).

    Raises:
        Exception: these bytes are not such a message. The class depends on the middleware.
    """
    if len(data) < _HEADER_BYTES:
        raise ValueError(f'a message has at least {_HEADER_BYTES} bytes')
    return deserialize_message(data, message_type)


def check_limits(message: Any) -> None:
    """Check that every text and list of a message is within its bound.

    Raises:
        LimitExceededError: names the field, its length and the bound, and shows how it begins.
    """
    length = _length(message, is_bounded=True)
    if length > MESSAGE:
        raise LimitExceededError(
            f'{type(message).__name__}: a message of {length} characters, bytes and elements; {_most(MESSAGE)}'
        )


def sanitize_message(message: Any) -> None:
    """Shorten and clean every text of a message in place, so that it can be sent: receivers drop a whole message if one
    of its texts is too long.
    """
    message_type: Any = type(message)
    for name, slot, key in _sized_fields(message_type):
        before = getattr(message, name)
        made = _made_sendable(before, slot, key)
        if made is not before:
            setattr(message, name, made)


@functools.cache
def _sized_fields(message_type: Any) -> tuple[tuple[str, Any, str], ...]:
    """Return name, type and key in LIMITS of each field whose size is not fixed."""
    package = message_type.__module__.partition('.')[0]
    fields = zip(message_type.get_fields_and_field_types(), message_type.SLOT_TYPES, strict=True)
    keyed = [(name, slot, f'{package}/{message_type.__name__}.{name}') for name, slot in fields]
    return tuple(one for one in keyed if _check_of_slot(one[1], one[2], True) is not None)


def _made_sendable(value: Any, slot: Any, key: str) -> Any:
    """Return a sendable copy of the value, or the value itself if nothing had to change or it is a message."""
    if isinstance(slot, AbstractString | AbstractWString):
        limit = LIMITS.get(key, TEXT)
        made = sanitize_for_message(value, None if len(value) <= limit else limit - _TOLD)
        return value if made == value else made
    if isinstance(slot, NamespacedType):
        message_type: Any = class_of_slot(slot)
        if _check_of(message_type, True) is not None:
            sanitize_message(value)
    elif isinstance(slot, Array | AbstractSequence) and not isinstance(slot.value_type, BasicType):
        elements = [_made_sendable(one, slot.value_type, f'{key}[]') for one in value]
        if any(made is not one for made, one in zip(elements, value, strict=True)):
            return elements
    return value


def length_of(message: Any) -> int:
    """Return the number of characters, bytes and elements of all texts and lists of a message."""
    return _length(message, is_bounded=False)


def _length(message: Any, is_bounded: bool) -> int:
    message_type: Any = type(message)
    check = _check_of(message_type, is_bounded)
    return 0 if check is None else check(message, '')


@functools.cache
def _check_of(message_type: Any, is_bounded: bool) -> _Check | None:
    """Return the check of a message type, or None if its size is fixed."""
    fields = _sized_fields(message_type)
    parts = [
        (name, check) for name, slot, key in fields if (check := _check_of_slot(slot, key, is_bounded)) is not None
    ]
    if not parts:
        return None

    def check_message(message: Any, path: str) -> int:
        before = f'{path}.' if path else ''
        return sum(check(getattr(message, name), before + name) for name, check in parts)

    return check_message


def _check_of_slot(slot: Any, key: str, is_bounded: bool) -> _Check | None:
    if isinstance(slot, AbstractString | AbstractWString):
        return functools.partial(_check_text, limit=LIMITS.get(key, TEXT) if is_bounded else math.inf)
    if isinstance(slot, NamespacedType):
        message_type: Any = class_of_slot(slot)
        return _check_of(message_type, is_bounded)
    if not isinstance(slot, Array | AbstractSequence):
        return None
    limit = LIMITS.get(key, LIST) if is_bounded and isinstance(slot, AbstractSequence) else math.inf
    check_element = _check_of_slot(slot.value_type, f'{key}[]', is_bounded)

    def check_list(values: Any, path: str) -> int:
        length = len(values)
        if length > limit:
            raise LimitExceededError(f'{path} has {length} elements; {_most(limit)}')
        if check_element is None:
            return length
        return length + sum(check_element(value, f'{path}[{index}]') for index, value in enumerate(values))

    return check_list


def _check_text(text: str, path: str, *, limit: float) -> int:
    if len(text) > limit:
        raise LimitExceededError(
            f'{path} has {len(text)} characters, beginning with {short_repr(text[:40])}; {_most(limit)}'
        )
    return len(text)


def _most(limit: float) -> str:
    return f'at most {limit} are allowed'
