# SPDX-License-Identifier: BSD-3-Clause
"""Following a path in closed loop: arriving, touching nothing, and giving up for the right reason."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy
import pytest
from closed_loop import FOLLOWER, MODEL, PERIOD, RADIUS, ROLLING, Run, assert_arrived, check_following, run
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexbt_navigation.controller.motions import STOP, Steering
from flexbt_navigation.controller.path_follower import (
    END_OF_LEG,
    HELD_UP,
    FollowerLimits,
    PathFollower,
    ProgressChecker,
)
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.planner.planners import GridPlanner, planner_for
from flexbt_sim.world import (
    MODELS,
    Circle,
    DriveModel,
    OccupancyMap,
    Pose,
    RobotModel,
    Shape,
    World,
    box,
    compose,
    wrap,
)
from flexbt_testing.worlds import drawn, free_places, room, worlds

OPEN = drawn(*['.' * 160] * 120)
WALL = drawn(*['.' * 80 + '##' + '.' * 78] * 120)
"""Open, but for a wall at x = 4.0 to 4.1."""


def follower(path: list[Pose], world: OccupancyMap = OPEN, limits: FollowerLimits = FOLLOWER) -> PathFollower:
    return PathFollower(path, Costmap(world, Inflation()), limits)


def line(*corners: tuple[float, float], spacing: float = 0.05, yaw: float = 0.0) -> list[Pose]:
    """Poses along straight lines; only the heading of the last counts."""
    poses = [Pose(*corners[0], yaw)]
    for a, b in pairwise(corners):
        count = max(1, round(math.dist(a, b) / spacing))
        poses += [
            Pose(a[0] + (b[0] - a[0]) * i / count, a[1] + (b[1] - a[1]) * i / count, yaw) for i in range(1, count + 1)
        ]
    return poses


def test_where_the_robot_is_on_its_path() -> None:
    motion = follower(line((1.0, 1.0), (3.0, 1.0), spacing=0.5))
    for pose, left, turned, passed in (
        (Pose(1.6, 1.1, 0.3), 0.1, 0.3, 1),
        (Pose(2.7, 0.9, -0.2), -0.1, -0.2, 3),
        (Pose(2.9, 1.0, math.pi - 0.1), 0.0, math.pi - 0.1, 3),
    ):
        motion.step(pose, 0.0)
        place = motion.place(pose)
        assert place == pytest.approx((left, turned, passed, math.dist(pose[:2], (3.0, 1.0))))
    car = replace(FOLLOWER, turning_radius=0.5)
    backward = [Pose(3.0 - 0.1 * i, 1.0, 0.0) for i in range(11)]
    motion = follower(backward, limits=car)
    motion.step(Pose(2.5, 1.05, 0.1), 0.0)
    assert motion.place(Pose(2.5, 1.05, 0.1))[:2] == pytest.approx((-0.05, 0.1))


@settings(deadline=None, max_examples=20)
@given(st.data(), worlds(least=30, size=90, blocks=14, resolutions=(0.03, 0.05, 0.1)), st.integers(0, 3))
def test_it_arrives_wherever_a_plan_leads(data: st.DataObject, world: OccupancyMap, late: int) -> None:
    anywhere = free_places(world, RADIUS + 0.01)
    assume(not anywhere.is_empty)
    try:
        check_following(world, data.draw(anywhere), data.draw(anywhere), late)
    except NavigationError as error:
        assert error.code == 'NO_VALID_PATH'


SLOT = drawn(*['.' * 60] * 40, *['#' * 25 + '.' * 10 + '#' * 25] * 20, *['.' * 60] * 40)
"""A passage of 0.5 m, 1 m long."""


@pytest.mark.parametrize('late', [0, 2, 4])
@pytest.mark.parametrize('start', [Pose(0.5, 1.0, 0.0), Pose(2.6, 0.4, 3.0), Pose(1.5, 4.5, -1.0)])
def test_it_gets_through_a_passage_with_three_centimetres_on_each_side(start: Pose, late: int) -> None:
    goal = Pose(1.0, 4.2, 1.0) if start.y < 2.5 else Pose(0.4, 0.4, 1.0)
    check_following(SLOT, start, goal, late)


DOORWAY = drawn(*['.' * 80] * 30, *['#' * 30 + '.' * 20 + '#' * 30] * 3, *['.' * 80] * 30)
"""From x = 1.5 to 2.5, y = 1.5 to 1.65."""


def test_a_way_round_a_jamb_leaves_more_than_a_hair() -> None:
    """The cells have room: a straight line that passed it by 0.3 mm could not be followed."""
    start, goal = Pose(2.495452642902754, 1.2415973331427481, -0.9), Pose(2.8677533606488077, 1.8719388618978334, -2.0)
    costmap = Costmap(DOORWAY, Inflation(0.105))
    path = GridPlanner(costmap).plan(start, goal)
    assert min(room(DOORWAY, pose.x, pose.y) for pose in path) > 0.11
    burger = replace(MODEL, footprint=Circle(0.105))
    assert_arrived(Run(DOORWAY, start, burger).go(PathFollower(path, costmap, FOLLOWER), late=1), goal)


@pytest.mark.parametrize('spacing', [0.01, 0.3, 10.0])
def test_how_far_the_poses_of_a_path_are_apart_does_not_matter(spacing: float) -> None:
    path = line((1.0, 1.0), (5.0, 1.0), (5.0, 4.0), spacing=spacing, yaw=2.0)
    done = run(OPEN, Pose(1.0, 1.0, 0.0), follower(path))
    assert_arrived(done, path[-1])
    assert done.now < 7.0 / FOLLOWER.speed + 8.0
    assert all(min(abs(pose.y - 1.0), abs(pose.x - 5.0)) < 0.2 for pose in done.poses)


@pytest.mark.parametrize('yaw', [0.0, 1.6, math.pi, -2.0])
def test_a_path_behind_the_robot_begins_with_a_turn(yaw: float) -> None:
    path = line((3.0, 3.0), (3.0 + 2.0 * math.cos(yaw), 3.0 + 2.0 * math.sin(yaw)), yaw=yaw)
    done = run(OPEN, Pose(3.0, 3.0, 0.0), follower(path))
    assert_arrived(done, path[-1])
    assert all(min(pose.distance(point) for point in path) < 0.1 for pose in done.poses)


def test_a_path_that_begins_elsewhere_is_driven_to() -> None:
    path = line((4.0, 4.0), (6.0, 4.0))
    done = run(OPEN, Pose(1.0, 1.0, 0.0), follower(path))
    assert_arrived(done, path[-1])


def test_a_path_that_crosses_itself_and_passes_its_own_end_is_driven_to_its_end() -> None:
    path = line((1.0, 2.0), (5.0, 2.0), (5.0, 4.0), (3.0, 4.0), (3.0, 1.0), (1.5, 1.0), (1.5, 2.0), yaw=1.5)
    done = run(OPEN, Pose(1.0, 2.0, 0.0), follower(path))
    assert_arrived(done, path[-1])
    for corner in ((5.0, 4.0), (3.0, 1.0)):
        assert min(math.dist(pose[:2], corner) for pose in done.poses) < 0.3


def test_a_path_that_was_planned_long_ago_is_joined_where_the_robot_is_by_now() -> None:
    """Even one step towards its beginning would be a turn on the spot."""
    before = follower(line((1.0, 1.0), (7.0, 1.0)))
    before.step(Pose(4.5, 1.05, 0.0), 0.0)
    later = PathFollower(line((1.0, 1.0), (7.0, 1.0)), Costmap(OPEN, Inflation()), FOLLOWER, before)
    velocity = later.step(Pose(4.5, 1.05, 0.0), 0.0)
    assert velocity is not None
    assert velocity.linear == FOLLOWER.speed
    assert later.distance_to_goal == pytest.approx(2.5, abs=0.1)


def test_poses_that_are_repeated_do_no_harm() -> None:
    path = [pose for pose in line((1.0, 1.0), (2.0, 1.0)) for _ in range(3)]
    assert_arrived(run(OPEN, path[0], follower(path)), path[-1])


@pytest.mark.parametrize('goal', [Pose(3.0, 3.0, 1.5), Pose(3.05, 3.0, -3.0), Pose(2.0, 2.5, 0.0), Pose(3.0, 3.0, 0.0)])
def test_a_path_of_one_pose_is_a_goal(goal: Pose) -> None:
    assert_arrived(run(OPEN, Pose(3.0, 3.0, 0.0), follower([goal])), goal)


@pytest.mark.parametrize(
    'path',
    [
        [],
        [Pose(math.nan, 1.0, 0.0)],
        [Pose(1.0, 1.0, 0.0), Pose(math.inf, 1.0, 0.0), Pose(2.0, 1.0, 0.0)],
        [Pose(1.0, 1.0, 0.0), Pose(2.0, 1.0, math.nan)],
    ],
)
def test_what_is_no_path_is_refused(path: list[Pose]) -> None:
    with pytest.raises(NavigationError) as raised:
        follower(path)
    assert raised.value.code == 'INVALID_PATH'


def test_the_distance_to_the_goal_is_that_along_the_path() -> None:
    path = line((1.0, 1.0), (3.0, 1.0), (3.0, 3.0))
    motion = follower(path)
    assert motion.distance_to_goal == pytest.approx(4.0)
    motion.step(Pose(2.0, 1.02, 0.0), 0.0)
    assert motion.distance_to_goal == pytest.approx(3.02)
    assert motion.speed > 0.0


@pytest.mark.parametrize(('patience', 'code'), [(0.3, 'PATIENCE_EXCEEDED'), (0.0, 'NO_VALID_CONTROL')])
def test_an_obstacle_on_the_path_stops_the_robot_before_it(patience: float, code: str) -> None:
    path = line((1.0, 3.0), (6.0, 3.0))
    done = run(WALL, path[0], follower(path, WALL, replace(FOLLOWER, patience=patience)))
    assert (done.code, done.touched) == (code, False)
    assert 0.0 < 4.0 - done.robot.pose.x - RADIUS < FOLLOWER.speed * FOLLOWER.collision_time + 0.05


@pytest.mark.parametrize('acceleration', [0.3, 1.0, 20.0])
def test_a_turn_to_the_heading_of_the_goal_ends_there_however_hard_the_robot_brakes(acceleration: float) -> None:
    model = replace(MODEL, drive=replace(MODEL.drive, angular_acceleration=acceleration))
    limits = FollowerLimits.of(model.drive)
    done = Run(OPEN, Pose(3.0, 3.0, 0.0), model).go(follower([Pose(3.0, 3.0, 3.0)], limits=limits), late=1)
    done.world.step(10.0)
    assert done.code == ''
    assert done.robot.pose.yaw == pytest.approx(3.0, abs=limits.yaw_tolerance + 0.02)


def test_no_turn_is_commanded_that_is_faster_than_the_robot_can() -> None:
    """Collisions are looked for on the arc of the command."""
    model = replace(MODEL, drive=replace(MODEL.drive, angular_speed=0.3))
    path = line((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), yaw=2.0)
    done = Run(OPEN, path[0], model).go(follower(path, limits=FollowerLimits.of(model.drive)))
    assert done.code == ''
    assert max(abs(command.angular) for command in done.commands) <= 0.3


@pytest.mark.parametrize('speed', [1.2, 2.0, 3.0])
def test_a_fast_robot_stops_before_an_obstacle_and_at_its_goal(speed: float) -> None:
    path = line((0.5, 3.0), (7.0, 3.0))
    model = replace(MODEL, drive=replace(MODEL.drive, linear_speed=speed))
    for world, rest in ((WALL, 4.0 - RADIUS), (OPEN, path[-1].x)):
        motion = follower(path, world, replace(FOLLOWER, speed=speed))
        done = Run(world, path[0], model).go(motion, late=1)
        assert (done.code, done.touched) == ('' if world is OPEN else 'PATIENCE_EXCEEDED', False)
        assert done.robot.pose.x == pytest.approx(rest - 0.1, abs=0.1)
        assert max(command.linear for command in done.commands) == speed


def test_a_fast_car_stops_before_an_obstacle() -> None:
    car, known = MODELS['car'], drawn(*['.' * 600] * 200, resolution=0.2)
    world = drawn(*['.' * 400 + '#' + '.' * 199] * 200, resolution=0.2)
    limits = replace(FollowerLimits.of(car.drive), speed=car.drive.linear_speed)
    maps = [Costmap(one, Inflation.of(car.footprint)) for one in (known, world)]
    way = planner_for(maps[0], limits.steering).plan(Pose(10.0, 20.0, 0.0), Pose(110.0, 20.0, 0.0))
    done = Run(world, way[0], car).go(PathFollower(way, maps[1], limits), late=1)
    assert (done.code, done.touched) == ('PATIENCE_EXCEEDED', False)
    assert max(command.linear for command in done.commands) == limits.speed


@pytest.mark.parametrize(
    ('shape', 'acceleration', 'turn', 'wall'),
    [(Circle(0.25), 0.5, 120.0, 2.2), (Circle(0.25), 0.3, 90.0, 2.2), (box(0.8, 0.4), 0.3, 60.0, 2.5)],
)
def test_a_robot_that_brakes_slowly_stops_before_a_wall_behind_a_bend(
    shape: Shape, acceleration: float, turn: float, wall: float
) -> None:
    """It brakes its turn faster than its speed, and so leaves the bend that was free."""
    cells = numpy.zeros((100, 160), numpy.int8)
    cells[int(wall / 0.05), 80:] = 100
    grid = OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0))
    drive = DriveModel(linear_speed=1.0, linear_acceleration=acceleration)
    model = RobotModel(footprint=shape, lidar=None, drive=drive)
    angle = math.radians(turn)
    path = line((1.0, 1.5), (5.0, 1.5), (5.0 + 2.0 * math.cos(angle), 1.5 + 2.0 * math.sin(angle)))
    limits = replace(FollowerLimits.of(drive), speed=1.0)
    done = Run(grid, path[0], model).go(PathFollower(path, Costmap(grid, Inflation.of(shape)), limits))
    assert (done.code, done.touched) == ('PATIENCE_EXCEEDED', False)


def test_a_robot_that_brakes_its_turn_slowly_does_not_swing_into_a_wall() -> None:
    """A long robot, on the way along a wall to a goal with another heading."""
    cells = numpy.zeros((120, 120), numpy.int8)
    cells[:, 60] = 100
    grid = OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0))
    drive = DriveModel(linear_speed=0.26, linear_acceleration=0.104, angular_acceleration=0.2)
    model = RobotModel(footprint=box(1.0, 0.3), lidar=None, drive=drive)
    start = Pose(2.5678299678933976, 3.0, math.pi / 2.0)
    path = [start, Pose(start.x, 3.2044909366822405, -1.1164043463519846)]
    motion = PathFollower(path, Costmap(grid, Inflation.of(model.footprint)), FollowerLimits.of(drive))
    done = Run(grid, start, model).go(motion, late=1)
    assert (done.code, done.touched) == ('PATIENCE_EXCEEDED', False)


@pytest.mark.parametrize(('acceleration', 'turn', 'speed'), [(0.3, 84.0, 0.5), (0.5, 65.0, 0.3)])
def test_a_long_robot_whose_turn_lasts_longer_than_its_way_does_not_swing_into_a_wall_beside_a_bend(
    acceleration: float, turn: float, speed: float
) -> None:
    """It stops at once, and turns on."""
    cells = numpy.zeros((100, 100), numpy.int8)
    cells[38] = 100
    grid = OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0))
    drive = DriveModel(linear_speed=1.0, linear_acceleration=2.5, angular_acceleration=acceleration)
    model = RobotModel(footprint=box(0.9, 0.4), lidar=None, drive=drive)
    angle = -math.radians(turn)
    path = line((1.0, 1.5), (2.5, 1.5), (2.5 + 1.5 * math.cos(angle), 1.5 + 1.5 * math.sin(angle)))
    limits = replace(FollowerLimits.of(drive), speed=speed)
    done = Run(grid, path[0], model).go(PathFollower(path, Costmap(grid, Inflation.of(model.footprint)), limits))
    assert (done.code in ('', 'PATIENCE_EXCEEDED'), done.touched) == (True, False)


def test_patience_does_not_begin_anew_with_each_path() -> None:
    path = line((1.0, 3.0), (6.0, 3.0))
    costmap, limits = Costmap(WALL, Inflation()), replace(FOLLOWER, patience=1.0)
    motion, stopped = PathFollower(path, costmap, limits), Pose(3.7, 3.0, 0.0)
    for tick in range(10):
        motion = PathFollower(path, costmap, limits, motion)
        assert motion.step(stopped, 0.1 * tick) == (0.0, 0.0)
    with pytest.raises(NavigationError) as raised:
        PathFollower(path, costmap, limits, motion).step(stopped, 1.1)
    assert raised.value.code == 'PATIENCE_EXCEEDED'


def test_a_turn_goes_on_until_a_command_takes_effect() -> None:
    """A long robot that turns towards a wall has swung on by a period, and then brakes."""
    walled, inflation = OPEN.obstacles.copy(), Inflation.of(box(0.9, 0.4))
    walled[:, OPEN.cell(3.0, 3.0)[1]] = True
    along, ahead = line((2.655, 3.0), (2.655, 4.5)), math.pi / 2.0
    motion = PathFollower(along, Costmap(OPEN, inflation), FOLLOWER)
    for number in range(9):
        assert motion.step(Pose(2.655, 3.0, ahead + 0.9), number * PERIOD) == (0.0, -FOLLOWER.angular_speed)
    motion.update(Costmap(OPEN, inflation, walled))
    assert motion.step(Pose(2.655, 3.0, ahead), 9.0 * PERIOD) == (0.0, 0.0)
    for number in range(10, 26):
        velocity = motion.step(Pose(2.655, 3.0, ahead), number * PERIOD)
    assert velocity is not None and velocity.linear > 0.0


def test_corners_are_kept_apart_from_what_was_seen_beside_them() -> None:
    """And may move: it is 4 cm from the corner of a cart that drives past it, and 22 cm from the circle within."""
    seen = OPEN.obstacles.copy()
    seen[OPEN.cell(3.33, 3.27)] = True
    costmap = Costmap(OPEN, Inflation.of(box(0.6, 0.4)), seen)
    path = line((3.0, 3.0), (6.0, 3.0))
    freely = PathFollower(path, Costmap(OPEN, costmap.inflation), FOLLOWER).step(path[0], 0.0)
    beside = PathFollower(path, costmap, FOLLOWER).step(path[0], 0.0)
    assert freely is not None and freely.linear == FOLLOWER.speed
    assert beside is not None and 0.0 <= beside.linear < FOLLOWER.speed / 2.0


@pytest.mark.parametrize('yaw', [0.0, 1e-9, -1e-9])
def test_a_box_drives_along_what_is_near_however_its_bearing_is_rounded(yaw: float) -> None:
    seen = OPEN.obstacles.copy()
    seen[OPEN.cell(0.0, 3.27)[0]] = True
    costmap = Costmap(OPEN, Inflation.of(box(0.6, 0.4)), seen)
    path = line((3.0, 3.02), (6.0, 3.02))
    assert 0.0 < costmap.gap_seen(path[0], 1.0) < 0.03
    velocity = PathFollower(path, costmap, FOLLOWER).step(path[0]._replace(yaw=yaw), 0.0)
    assert velocity is not None and velocity.linear > 0.0
    nearer = PathFollower(line((3.0, 3.02), (6.0, 3.05)), costmap, FOLLOWER).step(path[0], 0.0)
    assert nearer is not None and 0.0 < nearer.linear <= 0.05


def test_patience_at_the_goal_begins_anew_after_it_could_turn() -> None:
    seen = OPEN.obstacles.copy()
    seen[OPEN.cell(3.0, 3.32)] = True
    inflation, here = Inflation.of(box(0.6, 0.4)), Pose(3.0, 3.0, 0.0)
    blocked, free = Costmap(OPEN, inflation, seen), Costmap(OPEN, inflation)
    motion = PathFollower([here._replace(yaw=1.5)], blocked, FOLLOWER)
    for now in (0.0, 0.1, 1.0, 1.2, 1.4, 1.6):
        motion.update(free if now == 0.1 else blocked)
        velocity = motion.step(here, now)
        assert velocity is not None and (velocity.angular > 0.0) is (now == 0.1)
    with pytest.raises(NavigationError) as raised:  # it has braked by 1.6
        motion.step(here, 1.8)
    assert raised.value.code == 'PATIENCE_EXCEEDED'


PASSAGE = drawn(*['#' * 60 + '.' * 40] * 55, *['.' * 100] * 10, *['#' * 60 + '.' * 40] * 55)
"""It leads into the open at x = 3, 25 cm on each side of y = 3."""


def test_who_has_no_room_to_turn_near_the_goal_turns_at_the_goal() -> None:
    cart = replace(MODEL, footprint=box(0.6, 0.4))
    start, goal = Pose(2.9, 3.0, 0.0), Pose(3.32, 3.0, 3.0)
    costmap = Costmap(PASSAGE, Inflation.of(cart.footprint))
    path = line(start[:2], goal[:2], yaw=goal.yaw)
    done = Run(PASSAGE, start, cart).go(PathFollower(path, costmap, FOLLOWER))
    assert_arrived(done, goal)
    assert done.robot.pose.distance(goal) <= END_OF_LEG + ROLLING
    nowhere = goal._replace(x=3.2)
    done = Run(PASSAGE, start, cart).go(PathFollower(line(start[:2], nowhere[:2], yaw=goal.yaw), costmap, FOLLOWER))
    assert (done.code, done.touched) == ('PATIENCE_EXCEEDED', False)
    assert done.robot.pose.distance(nowhere) <= END_OF_LEG + ROLLING


def test_what_passes_beside_a_goal_does_not_keep_the_robot_from_turning_where_it_is() -> None:
    seen = OPEN.obstacles.copy()
    seen[OPEN.cell(3.0, 3.32)] = True
    inflation, here = Inflation.of(box(0.6, 0.4)), Pose(3.0, 3.0, 0.0)
    blocked, free = Costmap(OPEN, inflation, seen), Costmap(OPEN, inflation)
    path = line(here[:2], (3.08, 3.0), yaw=1.5)

    def is_turning(now: float, costmap: Costmap, motion: PathFollower, left: float = 0.08) -> bool:
        motion.update(costmap)
        velocity = motion.step(here._replace(x=3.08 - left), now)
        assert velocity is not None and velocity != STOP
        return velocity.linear == 0.0

    passing, staying = PathFollower(path, blocked, FOLLOWER), PathFollower(path, blocked, FOLLOWER)
    assert not is_turning(1.0, blocked, passing) and is_turning(1.1, free, passing) and is_turning(9.0, free, passing)
    for now in (1.0, 1.2, 1.4):
        assert not is_turning(now, blocked, staying)
    staying = PathFollower(path, free, FOLLOWER, staying)
    assert not is_turning(1.5, free, staying)  # and does not go to and fro
    exact = PathFollower(path, free, replace(FOLLOWER, xy_tolerance=0.01))
    assert is_turning(1.0, free, exact, left=0.005) and not is_turning(2.0, blocked, exact, left=0.05)
    assert not is_turning(3.0, free, exact, left=0.015)  # nearer than 2 cm, which will do for others


def test_beside_the_map_there_is_no_way() -> None:
    path = line((6.0, 3.0), (10.0, 3.0))
    done = run(OPEN, path[0], follower(path))
    assert done.code == 'PATIENCE_EXCEEDED'
    assert done.robot.pose.x < 8.0


def test_a_wall_that_comes_and_goes_is_waited_for_and_one_that_stays_is_not() -> None:
    path = line((3.0, 3.0), (6.0, 3.0))
    motion = follower(path)
    driven = Run(OPEN, path[0]).go(motion, until=2.6)
    motion.update(Costmap(WALL, Inflation()))
    driven.go(motion, until=driven.now + 0.25)
    assert driven.commands[-1] == (0.0, 0.0)
    motion.update(Costmap(OPEN, Inflation()))
    driven.go(motion, until=driven.now + 1.0)
    assert driven.commands[-1].linear > 0.2
    motion.update(Costmap(drawn(*['.' * 100 + '##' + '.' * 58] * 120), Inflation()))
    began = driven.now
    driven.go(motion)
    assert driven.code == 'PATIENCE_EXCEEDED'
    assert driven.now - began < (5.0 - path[0].x) / FOLLOWER.speed


def test_a_robot_that_overlaps_an_obstacle_of_its_map_is_led_away_from_it() -> None:
    start = Pose(3.85, 3.0, math.pi)
    path = GridPlanner(Costmap(WALL, Inflation())).plan(start, Pose(2.0, 3.0, math.pi))
    done = run(OPEN, start, follower(path, WALL))
    assert done.code == ''
    assert max(pose.x for pose in done.poses) == start.x
    assert done.robot.pose.distance(path[-1]) <= FOLLOWER.xy_tolerance + ROLLING


def test_a_robot_that_is_held_up_by_what_the_map_does_not_show_makes_no_progress() -> None:
    path = line((3.0, 3.0), (6.0, 3.0))
    done = run(WALL, path[0], follower(path, OPEN))
    assert (done.code, done.touched) == ('FAILED_TO_MAKE_PROGRESS', True)
    reached = (4.0 - RADIUS - 3.0) / FOLLOWER.speed
    assert FOLLOWER.progress_time < done.now < reached + FOLLOWER.progress_time + 1.0


def test_progress_is_half_a_metre_in_ten_seconds_whatever_path_is_followed() -> None:
    """A newer path does not begin anew, as in Nav2."""
    motion: PathFollower | None = None
    path = line((1.0, 1.0), (6.0, 1.0))
    steps = round(FOLLOWER.progress_time / PERIOD) + 2
    with pytest.raises(NavigationError) as raised:
        for number in range(steps):
            motion = PathFollower(path, Costmap(OPEN, Inflation()), FOLLOWER, motion)
            motion.step(Pose(1.0 + 0.49 * number / steps, 1.0, 0.0), number * PERIOD)
    assert raised.value.code == 'FAILED_TO_MAKE_PROGRESS'
    assert number * PERIOD > FOLLOWER.progress_time
    progress = ProgressChecker(FOLLOWER)
    for number in range(5 * steps):
        there = Pose(1.0 + 0.51 * number / steps, 1.0, 0.0)
        progress.check(there, number * PERIOD, turning=False, left=1.0, yielding=False)


def test_that_the_controller_was_held_up_is_no_lack_of_progress() -> None:
    """Where time runs away from a busy machine the robot stands, and turns on when the controller does."""
    motion = follower(line((1.0, 1.0), (6.0, 1.0)))
    assert motion.step(Pose(1.0, 1.0, 3.0), -PERIOD) is not None
    for number in range(round(FOLLOWER.progress_time / HELD_UP) - 1):
        assert motion.step(Pose(1.0, 1.0, 3.0), 4.0 * number) is not None
    with pytest.raises(NavigationError, match='moved less than'):
        for number in range(3):
            motion.step(Pose(1.0, 1.0, 3.0), 100.0 + number)


def test_only_giving_way_to_others_without_coming_nearer_to_the_same_goal_is_given_up() -> None:
    """In all, for a minute; time in which the controller was held up does not count."""
    before, costmap = follower(line((1.0, 1.0), (3.0, 1.0))), Costmap(OPEN, Inflation())
    before.step(Pose(2.8, 1.0, 0.0), -PERIOD)
    motion = PathFollower(line((2.8, 1.0), (7.0, 1.0)), costmap, FOLLOWER, before)

    def give_way(at: float, begin: float, end: float) -> None:
        for second in numpy.arange(begin, end, PERIOD).tolist():
            # To and fro, so that it is in no place for long.
            there = Pose(at, second // 5.0 % 2.0, 0.0)
            motion.progress.check(there, second, turning=False, left=7.0 - at, yielding=True)

    give_way(2.8, 0.0, 40.0)
    give_way(3.8, 40.0, 80.0)
    motion.progress.check(Pose(3.8, 1.0, 0.0), 999.0, turning=False, left=3.2, yielding=True)
    motion = PathFollower(line((3.8, 1.0), (7.0, 1.0)), costmap, FOLLOWER, motion)
    with pytest.raises(NavigationError, match='gave way to others for 60 s'):
        give_way(3.8, 1000.0, 1021.0)


def test_where_poses_come_once_a_second_it_is_told_in_time_too() -> None:
    progress = ProgressChecker(FOLLOWER)
    with pytest.raises(NavigationError, match='moved less than'):
        for second in range(int(FOLLOWER.progress_time) + 2):
            progress.check(Pose(1.0, 1.0, 0.0), float(second), turning=False, left=1.0, yielding=False)
    assert second > FOLLOWER.progress_time


def test_a_turn_at_the_goal_is_progress() -> None:
    motion = follower([Pose(1.0, 1.0, 3.0)])
    for number in range(1000):
        assert motion.step(Pose(1.0, 1.0, 0.0005 * number), number * PERIOD) is not None


def test_a_robot_that_cannot_turn_at_the_goal_makes_no_progress() -> None:
    motion = follower([Pose(1.0, 1.0, 3.0)])
    with pytest.raises(NavigationError) as raised:
        for number in range(1000):
            motion.step(Pose(1.0, 1.0, 0.0), number * PERIOD)
    assert raised.value.code == 'FAILED_TO_MAKE_PROGRESS'
    assert number * PERIOD > FOLLOWER.progress_time


def test_a_limit_of_the_speed_holds_up_to_the_goal() -> None:
    motion = follower(line((1.0, 1.0), (1.4, 1.0)))
    motion.speed_limit = 0.03
    done = run(OPEN, Pose(1.0, 1.0, 0.0), motion)
    assert done.code == ''
    assert max(command.linear for command in done.commands) == 0.03


RATES = st.floats(-0.03, 0.03)
"""Of a drift, m/s and rad/s: much more than an odometry has."""


@settings(deadline=None, max_examples=10)
@given(RATES, RATES, st.floats(-0.01, 0.01), st.floats(2.5, 5.5), st.floats(2.0, 4.0), st.integers(0, 2))
def test_it_arrives_where_a_path_ends_whose_frame_drifts(
    x: float, y: float, yaw: float, to_x: float, to_y: float, late: int
) -> None:
    driven = Run(OPEN, Pose(2.0, 3.0, 0.0))

    def drift() -> Pose:
        return Pose(x * driven.now, y * driven.now, yaw * driven.now)

    path = line((2.0, 3.0), (to_x, to_y))
    driven.go(PathFollower(path, Costmap(OPEN, Inflation()), FOLLOWER, drift=drift), late)
    seconds = len(driven.commands) * PERIOD
    assert driven.code == '' and not driven.touched
    goal = compose(Pose(x * seconds, y * seconds, yaw * seconds), path[-1])
    assert driven.robot.pose.distance(goal) <= FOLLOWER.xy_tolerance + ROLLING + 0.05


def test_a_drift_that_is_not_known_ends_it() -> None:
    def drift() -> Pose:
        raise NavigationError('TF_ERROR', 'nobody tells')

    path = line((1.0, 1.0), (3.0, 1.0))
    done = run(OPEN, path[0], PathFollower(path, Costmap(OPEN, Inflation()), FOLLOWER, drift=drift))
    assert (done.code, done.commands) == ('TF_ERROR', [])


# -- a car -----------------------------------------------------------------------------------------------------------

FIELD = OccupancyMap(numpy.zeros((400, 400), numpy.int8), 0.25, Pose(-50.0, -50.0, 0.0))
CAR = FollowerLimits(
    speed=3.0,
    lookahead_max=8.0,
    approach_distance=4.0,
    approach_speed=0.3,
    angular_speed=1.0,
    xy_tolerance=0.5,
    yaw_tolerance=0.4,
    turning_radius=MODELS['car'].drive.turning_radius,
)


def drive_car(
    start: Pose, goal: Pose, limits: FollowerLimits = CAR, planned_for: Steering = CAR.steering, late: int = 0
) -> Pose:
    """Return where it gets to. Raises NavigationError; no command asks for a bend that a car cannot drive. Commands are
    so many periods late."""
    world = World(FIELD)
    world.add('car', MODELS['car'], start)
    car = world.robots['car']
    costmap = Costmap(FIELD, Inflation.of(car.model.footprint))
    motion = PathFollower(planner_for(costmap, planned_for).plan(start, goal), costmap, limits)
    under_way = deque([STOP] * late)
    while world.time < 120.0:
        velocity = motion.step(car.pose, world.time)
        if velocity is None:
            return car.pose
        assert abs(velocity.angular) * limits.turning_radius <= abs(velocity.linear) + 1e-9
        assert velocity.linear >= 0.0 or limits.reverses
        under_way.append(velocity)
        car.command(*under_way.popleft(), world.time)
        world.step(0.05)
    raise AssertionError('neither there nor given up')


PARKED = FollowerLimits.of(MODELS['car'].drive)


@pytest.mark.parametrize(
    ('goal', 'reverses', 'late'),
    [
        (Pose(-12.0, 8.0, 2.0), False, 3),
        (Pose(-12.0, 8.0, 2.0), True, 0),
        (Pose(0.0, 4.0, 0.0), True, 3),
        (Pose(0.0, 0.0, math.pi), True, 3),
        (Pose(0.0, 0.0, math.pi), False, 0),
    ],
)
def test_a_car_gets_there_with_the_heading_of_the_goal(goal: Pose, reverses: bool, late: int) -> None:
    limits = replace(PARKED, reverses=reverses)
    there = drive_car(Pose(0.0, 0.0, 0.0), goal, limits, limits.steering, late)
    assert there.distance(goal) <= limits.xy_tolerance + 0.1
    assert abs(wrap(there.yaw - goal.yaw)) <= limits.yaw_tolerance


@pytest.mark.parametrize(('reverses', 'direction'), [(True, -1.0), (False, 0.0)])
def test_a_car_backs_off_from_who_stands_at_its_bumper_if_it_may_reverse(reverses: bool, direction: float) -> None:
    seen = FIELD.obstacles.copy()
    seen[FIELD.cell(3.4, 0.1)] = True
    costmap = Costmap(FIELD, Inflation.of(MODELS['car'].footprint), seen)
    motion = PathFollower(line((0.0, 0.0), (20.0, 0.0)), costmap, replace(PARKED, reverses=reverses))
    velocity = motion.step(Pose(0.0, 0.0, 0.0), 0.0)
    assert velocity is not None and numpy.sign(velocity.linear) == direction


ANYHOW = Steering()
"""Of paths that are planned for a robot that turns on the spot: what other planners may give a car."""


def test_a_car_follows_a_path_that_it_cannot_drive_in_bends_that_it_can() -> None:
    for start, goal in (
        (Pose(0.0, 0.0, math.pi / 2.0), Pose(30.0, 0.0, 0.0)),
        (Pose(0.0, 0.0, 0.0), Pose(30.0, 20.0, 0.6)),
    ):
        there = drive_car(start, goal, CAR, ANYHOW)
        assert there.distance(goal) <= CAR.xy_tolerance + 0.1
        assert abs(wrap(there.yaw - goal.yaw)) <= CAR.yaw_tolerance


def test_a_car_does_not_turn_on_the_spot_at_a_goal_with_another_heading() -> None:
    start, goal = Pose(0.0, 0.0, 0.0), Pose(30.0, 0.0, 2.0)
    with pytest.raises(NavigationError, match='yaw_goal_tolerance') as raised:
        drive_car(start, goal, CAR, ANYHOW)
    assert raised.value.code == 'NO_VALID_CONTROL'
    assert drive_car(start, goal, replace(CAR, yaw_tolerance=math.pi), ANYHOW).distance(goal) <= CAR.xy_tolerance + 0.1


def test_a_car_does_not_circle_for_ever_round_a_goal_within_its_turning_radius() -> None:
    with pytest.raises(NavigationError) as raised:
        drive_car(Pose(0.0, 0.0, 0.0), Pose(0.0, 4.0, 0.0), CAR, ANYHOW)
    assert raised.value.code == 'FAILED_TO_MAKE_PROGRESS'
