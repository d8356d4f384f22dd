# SPDX-License-Identifier: BSD-3-Clause
"""Ports for the fields of any message, and the expressions that they may contain.

An attribute such as ``goal.pose.header.frame_id`` is a port of the type of that field. Its value is a text, a pointer
``{key}``, or ``${expression}`` in the script language, where ``pose.header.frame_id`` reads a field of the message in
the entry ``pose``.
"""

from __future__ import annotations

import typing
from abc import ABCMeta
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Final, NamedTuple

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values.fields import Field, constants_of
from flexbt_common.values.templates import Expression, MessageTemplate, Source, embedded, is_expression
from flexbt_common.values.value_types import (
    FieldError,
    ValueType,
    from_plain,
    interface_class,
    message_type_name,
    parse_text,
    resolve_type,
)
from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, ConversionError, ElementError, ScriptError
from flexbt_core.behavior_tree.model.ports import (
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
from flexbt_core.values.text import did_you_mean
from flexbt_server.trees.ros_ports import PATH, POSE_STAMPED, POSES, array_type, message_type

_TYPES: Final = {
    'bool': BOOL, 'int8': INT8, 'int16': INT16, 'int32': INT, 'int64': INT64, 'uint8': UINT8, 'uint16': UINT16,
    'uint32': UNSIGNED, 'uint64': UINT64, 'float32': FLOAT, 'float64': DOUBLE, 'string': STRING,
    'geometry_msgs/msg/PoseStamped': POSE_STAMPED, 'geometry_msgs/msg/PoseStamped[]': POSES, 'nav_msgs/msg/Path': PATH,
}  # fmt: skip
"""Port types of fields by the names of their types. Port types of other messages are created on request."""


def type_of_field(field: Field) -> PortType:
    """Return the port type of a field. Integers may also be written as the names of constants of their message."""
    if field.slot is None:
        return _whole(field.owner)
    kind = type_by_name(field.type_name)
    constants = constants_of(field.owner) if kind.category == 'integer' else {}
    return _with_constants(kind, constants) if constants else kind


def type_by_name(name: str) -> PortType:
    """Return the port type for values of a ROS type, such as ``float64`` or ``nav_msgs/msg/Path``.

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
        return replace(array_type(resolved), from_text=_reader(resolved))
    return message_type(resolved.message)


def _whole(message: type[Any]) -> PortType:
    """Return the port type of a whole message, including goals, requests and other parts of an interface."""
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
    """Return the parser for JSON or YAML of a message or a list of messages. In XML the text begins with ``json:``."""

    def from_text(text: str) -> Any:
        return from_plain(parse_text(text.removeprefix('json:'), resolved), resolved)

    return from_text


# Expressions in ports.


def expression_type(name: str, roots: Mapping[str, type[Any]]) -> PortType:
    """Return the port type of literals that are expressions. Errors show ``name``."""

    def from_text(text: str) -> Expression:
        try:
            return Expression(text, roots)
        except ScriptError as error:
            raise ConversionError(error.reason) from error

    return PortType(name, Expression, 'object', from_text, immutable=True)


def _embedded(text: str) -> Expression:
    try:
        return embedded(text)
    except ScriptError as error:
        raise ConversionError(error.reason) from error


_EMBEDDED: Final = PortType('expression', Expression, 'object', _embedded, immutable=True)


# Leaves whose ports are the fields that their XML element names.


Fields = dict[tuple[str, str], tuple[Field, Source]]
"""Fields of the messages of an interface, by part and path."""


class Part(NamedTuple):
    """A message of an interface that XML attributes may address: the ``attribute`` of the interface class, or that
    class itself if '' is given. A leaf reads the ports of an input part and writes those of an output part."""

    attribute: str
    is_input: bool

    def of(self, interface: type[Any]) -> type[Any]:
        message: type[Any] = getattr(interface, self.attribute) if self.attribute else interface
        return message


class MessageLeaf(LeafNode):
    """Base of leaves that exchange messages of any type. An XML element names the interface in its attribute ``type``,
    and fields in attributes such as ``goal.pose.header.frame_id``.

    Each element gets a separate class, derived from the class of its tag, whose ports are these fields. A manifest
    defines such a class for a new tag (``node_manifests``).
    """

    __slots__ = ()

    interface_kind: ClassVar[str]
    """Kind of interface: ``msg``, ``srv`` or ``action``."""
    type_attribute: ClassVar[str]
    """Name of the class attribute that holds the interface class."""
    parts: ClassVar[Mapping[str, Part]]
    """Messages of the interface, by the prefix of the attributes."""
    condition: ClassVar[str] = ''
    """Port with a condition on the messages that the leaf receives."""
    templates: ClassVar[Mapping[str, MessageTemplate]] = {}
    """The fields that are sent or received, by part."""
    verdict: ClassVar[Expression | None] = None
    """Condition of a class from a manifest, where it is not a port."""
    is_declared: ClassVar[bool] = False
    """True if a manifest declares the class, so that it needs nothing from an element."""

    @classmethod
    def for_element(cls, attributes: Mapping[str, str]) -> type[MessageLeaf]:
        """Return the class for an element with these attributes.

        Raises:
            ElementError: the type is unknown, or its messages have no such fields.
        """
        name = attributes.get('type')
        if cls.is_declared or name is None:
            return cls  # in the second case the loader reports the missing port
        try:
            interface = interface_class(name, cls.interface_kind)
        except UnknownTypeError as error:
            raise ElementError([('type', str(error))]) from error
        fields: Fields = {}
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
            fields[prefix, path] = field, Source(attribute)
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
        # A number may come from an entry of another numeric type: the value decides.
        return replace(port, declares=kind.category == 'object')

    @classmethod
    def received(cls, interface: type[Any]) -> dict[str, type[Any]]:
        """Return the classes of the messages that conditions may read, by part."""
        return {name: part.of(interface) for name, part in cls.parts.items() if not part.is_input}

    @classmethod
    def derived(
        cls, name: str, interface: type[Any], fields: Fields, ports: Mapping[str, Port], options: Mapping[str, Any]
    ) -> type[MessageLeaf]:
        """Return a class for an interface, with these fields, ports and further class attributes."""
        of_parts: dict[str, dict[str, tuple[Field, Source]]] = {prefix: {} for prefix in cls.parts}
        for (prefix, path), field in fields.items():
            of_parts[prefix][path] = field
        attributes: dict[str, Any] = {
            '__slots__': (),
            '__doc__': cls.__doc__,
            '__module__': cls.__module__,
            'templates': {
                prefix: MessageTemplate(cls.parts[prefix].of(interface), given) for prefix, given in of_parts.items()
            },
            'ports': ports,
            cls.type_attribute: interface,
        }
        return typing.cast('type[MessageLeaf]', ABCMeta(name, (cls,), attributes | dict(options)))

    @classmethod
    def options(cls, attributes: Mapping[str, str]) -> dict[str, Any]:
        """Return the class attributes that these XML attributes, or entries of a manifest, determine.

        Raises:
            ElementError: an attribute has an invalid value.
        """
        return {}

    def message(self, prefix: str) -> Any:
        """Return the message of an input part, filled from its ports.

        Raises:
            ValueError, PortError: a value is missing or does not fit.
        """
        return self.templates[prefix].make(self._named, self._evaluated)

    def _named(self, port: str) -> Any:
        value = self.get_input_or(port, None)
        if value is None and port in self.port_values:
            return self.get_input(port)  # raises the reason
        return value

    def _evaluated(self, field: Field, expression: Expression) -> Any:
        ports = {name: self.get_input(name) for name in self.ports if self.is_declared and name in expression.names}
        try:
            return cast(expression.value(self.context.scripts, self.blackboard, ports), type_of_field(field))
        except BehaviorTreeError as error:
            raise ValueError(str(error)) from error

    def take(self, prefix: str, message: Any) -> None:
        """Write the ports of an output part.

        Raises:
            ValueError, PortError: the message has no such element, or the entry has another type.
        """
        for path, (field, source) in self.templates[prefix].fields.items():
            if self.port_key(source.name) is not None:
                try:
                    self.set_output(source.name, field.get(message))
                except FieldError as error:
                    raise ValueError(f'[{path or prefix}]: {error}') from error

    def judge(self, messages: Mapping[str, Any]) -> NodeStatus:
        """Return SUCCESS, or FAILURE with the reason if the leaf has a condition and it is false for the messages."""
        condition = self.get_input_or(self.condition, None) if self.condition in self.ports else self.verdict
        try:
            if condition is None or condition.holds(self.context.scripts, self.blackboard, messages):
                return NodeStatus.SUCCESS
            return self.fail(f'{self.condition}: not true: {condition.described(self.blackboard, messages)}')
        except (BehaviorTreeError, ValueError) as error:
            return self.fail(f'{self.condition}: {error}')
