# SPDX-License-Identifier: BSD-3-Clause
"""Robots, obstacles and doors that move: nothing ever overlaps anything, and all depends on the seed and the calls."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import (
    MODELS,
    BatteryModel,
    Body,
    Circle,
    DoorModel,
    DriveModel,
    LidarModel,
    ObstacleModel,
    OccupancyMap,
    OdometryModel,
    Polygon,
    Pose,
    RobotModel,
    RouteModel,
    Shape,
    StationModel,
    WalkModel,
    World,
    WorldSnapshot,
    ZoneModel,
    box,
    compose,
    drive,
    gap,
    wrap,
)
from flexbt_sim.world.plane.loops import polygon_gap, polygon_gap_at_once
from flexbt_testing.worlds import drawn, places, rooms, worlds

ROUNDING = 1e-6
footprints: st.SearchStrategy[Shape] = st.sampled_from(
    [Circle(0.1), Circle(0.3), box(0.5, 0.2), Polygon(((0.3, 0.0), (-0.1, 0.15), (-0.1, -0.15)))]
)
drives = st.builds(
    DriveModel,
    linear_speed=st.sampled_from([0.26, 2.0, 20.0]),
    angular_speed=st.floats(0.1, 10.0),
    linear_acceleration=st.sampled_from([0.5, 100.0]),
    turning_radius=st.sampled_from([0.0, 1.0]),
    slip=st.sampled_from([0.0, 0.2]),
)
robot_models = st.builds(RobotModel, footprint=footprints, drive=drives, lidar=st.none())
commands = st.tuples(st.floats(-25.0, 25.0), st.floats(-12.0, 12.0))


def outline(body: Body) -> numpy.ndarray[tuple[int, ...], numpy.dtype[numpy.float64]]:
    """Points of a body's border, a centimetre apart."""
    if isinstance(body.shape, Circle):
        return numpy.array([[body.pose.x, body.pose.y]])
    points = []
    for x0, y0, x1, y1 in body.shape.sides(body.pose):
        along = numpy.linspace(0.0, 1.0, max(2, math.ceil(math.hypot(x1 - x0, y1 - y0) / 0.01)))[:, None]
        points.append(numpy.array([[x0, y0]]) * (1.0 - along) + numpy.array([[x1, y1]]) * along)
    return numpy.concatenate(points)


def assert_nothing_overlaps(world: World) -> None:
    """No robot overlaps anything. Obstacles may have been put on each other and on walls."""
    for robot in world.robots.values():
        for other in (*world.robots.values(), *world.obstacles.values(), *world.doors.values()):
            apart = gap(robot.shape, robot.pose, other.shape, other.pose)
            assert other is robot or apart >= -ROUNDING, (robot.name, other.name)
        if world.map is not None:
            room = rooms(world.map, outline(robot)).min()
            assert room >= (robot.radius if isinstance(robot.shape, Circle) else 0.0) - ROUNDING, robot.name


def try_to_add(
    world: World, data: st.DataObject, name: str, model: RobotModel, somewhere: st.SearchStrategy[Pose]
) -> None:
    for _ in range(3):
        try:
            world.add(name, model, data.draw(somewhere))
            return
        except SimulationError:
            continue


@settings(deadline=None, max_examples=20)
@given(st.data(), worlds(least=20, resolutions=(0.05, 0.1)) | st.none())
def test_nothing_ever_overlaps_whatever_is_commanded(data: st.DataObject, grid: OccupancyMap | None) -> None:
    world = World(grid, seed=data.draw(st.integers(0, 9)), step=data.draw(st.sampled_from([0.01, 0.02, 0.1])))
    somewhere = places(grid) if grid else st.builds(Pose, *[st.floats(-2.0, 2.0)] * 3)
    for i in range(data.draw(st.integers(1, 5))):
        try_to_add(world, data, f'robot{i}', data.draw(robot_models), somewhere)
    for i in range(data.draw(st.integers(0, 3))):
        walk = data.draw(st.none() | st.builds(WalkModel, speed=st.floats(0.1, 5.0)))
        model = ObstacleModel(pose=data.draw(somewhere), shape=data.draw(footprints), random_walk=walk)
        try:
            world.add(f'obstacle{i}', model)
        except SimulationError:
            continue
    for _ in range(data.draw(st.integers(1, 12))):
        for robot in world.robots.values():
            robot.command(*data.draw(commands), world.time)
        world.step(data.draw(st.sampled_from([0.02, 0.1, 0.5])))
        assert_nothing_overlaps(world)


