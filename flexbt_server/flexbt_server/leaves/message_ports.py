# SPDX-License-Identifier: BSD-3-Clause
"""Ports for the fields of any message, and the expressions that may stand in them.

An attribute such as ``goal.pose.header.frame_id`` is a port of the type of that field. Its value is a text, a pointer
``{key}``, or ``${expression}`` in the language of scripts, in which ``pose.header.frame_id`` reads a field of the
message in the entry ``pose``.
"""

from __future__ import annotations

import copy
import re
import typing
from abc import ABCMeta
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, ClassVar, Final, NamedTuple

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values.fields import Field, constants_of, interface_class
from flexbt_common.values.value_types import (
    FieldError,
    ValueType,
    from_plain,
    message_type_name,
    parse_text,
    resolve_type,
)
from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, ConversionError, ElementError, ScriptError
from flexbt_core.behavior_tree.model.ports import (
    ANY,
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    INT8,
    INT16,
    INT64,
    STRING,
    UINT8,
    UINT16,
    UINT64,
    UNSIGNED,
    Port,
    PortType,
    cast,
    input_port,
    list_of,
    output_port,
    pointer_key,
)
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.script.parser import parse_script
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_server.trees.ros_ports import PATH, POSE_STAMPED, POSES, message_type

_TYPES: Final = {
    'bool': BOOL, 'int8': INT8, 'int16': INT16, 'int32': INT, 'int64': INT64, 'uint8': UINT8, 'uint16': UINT16,
    'uint32': UNSIGNED, 'uint64': UINT64, 'float32': FLOAT, 'float64': DOUBLE, 'string': STRING,
    'geometry_msgs/msg/PoseStamped': POSE_STAMPED, 'geometry_msgs/msg/PoseStamped[]': POSES, 'nav_msgs/msg/Path': PATH,
}  # fmt: skip
"""Port types of fields by the names of their types; those of other messages are made."""
_SCALARS: Final = frozenset(name for name in _TYPES if '/' not in name)
_NOTHING: Final[Mapping[str, Any]] = MappingProxyType({})
_VALUE: Final = '_value'
"""Name by which an expression keeps its value on its own blackboard."""
_NAMES: Final = re.compile(r'(?<![\w.])@?[A-Za-z_]\w*')
_PRIVATE: Final = re.compile(r"(?<![\w.'])_\w+")
_PARTS: Final = re.compile(r"'[^']*'|(?<![\w.])(@?[A-Za-z_]\w*)((?:\.\w+)+)")
"""A text of a script, or a name with the path of a field."""


def type_of_field(field: Field) -> PortType:
    """Return the port type of a field. Integers may also be written as the names of constants of their message."""
    if field.slot is None:
        return _whole(field.owner)
    kind = type_by_name(field.type_name)
    constants = constants_of(field.owner) if kind.category == 'integer' else {}
    return _with_constants(kind, constants) if constants else kind


def type_by_name(name: str) -> PortType:
    """Return the port type of values of a type of ROS, such as ``float64`` or ``nav_msgs/msg/Path``.

    Raises:
        UnknownTypeError: no such message is installed.
    """
    resolved = resolve_type(name)
    known = _TYPES.get(resolved.name)
    if known is not None:
        return known
    if resolved.message is None:
        return list_of(_TYPES[resolved.name.removesuffix('[]')])
    if resolved.is_array:
        return PortType(resolved.name, list, from_text=_reader(resolved))
    return message_type(resolved.message)


def _whole(message: type[Any]) -> PortType:
    """Return the type of a whole message, also of a goal, a request, and what else has no name of its own."""
    name = message_type_name(message)
    if '/msg/' in name:
        return _TYPES.get(name) or message_type(message)
    return PortType(name, message, from_text=_reader(ValueType(name, None, message, is_array=False)))


def _with_constants(kind: PortType, constants: Mapping[str, Any]) -> PortType:
    parse = kind.from_text
    assert parse is not None

    def from_text(text: str) -> Any:
        if text[:1].isalpha():
            if text not in constants:
                raise ConversionError(f'there is no constant {text}{did_you_mean(text, constants, "")}')
            return constants[text]
        return parse(text)

    return PortType(kind.name, int, 'integer', from_text, kind.minimum, kind.maximum, immutable=True)


