# SPDX-License-Identifier: BSD-3-Clause
"""The parts of the demonstration: its world, its trees, its behavior, and its processes."""

from pathlib import Path

import pytest
import yaml

from flexbt_core import Autonomy, define, load_xml
from flexbt_demo_behaviors.demonstration.report import world_with_places
from flexbt_demo_behaviors.nav2_robot.behavior import AskOperator
from flexbt_demo_behaviors.nav2_robot.main import PLACES, PROGRAM, WORLD, robot_processes
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_server.node_types import node_registry

TREES = sorted((Path(__file__).parents[1] / 'flexbt_demo_behaviors' / 'nav2_robot').glob('*.xml'))


def fail_on_broken(point: str, error: Exception) -> None:
    raise AssertionError(f'{point}: {error}')


@pytest.mark.parametrize('file', TREES, ids=lambda file: file.name)
def test_a_tree_loads_and_says_which_one_is_meant(file: Path) -> None:
    document = load_xml(file.read_bytes(), file.name, node_registry(fail_on_broken))
    assert document.main in document.trees


def test_the_robot_stands_in_its_dock_and_every_place_is_free() -> None:
    world = world_with_places(WORLD, PLACES)
    assert world.robots['robot'].pose == world.places['dock']
    for place in world.places.values():
        world.move('robot', place)  # refused in a wall, or at an obstacle


def test_the_behavior_is_found_and_asks_a_person_below_full_autonomy() -> None:
    entry = BehaviorLibrary.discover().find('Ask Operator')
    assert (entry.error, entry.make) == ('', AskOperator)
    ways = define(AskOperator().create()).children['Ask'].transitions
    assert (ways['go_on'].outcome, ways['go_on'].autonomy) == ('go_on', Autonomy.High)
    assert ways['elsewhere'].state == 'AskPlace'


def test_the_processes_are_installed_and_the_server_has_the_trees_of_this_demonstration() -> None:
    for process in (*robot_processes(10.0), PROGRAM):
        assert Path(process.command()[0]).is_file()
    words = next(process for process in robot_processes(10.0) if process.name == 'bt_server').command()
    parameters = dict(word.split(':=', 1) for word in words if ':=' in word)
    assert yaml.safe_load(parameters['navigators']) == [
        'navigate_to_pose', 'navigate_through_poses', 'follow_waypoints',
    ]  # fmt: skip
    for name in ('default_nav_to_pose_bt_xml', 'default_nav_through_poses_bt_xml'):
        assert Path(yaml.safe_load(parameters[name])).name in {file.name for file in TREES}