@pytest.mark.parametrize(('step', 'speed'), [(0.02, 30.0), (0.1, 30.0), (1.0, 30.0)])
def test_a_robot_stops_at_an_obstacle_however_far_it_drives_in_one_step(step: float, speed: float) -> None:
    world = World(step=step)
    drive = DriveModel(linear_speed=speed, linear_acceleration=1000.0, watchdog=100.0)
    robot = world.add('robot', RobotModel(footprint=Circle(0.2), drive=drive, lidar=None), Pose(0.0, 0.0, 0.0))
    world.add('pillar', ObstacleModel(pose=Pose(12.0, 0.0, 0.0), shape=Circle(0.3)))
    robot.command(speed, 0.0, 0.0)
    world.step(2.0)
    assert robot.pose.x == pytest.approx(11.5, abs=0.01) and robot.contacts == 1


def test_robots_drive_into_each_other_and_stop() -> None:
    world = World()
    for name, x, yaw in (('one', 0.0, 0.0), ('other', 1.0, math.pi)):
        world.add(name, MODELS['waffle'], Pose(x, 0.0, yaw))
    for _ in range(250):
        for robot in world.robots.values():
            robot.command(0.26, 0.0, world.time)
        world.step()
    one, other = world.robots.values()
    assert 0.0 <= one.pose.distance(other.pose) - 0.44 <= 0.01
    assert one.contacts >= 1
    assert one.in_contact
    assert one.linear == 0.0


def test_a_robot_stops_at_a_wall_and_backs_off() -> None:
    world = World(drawn(*['.' * 60 + '#' * 4] * 40))
    robot = world.add('alpha', replace(MODELS['burger'], footprint=box(0.4, 0.3)), Pose(2.0, 1.0, 0.0))
    for _ in range(300):
        robot.command(0.22, 0.0, world.time)
        world.step()
    assert 2.95 <= robot.pose.x + 0.2 <= 3.0
    for _ in range(100):
        robot.command(-0.22, 0.0, world.time)
        world.step()
    assert robot.pose.x + 0.2 < 2.7


def test_a_car_takes_no_sharper_bend_than_it_can() -> None:
    world = World()
    car = world.add('car', MODELS['car'], Pose(0.0, 0.0, 0.0))
    car.command(0.0, 1.0, 0.0)
    world.step(0.4)
    assert car.pose == Pose(0.0, 0.0, 0.0)
    for speed in (1.0, 8.0, -3.0, 1.0):
        for _ in range(200):
            car.command(speed, 1.0, world.time)
            world.step()
            assert abs(car.angular) <= abs(car.linear) / 5.0
        assert car.angular == pytest.approx(min(1.0, abs(speed) / 5.0))
    world.step(10.0)
    world.add('mud', ZoneModel(kind='slow', area=Circle(50.0), pose=car.pose, speed=0.5))
    for _ in range(100):
        car.command(1.0, 1.0, world.time)
        world.step()
    assert (car.linear, car.angular) == pytest.approx((0.5, 0.5 / 5.0))
    for _ in range(100):
        car.command(1.0, 0.1, world.time)
        world.step()
    assert (car.linear, car.angular) == pytest.approx((0.5, 0.05))


def test_a_blocked_car_does_not_turn() -> None:
    world = World()
    car = world.add('car', MODELS['car'], Pose(0.0, 0.0, 0.0))
    world.add('wall', ObstacleModel(pose=Pose(8.0, 0.0, 0.0), shape=box(1.0, 40.0)))
    while not car.in_contact:
        car.command(8.0, 0.2, world.time)
        world.step()
    yaw = car.pose.yaw
    for _ in range(200):
        car.command(8.0, 0.2, world.time)
        world.step()
    assert (car.pose.yaw, car.twist) == (pytest.approx(yaw, abs=1e-3), (0.0, 0.0))
    car.command(-1.0, 0.2, world.time)
    world.step(0.4)
    assert not car.in_contact and car.pose.yaw > yaw


def walk(world: World, steps: int = 150) -> list[WorldSnapshot]:
    snapshots = []
    for step in range(steps):
        for number, robot in enumerate(world.robots.values()):
            robot.command(0.2, math.sin(step * 0.05 + number), world.time)
        world.step()
        snapshots.append(world.snapshot())
    return snapshots


NOISY = replace(
    MODELS['burger'],
    drive=replace(MODELS['burger'].drive, slip=0.1),
    odometry=OdometryModel(linear_noise=0.05, angular_noise=0.05, drift=0.02),
)