def _reader(resolved: ValueType) -> Callable[[str], Any]:
    """Return what reads the JSON or YAML of a message, or of a list of messages; in XML it begins with ``json:``."""

    def from_text(text: str) -> Any:
        return from_plain(parse_text(text.removeprefix('json:'), resolved), resolved)

    return from_text


# Expressions.


class Expression:
    """An expression in the language of scripts that also reads fields of messages, as ``name.field``.

    Names are entries of the blackboard. A name with a field is a message in an entry, unless it is one of ``roots``:
    the messages that a leaf has received, by what they are called in its expressions.
    """

    def __init__(self, text: str, roots: Mapping[str, type[Any]]) -> None:
        """Raise ScriptError or FieldError if this is no expression, or reads a field that a root does not have."""
        self.text = text
        self._roots = roots
        self._constants: dict[str, Any] = {}
        self._fields: dict[str, tuple[str, str, Field | None]] = {}
        """By placeholder in the script: name and path, and the field of a root."""
        self._placeholders: dict[str, str] = {}
        self.script = _PARTS.sub(self._placeholder, text)
        if len(parse_script(self.script)) != 1:
            raise ScriptError(text, 0, 'expected one expression')
        self.names = frozenset(_NAMES.findall(re.sub(r"'[^']*'", '', text)))
        """Names in the text: entries, ports, roots."""
        self._private = [name for name in _PRIVATE.findall(self.script) if name not in self._placeholders.values()]

    def _placeholder(self, match: re.Match[str]) -> str:
        whole, name, path = match[0], match[1], match[2]
        if name is None:
            return whole
        known = self._placeholders.get(whole)
        if known is not None:
            return known
        placeholder = self._placeholders[whole] = f'_field{len(self._placeholders)}'
        path = path[1:]
        root = self._roots.get(name)
        if root is not None and path in constants_of(root):
            self._constants[placeholder] = getattr(root, path)
            return placeholder
        field = None if root is None else Field(root, path)
        if field is not None and (field.slot is None or field.type_name not in _SCALARS):
            raise FieldError(whole, f'it is a {field.type_name}; an expression reads numbers, bools and texts')
        self._fields[placeholder] = name, path, field
        return placeholder

    def value(self, node: TreeNode, values: Mapping[str, Any] = _NOTHING) -> Any:
        """Return the value, on the blackboard of a node; ``values`` are named values in front of the blackboard.

        Raises:
            ValueError, BlackboardError: an entry is missing, or has no such field.
            ScriptError: the values cannot be combined so.
        """
        board = self._board(node, {}, values)
        board.declare(_VALUE, ANY)
        node.context.scripts.script(f'{_VALUE} := ({self.script})').bind(board).run()
        return board.get(_VALUE)

    def holds(self, node: TreeNode, messages: Mapping[str, Any], values: Mapping[str, Any] = _NOTHING) -> bool:
        """Return whether the condition is true of these messages and named values. Raises as :meth:`value`."""
        board = self._board(node, messages, values)
        return bool(node.context.scripts.script(self.script).bind(board, condition=True).run())

    def described(self, node: TreeNode, messages: Mapping[str, Any], values: Mapping[str, Any] = _NOTHING) -> str:
        """Return the expression and the values of the fields that it reads, for a person."""
        shown = [f'{name} = {short_repr(value)}' for name, value in values.items()]
        for name, path, field in self._fields.values():
            shown.append(f'{name}.{path} = {short_repr(_read(node, name, path, field, messages, values))}')
        return f'{self.text} ({", ".join(shown)})' if shown else self.text

    def _board(self, node: TreeNode, messages: Mapping[str, Any], values: Mapping[str, Any]) -> Blackboard:
        board = Blackboard(node.blackboard)
        board.enable_autoremap()
        for name in self._private:
            board.remap(name, name)
        for name, value in (*self._constants.items(), *values.items()):
            board.put(name, value, None)
        for placeholder, (name, path, field) in self._fields.items():
            board.put(placeholder, _read(node, name, path, field, messages, values), None)
        return board


def _read(
    node: TreeNode, name: str, path: str, field: Field | None, messages: Mapping[str, Any], values: Mapping[str, Any]
) -> Any:
    if field is not None:
        return field.get(messages[name])
    message = values[name] if name in values else node.blackboard.get(name)
    if not hasattr(type(message), 'get_fields_and_field_types'):
        raise ValueError(f'the entry [{name}] holds no message with a field {path!r}, but {short_repr(message)}')
    return Field(type(message), path).get(message)


