# SPDX-License-Identifier: BSD-3-Clause
"""Ports of node classes, their types, and the conversions between types."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final, Literal, NamedTuple, TypeGuard

from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import short_repr

from .errors import ConversionError
from .status import NodeStatus


class PortDirection(Enum):
    """The direction of a port: a node reads it, writes it, or both."""

    INPUT = 'input'
    OUTPUT = 'output'
    INOUT = 'inout'


class _NoDefault(Enum):
    NO_DEFAULT = 'no default'


NO_DEFAULT: Final = _NoDefault.NO_DEFAULT


def with_branch(text: str, nav2_branch: str) -> str:
    """Return the text with a note that only this branch of Nav2 has the feature; unchanged for ''."""
    return f'{text} (Nav2 {nav2_branch} only)'.lstrip() if nav2_branch else text


@dataclass(frozen=True, slots=True)
class Port:
    """A port of a node class.

    ``type`` None accepts every type. ``default`` is used when the XML does not give the port. It is either text as
    written in the XML (a literal or a ``{pointer}``), or a value. If a required port is missing, loading fails.

    ``literal`` is the type of a literal, for ports where ``type`` is not enough: for example, a port whose pointer may
    lead to an entry of any type. Values of that type must be immutable.

    ``nav2_branch`` is the branch of Nav2 for which a file must be written to use the port (see ``NodeRegistry``); ''
    for any branch. A port with ``declares`` false has an unknown type: other nodes create the entry that it points to,
    and set its type.
    """

    direction: PortDirection
    type: PortType | None = None
    default: Any = NO_DEFAULT
    description: str = ''
    required: bool = False
    literal: PortType | None = None
    nav2_branch: str = ''
    declares: bool = True

    @property
    def documentation(self) -> str:
        """The description, with the only branch of Nav2 that has the port."""
        return with_branch(self.description, self.nav2_branch)

    @property
    def readable(self) -> bool:
        return self.direction is not PortDirection.OUTPUT

    @property
    def writable(self) -> bool:
        return self.direction is not PortDirection.INPUT


def input_port(
    type: PortType | None = None,
    *,
    default: Any = NO_DEFAULT,
    description: str = '',
    optional: bool = False,
    literal: PortType | None = None,
    nav2_branch: str = '',
) -> Port:
    """Return a port that the node reads. The XML must give it, unless it has a default or is optional."""
    return Port(
        PortDirection.INPUT, type, default, description, default is NO_DEFAULT and not optional, literal, nav2_branch
    )


def output_port(
    type: PortType | None = None, *, default: str | None = None, description: str = '', nav2_branch: str = ''
) -> Port:
    """Return a port that the node writes. The XML may omit it; a default must be a ``{pointer}``."""
    written = NO_DEFAULT if default is None else default
    return Port(PortDirection.OUTPUT, type, written, description, nav2_branch=nav2_branch)


def inout_port(
    type: PortType | None = None,
    *,
    default: Any = NO_DEFAULT,
    description: str = '',
    optional: bool = False,
    literal: PortType | None = None,
    nav2_branch: str = '',
) -> Port:
    """Return a port that the node reads and writes."""
    return Port(
        PortDirection.INOUT, type, default, description, default is NO_DEFAULT and not optional, literal, nav2_branch
    )


class PortValue(NamedTuple):
    """The value of one port in the XML, or its default: a literal, or a pointer to a blackboard key.

    ``literal`` is the converted value if nodes can share it, or a default that is not text. Without it, each read
    converts the text.
    """

    text: str
    key: str | None = None
    literal: Any = NO_DEFAULT


def pointer_key(text: str, port_name: str) -> str | None:
    """Return the blackboard key that ``text`` points to, or None when it is a literal.

    Spaces around the braces are ignored; spaces inside are part of the key. ``{=}`` and ``=`` mean the key with the
    name of the port.
    """
    stripped = text.strip(' ')
    if stripped == '=':
        return port_name
    if len(stripped) < 3 or stripped[0] != '{' or stripped[-1] != '}':
        return None
    key = stripped[1:-1]
    return port_name if key == '=' else key


# Types of ports and blackboard entries, and the conversions between them.
#
# The rules are those of BehaviorTree.CPP 4. Numbers convert to each other when nothing is lost. Text converts to the
# type of the port by a *prefix* parse (``7.5`` read as an integer is 7). Nothing else converts silently. Other layers
# add types, such as ROS messages: a :class:`PortType` with the Python class of the values.

Category = Literal['integer', 'real', 'bool', 'text', 'object']
NUMBERS: Final = ('integer', 'real', 'bool')
"""Categories whose values convert to each other."""

# The largest integer up to which every integer has a distinct double.
_EXACT_IN_DOUBLE = 2**53 - 1
_INTEGER_PREFIX = re.compile(r'(?=-?[0-9])(-?)0*([0-9]*)')
_REAL_PREFIX = re.compile(r'-?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf(?:inity)?|nan)', re.IGNORECASE)
_NOT_ZERO = re.compile(r'[-.0]*[1-9]')
_BOOLEANS = {
    '0': False, 'false': False, 'False': False, 'FALSE': False,
    '1': True, 'true': True, 'True': True, 'TRUE': True,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PortType:
    """The type of a port or of a blackboard entry.

    Errors and models show ``name``. ``python_type`` is the class of the values. ``from_text`` converts a literal of an
    XML file and raises ConversionError; it is None when text cannot express a value. ``minimum`` and ``maximum`` bound
    integers, both inclusive. ``element`` is the type of the elements of a list, if it is known.
    """

    name: str
    python_type: type[Any]
    category: Category = 'object'
    from_text: Callable[[str], Any] | None = None
    minimum: int | None = None
    maximum: int | None = None
    # Immutable values are converted once, at load, and shared by all reads.
    immutable: bool = field(default=False)
    element: PortType | None = None

    def parse(self, text: str) -> Any:
        """Return the value that ``text`` means. Turn exceptions of ``from_text`` into ConversionError."""
        if self.from_text is None:
            raise ConversionError(f'{self.name} cannot be written as text')
        try:
            return self.from_text(text)
        except (ValueError, TypeError, ArithmeticError, LookupError) as error:
            raise ConversionError(f"can't convert text {short_repr(text)} to {self.name}: {error}") from error

    def same(self, other: PortType) -> bool:
        """Return whether both are the same type: equal names, or objects of the same Python class.

        Lists are the same if their elements are, or if both are of numbers.
        """
        if self is other or self.name == other.name:
            return True
        if not (self.category == other.category == 'object' and self.python_type is other.python_type):
            return False
        one, two = self.element, other.element
        if one is None or two is None:
            return True
        return one.same(two) or (one.category in NUMBERS and two.category in NUMBERS)

    def may_read(self, entry: PortType) -> bool:
        """Return whether an input of this type can read some values of an ``entry``.

        It can if the types are the same, if the entry holds text, or if one Python class derives from the other.
        BehaviorTree.CPP has the last rule since 4.9, for registered classes.
        """
        if entry is STRING or self.same(entry):
            return True
        ours, theirs = self.python_type, entry.python_type
        is_related = ours is not theirs and (issubclass(theirs, ours) or issubclass(ours, theirs))
        return is_related and self.category == entry.category == 'object'

    def __str__(self) -> str:
        return self.name


def _bounded(value: int, name: str, minimum: int | None, maximum: int | None) -> int:
    if (minimum is not None and value < minimum) or (maximum is not None and value > maximum):
        raise ConversionError(f'{value} is out of the range of {name}, {minimum} to {maximum}')
    return value


def _integer_type(name: str, bits: int, signed: bool) -> PortType:
    minimum = -(1 << (bits - 1)) if signed else 0
    maximum = (1 << (bits - 1)) - 1 if signed else (1 << bits) - 1

    def from_text(text: str) -> int:
        match = _INTEGER_PREFIX.match(text)
        digits = match.group(2) if match is not None else ''
        # 20 digits hold every 64-bit integer; int() rejects very long numbers, or is slow on them.
        if match is None or len(digits) > 20:
            raise ConversionError(f"can't convert text {short_repr(text)} to {name}")
        value = int(digits or '0')
        return _bounded(-value if match.group(1) else value, name, minimum, maximum)

    return PortType(name, int, 'integer', from_text, minimum, maximum, immutable=True)


def decimal(text: str) -> float:
    """Return the double nearest to a decimal number.

    Raises ConversionError if a finite number would become infinite, or a number other than zero would become zero.
    """
    value = float(text)
    if (math.isinf(value) and 'n' not in text.lower()) or (value == 0.0 and _NOT_ZERO.match(text)):
        raise ConversionError(f'the number {text[:40]} does not fit into a double')
    return value


def real_from_text(text: str) -> float:
    """Return the longest prefix of ``text`` that is a decimal number; ``inf`` and ``nan`` are numbers."""
    match = _REAL_PREFIX.match(text)
    if match is None:
        raise ConversionError(f"can't convert text {short_repr(text)} to double")
    return decimal(match.group())


def number_from_text(text: str) -> float | None:
    """Return the whole ``text`` as a decimal number; None if it is not one."""
    try:
        return decimal(text) if _REAL_PREFIX.fullmatch(text) else None
    except ConversionError:
        return None


def bool_from_text(text: str) -> bool:
    """Return a bool for ``0 1 true True TRUE false False FALSE``; raise ConversionError for other text."""
    try:
        return _BOOLEANS[text]
    except KeyError:
        accepted = ' '.join(_BOOLEANS)
        raise ConversionError(f"can't convert text {short_repr(text)} to bool; write one of {accepted}") from None


STRING = PortType('std::string', str, 'text', str, immutable=True)
BOOL = PortType('bool', bool, 'bool', bool_from_text, immutable=True)
DOUBLE = PortType('double', float, 'real', real_from_text, immutable=True)
FLOAT = PortType('float', float, 'real', real_from_text, immutable=True)
INT = _integer_type('int', 32, signed=True)
INT8 = _integer_type('int8_t', 8, signed=True)
INT16 = _integer_type('int16_t', 16, signed=True)
INT64 = _integer_type('int64_t', 64, signed=True)
UNSIGNED = _integer_type('unsigned int', 32, signed=False)
UINT8 = _integer_type('uint8_t', 8, signed=False)
UINT16 = _integer_type('uint16_t', 16, signed=False)
UINT64 = _integer_type('uint64_t', 64, signed=False)


def _status_from_text(text: str) -> NodeStatus:
    try:
        return NodeStatus[text]
    except KeyError:
        raise ConversionError(
            f'{short_repr(text)} is not a status; write one of {" ".join(NodeStatus.__members__)}'
        ) from None


def _key_from_text(text: str) -> str:
    if not text:
        raise ValueError('a key cannot be empty')
    return text


KEY = PortType('key', str, 'text', _key_from_text, immutable=True)
"""Type of a literal that is the key of an entry, for ports that read or write that entry."""

KEYS = PortType('keys', str, 'text', str, immutable=True)
"""Like KEY, for any number of entries: their keys, :func:`separated` by ``;``."""


def separated(text: str) -> list[str]:
    """Return the parts of a text between ``;``, without surrounding spaces. Empty parts are dropped."""
    return [piece.strip() for piece in text.split(';') if piece.strip()]


def _no_text(text: str) -> Any:
    raise ConversionError('an entry that may hold anything does not say what a text means')


ANY = PortType('BT::Any', object, from_text=_no_text)
"""Type of an entry that may hold anything, and of the ports that read such an entry.