def busy(seed: int = 7, order: tuple[str, ...] = ('alpha', 'beta', 'gamma')) -> World:
    world = World(drawn('#' * 122, *['#' + '.' * 120 + '#'] * 120, '#' * 122), seed=seed)
    starts = {'alpha': Pose(1.0, 1.0, 0.0), 'beta': Pose(3.0, 3.0, 1.0), 'gamma': Pose(5.0, 5.0, 2.0)}
    for name in order:
        world.add(name, NOISY, starts[name])
    world.add('cart', ObstacleModel(pose=Pose(2.0, 5.0, 0.0), random_walk=WalkModel(speed=0.7, period=1.0)))
    return world


def scans(world: World) -> list[bytes]:
    return [robot.scan.ranges.tobytes() for _, robot in sorted(world.robots.items()) if robot.scan is not None]


def test_the_same_seed_gives_the_same_bits_and_another_one_others() -> None:
    one, other, third = busy(), busy(), busy(8)
    assert repr(walk(one)) == repr(walk(other))
    assert scans(one) == scans(other)
    assert len(scans(one)) == 3
    assert repr(walk(third)) != repr(walk(busy()))


def test_the_order_in_which_robots_came_does_not_matter() -> None:
    one, other = busy(), busy(order=('gamma', 'alpha', 'beta'))
    for a, b in zip(walk(one, 100), walk_by_name(other, 100, list(one.robots)), strict=True):
        assert sorted(map(repr, a.entities)) == sorted(map(repr, b.entities))


def walk_by_name(world: World, steps: int, names: list[str]) -> list[WorldSnapshot]:
    snapshots = []
    for step in range(steps):
        for number, name in enumerate(names):
            world.robots[name].command(0.2, math.sin(step * 0.05 + number), world.time)
        world.step()
        snapshots.append(world.snapshot())
    return snapshots


def test_what_comes_and_goes_does_not_change_the_noise_of_the_others() -> None:
    one, other = busy(), busy()
    other.remove('beta')
    other.add('aaa', NOISY, Pose(5.5, 0.5, 0.0))
    for world in (one, other):
        for step in range(50):
            world.robots['alpha'].command(0.2, math.sin(step * 0.05), world.time)
            world.step()
    assert one.state('alpha') == other.state('alpha')
    other.add('beta', NOISY, Pose(3.0, 3.0, 1.0))
    for world in (one, other):
        world.step(1.0)
    assert one.state('alpha') == other.state('alpha')


def test_a_reset_world_runs_as_before() -> None:
    world = busy()
    world.add('dock', StationModel(pose=Pose(0.0, 0.0, 0.0)))
    world.add('mud', ZoneModel(kind='slow', area=Circle(0.5), speed=0.05))
    first = [state.entities for state in walk(world, 100)]
    world.move('dock', Pose(1.0, 1.0, 0.0))
    world.move('mud', Pose(1.0, 1.0, 0.0))
    world.reset()
    assert [state.entities for state in walk(world, 100)] == first


HALL = drawn('#' * 82, *['#' + '.' * 80 + '#'] * 80, '#' * 82)
somebody = st.sampled_from(['alpha', 'beta', 'box', 'cart', 'gate', 'new'])
somewhere = st.builds(Pose, st.floats(0.0, 4.1), st.floats(0.0, 4.1), st.floats(-3.0, 3.0))
models = st.sampled_from(
    [
        NOISY,
        ObstacleModel(pose=Pose(0.0, 0.0, 0.0), random_walk=WalkModel(speed=0.7, period=0.5)),
        ObstacleModel(pose=Pose(0.0, 0.0, 0.0)),
    ]
)
faults = st.sampled_from(
    [
        ('stuck_wheel', {'side': 'right'}),
        ('localization_lost', {'jump': [0.3, 0.1, 0.2], 'drift': 0.1}),
        ('lidar_blinded', {'width': 1.0}),
        ('battery_low', {'level': 0.0}),
        ('door_jammed', {}),
    ]
)
some_time = st.sampled_from([0.0, 0.02, 0.05, 0.3])
calls = st.one_of(
    st.tuples(st.just('add'), somebody, models, somewhere),
    st.tuples(st.just('remove'), somebody),
    st.tuples(st.just('move'), somebody, somewhere),
    st.tuples(st.just('door'), st.booleans()),
    st.tuples(st.just('command'), somebody, st.floats(-0.3, 0.3), st.floats(-2.0, 2.0)),
    st.tuples(st.just('set_fault'), somebody, faults, some_time, some_time),
    st.tuples(st.just('clear_fault'), somebody),
    st.tuples(st.just('reset')),
)


