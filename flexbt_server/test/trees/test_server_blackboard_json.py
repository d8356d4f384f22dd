# SPDX-License-Identifier: BSD-3-Clause
"""ROS messages in the JSON of blackboards."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Any

import pytest
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid, Path
from std_msgs.msg import ByteMultiArray, String

from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.blackboard_json import export_blackboard, import_blackboard
from flexbt_core.behavior_tree.model.errors import BlackboardError, ConversionError
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_server.trees.ros_ports import PATH, POSES, RosJsonTypes

TYPES = RosJsonTypes()


@dataclass(frozen=True)
class Waypoint:
    name: str


TEXT = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=5)
POINTS = st.builds(Point, x=st.floats(), y=st.floats(), z=st.floats())


@st.composite
def stamped(draw: st.DrawFn) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = draw(TEXT)
    message.header.stamp.sec = draw(st.integers(-(2**31), 2**31 - 1))
    message.header.stamp.nanosec = draw(st.integers(0, 2**32 - 1))
    message.pose.position = draw(POINTS)
    return message


@st.composite
def messages(draw: st.DrawFn) -> Any:
    match draw(st.integers(0, 4)):
        case 0:
            return draw(stamped())
        case 1:
            return Path(poses=draw(st.lists(stamped(), max_size=3)))
        case 2:
            return OccupancyGrid(data=draw(st.lists(st.integers(-128, 127), max_size=20)))
        case 3:
            message = PoseWithCovarianceStamped()
            message.pose.covariance[draw(st.integers(0, 35))] = draw(st.floats())
            return message
        case _:
            values = draw(st.lists(st.integers(0, 255), max_size=4))
            return ByteMultiArray(data=[bytes([value]) for value in values])


def plain(value: Any) -> Any:
    if isinstance(value, list):
        return [plain(item) for item in value]
    return type(value), repr(value)  # not its CDR: that has whatever was in memory between fields


@settings(max_examples=60, deadline=None)
@given(
    st.dictionaries(st.sampled_from('abcd'), messages() | st.lists(messages(), max_size=3)),
    st.lists(stamped(), max_size=2),
)
def test_messages_come_back_with_every_digit(values: dict[str, Any], poses: list[PoseStamped]) -> None:
    board = Blackboard()
    for key, value in values.items():
        board.set(key, value)
    board.set('poses', poses, POSES)
    board.declare('path', PATH)
    document, problems = export_blackboard(board, TYPES)
    assert not problems
    again = Blackboard()
    import_blackboard(again, json.loads(json.dumps(document, allow_nan=False)), TYPES)
    assert again.keys() == board.keys()
    for key in board.snapshot():
        assert plain(again.get(key)) == plain(board.get(key))
    one, other = board.entry('poses'), again.entry('poses')
    assert one is not None
    assert other is not None
    assert one.type is not None
    assert other.type is not None
    assert one.type.name == other.type.name
    again.set('path', Path())  # the type of the declared entry is back as well
    with pytest.raises(BlackboardError):
        again.set('path', 3)


def test_a_person_may_leave_fields_out_and_is_told_of_wrong_ones() -> None:
    board = Blackboard()
    pose = {'__type': 'geometry_msgs/msg/PoseStamped'}
    import_blackboard(board, {'goal': {**pose, 'header': {'frame_id': 'map'}}}, TYPES)
    goal = board.get('goal')
    assert (goal.header.frame_id, goal.pose.orientation.w) == ('map', 1.0)
    wrong: list[dict[str, Any]] = [
        {'headr': {}},
        {'header': {'frame_id': 3}},
        {'header': 'map'},
        {'pose': {'position': {'x': 'far'}}},
    ]
    for fields in wrong:
        with pytest.raises(BlackboardError, match='goal'):
            import_blackboard(board, {'goal': {**pose, **fields}}, TYPES)
    with pytest.raises(BlackboardError, match='os/msg/Path'):
        import_blackboard(board, {'goal': {'__type': 'os/msg/Path'}}, TYPES)


def test_classes_of_a_package_are_there_beside_the_messages() -> None:
    registry = builtin_registry()
    registry.json_types.register('demo::Waypoint', Waypoint, asdict, lambda fields: Waypoint(**fields))
    types = RosJsonTypes(registry.json_types)
    board = Blackboard()
    board.set('both', [Waypoint('a'), Point(x=1.0)])
    board.declare('later', types.port_type('Waypoint'))
    document, problems = export_blackboard(board, types)
    assert not problems
    again = Blackboard()
    import_blackboard(again, json.loads(json.dumps(document)), types)
    assert again.get('both') == board.get('both')
    again.set('later', Waypoint('b'))
    with pytest.raises(BlackboardError):
        again.set('later', Point())
    with pytest.raises(ValueError, match='registered'):
        registry.json_types.register('demo::Waypoint', PoseStamped, vars, lambda fields: PoseStamped())


def test_a_message_that_no_ros_type_fits_is_told() -> None:
    board = Blackboard()
    board.set('cut', String(data='a\0b'))
    board.set('nan', Point(x=math.nan))
    document, problems = export_blackboard(board, TYPES)
    assert list(document) == ['nan']
    assert 'NUL' in problems[0]


@pytest.mark.parametrize('text', ['', '5', '5;map;1', f'5;map;{"1;" * 9}'])
def test_a_text_that_is_no_path_is_refused_with_what_is_expected(text: str) -> None:
    with pytest.raises(ConversionError, match=r'is not a nav_msgs/msg/Path: \d+ fields; expected '):
        PATH.parse(text)