As with an entry without a type (None), the next write fixes the type. Text is rejected where it would have to be
converted.
"""


def is_fixed(type: PortType | None) -> TypeGuard[PortType]:
    """Return whether an entry of this type keeps it on every write."""
    return type is not None and type is not ANY


NODE_STATUS = PortType('BT::NodeStatus', NodeStatus, from_text=_status_from_text, immutable=True)


def list_of(element: PortType) -> PortType:
    """Return a list type. Its text form is the elements :func:`between_semicolons`, or ``json:[...]``."""
    name = f'std::vector<{element.name}>'
    if element.from_text is None:
        return PortType(name, list, element=element)

    def from_text(text: str) -> list[Any]:
        if text.startswith('json:'):
            return _elements_of_json(text.removeprefix('json:'), element)
        return between_semicolons(text, element)

    return PortType(name, list, from_text=from_text, element=element)


def between_semicolons(text: str, element: PortType) -> list[Any]:
    """Return the elements of ``text``, separated by ``;``. One empty part at the end is dropped."""
    pieces = text.split(';')
    if not pieces[-1]:
        pieces.pop()
    return [element.parse(piece) for piece in pieces]


def _elements_of_json(text: str, element: PortType) -> list[Any]:
    try:
        values = load_json(text)
    except RecursionError as error:
        raise ConversionError(str(error)) from error
    if not isinstance(values, list):
        raise ConversionError(f'{short_repr(text)} is not a list of JSON')
    for value in values:
        if isinstance(value, str) is not (element.category in ('text', 'object')):
            raise ConversionError(f'{short_repr(value)} is not of type {element.name}')
    return [cast(value, element) for value in values]


def type_of(value: object) -> PortType:
    """Return the type that an entry gets when ``value`` is the first value written to it."""
    if isinstance(value, bool):
        return BOOL
    if isinstance(value, int):
        for candidate in (INT, INT64, UINT64):
            if fits(value, candidate):
                return candidate
        raise ConversionError(f'the integer {value} does not fit into 64 bits')
    if isinstance(value, float):
        return DOUBLE
    if isinstance(value, str):
        return STRING
    cls = type(value)
    return PortType(cls.__qualname__, cls)


def fits(value: int, kind: PortType) -> bool:
    """Return whether the integer is within the bounds of an integer type."""
    assert kind.minimum is not None
    assert kind.maximum is not None
    return kind.minimum <= value <= kind.maximum


def cast(value: Any, wanted: PortType) -> Any:
    """Return ``value`` converted to ``wanted``. Raises ConversionError if that would lose or guess data."""
    category = wanted.category
    if category == 'object':
        if isinstance(value, wanted.python_type):
            return value
        if isinstance(value, str) and wanted.from_text is not None:
            return wanted.parse(value)
    elif category == 'text':
        if isinstance(value, str):
            return value
        if isinstance(value, int):
            return str(int(value))
        if isinstance(value, float):
            return f'{value:f}'
    elif isinstance(value, str):
        return wanted.parse(value)
    elif isinstance(value, int | float):
        return _cast_number(value, wanted)
    raise ConversionError(f'no safe conversion from {type(value).__name__} to {wanted.name}')


def _cast_number(value: int | float, wanted: PortType) -> int | float | bool:
    if wanted.category == 'bool':
        if isinstance(value, bool):
            return value
        if isinstance(value, int):
            if value in (0, 1):
                return bool(value)
            raise ConversionError(f'of the integers only 0 and 1 can be read as bool, not {value}')
        if value < 0:
            raise ConversionError(f'a negative number cannot be read as bool: {value}')
        return value != 0.0
    if wanted.category == 'real':
        if isinstance(value, int) and abs(value) > _EXACT_IN_DOUBLE:
            raise ConversionError(f'loss of precision when the integer {value} is read as {wanted.name}')
        return float(value)
    if isinstance(value, float):
        if not math.isfinite(value) or value != int(value):
            raise ConversionError(f'{value} is not an integer, and cannot be read as {wanted.name}')
        value = int(value)
    return _bounded(int(value), wanted.name, wanted.minimum, wanted.maximum)
