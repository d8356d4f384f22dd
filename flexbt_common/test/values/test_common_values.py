# SPDX-License-Identifier: BSD-3-Clause
"""Typed values: the round trip of every installed message type is exact, and errors say where."""

from __future__ import annotations

import math
import random
import struct
from array import array
from typing import Any

import numpy
import pytest
from ament_index_python.resources import get_resource, get_resources
from geometry_msgs.msg import Point, Point32, Pose, PoseArray, PoseStamped, PoseWithCovariance, Twist
from hypothesis import given, settings
from hypothesis import strategies as st
from nav2_msgs.action import Spin
from nav_msgs.msg import OccupancyGrid, Path
from rosidl_parser.definition import (
    AbstractSequence,
    AbstractString,
    AbstractWString,
    Array,
    BoundedSequence,
    NamespacedType,
)
from std_msgs.msg import Byte, String, UInt8

from flexbt_common.errors import UnknownTypeError, ValueConversionError
from flexbt_common.values.entries import Encoding, check_value, from_entry, text_to_value, to_entry, value_to_text
from flexbt_common.values.value_types import PRIMITIVES, FieldError, exact, resolve_type, type_name
from flexbt_msgs.msg import BlackboardEntry
from flexbt_testing.hostile_yaml import HOSTILE_YAML
from flexbt_testing.waiting import processor_time

COMMON_INTERFACES = (
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs', 'sensor_msgs', 'shape_msgs',
    'std_msgs', 'stereo_msgs', 'trajectory_msgs', 'visualization_msgs', 'flexbt_msgs',
)  # fmt: skip


def installed_messages() -> list[str]:
    """Return every message of the common interfaces that are installed here."""
    packages = set(COMMON_INTERFACES) & set(get_resources('rosidl_interfaces'))
    names = []
    for package in sorted(packages):
        lines = get_resource('rosidl_interfaces', package)[0].splitlines()
        names += [
            f'{package}/{line.removesuffix(".msg")}'
            for line in lines
            if line.startswith('msg/') and line.endswith('.msg')
        ]
    return sorted(names)


MESSAGES = installed_messages()

scalars: dict[str, st.SearchStrategy[Any]] = {
    'boolean': st.booleans(),
    'float': st.floats(width=32),
    'double': st.floats(),
}
for bits in (8, 16, 32, 64):
    scalars[f'int{bits}'] = st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    scalars[f'uint{bits}'] = st.integers(0, 2**bits - 1)


class MessageGenerator:
    """Random fields for any message. (Drawing each of them with hypothesis takes minutes for the large messages.)"""

    SPECIAL_FLOATS = (0.0, -0.0, math.inf, -math.inf, math.nan, 1e-45, 3.4e38, 0.1, 1 / 3)
    LETTERS = 'aZ09 :;{}[],"\'\\\n\t#-.~é漢🤖\x7f\u2028'

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def fields(self, name: str, depth: int = 0) -> dict[str, Any]:
        message = resolve_type(name).message
        assert message is not None
        slots = zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True)
        return {field: self.slot(slot, depth) for field, slot in slots}

    def slot(self, slot: Any, depth: int) -> Any:
        if isinstance(slot, NamespacedType):
            return self.fields(f'{slot.namespaces[0]}/msg/{slot.name}', depth + 1)
        if isinstance(slot, AbstractString | AbstractWString):
            most = min(9, getattr(slot, 'maximum_size', 9))
            return ''.join(self.random.choices(self.LETTERS, k=self.random.randint(0, most)))
        if isinstance(slot, Array | AbstractSequence):
            most = 0 if depth > 3 else 2
            if isinstance(slot, BoundedSequence):
                most = min(most, slot.maximum_size)
            size = slot.size if isinstance(slot, Array) else self.random.randint(0, most)
            return [self.slot(slot.value_type, depth) for _ in range(size)]
        return self.scalar(slot.typename)

    def scalar(self, kind: str) -> Any:
        if kind == 'boolean':
            return self.random.random() < 0.5
        if kind in ('float', 'double'):
            value = self.random.choice([*self.SPECIAL_FLOATS, self.random.uniform(-1e9, 1e9)])
            return struct.unpack('<f', struct.pack('<f', value))[0] if kind == 'float' else value
        bits = int(''.join(filter(str.isdigit, kind)) or 8)
        low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if kind.startswith('int') else (0, (1 << bits) - 1)
        return self.random.choice([low, high, self.random.randint(low, high)])


