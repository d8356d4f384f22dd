# SPDX-License-Identifier: BSD-3-Clause
"""The subject of a decision as a message: the values that an operator has to see, within bounds for a slow link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from flexbt_core.values.text import pluralize, sanitize_for_message, short_repr
from flexbt_msgs.msg import BlackboardEntry, DecisionSubject

from .entries import Encoding, to_entry
from .limits import length_of
from .message_fields import fewer_poses

MOST_KEYS: Final = 20
"""Maximum number of values of one decision that are shown; the others are only listed by name."""

MOST_POSES: Final = 500
"""Maximum number of poses of a path: as many as a map on a screen can show."""

MOST_BYTES: Final = 64_000
"""Maximum size of a path or another list of poses, bytes."""

MOST_CHARACTERS: Final = 2_000
"""Maximum number of characters of any other value as text."""

_MOST_PARTS: Final = 20_000
"""Maximum number of elements and characters of a value that are read, so that a large one does not hold up the run."""


def subject_message(id: str, number: int, values: Mapping[str, Any], missing: Sequence[str] = ()) -> DecisionSubject:
    """Return the message, with ROS messages first; ``missing`` are the keys that should have a value."""
    ranked = sorted(values, key=lambda key: (_poses(values[key]) is None, not _is_message(values[key]), key))
    subject = DecisionSubject(id=id, number=number)
    for key in ranked[:MOST_KEYS]:
        entry, note = _entry(key, values[key])
        subject.entries.append(entry)
        subject.notes += [note] if note else []
    if left_out := ranked[MOST_KEYS:]:
        names = sanitize_for_message(', '.join(left_out), MOST_CHARACTERS // 4)
        subject.notes.append(f'{pluralize(len(left_out), "value")} not shown: {names}')
    subject.notes += [f'{sanitize_for_message(key)} has no value' for key in missing[:MOST_KEYS]]
    return subject


def subject_fields(subject: DecisionSubject | None) -> dict[str, Any]:
    """Return the fields of a pending decision that identify its subject."""
    if subject is None:
        return {}
    return {'subject': [entry.key for entry in subject.entries], 'subject_number': subject.number}


def _entry(key: str, value: Any) -> tuple[BlackboardEntry, str]:
    """Return an entry for a value, and a note about its omitted part."""
    poses = _poses(value)
    try:
        if poses is not None:
            fewer = fewer_poses(value, MOST_POSES)
            entry = to_entry(key, fewer, None, Encoding.BINARY)
            if len(entry.data) <= MOST_BYTES:
                kept = len(_poses(fewer) or ())
                return entry, '' if fewer is value else f'{sanitize_for_message(key)}: {kept} of {len(poses)} poses'
        elif _parts(value, _MOST_PARTS) >= 0:
            entry = to_entry(key, value, None, Encoding.TEXT)
            if len(entry.text) <= MOST_CHARACTERS:
                return entry, ''
    except Exception:  # it has no ROS type, or its code raises
        return BlackboardEntry(key=key, text=short_repr(value)), ''
    return BlackboardEntry(key=key, text=short_repr(value)), f'{sanitize_for_message(key)} is too large to be shown'


def _poses(value: Any) -> Sequence[Any] | None:
    """Return the poses of a path or a list of poses; None for another value, and for one without poses."""
    poses = getattr(value, 'poses', None) if _is_message(value) else value  # other objects have their own code
    if type(poses) is not list or not poses or not _is_message(poses[0]):
        return None
    return poses if hasattr(poses[0], 'pose') or hasattr(poses[0], 'position') else None


def _is_message(value: Any) -> bool:
    return hasattr(type(value), 'get_fields_and_field_types')


def _parts(value: Any, room: int) -> int:
    """Return ``room`` minus the elements and characters of a value; negative if the value is larger."""
    if _is_message(value):
        return room - length_of(value)
    if isinstance(value, str | bytes | bytearray) or hasattr(value, 'itemsize'):
        return room - len(value) if hasattr(value, '__len__') else room
    if isinstance(value, Mapping):
        value = [*value.keys(), *value.values()] if len(value) <= room else value
    if isinstance(value, list | tuple | set | frozenset | Mapping):
        room -= len(value)
        for element in value if room >= 0 else ():
            if (room := _parts(element, room)) < 0:
                break
    return room