def serve(world: World, call: tuple[Any, ...]) -> str:
    """Do what a service does; why it refused."""
    what, *values = call
    try:
        if what == 'door':
            if 'gate' in world.doors:
                world.doors['gate'].command(*values)
        elif what == 'command':
            if values[0] in world.robots:
                linear, angular = values[1:]
                world.robots[values[0]].command(linear, angular, world.time)
        elif what == 'set_fault':
            entity, (fault, parameters), after, duration = values
            world.set_fault(entity, fault, parameters, after, duration)
        else:
            getattr(world, what)(*values)
    except SimulationError as error:
        return str(error)
    return ''


@settings(deadline=None, max_examples=20)
@given(st.lists(st.tuples(calls, st.integers(0, 12), st.booleans()), max_size=20))
def test_services_at_the_same_simulated_times_give_the_same_bits(script: list[tuple[Any, int, bool]]) -> None:
    """Of two worlds the second makes all steps between two calls at once, is looked at, and its scans are not always
    read."""

    def made() -> World:
        world = World(HALL, seed=5)
        world.add('alpha', NOISY, Pose(1.0, 1.0, 0.3))
        world.add('beta', replace(NOISY, lidar=LidarModel(beams=40, dropout=0.2, rate=20.0)), Pose(3.0, 3.0, 1.0))
        world.add('box', ObstacleModel(pose=Pose(3.0, 1.0, 0.0)))
        world.add('cart', ObstacleModel(pose=Pose(1.0, 3.0, 0.0), random_walk=WalkModel(speed=0.7, period=0.5)))
        world.add('gate', DoorModel(from_=(2.0, 1.0), to=(2.0, 2.0), automatic=True))
        return world

    one, other = made(), made()
    for call, steps, is_read in script:
        assert serve(one, call) == serve(other, call)
        for robot in other.robots.values():
            robot.devices['lidar'].is_read = is_read
        for _ in range(steps):
            one.step()
        other.step(steps * other.step_size)
        assert repr(other.snapshot()) == repr(one.snapshot())
    for robot in other.robots.values():
        robot.devices['lidar'].is_read = True
    for world in (one, other):
        world.step(0.4)
    assert repr(other.snapshot()) == repr(one.snapshot())
    assert scans(other) == scans(one)


def test_the_noise_of_the_odometry_grows_with_the_way_and_has_no_bias() -> None:
    """After d metres the deviation is noise * sqrt(d), whatever the step."""
    errors = []
    for step in (0.01, 0.05):
        for seed in range(150):
            world = World(seed=seed, step=step)
            model = RobotModel(lidar=None, odometry=OdometryModel(linear_noise=0.05))
            robot = world.add('alpha', model, Pose(0.0, 0.0, 0.0))
            while robot.pose.x < 1.0:
                robot.command(0.26, 0.0, world.time)
                world.step(0.2)
            errors.append((robot.odometry.x - robot.pose.x) / math.sqrt(robot.pose.x))
    for some in (errors[:150], errors[150:]):
        assert abs(float(numpy.mean(some))) < 4.0 * 0.05 / math.sqrt(150)
        assert float(numpy.std(some)) == pytest.approx(0.05, rel=0.25)


def test_exact_odometry_is_the_way_that_was_driven() -> None:
    world = World()
    robot = world.add('alpha', RobotModel(lidar=None), Pose(1.0, 2.0, 0.5))
    for _ in range(300):
        robot.command(0.2, 0.3, world.time)
        world.step()
    assert tuple(robot.estimate) == pytest.approx(tuple(robot.pose))
    assert math.hypot(robot.odometry.x, robot.odometry.y) == pytest.approx(robot.pose.distance(Pose(1.0, 2.0, 0.5)))


def test_slip_is_lost_on_the_ground_and_seen_by_the_wheels() -> None:
    world = World(seed=1)
    model = RobotModel(lidar=None, drive=DriveModel(slip=0.2))
    robot = world.add('alpha', model, Pose(0.0, 0.0, 0.0))
    for _ in range(1000):
        before = robot.pose
        robot.command(0.26, 0.0, world.time)
        world.step()
        assert world.state('alpha').linear[0] * world.step_size == pytest.approx(robot.pose.distance(before))
    assert robot.pose.x == pytest.approx(0.8 * robot.odometry.x, rel=0.03)
    world.add('wall', ObstacleModel(pose=compose(robot.pose, Pose(1.0, 0.0, 0.0)), shape=box(0.1, 5.0)))
    for turning, steps in ((0.0, 200), (1.0, 50)):  # up to the wall, and against it
        pose, odometry = robot.pose, robot.odometry
        for _ in range(steps):
            robot.command(0.26, turning, world.time)
            world.step()
    assert robot.in_contact
    turned, measured = (wrap(now.yaw - then.yaw) for now, then in ((robot.pose, pose), (robot.odometry, odometry)))
    assert turned == pytest.approx(0.8 * measured, rel=0.05)


