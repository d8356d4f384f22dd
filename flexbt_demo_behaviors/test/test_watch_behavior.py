# SPDX-License-Identifier: BSD-3-Clause
"""The behavior of the night watch: its machine, its trees, the order of its rooms, what it finds."""

import math
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import LaserScan

from flexbt_core import Autonomy, MachineDefinition, TreeLibrary, define, load_xml, unsure_reads
from flexbt_demo_behaviors.night_watch.behavior import NightWatch
from flexbt_demo_behaviors.night_watch.states import rooms_left, unexpected_points
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import tool

TREES = sorted((Path(__file__).parents[1] / 'flexbt_demo_behaviors' / 'night_watch').glob('*.xml'))


def machine_at(definition: MachineDefinition, *labels: str) -> MachineDefinition:
    """Return a machine inside of another."""
    for label in labels:
        child = definition.children[label]
        assert isinstance(child, MachineDefinition)
        definition = child
    return definition


def test_the_behavior_is_found_by_its_name_and_usable() -> None:
    entry = BehaviorLibrary.discover().find('Night Watch')
    assert entry.error == ''
    assert entry.make is NightWatch
    assert all(parameter.description for parameter in entry.parameters)


def test_every_value_that_is_read_has_been_written() -> None:
    assert list(unsure_reads(define(NightWatch().create()))) == []


def test_a_finding_and_a_loss_are_matters_for_a_person_below_full_autonomy() -> None:
    definition = define(NightWatch().create())
    tour, partner = machine_at(definition, 'Watch', 'Round'), machine_at(definition, 'Watch', 'Partner')
    assert tour.children['JudgeFinding'].transitions['alarm'].autonomy == Autonomy.High
    assert tour.children['JudgeFinding'].transitions['harmless'].autonomy == Autonomy.Full
    assert partner.children['JudgeLoss'].transitions['take_over'].autonomy == Autonomy.High


@pytest.mark.parametrize(
    ('parameter', 'value', 'why'),
    [
        ('rooms', 'store cellar', 'cellar'),
        ('rooms', '', 'none'),
        ('home', 'cellar', 'cellar'),
        ('places', 'flexbt_sim/missing.yaml', 'missing'),
    ],
)
def test_what_is_no_place_is_refused_when_the_behavior_is_built(parameter: str, value: str, why: str) -> None:
    behavior = NightWatch()
    behavior.set_parameter(parameter, value)
    with pytest.raises(Exception, match=why):
        define(behavior.create())


def test_all_trees_load_into_one_library() -> None:
    def fail(point: str, error: Exception) -> None:
        raise AssertionError(f'{point}: {error}')

    registry = node_registry(fail)
    documents = [load_xml(file.read_bytes(), file.name, registry) for file in TREES]
    assert set(TreeLibrary().stage(documents).tree_ids()) == {'WatchDrive', 'BatteryLow', 'Charge'}


@pytest.mark.parametrize(
    ('mocks', 'result'),
    [([], 'FAILURE'), (['BatteryKnown=SUCCESS'], 'SUCCESS'), (['IsBatteryCharging=SUCCESS'], 'SUCCESS')],
)
def test_a_robot_is_docked_where_it_is_charged_or_full_and_not_where_nothing_is_known(
    mocks: list[str], result: str
) -> None:
    """IsBatteryLow fails for a full battery, and where nothing is known of it."""
    words = [word for mock in (*mocks, 'IsBattery*=FAILURE', '*=SUCCESS') for word in ('--mock', mock)]
    done = tool('run', *map(str, TREES), '--tree', 'Charge', '--set', 'goal=dock', '--quiet', *words)
    assert result in done.out, done


def test_rooms_come_in_order_each_once_and_those_that_were_postponed_last() -> None:
    rooms = ['archive', 'lobby', 'workshop', 'lobby', 'store']
    assert rooms_left(rooms, [], []) == ['archive', 'lobby', 'workshop', 'store']
    assert rooms_left(rooms, ['lobby'], ['archive', 'cellar']) == ['workshop', 'store', 'archive']
    assert rooms_left(rooms, rooms, ['archive']) == []


def grid_with_a_wall() -> OccupancyGrid:
    """4 x 4 m of free space, and a wall at x = 3 m."""
    grid = OccupancyGrid()
    grid.info.width = grid.info.height = 80
    grid.info.resolution = 0.05
    cells = np.zeros((80, 80), dtype=np.int8)
    cells[:, 60] = 100
    grid.data = cells.ravel().tolist()
    return grid


def scan_of(ranges: dict[int, float]) -> LaserScan:
    """Return a scan of 360 beams, one for each degree, of which some hit something."""
    full = [math.inf] * 360
    for degree, distance in ranges.items():
        full[degree] = distance
    return LaserScan(angle_min=0.0, angle_increment=math.radians(1.0), ranges=full)


def test_a_beam_that_ends_at_a_wall_of_the_map_is_expected_and_one_before_it_is_not() -> None:
    pose = PoseStamped()
    pose.pose.position.x, pose.pose.position.y = 1.5, 2.0
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(math.pi / 4), math.cos(math.pi / 4)  # along y
    scan = scan_of({270: 1.5, 271: 1.5, 275: 0.8, 0: 1.0, 90: 3.0})  # wall, wall, before it, aside, beyond the reach
    points = unexpected_points(grid_with_a_wall(), pose, scan, reach=2.0)
    expected = [(1.5, 3.0), (1.5 + 0.8 * math.cos(math.radians(5)), 2.0 + 0.8 * math.sin(math.radians(5)))]
    assert points[np.argsort(points[:, 0])] == pytest.approx(np.array(expected), abs=1e-5)


def test_nothing_is_unexpected_where_nothing_is_seen() -> None:
    assert len(unexpected_points(grid_with_a_wall(), PoseStamped(), scan_of({}), reach=2.0)) == 0