def same(one: Any, other: Any) -> bool:
    """Equality of values to the last bit. (Not by the bytes of the CDR: its padding is not initialised.)"""
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(same, one, other))
    if hasattr(one, 'SLOT_TYPES'):
        return type(one) is type(other) and repr(one) == repr(other)
    if isinstance(one, float) and math.isnan(one):
        return isinstance(other, float) and math.isnan(other)
    return type(one) is type(other) and one == other


@pytest.mark.parametrize('name', MESSAGES)
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_every_message_survives_both_encodings(name: str, seed: int) -> None:
    value = check_value(MessageGenerator(seed).fields(name), name)
    for encoding in Encoding:
        entry = to_entry('key', value, encoding=encoding)
        assert entry.type == name
        assert same(from_entry(entry), value), entry
        array_entry = to_entry('key', [value, value], encoding=encoding)
        assert array_entry.type == f'{name}[]'
        assert same(from_entry(array_entry), [value, value]), array_entry


@pytest.mark.parametrize('name', sorted(PRIMITIVES))
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_primitive_and_array_of_it_survives(name: str, data: st.DataObject) -> None:
    slot = PRIMITIVES[name]
    # A string that stands alone is not part of a message, so that not even a NUL is lost.
    alone = st.text(st.characters(exclude_categories=['Cs'])) if name == 'string' else scalars[slot.typename]
    value = data.draw(alone)
    for encoding in Encoding:
        assert same(from_entry(to_entry('k', value, name, encoding)), value)
    values = data.draw(st.lists(alone, max_size=4))
    assert same(from_entry(to_entry('k', values, f'{name}[]')), values)


@settings(max_examples=150, deadline=None)
@given(st.text(st.characters(exclude_categories=['Cs']), max_size=20))
def test_the_text_of_a_string_is_read_back_whatever_it_looks_like(text: str) -> None:
    assert text_to_value(value_to_text(text), 'string') == text


@settings(max_examples=150, deadline=None)
@given(
    st.text(max_size=30),
    st.sampled_from(['geometry_msgs/msg/PoseStamped', 'float64', 'int32[]', 'bool', 'string']),
)
def test_any_text_gives_a_value_or_our_error(text: str, name: str) -> None:
    try:
        value = from_entry(BlackboardEntry(key='k', type=name, text=text))
    except (ValueConversionError, UnicodeEncodeError):
        return
    assert same(from_entry(to_entry('k', value, name)), value)


@settings(max_examples=200, deadline=None)
@given(
    st.binary(min_size=1, max_size=60),
    st.sampled_from(['geometry_msgs/msg/Pose[]', 'std_msgs/msg/String[]', 'float64']),
)
def test_damaged_data_gives_our_error(data: bytes, name: str) -> None:
    try:
        from_entry(BlackboardEntry(key='k', type=name, data=data))
    except ValueConversionError as error:
        assert error.key == 'k' and error.type == name


def test_yaml_as_people_write_it() -> None:
    pose = text_to_value(
        '{header: {frame_id: map}, pose: {position: {x: 1, y: 1e-3}, orientation: {w: 1}}}',
        'geometry_msgs/PoseStamped',
    )
    assert isinstance(pose, PoseStamped)
    assert (pose.header.frame_id, pose.pose.position.x, pose.pose.position.y) == ('map', 1.0, 0.001)
    assert text_to_value('', 'geometry_msgs/msg/Twist') == Twist()
    assert text_to_value('hello world', 'string') == 'hello world'
    assert text_to_value('17', 'string') == '17'
    assert math.isnan(text_to_value('.nan', 'float64'))
    assert text_to_value('-inf', 'float32') == -math.inf
    assert text_to_value('"-.INF"', 'float32') == -math.inf
    assert text_to_value('[1, 2]', 'float64[]') == [1.0, 2.0]
    assert text_to_value('7', 'int') == 7


