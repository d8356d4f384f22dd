# SPDX-License-Identifier: BSD-3-Clause
"""The parts of the demonstration: its world, its mission, its behavior, and its processes."""

from pathlib import Path

from flexbt_core import load_xml, node_skills, read_skills
from flexbt_demo_behaviors.demonstration.report import world_with_places
from flexbt_demo_behaviors.goals.main import PLACES, WORLD, robot_processes
from flexbt_demo_behaviors.goals.rooms import ROOMS, room_at
from flexbt_formal.planning.missions import read_mission, skill_problem
from flexbt_formal.planning.planner import plan
from flexbt_formal.planning.tree_xml import tree_xml
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.run_building import definition_of
from flexbt_server.leaves import ServiceLeaf
from flexbt_server.node_types import node_registry

FOLDER = Path(__file__).parents[1] / 'flexbt_demo_behaviors' / 'goals'


def fail_on_broken(point: str, error: Exception) -> None:
    raise AssertionError(f'{point}: {error}')


def test_every_room_of_the_world_has_a_place_in_it_that_is_free() -> None:
    world = world_with_places(WORLD, PLACES)
    assert set(world.places) == set(ROOMS)
    for room, place in world.places.items():
        assert room_at(place.x, place.y) == room
        world.move('robot', place)  # refused in a wall, or at the cup
    cup = world.obstacles['cup'].pose
    assert room_at(cup.x, cup.y) == 'kitchen'


def test_the_mission_is_planned_with_the_leaves_of_the_package() -> None:
    registry = node_registry(fail_on_broken)
    mission = read_mission((FOLDER / 'cup.yaml').read_text(), 'cup.yaml')
    library = node_skills(registry, lambda told: None)
    for name in mission.skills:
        library = read_skills((FOLDER / name).read_text(), name, library)
    start = [*mission.start, 'in_room(office)', 'at_table(office)', 'thing_in(cup, kitchen)']
    found = plan(skill_problem(library, start, mission.goal, mission.disturbances))
    assert found.actions == (
        'FlatEnterRoom(office, hall)',
        'FlatOpenDoor(kitchen_door, hall, kitchen)',
        'FlatPassDoor(kitchen_door, hall, kitchen)',
        'FlatApproach(cup, kitchen)',
        'FlatPickUp(cup, kitchen)',
        'FlatPassDoor(kitchen_door, kitchen, hall)',
        'FlatEnterRoom(hall, office)',
        'FlatDriveToTable(office)',
        'FlatPutDown(cup, office)',
    )
    assert load_xml(tree_xml(found), 'plan.xml', registry).main == 'Plan'
    leaves = [one for one in registry if one.node_class.__module__.startswith('flexbt_demo_')]
    assert leaves and all(one.id.startswith('Flat') for one in leaves), 'names are shared: those of others stay free'
    waiting = [one.id for one in leaves if issubclass(one.node_class, ServiceLeaf)]
    assert all(library.skills[id].deadline for id in waiting), 'others may undo what they wait for before it is seen'
    for file in FOLDER.glob('*.xml'):
        assert load_xml(file.read_bytes(), file.name, registry).main is not None


def test_the_behavior_is_found_and_the_processes_are_installed() -> None:
    entry = BehaviorLibrary.discover().find('Reach Goal')
    assert entry.error == ''
    assert definition_of(entry.instantiate()).children['Reach'].transitions['failed'].state == 'Ask'
    for process in robot_processes(10.0):
        assert Path(process.command()[0]).is_file()
