# SPDX-License-Identifier: BSD-3-Clause
"""A robot with planner, costmaps and controller in a simulated world, from goal to goal, without ROS."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy
import pytest
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.navigator import Navigator, Trip
from flexbt_sim.world import (
    COMMAND_PERIOD,
    MODELS,
    Circle,
    LidarModel,
    ObstacleModel,
    OccupancyMap,
    Pose,
    RobotModel,
    RouteModel,
    WalkModel,
    World,
    ZoneModel,
    box,
    wrap,
)
from flexbt_sim.world_tool import main

BLIND = RobotModel(lidar=None)
SEEING = RobotModel(lidar=LidarModel(beams=180))


def walled(height: int, width: int, resolution: float, draw: Callable[[NDArray[numpy.int8]], None]) -> OccupancyMap:
    """Return a closed map with what ``draw`` adds."""
    cells = numpy.zeros((height, width), numpy.int8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 100
    draw(cells)
    return OccupancyMap(cells, resolution, Pose(-1.0, -2.0, 0.0))


def shelves(cells: NDArray[numpy.int8]) -> None:
    """Rows of shelves with aisles of 1.8 m, as in a warehouse."""
    for row in range(80, cells.shape[0] - 60, 90):
        for column in range(60, cells.shape[1] - 150, 200):
            cells[row : row + 30, column : column + 150] = 100


def posts(cells: NDArray[numpy.int8]) -> None:
    """Post and a wall with a gap."""
    for row in range(30, cells.shape[0] - 30, 40):
        for column in range(30, cells.shape[1] - 30, 40):
            cells[row : row + 6, column : column + 6] = 100
    middle = cells.shape[1] // 2
    cells[:, middle : middle + 3] = 100
    cells[40:60, middle : middle + 3] = 0


def free_places(costmap: Costmap, seed: int) -> Callable[[], Pose]:
    """Draw places with room for the robot."""
    random = numpy.random.default_rng(seed)
    cells = numpy.argwhere(costmap.costs < 150)

    def draw() -> Pose:
        row, column = cells[random.integers(len(cells))].tolist()
        return Pose(*costmap.world.point(row, column), float(random.uniform(-math.pi, math.pi)))

    return draw


def check_reached(world: World, trip: Trip) -> None:
    """Within 0.25 m and 0.25 rad of the goal, and nothing was touched."""
    there = world.robots['robot'].pose
    assert (trip.code, trip.contacts) == ('', 0), trip.errors
    assert there.distance(trip.goal) <= 0.25
    assert abs(wrap(there.yaw - trip.goal.yaw)) <= 0.25


@pytest.fixture(scope='module')
def warehouse() -> Costmap:
    return Costmap(walled(1674, 1006, 0.03, shelves), Inflation())


def test_goals_are_reached_on_a_large_map_though_each_plan_is_old_when_it_comes(warehouse: Costmap) -> None:
    """At full speed a plan takes many seconds of simulated time. Its path begins where the robot was then."""
    draw = free_places(warehouse, 1)
    world = World(warehouse.world)
    world.add('robot', BLIND, draw())
    navigator = Navigator(world, 'robot', warehouse, plan_seconds=10.0)
    for _ in range(8):
        here = world.robots['robot'].pose
        goal = next(goal for goal in iter(draw, None) if 6.0 < goal.distance(here) < 12.0)
        trip = navigator.navigate(goal, timeout=300.0)
        check_reached(world, trip)
        assert trip.recoveries == 0


def test_obstacles_that_the_map_does_not_show_are_driven_round() -> None:
    known = walled(160, 240, 0.05, posts)
    for seed in range(2):
        static = Costmap(known, Inflation())
        draw = free_places(static, seed)
        world = World(known, seed=seed)
        world.add('robot', SEEING, Pose(0.0, -1.0, 0.0))
        world.add('crate', ObstacleModel(Pose(4.8, 1.15, 0.3), box(0.4, 0.6)))  # beside the gap
        world.add('cart', ObstacleModel(Pose(7.0, 2.0, 0.0), Circle(0.2), route=RouteModel(((9.0, 2.0),), speed=0.3)))
        for number in range(3):
            walk = WalkModel(speed=0.2 + 0.1 * number)
            while f'walker{number}' not in world.entities:
                place = draw()
                if place.distance(Pose(0.0, -1.0, 0.0)) > 1.0:
                    world.add(f'walker{number}', ObstacleModel(place, Circle(0.2), random_walk=walk))
        navigator = Navigator(world, 'robot', static)
        for goal in (Pose(9.5, 4.5, 1.0), Pose(0.0, 4.5, -2.0)):
            check_reached(world, navigator.navigate(goal, timeout=600.0))


def test_a_wall_that_the_map_does_not_show_is_driven_round_though_its_ends_are_out_of_sight() -> None:
    world = World(OccupancyMap(numpy.zeros((150, 150), numpy.int8), 0.1, Pose(0.0, 0.0, 0.0)))
    world.add('wall', ObstacleModel(pose=Pose(9.5, 7.0, 0.0), shape=box(0.3, 8.0)))
    world.add('post', ObstacleModel(pose=Pose(6.0, 7.0, 0.0), shape=Circle(0.4)))
    world.add('robot', MODELS['waffle'], Pose(4.0, 7.0, 0.0))
    check_reached(world, Navigator(world, 'robot').navigate(Pose(13.0, 7.0, 0.0), 120.0))


def test_where_there_is_no_way_the_code_says_why() -> None:
    def cell_in_the_middle(cells: NDArray[numpy.int8]) -> None:
        cells[30:70, 30:32] = cells[30:70, 68:70] = cells[30:32, 30:70] = cells[68:70, 30:70] = 100

    known = walled(100, 100, 0.05, cell_in_the_middle)
    world = World(known)
    world.add('robot', BLIND, Pose(-0.5, -1.5, 0.0))
    navigator = Navigator(world, 'robot')
    for goal, code in (
        (Pose(1.5, 0.5, 0.0), 'NO_VALID_PATH'),
        (Pose(0.5, 0.5, 0.0), 'GOAL_OCCUPIED'),
        (Pose(50.0, 0.5, 0.0), 'GOAL_OUTSIDE_MAP'),
    ):
        trip = navigator.navigate(goal)
        assert (trip.code, trip.contacts) == (code, 0)
    check_reached(world, navigator.navigate(Pose(3.5, 2.5, 0.0)))


def test_a_goal_that_is_covered_for_a_while_is_reached_when_it_is_free_again() -> None:
    known = walled(100, 100, 0.05, lambda cells: None)
    world = World(known)
    world.add('robot', SEEING, Pose(0.0, 0.0, 0.0))
    goal = Pose(2.0, 0.0, 0.0)
    world.add('crate', ObstacleModel(goal, Circle(0.3)))
    navigator = Navigator(world, 'robot')

    def go_away() -> None:
        if world.time > 30.0 and 'crate' in world.entities:
            world.remove('crate')

    navigator.on_step = go_away
    check_reached(world, navigator.navigate(goal))
    assert world.time > 30.0


def test_a_closed_passage_ends_with_the_code_of_the_planner_after_all_recoveries() -> None:
    def wall(cells: NDArray[numpy.int8]) -> None:
        cells[:, 50:52] = 100
        cells[40:60, 50:52] = 0

    world = World(walled(100, 100, 0.05, wall))
    world.add('robot', SEEING, Pose(0.5, 0.5, 0.0))
    world.add('crate', ObstacleModel(Pose(1.55, 0.5, 0.0), box(0.3, 0.9)))
    trip = Navigator(world, 'robot').navigate(Pose(3.0, 0.5, 0.0))
    assert trip.code in ('NO_VALID_PATH', 'PATIENCE_EXCEEDED')
    assert (trip.recoveries, trip.contacts) == (6, 0)


def test_a_recovery_that_fails_is_followed_by_the_next_one_and_not_counted() -> None:
    """The robot is in a passage that is too narrow to turn in."""

    def passage(cells: NDArray[numpy.int8]) -> None:
        cells[:, :] = 100
        cells[40:52, 14:90] = 0

    world = World(walled(100, 100, 0.05, passage))
    world.add('robot', RobotModel(footprint=box(0.6, 0.4), lidar=LidarModel(beams=180)), Pose(0.05, 0.3, 0.0))
    world.add('crate', ObstacleModel(Pose(1.5, 0.3, 0.0), box(0.3, 0.58)))
    trip = Navigator(world, 'robot').navigate(Pose(3.0, 0.3, 0.0))
    assert trip.code in ('NO_VALID_PATH', 'PATIENCE_EXCEEDED')
    assert (trip.recoveries, trip.contacts) == (6, 0)
    assert trip.seconds > 23.0  # 28.3 s; with a wait less, 18.7 s


def test_a_robot_that_is_no_circle_gets_through_a_door_and_touches_nothing() -> None:
    """It is 0.6 m long, and the door is 0.7 m wide."""

    def wall(cells: NDArray[numpy.int8]) -> None:
        cells[:, 60:63] = 100
        cells[45:59, 60:63] = 0

    for start in (Pose(0.0, 0.5, 1.5), Pose(0.5, -1.2, 3.0)):
        world = World(walled(100, 120, 0.05, wall))
        world.add('robot', RobotModel(footprint=box(0.6, 0.4), lidar=LidarModel(beams=180)), start)
        check_reached(world, Navigator(world, 'robot').navigate(Pose(3.5, 1.0, 1.0)))


@pytest.mark.parametrize('number', [2, 5, 7, 9, 23])
def test_a_robot_touches_nobody_who_walks_to_and_fro_across_its_way(number: int) -> None:
    x, side = 1.0 + 0.1 * number, 1.6 if number % 2 else -1.6
    world = World(OccupancyMap(numpy.zeros((80, 160), numpy.int8), 0.05, Pose(-1.0, -2.0, 0.0)), seed=number)
    robot = world.add('robot', RobotModel(), Pose(0.0, 0.0, 0.0))
    walk = RouteModel(waypoints=((x, -side), (x, side)), speed=0.4)
    world.add('walker', ObstacleModel(Pose(x, side, 0.0), Circle(0.2), route=walk))
    trip = Navigator(world, 'robot').navigate(Pose(5.5, 0.0, 0.0), timeout=300.0)
    assert (trip.code, trip.contacts) == ('', 0)
    assert robot.pose.distance(Pose(5.5, 0.0, 0.0)) < 0.25


def test_a_robot_that_turns_on_the_spot_stands_still_when_somebody_walks_into_it() -> None:
    """One of its corners swings away from them, and the next one towards them."""
    begin, to = Pose(3.0253, 4.3194, 2.964), (6.5887, 2.475)
    world = World(OccupancyMap(numpy.zeros((160, 160), numpy.int8), 0.05, Pose(0.0, 0.0, 0.0)), seed=56)
    world.add('robot', replace(MODELS['waffle'], footprint=box(0.6, 0.4)), Pose(4.0, 4.0, 0.0))
    walk = RouteModel(waypoints=(to,), speed=0.30468, order='once')
    world.add('person', ObstacleModel(begin, Circle(0.2), route=walk))
    trip = Navigator(world, 'robot').navigate(Pose(4.0, 4.0, -1.88605), timeout=40.0)
    assert trip.contacts == 0


def test_a_robot_gives_way_to_somebody_who_comes_through_a_corridor_for_one() -> None:
    """They go to and fro, and never give way: they would stand before it for ever."""

    def corridor(cells: NDArray[numpy.int8]) -> None:
        cells[:, 50:130] = 100
        cells[41:59, 50:130] = 0

    world = World(walled(100, 180, 0.05, corridor))
    world.add('robot', MODELS['waffle'], Pose(0.5, 0.5, 0.0))
    walk = RouteModel(((6.6, 0.5), (0.3, 0.5), (0.3, -1.0)), speed=0.2, order='back_and_forth')
    world.add('person', ObstacleModel(Pose(6.8, 1.5, 0.0), Circle(0.2), route=walk))
    check_reached(world, Navigator(world, 'robot').navigate(Pose(7.0, -0.5, 0.0), timeout=300.0))


def test_it_keeps_out_of_a_no_go_zone() -> None:
    world = World(walled(80, 160, 0.05, lambda cells: None))
    robot = world.add('robot', SEEING, Pose(0.0, 0.0, 0.0))
    world.add('lawn', ZoneModel(kind='no_go', pose=Pose(3.0, 0.0, 0.0), area=box(1.0, 2.5)))
    trip = Navigator(world, 'robot').navigate(Pose(6.0, 0.0, 0.0))
    assert (trip.code, trip.contacts, robot.violations) == ('', 0, 0)
    assert trip.length > 6.3


def test_several_drive_in_one_world_each_to_goals_of_its_own() -> None:
    world = World(walled(80, 80, 0.05, lambda cells: None))
    places = [Pose(-0.4, -1.4, 0.0), Pose(2.4, -1.4, 2.0), Pose(1.0, 1.4, -1.57)]
    for number, place in enumerate(places):
        world.add(f'robot{number}', SEEING, place)
    navigators = [Navigator(world, name) for name in world.robots]
    trips = [one.start(goal) for one, goal in zip(navigators, [*places[1:], places[0]], strict=True)]
    while sum(one.step() for one in navigators):
        world.step(COMMAND_PERIOD)
    for trip, robot in zip(trips, world.robots.values(), strict=True):
        assert (trip.code, trip.contacts) == ('', 0), trip
        assert robot.pose.distance(trip.goal) < 0.25
    assert world.time < sum(trip.seconds for trip in trips)
    assert not any(one.step() for one in navigators)


def test_world_tool_has_it_drive_robots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / 'world.yaml'
    file.write_text(
        'plan: {rooms: [{from: [0, 0], to: [4, 2]}]}\n'
        'robots: {alpha: {model: burger, pose: [1, 1, 0]}}\n'
        'places: {corner: [1.6, 0.5, 0]}\n'
    )
    run = ['run', str(file), str(tmp_path / 'run.png'), '--pixels', '120']
    assert main([*run, '--goal', 'alpha=corner', '--seconds', '40']) == 0
    assert re.search(r'\nalpha: reached after \d+\.\d s, \d\.\d m\n', capsys.readouterr().out)
    assert main([*run, '--goal', 'alpha=0.8,0.8,0', '--seconds', '0.5']) == 0
    assert '\nalpha: on its way\n' in capsys.readouterr().out
    for wrong in ('alpha=here', 'beta=corner', 'alpha=1,2', 'alpha=1,2,up'):
        assert main([*run, '--goal', wrong]) == 1
    assert capsys.readouterr().err.count('places: corner') == 4