@pytest.mark.parametrize(
    ('text', 'name', 'fragments'),
    [
        (
            '{pose: {position: {z: high}}}',
            'geometry_msgs/msg/PoseStamped',
            ['pose.position.z', "'high'", 'number'],
        ),
        ('{pos: {}}', 'geometry_msgs/msg/PoseStamped', ['pos', "did you mean 'pose'"]),
        ('{poses: [{}, {pose: 3}]}', 'nav_msgs/msg/Path', ['poses[1].pose']),
        ('[1, x]', 'int32[]', ['[1]', 'integer']),
        ('300', 'uint8', ['300', '0 to 255']),
        ('1.5', 'int32', ['integer', '1.5']),
        ('--5', 'float64', ['number', "'--5'"]),
        ('-+1e5', 'float64', ['number', "'-+1e5'"]),
        ('yes please', 'bool', ['true or false']),
        ('1e39', 'float32', ['float32']),
        ('{covariance: [1.0]}', 'geometry_msgs/msg/PoseWithCovariance', ['covariance', 'exactly 36']),
        ('{a: [', 'geometry_msgs/msg/Pose', ['not JSON, and no YAML: ']),
        ('1', 'geometry_msgs/msg/Poze', ['Poze', "did you mean 'Pose'"]),
        ('1', 'geometri_msgs/msg/Pose', ['geometri_msgs', 'geometry_msgs']),
        ('1', 'os.path', ['not a type name']),
    ],
)
def test_errors_name_key_type_text_and_place(text: str, name: str, fragments: list[str]) -> None:
    with pytest.raises(ValueConversionError) as caught:
        from_entry(BlackboardEntry(key='the_key', type=name, text=text))
    message = str(caught.value)
    for fragment in [*fragments, 'the_key', name]:
        assert fragment in message, message


@pytest.mark.parametrize(
    ('value', 'name'),
    [
        (PoseStamped(), 'nav_msgs/msg/Path'),
        (True, 'int32'),
        ('1', 'int32'),
        ('a\0b', 'std_msgs/msg/String'),
        ([Pose(), Point()], 'geometry_msgs/msg/Pose[]'),
        (None, 'string'),
        (-1, 'uint64'),
    ],
)
def test_a_wrong_python_value_is_refused(value: Any, name: str) -> None:
    with pytest.raises(ValueConversionError):
        to_entry('k', value, name)


def test_a_field_of_a_wrong_type_is_refused_before_the_serializer_sees_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pose = Point()
    object.__setattr__(pose, '_x', None)
    with pytest.raises(ValueConversionError, match='x'):
        to_entry('k', pose)
    text = String()
    object.__setattr__(text, '_data', 'a\0b')
    with pytest.raises(ValueConversionError, match='NUL'):
        to_entry('k', text)


class Loose(dict[str, Any]):
    """Fields of other classes than those that rclpy's serializer reads without a check."""

    def message(self, name: str) -> Any:
        kind: Any = resolve_type(name).message
        return kind(check_fields=False, **self)


@pytest.mark.parametrize(
    ('name', 'loose', 'same_as'),
    [
        ('geometry_msgs/Point', Loose(x=3, y=numpy.float32(1.5), z='2.5'), {'x': 3.0, 'y': 1.5, 'z': 2.5}),
        ('std_msgs/Bool', Loose(data=numpy.True_), {'data': True}),
        ('std_msgs/UInt8', Loose(data=numpy.int16(7)), {'data': 7}),
        ('std_msgs/Byte', Loose(data=2), {'data': 2}),
        ('std_msgs/ByteMultiArray', Loose(data=[1, b'2']), {'data': [1, 50]}),
        ('rcl_interfaces/ParameterValue', Loose(bool_array_value=[numpy.True_]), {'bool_array_value': [True]}),
        (
            'geometry_msgs/Polygon',
            Loose(points=[Point32(check_fields=False, x=1)]),
            {'points': [{'x': 1.0}]},
        ),
    ],
)
def test_numbers_of_other_classes_are_sent_as_they_are_shown(name: str, loose: Loose, same_as: dict[str, Any]) -> None:
    value = check_value(same_as, name)
    for encoding in Encoding:
        assert same(from_entry(to_entry('k', loose.message(name), encoding=encoding)), value)
        assert same(from_entry(to_entry('k', [value, loose.message(name)], encoding=encoding)), [value, value])
    assert exact(value) is value


