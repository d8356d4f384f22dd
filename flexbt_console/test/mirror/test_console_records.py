# SPDX-License-Identifier: BSD-3-Clause
"""The records of the mirror against the messages that they mirror: nothing of a message is forgotten."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from array import array
from collections.abc import Iterable
from enum import IntEnum
from typing import Any, Final

import pytest
from geometry_msgs.msg import PoseStamped
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import OccupancyGrid

from flexbt_common import names
from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_console.link.messages import command_message, record_of
from flexbt_console.link.surroundings_link import SurroundingsFeed
from flexbt_console.mirror import mirror, records, trees
from flexbt_console.present.json_form import encode_json
from flexbt_console.present.style import UNICODE
from flexbt_console.ui.screen.robot_panes import MapPane
from flexbt_console.ui.web.picture import parts_of
from flexbt_core.clock.clock import ManualClock
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES
from flexbt_msgs import msg
from flexbt_msgs.action import SynthesizeBehavior

NOT_MIRRORED: Final[dict[Any, dict[str, str]]] = {
    msg.BlackboardEntry: {'data': 'the operator reads and writes text; the executive turns it into data'},
    msg.ExecutiveCommand: {'stamp': 'it is the time of sending: a command that is sent again gets another'},
    msg.ExecutiveEvents: {'events': 'each is a record, with the number of its own'},
    msg.StopGuardStatus: {
        'stamp': 'it is the time of sending',
        'guard_id': 'what a guard says now is what counts, whichever it is',
        'sequence': 'the newest is latched',
    },
    msg.TreeStatus: {'changes': 'they are in what each node ended with, and since when its status holds'},
    msg.TreeStatusChange: {'previous_status': 'it is the one that the mirror has, where no message was lost'},
    msg.TreeStructure: {'blackboard': 'the console shows no blackboards of trees'},
    SynthesizeBehavior.Goal: {'operator_id': 'it is that of the console, not of the request'},
    SynthesizeBehavior.Result: {
        'code': 'where it is no answer, an exception is raised',
        'message': 'it is the text of that exception',
    },
}
"""Fields of messages that no record has, and why."""

NOT_SENT: Final[dict[Any, dict[str, str]]] = {
    records.OperatorCommand: {'stops': 'what waited when a STOP was given is refused here'},
    records.StopGuard: {'is_silent': 'from the time when it was heard'},
    trees.MirroredTree: {
        'gone_at': 'from what the executive says of the server',
        'life': 'from what the executive says of the server',
        'server': 'from who has sent the message',
        'last': 'from the changes of its statuses',
        'left_out': 'from the number of its nodes',
        'since': 'from the changes of its statuses',
    },
}
"""Fields of records that no message has, and where they are from."""

RENAMED: Final[dict[Any, dict[str, str]]] = {
    msg.Progress: {'distance_remaining': 'distance', 'time_remaining': 'time', 'poses_remaining': 'poses'},
    msg.BehaviorParameter: {'default_value': 'default'},
    msg.ExecutiveCommand: {'operator_id': 'operator'},
    msg.ExecutiveEvent: {'operator_id': 'operator'},
    msg.ExecutiveEvents: {'first': 'sequence'},
    msg.TreeStructure: {'behavior_tree': 'tree', 'number': 'structure'},
    msg.QueueEntry: {'operator_id': 'operator'},
    msg.DecisionSubject: {'id': 'decision_id', 'entries': 'values'},
    msg.TreeBreakpoint: {'behavior_tree': 'tree', 'operator_id': 'operator'},
    msg.TreeHold: {'behavior_tree': 'tree', 'operator_id': 'operator'},
    msg.StopGuardStatus: {'operator_id': 'operator', 'results': 'carried_out'},
    msg.UserdataScope: {'entries': 'values'},
}
"""Fields of messages by other names in the record."""

RECORDS: Final[dict[Any, Any]] = {
    msg.ActiveState: records.ActiveState,
    msg.BehaviorList: records.BehaviorList,
    msg.BehaviorManifest: records.Behavior,
    msg.BehaviorInput: records.BehaviorInput,
    msg.BehaviorParameter: records.BehaviorParameter,
    msg.BehaviorStructure: records.Structure,
    msg.BlackboardEntry: records.InputValue,
    msg.CommandResult: records.CommandResult,
    msg.DecisionSubject: records.Subject,
    msg.DecisionSubjects: records.Subjects,
    msg.ExecutiveCommand: records.OperatorCommand,
    msg.ExecutiveEvent: records.ExecutiveEvent,
    msg.ExecutiveEvents: records.ExecutiveEvent,
    msg.ExecutiveLog: records.LogLine,
    msg.ExecutiveStatus: records.ExecutiveSnapshot,
    msg.PeerStatus: records.Peer,
    msg.MissionQueue: records.MissionQueue,
    msg.Progress: records.DriveProgress,
    msg.PendingDecision: records.Decision,
    msg.QueueEntry: records.QueueEntry,
    msg.QueueOptions: QueueOptions,
    msg.StateStructure: records.StateStructure,
    msg.StopGuardStatus: records.StopGuard,
    msg.TreeBreakpoint: records.TreeBreakpoint,
    msg.TreeHold: records.TreeHold,
    msg.TreeNode: trees.MirroredNode,
    msg.TreeStatus: trees.MirroredTree,
    msg.TreeStatusChange: trees.StatusChange,
    msg.TreeStructure: trees.MirroredTree,
    msg.UserdataScope: records.UserdataScope,
    SynthesizeBehavior.Goal: records.SynthesisRequest,
    SynthesizeBehavior.Result: records.Synthesis,
}
"""The records of messages; what several tell may be one."""

NO_RECORD: Final[dict[Any, str]] = {
    msg.AutonomyLevel: 'a pair: path and level',
    msg.BehaviorArgument: 'a pair: name and value',
    msg.BlackboardWrites: 'a list of writes, which the query makes of three lists',
    msg.BtLoadError: 'of BtLoad, which no console asks for',
    msg.BtLoadReport: 'of BtLoad, which no console asks for',
    msg.Place: 'a pose by its name',
    msg.PlaceList: 'poses by their names',
    msg.TreeDebugging: 'it is in the status of the executive',
    msg.RobotPlan: 'points of what is around the robot',
}
"""Messages that have none, and why."""

CONSTANTS: Final[dict[Any, type[IntEnum]]] = {
    msg.CommandResult: records.ResultCode,
    msg.ExecutiveCommand: records.CommandKind,
    msg.ExecutiveEvent: records.EventKind,
    msg.ExecutiveLog: records.LogSeverity,
    msg.ExecutiveStatus: records.ExecutiveState,
    msg.PendingDecision: records.DecisionKind,
    msg.QueueOptions: OnFailure,
    msg.StateStructure: records.StateKind,
    msg.TreeBreakpoint: records.BreakpointKind,
    msg.TreeNode: trees.MirroredNodeKind,
    msg.TreeStatus: trees.MirroredStatus,
}
"""The constants of a message as an enumeration. No console sends a command of kind UNKNOWN."""


def test_each_message_has_a_record_or_none_for_a_reason() -> None:
    messages = {one for one in vars(msg).values() if isinstance(one, type)}
    assert {one for one in RECORDS if one in messages} | NO_RECORD.keys() == messages
    assert not RECORDS.keys() & NO_RECORD.keys()


@pytest.mark.parametrize('record', dict.fromkeys(RECORDS.values()), ids=lambda record: record.__name__)
def test_each_field_of_a_message_is_mirrored_or_left_out_for_a_reason(record: Any) -> None:
    expected = set(NOT_SENT.get(record, {}))
    for message in (one for one, its in RECORDS.items() if its is record):
        renamed, left_out = RENAMED.get(message, {}), NOT_MIRRORED.get(message, {})
        fields = message.get_fields_and_field_types()
        assert {*renamed, *left_out} <= fields.keys()
        expected |= {renamed.get(name, name) for name in fields if name not in left_out}
    assert {field.name for field in dataclasses.fields(record)} == expected


def constants_of(message: Any) -> dict[str, int]:
    """Return the numbers among the constants of a message, by their names."""
    return {
        name: value
        for name in dir(type(message))
        if name.isupper() and '__' not in name and isinstance(value := getattr(message, name), int)
    }


@pytest.mark.parametrize('message', CONSTANTS, ids=lambda message: message.__name__)
def test_the_constants_of_a_message_are_those_of_the_record(message: Any) -> None:
    constants = constants_of(message)
    if message is msg.ExecutiveCommand:
        del constants['UNKNOWN']
        assert constants.pop('NOTE_LENGTH') == records.NOTE_LENGTH
    assert {one.name: one.value for one in CONSTANTS[message]} == constants


def test_levels_and_liveness_are_those_of_the_engine_and_of_the_action() -> None:
    assert {int(one): one.name.title() for one in records.AutonomyLevel} == AUTONOMY_NAMES
    liveness = {value: name.lower().replace('_', '-') for name, value in constants_of(SynthesizeBehavior.Goal).items()}
    assert liveness == dict(enumerate(records.LIVENESS))


def filled(message: Any, numbers: Any) -> Any:
    """Return the message with every field other than its default, in all that it consists of."""
    for name, type in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, 'get_fields_and_field_types'):
            filled(value, numbers)
        elif type.startswith('sequence<'):
            inside = type.removeprefix('sequence<').removesuffix('>').partition(',')[0]
            setattr(message, name, [element(inside, numbers)])
        else:
            setattr(message, name, element(type, numbers))
    return message


def element(type: str, numbers: Any) -> Any:
    """Return a value of a type."""
    if type.startswith('string'):
        return f'text {next(numbers)}'
    if type == 'boolean':
        return True
    if '/' in type:
        package, name = type.split('/')
        assert package == 'flexbt_msgs', type
        return filled(getattr(msg, name)(), numbers)
    return 1.5 if type in ('float', 'double') else next(numbers)


def values(record: Any) -> list[tuple[str, Any]]:
    """Return the fields of a record, and of the records in it, by their names."""
    found = []
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        found.append((f'{type(record).__name__}.{field.name}', value))
        for part in value if isinstance(value, tuple) else (value,):
            found += values(part) if dataclasses.is_dataclass(part) else []
    return found


@pytest.mark.parametrize(
    'message', [msg.ExecutiveStatus, msg.BehaviorStructure, msg.BehaviorList, msg.ExecutiveLog, msg.MissionQueue]
)
def test_what_a_message_says_reaches_the_record(message: Any) -> None:
    """2 is a constant of each message that has constants; a number that is none would be taken for UNKNOWN."""
    full = filled(message(), itertools.repeat(2))
    empty = (None, '', (), 0, False)
    forgotten = [name for name, value in values(record_of(full)) if value in empty]
    assert forgotten == []


def test_what_a_command_says_reaches_the_message() -> None:
    numbers = {int: 3, float: 1.5, bool: True}
    fields: dict[str, Any] = {
        field.name: numbers.get(type(field.default), field.name)
        for field in dataclasses.fields(records.OperatorCommand)
    }
    fields |= {
        'kind': records.CommandKind.NOTE,
        'arguments': (('a', 'b'),),
        'inputs': (records.InputValue('k', 't', 'x'),),
        'queue_options': (QueueOptions(place='kitchen'),),
    }
    sent = command_message(records.OperatorCommand(**fields), 12.5)
    for name in sent.get_fields_and_field_types():
        assert getattr(sent, name) != getattr(msg.ExecutiveCommand(), name), name


def test_events_are_numbered_from_the_first_on() -> None:
    event = filled(msg.ExecutiveEvent(), itertools.repeat(2))
    first, second = record_of(msg.ExecutiveEvents(executive_id='e', first=7, events=[event, msg.ExecutiveEvent()]))
    assert (first.sequence, second.sequence, first.executive_id) == (7, 8, 'e')
    assert first.kind is records.EventKind.COMMAND
    assert [name for name, value in values(first) if value in (None, '', 0, False)] == []


def test_what_a_tree_tells_reaches_its_run() -> None:
    known = mirror.Mirror(ManualClock())
    receive = SurroundingsFeed(known).receivers
    node = filled(msg.TreeNode(), itertools.repeat(2))
    node.uid, node.parent = 1, 0
    structure = filled(msg.TreeStructure(), itertools.repeat(2))
    structure.nodes = [node]
    receive[names.TREE_STRUCTURE](structure)
    status = filled(msg.TreeStatus(), itertools.repeat(2))
    status.changes[0].uid = 1
    receive[names.TREE_STATUS](status, '/bt_server')
    (run,) = known.view().trees
    forgotten = [name for name, value in values(run) if value in (None, '', (), 0, False)]
    # All nodes are known, and the server is there.
    assert forgotten == ['MirroredNode.parent', 'MirroredTree.left_out', 'MirroredTree.gone_at']


def test_the_places_of_the_robot_are_known_by_name() -> None:
    kitchen = msg.Place(name='kitchen')
    kitchen.pose.header.frame_id = 'map'
    kitchen.pose.pose.position.x = 1.5
    kitchen.pose.pose.orientation.z = kitchen.pose.pose.orientation.w = 0.5**0.5
    nowhere = msg.Place(name='nowhere')
    places = record_of(msg.PlaceList(places=[kitchen, nowhere]))
    assert places.keys() == {'kitchen'}
    assert places['kitchen'].yaw == pytest.approx(1.5707963)


def _pose(x: float, y: float) -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id = 'map'
    pose.pose.position.x, pose.pose.position.y = x, y
    return pose


@pytest.mark.parametrize('is_first', [False, True])  # it is latched, and may come before the pose
@pytest.mark.parametrize(('frame', 'is_drawn'), [('map', True), ('', True), ('odom', False)])
def test_a_plan_in_another_frame_than_the_robot_is_not_drawn(frame: str, is_drawn: bool, is_first: bool) -> None:
    known = mirror.Mirror(ManualClock())
    receive = SurroundingsFeed(known).receivers[names.EXECUTIVE_PLAN]
    plan = msg.RobotPlan(frame_id=frame, x=[0.0, 2.0], y=[1.0, 3.0])
    if is_first:
        receive(plan)
    known.receive_snapshot(record_of(msg.ExecutiveStatus(sequence=1, robot_pose=_pose(1.0, 2.0))))
    if not is_first:
        receive(plan)
    assert known.view().drawn.plan == (((0.0, 1.0), (2.0, 3.0)) if is_drawn else ())


@pytest.mark.parametrize('has_map', [True, False])
@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf, 1e308, -1e308])
def test_what_is_nowhere_is_not_on_the_map(number: float, has_map: bool) -> None:
    """A robot that is lost may send anything, and the operator goes on seeing the rest."""
    known = mirror.Mirror(ManualClock())
    receive = SurroundingsFeed(known).receivers
    grid = OccupancyGrid(data=array('b', [0] * 4))
    grid.info.width = grid.info.height = 2
    grid.info.resolution = 0.5
    if has_map:
        receive[names.MAP](grid)
    known.receive_places(record_of(_places(_pose(1.0, 2.0), _pose(number, 0.0), _pose(0.0, number))))
    for sequence, pose in enumerate((_pose(number, 0.0), _pose(0.0, number)), 1):
        known.receive_snapshot(record_of(msg.ExecutiveStatus(sequence=sequence, robot_pose=pose)))
        with pytest.raises(ValueError, match='nowhere'):
            place = pose.pose.position
            receive[names.EXECUTIVE_PLAN](msg.RobotPlan(frame_id='map', x=[0.0, place.x], y=[0.0, place.y]))
        grid.info.origin = pose.pose
        with pytest.raises(ValueError, match='a map of'):
            receive[names.MAP](grid)
        view = known.view()
        assert view.snapshot is not None and view.snapshot.robot_pose is None
        assert view.places.keys() == {'0'}
        assert MapPane(UNICODE).draw(view, 40, 12).plain
        json.loads(encode_json(parts_of(view, 'ann')))


@given(
    yaw=st.floats(-7.0, 7.0),
    width=st.integers(1, 30),
    height=st.integers(1, 30),
    walls=st.sets(st.integers(0, 899), max_size=20),
)
def test_walls_of_a_map_that_is_turned_are_where_they_are(yaw: float, width: int, height: int, walls: set[int]) -> None:
    known, grid = mirror.Mirror(ManualClock()), OccupancyGrid()
    grid.info.width, grid.info.height, grid.info.resolution = width, height, 0.5
    grid.info.origin.position.x, grid.info.origin.position.y = 3.0, -2.0
    grid.info.origin.orientation.w, grid.info.origin.orientation.z = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
    grid.data = array('b', [100 if cell in walls else 0 for cell in range(width * height)])
    SurroundingsFeed(known).receivers[names.MAP](grid)
    seen = known.view().surroundings.map
    assert seen is not None

    def centres(columns: int, cells: Iterable[int]) -> list[tuple[float, float]]:
        return [(0.5 * (cell % columns + 0.5), 0.5 * (cell // columns + 0.5)) for cell in cells]

    there = [
        (3.0 + math.cos(yaw) * x - math.sin(yaw) * y, -2.0 + math.sin(yaw) * x + math.cos(yaw) * y)
        for x, y in centres(width, walls & set(range(width * height)))
    ]
    shown = [
        (seen.x + x, seen.y + y)
        for x, y in centres(seen.width, (cell for cell, value in enumerate(seen.cells) if value == 100))
    ]
    for these, others in ((there, shown), (shown, there)):
        assert all(min(math.dist(one, other) for other in others) < 0.5 for one in these)
    assert any(value != 255 for value in seen.cells)


def test_a_map_that_is_turned_and_long_is_refused() -> None:
    known, grid = mirror.Mirror(ManualClock()), OccupancyGrid()
    grid.info.width, grid.info.height, grid.info.resolution, grid.data = 1_000_000, 1, 0.05, array('b', [0] * 1_000_000)
    grid.info.origin.orientation.w = grid.info.origin.orientation.z = 1.0
    SurroundingsFeed(known).receivers[names.MAP](grid)
    grid.info.origin.orientation.z = 0.5
    with pytest.raises(ValueError, match='a map that is turned by'):
        SurroundingsFeed(known).receivers[names.MAP](grid)


def test_a_map_without_cells_is_none() -> None:
    """Nobody could draw it."""
    known, grid = mirror.Mirror(ManualClock()), OccupancyGrid()
    grid.info.resolution = 0.05
    with pytest.raises(ValueError, match='a map of 0 x 0 cells'):
        SurroundingsFeed(known).receivers[names.MAP](grid)
    assert known.view().surroundings.map is None


def _places(*poses: PoseStamped) -> msg.PlaceList:
    return msg.PlaceList(places=[msg.Place(name=str(number), pose=pose) for number, pose in enumerate(poses)])