def expression_type(name: str, roots: Mapping[str, type[Any]]) -> PortType:
    """Return the type of literals that are expressions; ``name`` is what errors call it."""

    def from_text(text: str) -> Expression:
        try:
            return Expression(text, roots)
        except ScriptError as error:
            raise ConversionError(error.reason) from error

    return PortType(name, Expression, 'object', from_text, immutable=True)


def is_expression(text: object) -> bool:
    """Return whether the value of a field is written as ``${expression}``."""
    return isinstance(text, str) and text.strip().startswith('${') and text.rstrip().endswith('}')


def embedded(text: str) -> Expression:
    """Return the expression of ``${expression}``. Raises ConversionError."""
    return expression_type('expression', {}).parse(text.strip()[2:-1])


_EMBEDDED: Final = PortType('expression', Expression, 'object', embedded, immutable=True)


# Leaves whose ports are the fields that their element gives.


class Part(NamedTuple):
    """A message of an interface that attributes may address: the class of the interface has it as ``attribute``, or
    is it, if that is ''. A leaf reads the ports of an input, and writes those of an output."""

    attribute: str
    is_input: bool

    def of(self, interface: type[Any]) -> type[Any]:
        message: type[Any] = getattr(interface, self.attribute) if self.attribute else interface
        return message


class Source(NamedTuple):
    """Where the value of a field comes from or goes to: a port, or else a constant or an expression."""

    port: str
    value: Any = None