# -- obstacles, doors, zones, batteries ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('order', 'expected'),
    [
        ('loop', [1.0, 2.0, 1.0, 0.0, 1.0]),
        ('back_and_forth', [1.0, 2.0, 1.0, 0.0, 1.0]),
        ('once', [1.0, 2.0, 2.0, 2.0, 2.0]),
    ],
)
def test_an_obstacle_goes_its_way(order: str, expected: list[float]) -> None:
    world = World()
    route = RouteModel(waypoints=((0.0, 0.0), (2.0, 0.0)), speed=1.0, order=order)
    obstacle = world.add('person', ObstacleModel(pose=Pose(0.0, 0.0, 0.0), route=route))
    seen = []
    for _ in expected:
        world.step(1.0)
        seen.append(obstacle.pose.x)
    assert seen == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize('order', ['loop', 'back_and_forth'])
def test_two_obstacles_that_meet_where_they_cannot_pass_turn_back(order: str) -> None:
    world = World()
    ends = (0.0, 0.0), (4.0, 0.0)
    for name, pose, waypoints in (('one', ends[0], ends), ('other', ends[1], ends[::-1])):
        route = RouteModel(waypoints=waypoints, speed=1.0, order=order, patience=2.0)
        world.add(name, ObstacleModel(pose=Pose(*pose, 0.0), route=route))
    visits = dict.fromkeys(world.obstacles, 0)
    for _ in range(400):
        world.step(0.1)
        for obstacle, end in zip(world.obstacles.values(), ends, strict=True):
            visits[obstacle.name] += obstacle.pose.distance(Pose(*end, 0.0)) < 0.01
    assert min(visits.values()) >= 3


@settings(deadline=None, max_examples=50)
@given(*[st.floats(0.1, 1.0)] * 4, *[st.floats(-0.5, 0.5)] * 2, st.floats(-3.0, 3.0))
def test_boxes_that_overlap_say_how_far_one_has_to_go(
    length: float, width: float, other_length: float, other_width: float, x: float, y: float, yaw: float
) -> None:
    """Also where they cross and no corner is in the other: two who walk about could never part."""
    one, other = box(length, width), box(other_length, other_width)
    overlap = -gap(one, Pose(0.0, 0.0, 0.0), other, Pose(x, y, yaw))
    assume(overlap > 0.01)

    def parts(distance: float) -> bool:
        return any(
            gap(one, Pose(distance * math.cos(way), distance * math.sin(way), 0.0), other, Pose(x, y, yaw)) >= 0.0
            for way in (turn + angle * math.pi / 2.0 for angle in range(4) for turn in (0.0, yaw))
        )

    assert parts(overlap + 1e-6)
    assert not parts(overlap - 1e-6)


def test_who_walks_about_gets_out_of_a_wall_on_the_side_that_it_stands_on() -> None:
    """Its overlap is known by cells, so that a short step in the right direction may leave it as it is."""
    world = World(drawn(*['#' * 100] * 5, *['.' * 100] * 40, *['#' * 100] * 5, *['.' * 100] * 50, resolution=0.1))
    walker = ObstacleModel(Pose(5.0, 4.9, -0.3), box(0.95, 0.45), random_walk=WalkModel(speed=0.4, period=2.0))
    obstacle = world.add('walker', walker)
    world.step(60.0)
    assert obstacle.pose.y < 4.7


def test_an_obstacle_that_stands_in_a_wall_stops_at_a_robot_all_the_same() -> None:
    world = World(drawn(*['.' * 100] * 40, *['#' * 100] * 5, resolution=0.1))
    cart = ObstacleModel(Pose(2.0, 0.6, 0.0), Circle(0.25), RouteModel(waypoints=((8.0, 0.6),), order='once'))
    obstacle = world.add('cart', cart)
    robot = world.add('alpha', RobotModel(footprint=Circle(0.22), lidar=None), Pose(5.0, 0.75, 0.0))
    world.step(10.0)
    assert robot.pose.distance(obstacle.pose) == pytest.approx(0.47, abs=0.003)


