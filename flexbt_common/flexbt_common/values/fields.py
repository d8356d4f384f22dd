# SPDX-License-Identifier: BSD-3-Clause
"""Interfaces by their names, and the fields of their messages by paths such as ``pose.position.x`` or ``poses.0``."""

from __future__ import annotations

from array import array
from typing import Any, Final

import numpy
from rosidl_parser.definition import AbstractSequence, Array, NamespacedType

from flexbt_core.values.text import did_you_mean

from .value_types import PRIMITIVES, FieldError, class_of_slot, slot_type_name, slot_value

MOST_ELEMENTS: Final = 1_000
"""Maximum number of elements of a list that is filled by the paths of its elements."""
LENGTH: Final = 'length'
"""Last step of a path, for the number of elements of a list."""


def constants_of(message: type[Any]) -> dict[str, Any]:
    """Return the constants that a message declares, by name."""
    return {name: getattr(message, name) for name in dir(type(message)) if name.isupper() and name[0] != '_'}


class Field:
    """A field within messages of a class, by its path; the empty path is the message itself.

    Steps are names of fields, indices of lists, or, at the end, ``length``, the number of elements of a list.
    """

    def __init__(self, message: type[Any], path: str) -> None:
        """Raise FieldError if messages of this class have no such field."""
        self.path = path
        self.owner = message
        """Class of the message that has the field, or the list with it."""
        self.slot: Any = None
        """Type of the field, as rosidl describes it; None for the message itself."""
        self.steps: tuple[str | int, ...] = ()
        self.is_length = False
        names = path.split('.') if path else []
        for number, name in enumerate(names):
            self._descend(name, '.'.join(names[:number]), is_last=number == len(names) - 1)

    def _descend(self, step: str, before: str, *, is_last: bool) -> None:
        slot = self.slot
        if isinstance(slot, Array | AbstractSequence):
            self._descend_list(step, before, is_last=is_last)
            return
        if isinstance(slot, NamespacedType):
            self.owner = class_of_slot(slot)
        elif slot is not None:
            raise FieldError(before, f'it is a {slot_type_name(slot)}, which has no field {step!r}')
        fields = list(self.owner.get_fields_and_field_types())
        if step not in fields:
            known = f'; its fields are {", ".join(fields)}' if fields else '; it has no fields'
            raise FieldError(before, f'{self.owner.__name__} has no field {step!r}{did_you_mean(step, fields, known)}')
        self.steps += (step,)
        self.slot = self.owner.SLOT_TYPES[fields.index(step)]

    def _descend_list(self, step: str, before: str, *, is_last: bool) -> None:
        slot = self.slot
        if is_last and step == LENGTH:
            self.is_length = True
            self.slot = PRIMITIVES['int64']
            return
        most = slot.size if isinstance(slot, Array) else getattr(slot, 'maximum_size', MOST_ELEMENTS)
        if not (step.isascii() and step.isdigit()) or len(step) > 9 or int(step) >= min(most, MOST_ELEMENTS):
            known = f'an index from 0 to {min(most, MOST_ELEMENTS) - 1}, or "{LENGTH}"'
            raise FieldError(before, f'it is a list, which has no {step!r}; write {known}')
        self.steps += (int(step),)
        self.slot = slot.value_type

    @property
    def type_name(self) -> str:
        """Name of the type of the field, as ``resolve_type`` takes it; '' for the message itself."""
        return '' if self.slot is None else slot_type_name(self.slot)

    def get(self, message: Any) -> Any:
        """Return the value of the field in a message; lists, numbers and texts as Python has them.

        Raises:
            FieldError: a list of the message has no such element.
        """
        for number, step in enumerate(self.steps):
            if isinstance(step, str):
                message = getattr(message, step)
            elif step < len(message):
                message = message[step]
            else:
                place = '.'.join(map(str, self.steps[:number]))
                raise FieldError(place, f'there is no element {step}; the list has {len(message)}')
        if self.is_length:
            return len(message)
        return _as_python(message)

    def set(self, message: Any, value: Any) -> None:
        """Write a value into the field of a message. A list grows by one element when that after its last is written.

        Raises:
            FieldError: the value does not fit, or an element before this one is missing.
        """
        holder = message
        fields = [Field(type(message), '.'.join(map(str, self.steps[:end]))) for end in range(1, len(self.steps))]
        for before, step in zip(fields, self.steps, strict=False):
            _grow(holder, before, step)
            holder = getattr(holder, step) if isinstance(step, str) else holder[step]
        last = self.steps[-1]
        fitting = slot_value(value, self.slot, self.path)
        if isinstance(last, str):
            setattr(holder, last, fitting)
        elif last == len(holder) and hasattr(holder, 'append'):
            holder.append(fitting)
        else:
            _grow(holder, self, last)
            holder[last] = fitting


def _as_python(value: Any) -> Any:
    """Return the value of a field with Python lists and numbers; messages stay unchanged."""
    if isinstance(value, array | numpy.ndarray | numpy.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_as_python(item) for item in value]
    return value[0] if isinstance(value, bytes) else value


def _grow(holder: Any, field: Field, step: str | int) -> None:
    """Append the element ``step`` of a list, if it is the next one; ``field`` describes the element."""
    if isinstance(step, str) or step < len(holder):
        return
    if step > len(holder) or not isinstance(field.slot, NamespacedType):
        raise FieldError(field.path, f'element {len(holder)} is missing; write elements in order, from 0')
    holder.append(class_of_slot(field.slot)())