def test_a_map_is_sent_in_time() -> None:
    grid = OccupancyGrid(data=array('b', bytes(1_000_000)))
    began = processor_time()
    entry = to_entry('map', grid)
    assert processor_time() - began < 0.3
    assert from_entry(entry) == grid


def test_what_does_not_fit_a_field_of_a_goal_is_refused_with_its_place() -> None:
    goal = Spin.Goal(check_fields=False, target_yaw=1)
    assert (exact(goal), goal.target_yaw) == (Spin.Goal(target_yaw=1.0), 1)
    with pytest.raises(FieldError, match=r'field poses\[1\].position.x: expected a number, got True'):
        exact(PoseArray(poses=[Pose(), Pose(position=Point(check_fields=False, x=True))]))
    with pytest.raises(FieldError, match='field data: 300 is outside 0 to 255'):
        exact(UInt8(check_fields=False, data=300))
    with pytest.raises(FieldError, match=r'field poses\[0\]: expected a Pose, got None'):
        exact(PoseArray(check_fields=False, poses=[None]))
    pose = PoseWithCovariance()
    object.__setattr__(pose, '_covariance', numpy.zeros(35))  # of which the serializer would read 36
    with pytest.raises(FieldError, match='35 elements'):
        exact(pose)
    object.__setattr__(pose, '_covariance', numpy.array(0.0))
    with pytest.raises(ValueConversionError, match='field covariance: expected a list'):
        to_entry('k', pose)


def test_types_of_python_values() -> None:
    assert type_name(1) == 'int64'
    assert type_name(True) == 'bool'
    assert type_name([1, 2.0]) == 'float64[]'
    assert type_name([Byte(), Byte()]) == 'std_msgs/msg/Byte[]'
    assert type_name(Path()) == 'nav_msgs/msg/Path'
    for hopeless in ({}, [], [1, 'a'], [[1]], object()):
        with pytest.raises(UnknownTypeError):
            type_name(hopeless)


def test_an_empty_array_of_messages_survives_both_encodings() -> None:
    for encoding in Encoding:
        entry = to_entry('k', [], 'geometry_msgs/msg/Pose[]', encoding)
        assert from_entry(entry) == []
    assert from_entry(BlackboardEntry(key='k', type='geometry_msgs/msg/Pose[]')) == []


BOMBS = {
    **HOSTILE_YAML,
    'nested less': '[' * 900 + ']' * 900,
    'many digits': '9' * 200_000,
    'many hexadecimal digits': '0x' + 'f' * 100_000,
}


@pytest.mark.parametrize('text', BOMBS.values(), ids=BOMBS)
@pytest.mark.parametrize('type', ['int64', 'float64', 'bool', 'float64[]', 'geometry_msgs/msg/PoseStamped'])
def test_text_that_is_meant_to_do_harm_is_refused_in_time(type: str, text: str) -> None:
    began = processor_time()
    with pytest.raises(ValueConversionError) as caught:
        from_entry(BlackboardEntry(key='k', type=type, text=text))
    assert processor_time() - began < 10.0
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize('name', ['string', 'geometry_msgs/msg/Pose[]'])
def test_blanks_around_the_name_of_a_type_make_no_other_one(name: str) -> None:
    """What is known of a name is kept: there must not be any number of names."""
    assert all(resolve_type(' ' * count + name + '\t' * count) is resolve_type(name) for count in range(5))