def test_an_obstacle_that_stands_in_another_one_stops_at_a_robot_all_the_same() -> None:
    world = World()
    world.add('shelf', ObstacleModel(pose=Pose(0.0, 0.0, 0.0), shape=box(1.0, 1.0)))
    route = RouteModel(waypoints=((5.0, 0.0),), order='once')
    cart = world.add('cart', ObstacleModel(pose=Pose(0.4, 0.0, 0.0), shape=Circle(0.5), route=route))
    world.add('alpha', RobotModel(footprint=Circle(0.22), lidar=None), Pose(1.3, 0.0, 0.0))
    world.step(10.0)
    assert cart.pose.x == pytest.approx(1.3 - 0.72, abs=0.003)


@pytest.mark.parametrize('step', [0.02, 1.0])
def test_an_obstacle_with_several_points_within_a_step_stops_at_what_is_in_its_way(step: float) -> None:
    world, way = World(step=step), 30.0 * step
    route = RouteModel(waypoints=tuple((0.35 * way * n, 0.0) for n in (1, 2, 3)), speed=30.0, order='once')
    cart = world.add('cart', ObstacleModel(pose=Pose(0.0, 0.0, 0.0), shape=Circle(0.2), route=route))
    world.add('post', ObstacleModel(pose=Pose(0.4 + 0.75 * way, 0.0, 0.0), shape=Circle(0.2)))
    world.step()
    assert cart.pose.x == pytest.approx(0.75 * way, abs=0.003)


def test_an_obstacle_waits_for_what_is_in_its_way() -> None:
    world = World()
    robot = world.add('alpha', RobotModel(lidar=None), Pose(1.0, 0.0, 0.0))
    person = world.add(
        'person', ObstacleModel(pose=Pose(0.0, 0.0, 0.0), route=RouteModel(waypoints=((3.0, 0.0),), order='once'))
    )
    world.step(10.0)
    assert robot.pose == Pose(1.0, 0.0, 0.0)
    assert person.pose.x == pytest.approx(1.0 - 0.47, abs=0.01)
    world.move('alpha', Pose(1.0, 2.0, 0.0))
    world.step(10.0)
    assert person.pose.x == pytest.approx(3.0)


DOOR = DoorModel(from_=(0.0, 0.0), to=(1.0, 0.0), opening_time=2.0)
LEAVES = {'left': 0.0, 'right': math.pi}


def test_a_door_is_moved_and_works_where_it_is() -> None:
    world = World()
    door = world.add('gate', replace(DOOR, from_=(0.0, 0.0), to=(1.0, 0.0), automatic=True))
    start = world.snapshot().entities
    world.add('alpha', MODELS['burger'], Pose(5.5, 4.2, 1.57))
    world.step(1.0)
    assert door.opening == 0.0
    world.move('gate', Pose(5.0, 5.0, 0.0))
    assert (door.model.from_, door.model.to) == ((5.0, 5.0), (6.0, 5.0))
    world.step(5.0)
    assert door.opening == 1.0  # somebody is near it
    world.remove('alpha')
    world.reset()
    assert world.snapshot().entities == start
    other = world.add('flap', DOOR, Pose(1.0, 2.0, math.pi / 2.0))
    assert other.model.to == pytest.approx((1.0, 2.0 + DOOR.length))


def test_a_door_opens_and_closes_by_command_and_not_on_a_robot() -> None:
    world = World()
    door = world.add('gate', DOOR)
    with pytest.raises(SimulationError, match="would overlap 'gate'"):
        world.add('alpha', MODELS['burger'], Pose(0.5, 0.0, 0.0))
    door.command(True)
    world.step(1.0)
    assert door.opening == pytest.approx(0.5)
    world.step(2.0)
    assert door.opening == 1.0
    world.add('alpha', MODELS['burger'], Pose(0.5, 0.0, 0.0))
    door.command(False)
    world.step(5.0)
    assert door.opening == pytest.approx(0.605, abs=0.02)
    world.remove('alpha')
    world.step(2.0)
    assert door.opening == 0.0


@pytest.mark.parametrize('yaw', [0.0, 0.3, 2.0])
def test_both_leaves_of_a_double_door_close(yaw: float) -> None:
    world = World()
    leaves = [world.add(name, replace(DOOR, open=True), Pose(3.0, 1.0, yaw + turn)) for name, turn in LEAVES.items()]
    for leaf in leaves:
        leaf.command(False)
    world.step(3.0)
    assert [leaf.opening for leaf in leaves] == [0.0, 0.0]


@pytest.mark.parametrize('x', [0.3001, 0.6999])
def test_an_open_door_leaves_the_whole_passage_free(x: float) -> None:
    world = World()
    world.add('gate', replace(DOOR, open=True))
    alpha = world.add('alpha', RobotModel(footprint=Circle(0.3), lidar=None), Pose(x, -1.0, math.pi / 2.0))
    for _ in range(120):
        alpha.command(0.2, 0.0, world.time)
        world.step(0.1)
    assert alpha.pose.y > 1.0
    assert alpha.contacts == 0


