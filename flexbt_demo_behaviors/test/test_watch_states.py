# SPDX-License-Identifier: BSD-3-Clause
"""The states of the night watch, as the executive runs them: doors, the other robot, and what is seen in a room."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
from std_srvs.srv import SetBool

from flexbt_common import names
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core import EventState, OperatableStateMachine
from flexbt_demo_behaviors.night_watch.states import (
    CompareScanState,
    ForgetRoundState,
    NextRoomState,
    NoteRoomState,
    OpenDoorState,
    PlaceState,
    TakeOverState,
    WatchPartnerState,
    places_in,
    pose_of,
)
from flexbt_states import CalculationState
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import wait_until

PLACES = 'flexbt_demo_behaviors/night_watch/places.yaml'


@pytest.fixture
def bench() -> Iterator[StateBench]:
    """Run states."""
    bench = StateBench()
    yield bench
    bench.close()


@pytest.mark.parametrize(('success', 'outcome'), [(True, 'open'), (False, 'jammed')])
def test_a_door_opens_or_is_jammed_and_the_operator_is_told(bench: StateBench, success: bool, outcome: str) -> None:
    asked: list[bool] = []

    def answer(request: Any, response: Any) -> Any:
        asked.append(request.data)
        response.success, response.message = success, '' if success else 'rust'
        return response

    runtime = bench.runtime
    runtime.call(lambda: runtime.node.create_service(SetBool, 'doors/archive_door', answer))
    run = bench.run_state(lambda: OpenDoorState('doors', seconds=0.05), {'room': 'archive'})
    assert run.wait() == outcome
    assert asked == [True]
    assert ('rust' in run.errors()) is not success


def test_rooms_are_told_to_the_partner_and_left_behind_when_it_is_lost(bench: StateBench) -> None:
    """The state of one robot tells, that of the other hears; what is no room is left aside."""
    with NodeRuntime.open(names.ONBOARD_EXECUTIVE, namespace='alpha') as alpha:
        LivelinessToken(alpha).set_ready(True)
        publisher = alpha.call(lambda: alpha.node.create_publisher(String, 'rooms_left', names.transient_local_qos()))
        publisher.publish(String(data='store cellar office store'))
        run = bench.run_state(lambda: WatchPartnerState('alpha', PLACES), {'left_behind': []})
        wait_until(
            lambda: any('store, office' in line for leaf in run.active() for line in leaf.activity), 'rooms heard'
        )
        assert run.outcome is None
    assert run.wait() == 'lost'
    assert 'it had left: store, office' in run.errors()


def test_a_message_of_the_partner_that_comes_after_the_end_is_no_fault(bench: StateBench) -> None:
    """The subscription is destroyed on the executor, which may have taken a message before; found by the nemesis."""
    states: list[WatchPartnerState] = []

    def make() -> WatchPartnerState:
        states.append(WatchPartnerState('alpha', PLACES))
        return states[-1]

    run = bench.run_state(make, {'left_behind': []})
    wait_until(run.active, 'active')
    assert run.stop() == 'preempted'
    for state in states:
        state._on_message(String(data='store'))


def test_without_a_partner_nothing_is_ever_lost(bench: StateBench) -> None:
    run = bench.run_state(lambda: WatchPartnerState('', PLACES), {'left_behind': []})
    wait_until(run.active, 'active')
    assert run.stop() == 'preempted'


def test_the_next_room_is_one_with_a_door_when_there_is_a_place_to_open_it_from(bench: StateBench) -> None:
    userdata = {'inherited': ['store'], 'checked': ['lobby'], 'postponed': []}
    for room, outcome in (('archive', 'door'), ('lobby', 'room')):
        run = bench.run_state(lambda room=room: NextRoomState(room, PLACES), userdata)  # type: ignore[misc]
        assert run.wait() == outcome
    done = bench.run_state(lambda: NextRoomState('lobby', PLACES), {**userdata, 'inherited': []})
    assert done.wait() == 'done'


@pytest.mark.parametrize(
    ('state', 'userdata', 'expected'),
    [
        (NoteRoomState, {'rooms': ['lab', 'store'], 'room': 'lab'}, {'rooms': ['store', 'lab']}),
        (NoteRoomState, {'rooms': [], 'room': 'lab'}, {'rooms': ['lab']}),
        (ForgetRoundState, {'checked': ['lab'], 'postponed': ['lab']}, {'checked': [], 'postponed': []}),
        (TakeOverState, {'left_behind': ['lab']}, {'inherited': ['lab']}),
        (lambda: PlaceState('lab', PLACES), {}, {'pose': pose_of(places_in(PLACES)['lab'])}),
    ],
)
def test_lists_of_rooms_and_places_are_written(
    bench: StateBench, state: Callable[[], EventState], userdata: dict[str, Any], expected: dict[str, Any]
) -> None:
    read: dict[str, Any] = {}
    assert bench.run_state(state, userdata, outputs=list(expected), read=read).wait() == 'done'
    assert read == expected


@pytest.mark.parametrize(
    ('x', 'beams', 'outcome'), [(0.3, 6, 'found'), (0.3, 0, 'clear'), (3.0, 6, 'elsewhere'), (3.0, 0, 'elsewhere')]
)
def test_a_room_is_judged_from_its_place_only(bench: StateBench, x: float, beams: int, outcome: str) -> None:
    """A robot whose battery was charged between the drive and the look is at its dock, whatever it sees there."""
    pose = PoseStamped()
    pose.pose.position.x = x
    scan = LaserScan(angle_increment=0.01, ranges=[1.0] * beams)
    userdata = {'map': OccupancyGrid(), 'goal': PoseStamped(), 'pose': pose, 'scan': scan, 'finding': None}
    run = bench.run_state(CompareScanState, userdata)
    assert run.wait() == outcome


def test_a_place_that_is_missed_twice_is_told(bench: StateBench) -> None:
    """A robot that has looked from there in between may have been driven away again."""
    there, beside = PoseStamped(), PoseStamped()
    beside.pose.position.x = 0.75
    ends_of_drives = iter([beside, there, beside, beside, there])

    def machine() -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['beside'])
        for key, value in {'map': OccupancyGrid(), 'goal': there, 'scan': LaserScan(), 'pose': None}.items():
            machine.userdata[key] = value
        with machine:
            OperatableStateMachine.add(
                'Drive',
                CalculationState(lambda _pose: next(ends_of_drives)),
                {'done': 'Look'},
                remapping={'input_value': 'pose', 'output_value': 'pose'},
            )
            ways = {'found': 'Drive', 'clear': 'Drive', 'elsewhere': 'Drive', 'beside': 'beside'}
            OperatableStateMachine.add('Look', CompareScanState(), ways)
        return machine

    run = bench.run(machine)
    assert run.wait() == 'beside'
    assert 'something may stand there' in run.errors()
    assert list(ends_of_drives) == [there]


def test_a_place_in_another_frame_is_told(bench: StateBench) -> None:
    userdata = {'map': OccupancyGrid(), 'goal': PoseStamped(), 'pose': PoseStamped(), 'scan': LaserScan()}
    userdata['goal'].header.frame_id = 'odom'
    run = bench.run_state(CompareScanState, {**userdata, 'finding': None})
    run.wait()
    assert "they are in '', 'odom', ''" in run.errors()