class MessageLeaf(LeafNode):
    """Base of leaves that exchange messages of any type: an element names the interface by its attribute ``type``, and
    fields by attributes such as ``goal.pose.header.frame_id``.

    Each element has a class of its own, derived from that of its tag, whose ports are those fields. A manifest makes
    such a class for a tag of its own (``node_manifests``).
    """

    __slots__ = ()

    interface_kind: ClassVar[str]
    """Kind of interface: ``msg``, ``srv`` or ``action``."""
    type_attribute: ClassVar[str]
    """Attribute of the class that has the class of the interface."""
    parts: ClassVar[Mapping[str, Part]]
    """Messages of the interface, by what attributes begin with."""
    condition: ClassVar[str] = ''
    """Port with a condition on the messages that the leaf receives."""
    fields: ClassVar[Mapping[str, tuple[Field, Source]]] = {}
    """The fields that are sent or received, by path."""
    verdict: ClassVar[Expression | None] = None
    """Condition of a class from a manifest, which has no port for it."""
    is_complete: ClassVar[bool] = False
    """True if the class has its interface."""

    @classmethod
    def for_element(cls, attributes: Mapping[str, str]) -> type[MessageLeaf]:
        """Return the class for an element with these attributes.

        Raises:
            ElementError: the type is unknown, or its messages have no such fields.
        """
        name = attributes.get('type')
        if cls.is_complete or name is None:
            return cls  # in the second case the port is missing, which is reported
        try:
            interface = interface_class(name, cls.interface_kind)
        except UnknownTypeError as error:
            raise ElementError([('type', str(error))]) from error
        fields: dict[str, tuple[Field, Source]] = {}
        ports = dict(cls.ports)
        problems: list[tuple[str, str]] = []
        for attribute, text in attributes.items():
            prefix, _, path = attribute.partition('.')
            if prefix not in cls.parts:
                if path:
                    problems.append((attribute, f'[{cls.__name__}] has no {prefix!r}; it has {", ".join(cls.parts)}'))
                continue
            try:
                field = cls.field(interface, attribute)
            except FieldError as error:
                problems.append((attribute, str(error)))
                continue
            fields[attribute] = field, Source(attribute)
            port = cls.port_of(attribute, field)
            ports[attribute] = replace(port, literal=_EMBEDDED) if is_expression(text) else port
        if cls.condition:
            if pointer_key(attributes.get(cls.condition, ''), cls.condition) is not None:
                problems.append((cls.condition, 'a condition has to be written here, not on the blackboard'))
            condition = expression_type('condition', cls.received(interface))
            ports[cls.condition] = replace(ports[cls.condition], literal=condition)
        if problems:
            raise ElementError(problems)
        return cls.derived(cls.__name__, interface, fields, ports, cls.options(attributes))

    @classmethod
    def field(cls, interface: type[Any], path: str) -> Field:
        """Return a field of a part, such as ``goal.pose``.

        Raises:
            FieldError: the interface has no such field, or it cannot be an input.
        """
        prefix, _, inner = path.partition('.')
        field = Field(cls.parts[prefix].of(interface), inner)
        if field.is_length and cls.parts[prefix].is_input:
            raise FieldError(inner, 'the length of a list is not an input; write its elements')
        return field

    @classmethod
    def port_of(cls, path: str, field: Field) -> Port:
        """Return the port for a field of a part."""
        kind = type_of_field(field)
        port = input_port(kind) if cls.parts[path.partition('.')[0]].is_input else output_port(kind)
        # A number may come from an entry of another type of numbers: the value decides.
        return replace(port, declares=kind.category == 'object')

    @classmethod
    def received(cls, interface: type[Any]) -> dict[str, type[Any]]:
        """Return the classes of the messages that conditions may read, by part."""
        return {name: part.of(interface) for name, part in cls.parts.items() if not part.is_input}

    @classmethod
    def derived(
        cls,
        name: str,
        interface: type[Any],
        fields: Mapping[str, tuple[Field, Source]],
        ports: Mapping[str, Port],
        options: Mapping[str, Any],
    ) -> type[MessageLeaf]:
        """Return a class for an interface, with these fields and ports, and these further attributes."""
        attributes: dict[str, Any] = {
            '__slots__': (),
            '__doc__': cls.__doc__,
            '__module__': cls.__module__,
            'is_complete': True,
            'fields': fields,
            'ports': ports,
            cls.type_attribute: interface,
        }
        return typing.cast('type[MessageLeaf]', ABCMeta(name, (cls,), attributes | dict(options)))

    @classmethod
    def options(cls, attributes: Mapping[str, str]) -> dict[str, Any]:
        """Return attributes of the class that an element, or a manifest, determines by these attributes.

        Raises:
            ElementError: one of them has no such value.
        """
        return {}

    def message(self, prefix: str) -> Any:
        """Return the message that the fields of an input part make.

        Raises:
            ValueError, PortError: a value is missing, or does not fit.
        """
        given = {path: source for path, source in self.fields.items() if path.partition('.')[0] == prefix}
        message: Any = None
        if prefix in given:
            _, whole = given.pop(prefix)
            message = copy.deepcopy(self._value(prefix, whole)) if given else self._value(prefix, whole)
        if message is None:
            message = self.parts[prefix].of(getattr(self, self.type_attribute))()
        for path, (field, source) in sorted(given.items(), key=lambda one: one[1][0].steps):
            value = self._value(path, source)
            if value is None:  # a port that may be left out
                continue
            if any(other.startswith(f'{path}.') for other in given):  # it is changed, and belongs to the blackboard
                value = copy.deepcopy(value)
            try:
                field.set(message, value)
            except FieldError as error:
                raise ValueError(f'[{path}]: {error.reason}') from error
        return message

    def _value(self, path: str, source: Source) -> Any:
        value = self.get_input_or(source.port, None) if source.port else source.value
        if value is None and source.port in self.port_values:
            value = self.get_input(source.port)  # raises the reason
        if not isinstance(value, Expression):
            return value
        kind = type_of_field(self.fields[path][0])
        ports = {name: self.get_input(name) for name in self.ports if not source.port and name in value.names}
        try:
            return cast(value.value(self, ports), kind)
        except (BehaviorTreeError, ValueError) as error:
            raise ValueError(f'[{path}]: {error}') from error

    def take(self, prefix: str, message: Any) -> None:
        """Write the ports of an output part.

        Raises:
            ValueError, PortError: the message has no such element, or the entry another type.
        """
        for path, (field, source) in self.fields.items():
            if path.partition('.')[0] == prefix and self.port_key(source.port) is not None:
                try:
                    self.set_output(source.port, field.get(message))
                except FieldError as error:
                    raise ValueError(f'[{path}]: {error}') from error

    def judge(self, messages: Mapping[str, Any]) -> NodeStatus:
        """Return SUCCESS, or FAILURE with the reason if there is a condition that is not true of the messages."""
        condition = self.get_input_or(self.condition, None) if self.condition in self.ports else self.verdict
        try:
            if condition is None or condition.holds(self, messages):
                return NodeStatus.SUCCESS
            return self.fail(f'{self.condition}: not true: {condition.described(self, messages)}')
        except (BehaviorTreeError, ValueError) as error:
            return self.fail(f'{self.condition}: {error}')