def test_an_automatic_door_opens_for_who_comes_and_closes_after_it_has_gone() -> None:
    world = World()
    door = world.add('gate', replace(DOOR, automatic=True, hold=1.0))
    world.step(3.0)
    assert door.opening == 0.0
    world.add('alpha', MODELS['burger'], Pose(0.5, 1.0, 0.0))
    world.step(3.0)
    assert door.opening == 1.0
    world.move('alpha', Pose(0.5, 5.0, 0.0))
    world.step(0.9)
    assert door.opening == 1.0
    world.step(3.0)
    assert door.opening == 0.0


def test_an_automatic_door_opens_on_command_and_closes_again() -> None:
    world = World()
    door = world.add('gate', replace(DOOR, automatic=True, hold=3.0))
    world.step(1.0)
    door.command(True)
    world.step(2.5)
    assert door.opening == 1.0
    world.step(3.0)
    assert door.opening == 0.0


def test_zones_hold_count_and_blind() -> None:
    world = World()
    world.add('mud', ZoneModel(kind='slow', pose=Pose(1.0, 0.0, 0.0), area=box(1.0, 1.0), speed=0.05))
    world.add('lawn', ZoneModel(kind='no_go', pose=Pose(1.2, 0.0, 0.0), area=Circle(0.2)))
    world.add('glare', ZoneModel(kind='sensor_shadow', pose=Pose(3.0, 0.0, 0.0), area=box(1.0, 1.0)))
    world.add('wall', ObstacleModel(pose=Pose(2.0, 1.0, 0.0), shape=box(10.0, 0.1)))
    drifting = replace(MODELS['waffle'], odometry=OdometryModel(scale=1.1))
    robot = world.add('alpha', drifting, Pose(0.0, 0.0, 0.0))
    slowest, shadows = 1.0, 0
    while robot.pose.x < 4.0:
        robot.command(0.26, 0.0, world.time)
        world.step()
        if 0.7 < robot.pose.x < 1.4:
            slowest = min(slowest, robot.linear)
        if 2.7 < robot.pose.x < 3.4:
            assert robot.zones == ('glare',)
            assert robot.in_shadow
            shadows += numpy.isinf(robot.scan.ranges).all()
        if 3.45 < robot.pose.x < 3.5:
            assert robot.estimate.x > robot.pose.x + 0.05
    assert slowest == pytest.approx(0.05)
    assert robot.violations == 1
    assert shadows > 10
    assert robot.estimate.x == pytest.approx(robot.pose.x)
    assert numpy.isfinite(robot.scan.ranges).any()


def test_what_was_in_a_zone_or_a_station_is_not_any_more_when_that_is_removed_or_replaced() -> None:
    world = World()
    robot = world.add('alpha', MODELS['waffle'], Pose(0.0, 0.0, 0.0))
    mud = ZoneModel(kind='slow', area=Circle(9.0), speed=0.01)

    def speed() -> float:
        for _ in range(10):
            robot.command(0.2, 0.0, world.time)
            world.step()
        return float(robot.linear)

    world.add('mud', mud)
    assert speed() == pytest.approx(0.01)
    world.remove('mud')
    world.add('mud', replace(mud, speed=0.1))
    assert speed() == pytest.approx(0.1)
    world.remove('mud')
    assert speed() == pytest.approx(0.2)
    robot.command(0.0, 0.0, world.time)
    world.step(1.0)
    world.add('dock', StationModel(pose=robot.pose))
    world.step()
    assert robot.battery.is_charging
    world.remove('dock')
    assert not robot.battery.is_charging


def test_a_battery_drains_stops_the_robot_and_is_charged() -> None:
    world = World()
    model = replace(MODELS['burger'], battery=BatteryModel(capacity=0.01, idle=5.0, driving=10.0))
    robot = world.add('alpha', model, Pose(0.0, 0.0, 0.0))
    while robot.is_powered:
        before = robot.battery.power
        robot.command(0.22, 0.0, world.time)
        world.step()
    # 0.01 Wh are 36 J, and it takes 15 W while it drives.
    assert world.time == pytest.approx(36.0 / 15.0, rel=0.05)
    assert before == pytest.approx(-15.0, rel=1e-3)
    world.step(1.0)
    assert robot.battery.power == 0.0
    scan, pose = robot.scan, robot.pose
    robot.command(0.22, 0.0, world.time)
    world.step(1.0)
    assert robot.pose == pose
    assert robot.scan == scan
    world.add('dock', StationModel(pose=pose))
    world.step(0.5)
    assert robot.battery.is_charging
    assert robot.battery.level > 0.5
    assert robot.battery.power == 60.0 - 5.0
    world.step(1.0)
    assert (robot.battery.level, robot.battery.power) == (1.0, 0.0)


