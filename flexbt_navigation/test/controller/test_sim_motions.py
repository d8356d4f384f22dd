# SPDX-License-Identifier: BSD-3-Clause
"""Turning and driving straight in closed loop, and what Nav2 says when that does not work."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace

import numpy
import pytest
from closed_loop import MODEL, PERIOD, RADIUS, Run, run
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexbt_navigation.behaviors.motions import (
    ROLL_TIME,
    SPIN_LIMITS,
    AssistedTeleopMotion,
    DriveMotion,
    SpinMotion,
)
from flexbt_navigation.controller.motions import (
    LOOK_AHEAD,
    STOP,
    Inertia,
    KeepingApart,
    Motion,
    Velocity,
    collides,
    slowed,
)
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.costmaps.layers import LayeredCostmap, Observation
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world import (
    Circle,
    DriveModel,
    LidarModel,
    ObstacleModel,
    OccupancyMap,
    Pose,
    RobotModel,
    RouteModel,
    World,
    box,
    compose,
    drive,
    wrap,
)
from flexbt_testing.worlds import drawn, free_places, places, rooms, worlds

OPEN = drawn(*['.' * 120] * 120)
CENTRE = Pose(3.0, 3.0, 2.0)
WALL = drawn(*['.' * 60 + '#' + '.' * 59] * 120)
"""Open, but for a wall of one cell at x = 3.0."""

SPARE = 0.06
"""Nearer than this to what is possible, m, it does not matter what is said: the robot brakes, and cells are checked."""


def costs(world: OccupancyMap) -> Costmap:
    return Costmap(world, Inflation())


def test_a_command_of_an_operator_is_bounded_before_its_way_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[Pose] = []

    def overlap(_costmap: Costmap, pose: Pose) -> float:
        looked.append(pose)
        assert len(looked) < 10_000
        return 0.0

    monkeypatch.setattr(Costmap, 'overlap', overlap)
    costmap = Costmap(OPEN, Inflation.of(box(0.5, 0.3)))
    for command, bounded in (((0.0, 1e9), (0.0, 10.0)), ((0.0, -1e300), (0.0, -10.0)), ((1e300, 0.0), (10.0, 0.0))):
        looked.clear()
        teleop = AssistedTeleopMotion(lambda: Velocity(*command), 0.0, costmap)  # noqa: B023 - called here
        velocity = teleop.step(CENTRE, 0.0)
        assert velocity is not None
        assert all(abs(part) <= abs(most) for part, most in zip(velocity, bounded, strict=True))


@settings(deadline=None, max_examples=20)
@given(st.floats(-15.0, 15.0), st.integers(0, 3))
def test_a_spin_turns_by_its_angle_on_the_spot(angle: float, late: int) -> None:
    motion = SpinMotion(angle, 0.0, costs(OPEN))
    done = run(OPEN, CENTRE, motion, late)
    assert done.code == ''
    assert motion.turned == pytest.approx(angle, abs=0.03)
    assert done.robot.pose[:2] == CENTRE[:2]
    assert all(command.linear == 0.0 and command.angular * angle > 0.0 for command in done.commands)
    assert done.now < abs(angle) / 1.0 + 2.5


def test_a_spin_of_a_robot_that_brakes_gently_slows_down_in_time() -> None:
    gentle = replace(MODEL, drive=replace(MODEL.drive, angular_acceleration=1.0))
    limits = SPIN_LIMITS.braking_with(gentle.drive.angular_acceleration)
    done = Run(OPEN, CENTRE, gentle).go(SpinMotion(-1.0, 0.0, costs(OPEN), limits), late=1)
    done.world.step(10.0)
    assert done.robot.pose.yaw == pytest.approx(CENTRE.yaw - 1.0, abs=0.12)


@pytest.mark.parametrize('acceleration', [0.2, 0.5])
def test_a_spin_after_which_the_robot_would_roll_on_into_a_wall_ends_before_it(acceleration: float) -> None:
    """A long robot along a wall turns towards it: by most of these angles it fits, and not by a little more."""
    shape = box(1.0, 0.3)
    costmap, limits = Costmap(WALL, Inflation.of(shape)), SPIN_LIMITS.braking_with(acceleration)
    drive = DriveModel(linear_speed=0.1, linear_acceleration=0.01, angular_acceleration=acceleration)
    ends = set()
    for target in numpy.arange(-1.0, 0.0, 0.05):
        run = Run(WALL, Pose(2.6, 3.0, math.pi / 2.0), RobotModel(footprint=shape, lidar=None, drive=drive))
        done = run.go(SpinMotion(float(target), 0.0, costmap, limits), late=1)
        assert not done.touched, target
        ends.add(done.code)
    assert ends == {'', 'COLLISION_AHEAD'}


def test_a_spin_of_nothing_is_complete_at_once() -> None:
    assert SpinMotion(0.0, 1.0, costs(OPEN)).step(CENTRE, 5.0) is None


def test_a_robot_against_a_wall_can_turn() -> None:
    done = run(WALL, Pose(3.0 - RADIUS, 3.0, 0.0), SpinMotion(3.0, 10.0, costs(WALL)))
    assert (done.code, done.touched) == ('', False)


def test_a_robot_that_overlaps_a_wall_of_its_map_is_not_turned() -> None:
    """As in Nav2, whose footprint touches a lethal cell then."""
    done = run(OPEN, Pose(2.9, 3.0, 0.0), SpinMotion(3.0, 10.0, costs(WALL)))
    assert (done.code, done.robot.pose.yaw) == ('COLLISION_AHEAD', 0.0)


@settings(deadline=None, max_examples=30)
@given(st.data(), worlds(border=True), st.floats(-1.0, 1.0), st.floats(-2.0, 2.0))
def test_an_operator_cannot_drive_the_robot_into_an_obstacle(
    data: st.DataObject, world: OccupancyMap, linear: float, angular: float
) -> None:
    anywhere = free_places(world, RADIUS)
    assume(not anywhere.is_empty)
    start = data.draw(anywhere)
    teleop = AssistedTeleopMotion(lambda: Velocity(linear, angular), 0.0, costs(world))
    # The robot itself is no faster than its limits, so that it is never nearer than the command says.
    done = Run(world, start).go(teleop, until=6.0)
    assert not done.touched
    assert all(
        0.0 <= sent * wanted <= wanted * wanted
        for command in done.commands
        for sent, wanted in zip(command, (linear, angular), strict=True)
    )


def test_where_nothing_is_in_the_way_the_robot_does_what_the_operator_says_until_all_is_done() -> None:
    wanted = [Velocity(0.2, 0.5)]
    teleop = AssistedTeleopMotion(lambda: wanted[0], 0.0, costs(OPEN))
    assert teleop.step(CENTRE, 0.0) == (0.2, 0.5)
    wanted[0] = STOP
    assert teleop.step(CENTRE, 0.1) == STOP
    teleop.finish()
    assert teleop.step(CENTRE, 0.2) is None


@pytest.mark.parametrize(('gap', 'share'), [(0.05, 0.0), (0.15, 0.2), (0.55, 0.6), (1.5, 1.0)])
def test_a_command_is_scaled_by_the_time_until_a_collision(gap: float, share: float) -> None:
    """At 1 m/s, so that the gap, m, is the time, s; as in Nav2, collisions are seen in steps of 0.1 s."""
    teleop = AssistedTeleopMotion(lambda: Velocity(1.0, 0.1), 0.0, costs(WALL))
    sent = teleop.step(Pose(3.0 - RADIUS - gap, 3.0, 0.0), 0.0)
    assert sent == pytest.approx((share, 0.1 * share))


@pytest.mark.parametrize('seconds', [0.1, 0.15, 1.2])
def test_where_nothing_is_near_a_command_is_not_slowed_however_short_the_look_ahead(seconds: float) -> None:
    command = Velocity(0.2, 0.1)
    assert slowed(costs(OPEN), CENTRE, command, seconds) == command


@settings(deadline=None, max_examples=25)
@given(st.floats(0.0, 2.0), st.sampled_from([-1.0, 1.0]), st.floats(0.05, 3.0), st.integers(0, 3))
def test_a_drive_covers_its_distance_straight_ahead_or_back(
    distance: float, sign: float, speed: float, late: int
) -> None:
    motion = DriveMotion(sign * distance, sign * speed, 0.0, costs(OPEN))
    done = run(OPEN, CENTRE, motion, late)
    assert done.code == ''
    reached = done.robot.pose
    assert (reached.x - 3.0) * math.cos(2.0) + (reached.y - 3.0) * math.sin(2.0) == pytest.approx(
        sign * distance, abs=0.04 + 0.01 * late
    )
    assert abs((reached.y - 3.0) * math.cos(2.0) - (reached.x - 3.0) * math.sin(2.0)) < 1e-9
    assert motion.driven == pytest.approx(distance, abs=0.02 + 0.01 * late)


def way_ahead(world: OccupancyMap, start: Pose, sign: float, distance: float) -> float:
    """Return how far a robot could go straight, m, up to a distance, without touching an obstacle or leaving the
    map."""
    lengths = numpy.arange(0.0, distance + 0.002, 0.002)
    direction = numpy.array([math.cos(start.yaw), math.sin(start.yaw)]) * sign
    points = start[:2] + lengths[:, None] * direction
    outside = [not world.contains(*world.cell(*point)) for point in points]
    stops = numpy.flatnonzero((rooms(world, points) < RADIUS) | outside)
    return float(lengths[stops[0]]) if stops.size else distance


@settings(deadline=None, max_examples=40)
@given(st.data(), worlds(), st.floats(0.05, 2.0), st.sampled_from([-1.0, 1.0]), st.sampled_from([0.1, 0.26, 5.0]))
def test_a_drive_is_complete_or_an_obstacle_is_ahead_and_not_touched(
    data: st.DataObject, world: OccupancyMap, distance: float, sign: float, speed: float
) -> None:
    anywhere = free_places(world, RADIUS)
    assume(not anywhere.is_empty)
    start = data.draw(anywhere)
    rolls = ROLL_TIME * speed
    way = way_ahead(world, start, sign, distance + rolls + SPARE)
    done = run(world, start, DriveMotion(sign * distance, sign * speed, 0.0, costs(world)))
    if done.code:
        assert done.code == 'COLLISION_AHEAD'
        assert way < distance + rolls + SPARE
        assert not done.touched
        assert start.distance(done.robot.pose) >= way - LOOK_AHEAD * max(speed, 0.1) - SPARE
    else:
        assert way >= distance - SPARE


@pytest.mark.parametrize('speed', [0.1, 1.0, 40.0, 1e6, 1e300])
def test_no_speed_is_so_great_that_a_wall_is_overlooked(speed: float) -> None:
    done = run(WALL, Pose(2.0, 3.0, 0.0), DriveMotion(3.0, speed, 0.0, costs(WALL)))
    assert (done.code, done.touched) == ('COLLISION_AHEAD', False)


@pytest.mark.parametrize(('speed', 'deceleration'), [(0.5, 0.3), (1.0, 1.0), (2.0, 2.5), (2.0, 0.3)])
def test_a_drive_that_would_roll_on_into_a_wall_ends_before_it(speed: float, deceleration: float) -> None:
    world = drawn(*['.' * 200 + '#' + '.' * 19] * 120)  # a wall at x = 10 m
    drive = DriveModel(linear_speed=speed, linear_acceleration=deceleration)
    model = RobotModel(lidar=None, drive=drive)
    for distance in (8.5, 20.0):
        motion = DriveMotion(distance, speed, 0.0, costs(world), deceleration)
        done = Run(world, Pose(1.0, 3.0, 0.0), model).go(motion, late=1)
        assert (done.code, done.touched) == ('COLLISION_AHEAD', False)


@pytest.mark.parametrize('distance', [4.0, 1e300])
def test_the_map_is_not_left(distance: float) -> None:
    for start, sign in ((Pose(5.0, 3.0, 0.0), 1.0), (Pose(1.0, 3.0, 0.0), -1.0)):
        done = run(OPEN, start, DriveMotion(sign * distance, sign * 0.2, 0.0, costs(OPEN)))
        assert done.code == 'COLLISION_AHEAD'
        assert 0.0 < done.robot.pose.x < 6.0


def test_a_robot_that_overlaps_a_wall_of_its_map_can_back_out_of_it_but_not_on_through() -> None:
    inside = Pose(2.9, 3.0, 0.0)
    away = run(OPEN, inside, DriveMotion(-0.3, -0.15, 10.0, costs(WALL)))
    assert away.code == ''
    assert away.robot.pose.x < 2.62
    assert run(OPEN, inside, DriveMotion(0.3, 0.15, 10.0, costs(WALL))).code == 'COLLISION_AHEAD'


@pytest.mark.parametrize('rows', [slice(60, 61), slice(0, 120)])
def test_a_box_at_a_pole_or_a_thin_wall_of_its_map_can_back_away_from_it_but_not_drive_over_it(rows: slice) -> None:
    """It misses them by 7 mm, which is no distance on a grid."""
    cells = numpy.zeros((120, 160), numpy.int8)
    cells[rows, 80] = 100
    world, model = OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0)), RobotModel(footprint=box(0.9, 0.4), lidar=None)
    costmap, at = Costmap(world, Inflation.of(box(0.9, 0.4))), Pose(3.543, 3.02, 0.0)
    assert costmap.in_collision(at)
    on = Run(world, at, model).go(DriveMotion(0.15, 0.15, 10.0, costmap))
    assert (on.code, on.touched) == ('COLLISION_AHEAD', False)
    away = Run(world, at, model).go(DriveMotion(-0.3, -0.15, 10.0, costmap))
    assert (away.code, away.touched) == ('', False)


def test_a_robot_that_leaves_one_obstacle_does_not_get_to_drive_into_another() -> None:
    world = drawn(*['.' * 60 + '#' + '.' * 20 + '#' + '.' * 38] * 120)
    assert run(OPEN, Pose(3.06, 3.0, 0.0), DriveMotion(0.95, 0.2, 0.0, costs(world))).code == 'COLLISION_AHEAD'


def test_a_map_that_changes_counts_from_then_on() -> None:
    motion = DriveMotion(2.0, 0.2, 0.0, costs(OPEN))
    assert motion.step(Pose(2.5, 3.0, 0.0), 0.0) == (0.2, 0.0)
    motion.update(costs(WALL))
    with pytest.raises(NavigationError) as raised:
        motion.step(Pose(2.5, 3.0, 0.0), 0.1)
    assert raised.value.code == 'COLLISION_AHEAD'


@pytest.mark.parametrize(
    'motion',
    [
        SpinMotion(6.0, 1.0, costs(OPEN)),
        DriveMotion(2.0, 0.1, 1.0, costs(OPEN)),
        DriveMotion(-2.0, -0.1, 1.0, costs(OPEN)),
        AssistedTeleopMotion(lambda: Velocity(0.2, 0.5), 1.0, costs(OPEN)),
    ],
)
def test_what_takes_longer_than_allowed_times_out(motion: Motion) -> None:
    done = run(OPEN, CENTRE, motion)
    assert done.code == 'TIMEOUT'
    assert 1.0 < PERIOD * len(done.commands) < 1.1


@pytest.mark.parametrize('allowance', [0.0, -1.0])
def test_no_allowance_is_no_limit(allowance: float) -> None:
    assert run(OPEN, CENTRE, SpinMotion(25.0, allowance, costs(OPEN))).code == ''


def test_the_allowance_counts_from_the_first_step() -> None:
    motion = SpinMotion(3.0, 1.0, costs(OPEN))
    assert motion.step(CENTRE, 1000.0) is not None
    assert motion.step(CENTRE, 1001.0) is not None


@settings(deadline=None)
@given(st.data(), worlds(size=24), st.floats(-0.5, 0.5), st.floats(-2.0, 2.0))
def test_a_predicted_collision_is_one(data: st.DataObject, world: OccupancyMap, linear: float, angular: float) -> None:
    """On the arc that is driven, and within the time; and there is none where nothing is near the arc."""
    start = data.draw(places(world, beside=-0.5))
    times = numpy.linspace(0.0, 1.0, 200)
    headings = start.yaw + angular * times / 2.0
    chords = linear * times * numpy.sinc(angular * times / 2.0 / math.pi)
    arc = numpy.stack([start.x + chords * numpy.cos(headings), start.y + chords * numpy.sin(headings)], axis=1)
    distances = rooms(world, arc)
    assume(distances[0] >= RADIUS)
    inside = all(world.contains(*world.cell(*point)) for point in arc)
    if collides(costs(world), start, Velocity(linear, angular), 1.0):
        assert not inside or distances.min() < RADIUS
    else:
        assert inside
        assert distances.min() >= RADIUS - world.resolution**2 / (8.0 * RADIUS) - 1e-3


SPEEDS = st.floats(-0.5, 0.5), st.floats(-2.0, 2.0)


@settings(deadline=None, max_examples=50)
@given(*SPEEDS, *SPEEDS)
def test_a_robot_changes_its_velocity_as_foreseen(before: float, turning: float, linear: float, angular: float) -> None:
    """Beside a robot of the simulator, whose commands change."""
    model = DriveModel(linear_speed=1.0, angular_speed=3.0)
    world = World()
    robot = world.add('alpha', RobotModel(lidar=None, drive=model), CENTRE)
    for _ in range(20):
        robot.command(before, turning, world.time)
        world.step(0.05)
    inertia = Inertia(Velocity(before, turning), model.linear_acceleration, model.angular_acceleration)
    foreseen = inertia.poses(robot.pose, Velocity(linear, angular), 1.0, 20)
    for pose in foreseen:
        robot.command(linear, angular, world.time)
        world.step(0.05)
        assert robot.pose.distance(pose) < 0.02
        assert abs(wrap(robot.pose.yaw - pose.yaw)) < 0.06


def test_the_corner_of_a_box_does_not_pass_that_of_a_pole_between_two_looks() -> None:
    """It would clip it by 5 mm."""
    cells = numpy.zeros((80, 80), numpy.int8)
    cells[40, 40] = 100
    costmap = Costmap(OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0)), Inflation.of(box(0.9, 0.4)))
    assert collides(costmap, Pose(2.35854, 2.42463, -2.1), Velocity(0.0, 1.0024), 1.0)


def test_a_turn_does_not_end_at_once() -> None:
    """A box that stands along a wall and turns towards it hits it, though it is told to drive on."""
    costmap = Costmap(WALL, Inflation.of(box(0.9, 0.4)))
    beside, ahead = Pose(2.77, 3.0, math.pi / 2.0), Velocity(0.2, 0.0)
    assert not collides(costmap, beside, ahead, 1.0)
    assert collides(costmap, beside, ahead, 1.0, Inertia(Velocity(0.0, 1.0), 2.5, 3.2))


def test_a_robot_does_not_creep_towards_what_rests() -> None:
    """It would come to 0.02 m of it; no allowance ends it."""
    here = Pose(3.0, 3.0, 0.0)
    done = run(OPEN, here, DriveMotion(0.46, 0.1, 0.0, seen_from(here, Inflation(), 0.725, 0.0)))
    assert done.code == 'COLLISION_AHEAD'
    assert 0.43 < here.distance(done.robot.pose) < 0.45


def test_a_box_does_not_creep_with_a_corner_towards_what_rests() -> None:
    inflation = Inflation.of(box(0.6, 0.4))
    here = Pose(3.0, 3.0, 0.0)
    done = run(OPEN, here, SpinMotion(math.tau, 0.0, seen_from(here, inflation, 0.175, 0.375)))
    assert done.code == 'COLLISION_AHEAD'
    assert done.robot.pose.yaw > 0.1


def test_a_box_can_back_away_from_what_stands_against_it() -> None:
    """What was seen overlaps it by cells: it touches as many of them until it has moved by one."""
    here = Pose(3.0, 3.0, 0.0)
    done = run(OPEN, here, DriveMotion(-0.3, -0.15, 0.0, seen_from(here, Inflation.of(box(0.6, 0.4)), 0.275, 0.0)))
    assert done.code == ''
    assert 0.3 <= here.distance(done.robot.pose) < 0.35


def seen_from(here: Pose, inflation: Inflation, ahead: float, beside: float) -> Costmap:
    """Return the open map, with a point that was seen, the middle of a cell."""
    layers = LayeredCostmap(Costmap(OPEN, inflation), window=3.0)
    angles, ranges = numpy.array([math.atan2(beside, ahead)]), numpy.array([math.hypot(beside, ahead)])
    layers.observe(Observation(here, angles, ranges), here)
    return layers.costmap


def test_a_box_leaves_who_touches_it_without_a_turn() -> None:
    """One who walks after it is touched by a corner that swings, though the box as a whole gets away."""
    here, inflation = Pose(3.0, 3.0, 0.0), Inflation.of(box(0.4, 0.4))
    apart = KeepingApart(0.26)
    for ahead in (0.525, 0.275):
        apart.look(costmap := seen_from(here, inflation, ahead, 0.175), here, ahead)
    assert apart.leaves(costmap, here, Velocity(-0.2, 0.0))
    assert not apart.leaves(costmap, here, Velocity(-0.2, 0.2))
    apart = KeepingApart(0.26)
    apart.look(costmap := seen_from(here, inflation, 0.175, 0.175), here, 0.0)
    assert apart.limited(costmap, here, Velocity(-0.2, 0.0)) == Velocity(-0.2, 0.0)
    assert apart.limited(costmap, here, Velocity(0.0, -1.0)) is None


def test_a_robot_between_two_who_touch_it_stays_there() -> None:
    """To get away from the one that is nearer would be to drive into the other one."""
    here, inflation = Pose(3.0, 3.0, 0.0), Inflation()
    layers = LayeredCostmap(Costmap(OPEN, inflation), window=3.0)
    angles, ranges = numpy.array([0.0, math.pi]), numpy.array([0.225, 0.275])
    layers.observe(Observation(here, angles, ranges), here)
    apart = KeepingApart(0.26)
    apart.look(layers.costmap, here, 0.0)
    assert not apart.leaves(layers.costmap, here, Velocity(-0.12, 0.0))
    apart.look(alone := seen_from(here, inflation, 0.225, 0.0), here, 0.05)
    assert apart.leaves(alone, here, Velocity(-0.12, 0.0))


def test_a_robot_that_is_localized_anew_has_seen_nobody_move() -> None:
    """What it saw was beside where it thought to be."""
    here, inflation = Pose(3.0, 3.0, 0.0), Inflation.of(box(0.4, 0.4))
    apart, costmap = KeepingApart(0.26), seen_from(here, inflation, 0.525, 0.0)
    apart.look(seen_from(here, inflation, 0.325, 0.0), Pose(2.0, 3.0, 0.0), 0.0)
    apart.look(costmap, here, 0.2)
    assert not apart.has_company(0.2)
    apart.look(seen_from(here, inflation, 0.375, 0.0), here, 0.4)
    assert apart.has_company(0.4)


@pytest.mark.parametrize(
    ('bearing', 'aim', 'speed', 'begin'),
    [
        (-2.305, (-0.105, 0.208), 0.5, 0.61),
        (1.882, (-0.016, -0.355), 0.3, 0.58),
        (-2.084, (0.057, 0.207), 0.5, 1.33),
        (0.893, (0.19, 0.256), 0.4, 1.86),
        (1.516, (0.196, -0.308), 0.5, 1.18),
    ],
)
def test_a_robot_that_is_no_circle_and_turns_touches_nobody_who_comes(
    bearing: float, aim: tuple[float, float], speed: float, begin: float
) -> None:
    """Its corners swing while somebody comes from 1.5 m away."""
    model = RobotModel(footprint=box(0.6, 0.4), lidar=LidarModel(beams=180))
    world = World(OPEN)
    robot = world.add('robot', model, Pose(3.0, 3.0, 0.0))
    robot.devices['lidar'].is_read = True
    start = drive(Pose(3.0, 3.0, bearing), 1.5, 0.0, 1.0)
    there = (6.0 + 2.0 * aim[0] - start.x, 6.0 + 2.0 * aim[1] - start.y)
    walk = RouteModel(waypoints=(there, start[:2]), speed=speed)
    world.add('walker', ObstacleModel(Pose(start.x, start.y, 0.0), Circle(0.2), route=walk))
    layers = LayeredCostmap(Costmap(OPEN, Inflation.of(model.footprint)), window=3.0)
    motion = SpinMotion(math.tau, 20.0, layers.costmap)
    lidar, seen = LidarModel(beams=180), 0.0
    angles = lidar.angle_min + lidar.angle_increment * numpy.arange(lidar.beams, dtype=numpy.float64)
    with contextlib.suppress(NavigationError):
        while (velocity := STOP if world.time < begin else motion.step(robot.pose, world.time)) is not None:
            robot.command(*velocity, world.time)
            world.step(0.05)
            if robot.scan is not None and robot.scan.time > seen:
                seen, ranges = robot.scan.time, robot.scan.ranges.astype(numpy.float64)
                layers.observe(Observation(compose(robot.pose, lidar.pose), angles, ranges), robot.pose)
    world.step(0.5)
    assert robot.contacts == 0