# -- changes at run time ---------------------------------------------------------------------------------------------


def test_what_cannot_be_is_refused_and_changes_nothing() -> None:
    world = World(drawn('#' * 62, *['#' + '.' * 60 + '#'] * 60, '#' * 62))
    world.add('alpha', MODELS['burger'], Pose(1.0, 1.0, 0.0))
    world.add('gate', replace(DOOR, from_=(2.0, 2.0), to=(2.5, 2.0)))
    before = world.snapshot()
    for call, message in (
        (lambda: world.add('alpha', MODELS['burger'], Pose(2.0, 1.0, 0.0)), "there is a 'alpha' already"),
        (lambda: world.add('a b', MODELS['burger'], Pose(2.0, 1.0, 0.0)), 'cannot be a name'),
        (lambda: world.add('beta', MODELS['burger'], Pose(1.1, 1.0, 0.0)), "would overlap 'alpha'"),
        (lambda: world.add('beta', MODELS['burger'], Pose(9.0, 1.0, 0.0)), 'outside of the map'),
        (lambda: world.add('beta', MODELS['burger'], Pose(0.1, 1.0, 0.0)), 'from an obstacle'),
        (lambda: world.add('beta', MODELS['burger'], Pose(math.nan, 1.0, 0.0)), 'is not a pose'),
        (lambda: world.add('beta', MODELS['burger']), 'its pose is missing'),
        (lambda: world.add('box', ObstacleModel(pose=Pose(1.2, 1.0, 0.0))), "would overlap 'alpha'"),
        (lambda: world.move('nobody', Pose(1.0, 1.0, 0.0)), "there is no 'nobody'"),
        (lambda: world.move('gate', Pose(0.8, 1.0, 0.0)), "would overlap 'alpha'"),
        (lambda: world.move('alpha', Pose(0.0, 1.0, 0.0)), 'from an obstacle'),
        (lambda: world.remove('nobody'), "there is no 'nobody'"),
        (lambda: world.step(-1.0), 'cannot pass'),
        (lambda: world.step(math.nan), 'cannot pass'),
    ):
        with pytest.raises(SimulationError, match=message):
            call()
    assert world.snapshot() == before


def test_a_robot_with_a_hole_round_a_pillar_is_refused() -> None:
    """No side of it touches the pillar that it would stand on."""
    rows = ['.' * 60 for _ in range(60)]
    rows[30] = '.' * 30 + '#' + '.' * 29
    world = World(drawn(*rows))
    with pytest.raises(SimulationError, match='from an obstacle'):
        world.add('alpha', replace(MODELS['burger'], footprint=box(1.0, 1.0)), Pose(1.5, 1.5, 0.0))


@settings(deadline=None, max_examples=30)
@given(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.floats(0.1, 3.0))
def test_on_a_free_plane_it_drives_the_arc(linear: float, angular: float, duration: float) -> None:
    """Against the exact integral, when it does not have to accelerate."""
    quick = DriveModel(linear_speed=1.0, angular_speed=2.0, linear_acceleration=1000.0, angular_acceleration=1000.0,
                       watchdog=10.0)  # fmt: skip
    world = World(step=0.01)
    robot = world.add('alpha', RobotModel(lidar=None, drive=quick), Pose(0.0, 0.0, 0.0))
    robot.command(linear, angular, 0.0)
    world.step(duration)
    assert tuple(robot.pose) == pytest.approx(tuple(drive(Pose(0.0, 0.0, 0.0), linear, angular, duration)), abs=1e-6)


@settings(deadline=None, max_examples=60)
@given(st.data(), worlds(least=8))
def test_both_ways_give_the_same_gap_to_the_map(data: st.DataObject, grid: OccupancyMap) -> None:
    """A side that ends on the edge of a cell crosses it or not, by the last bit."""
    shape, pose = data.draw(footprints), data.draw(places(grid, beside=5.0))
    if isinstance(shape, Circle):
        return
    corners = numpy.array([grid.grid_position(x, y)[::-1] for x, y in shape.points(pose)])
    one, other = polygon_gap.interpreted(grid.obstacles, corners), polygon_gap_at_once(grid.obstacles, corners)
    assert one == pytest.approx(other, abs=1e-9) or max(one, other) < 1e-9
