# SPDX-License-Identifier: BSD-3-Clause
"""Docking in closed loop: from anywhere near the staging pose onto the dock, and off it; and what can go wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from closed_loop import MODEL, Run
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_navigation.controller.motions import STOP, Motion, Velocity
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.docking.motions import (
    RETRIES,
    ControlLaw,
    Dock,
    DockingLimits,
    DockMotion,
    DockState,
    Senses,
    StagingMotion,
    UndockMotion,
    load_docks,
    velocity_to,
)
from flexbt_navigation.errors import DockError, NavigationError
from flexbt_sim.errors import WorldError
from flexbt_sim.world import MODELS, OccupancyMap, Pose, RobotModel, box, wrap
from flexbt_testing.worlds import drawn

OPEN = drawn(*['.' * 120] * 120)
WALLED = drawn(*['.' * 100 + '#' + '.' * 19] * 120)
"""A wall at x = 5.0."""
DOCK = Pose(4.75, 3.0, 0.0)
"""Before the wall, with 3 cm to spare."""
PLAIN = DockingLimits()


class Station:
    """A robot on a map with a dock, which charges it when it is at rest there."""

    def __init__(
        self, world: OccupancyMap, start: Pose, dock: Pose = DOCK, works: bool = True, model: RobotModel = MODEL
    ) -> None:
        self.run = Run(world, start, model)
        self.costmap = Costmap(world, Inflation.of(model.footprint))
        self.dock = dock
        self.works = works
        self.seen: Pose | None = dock

    @property
    def is_charging(self) -> bool:
        robot = self.run.robot
        return self.works and robot.linear == robot.angular == 0.0 and robot.pose.distance(self.dock) < 0.15

    def senses(self) -> Senses:
        return Senses(lambda: self.is_charging, lambda: self.seen)

    def docking(self, limits: DockingLimits = PLAIN, charges: bool = True) -> DockMotion:
        return DockMotion(self.dock, self.senses(), limits, self.costmap, charges=charges)

    def undocking(self, limits: DockingLimits = PLAIN, seconds: float = 30.0) -> UndockMotion:
        return UndockMotion(self.senses(), limits, self.costmap, charges=True, seconds=seconds)


@settings(deadline=None, max_examples=20)
@given(st.floats(-0.25, 0.2), st.floats(-0.15, 0.15), st.floats(-0.5, 0.5), st.integers(0, 3))
def test_a_robot_near_the_staging_pose_gets_onto_the_dock_and_off_it(
    ahead: float, aside: float, turned: float, late: int
) -> None:
    station = Station(WALLED, Pose(DOCK.x - 0.7 + ahead, DOCK.y + aside, turned))
    motion = station.docking()
    done = station.run.go(motion, late)
    assert (done.code, done.touched) == ('', False)
    assert done.robot.pose.distance(DOCK) < PLAIN.docked_within + 0.03
    assert abs(wrap(done.robot.pose.yaw)) < 0.5
    assert station.is_charging
    assert motion.state is DockState.WAIT_FOR_CHARGE
    assert all(abs(command.linear) <= 0.25 and abs(command.angular) <= 1.0 for command in done.commands)
    there = done.robot.pose
    off = station.run.go(station.undocking(), late)
    assert (off.code, off.touched) == ('', False)
    assert there.distance(off.robot.pose) == pytest.approx(0.7, abs=0.1)
    assert not station.is_charging


CAR = MODELS['car']
CAR_LIMITS = DockingLimits.of(CAR.drive.turning_radius)
YARD = drawn(*['.' * 100 + '#' + '.' * 39] * 100, resolution=0.2)
"""A wall at x = 20.0."""
CAR_DOCK = Pose(20.0 - 3.4 - 0.1, 10.0, 0.0)
"""Before the wall, with 10 cm to spare."""


@settings(deadline=None, max_examples=6)
@given(st.floats(-0.5, 0.5), st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.integers(0, 3))
def test_a_car_gets_onto_the_dock_and_off_it_without_a_turn_on_the_spot(
    ahead: float, aside: float, turned: float, late: int
) -> None:
    begin = CAR_LIMITS.staging_pose(CAR_DOCK)
    station = Station(YARD, Pose(begin.x + ahead, begin.y + aside, turned), CAR_DOCK, model=CAR)
    motion = station.docking(CAR_LIMITS)
    done = station.run.go(motion, late)
    assert (done.code, done.touched, motion.retries) == ('', False, 0)
    assert station.is_charging
    assert done.robot.pose.distance(CAR_DOCK) < CAR_LIMITS.docked_within + 0.03
    there = done.robot.pose
    off = station.run.go(station.undocking(CAR_LIMITS), late)
    assert (off.code, off.touched) == ('', False)
    assert there.distance(off.robot.pose) == pytest.approx(CAR.drive.turning_radius, abs=0.1)
    assert abs(off.robot.pose.y - there.y) < 0.05
    widest = 1.0 / CAR.drive.turning_radius + 1e-9
    assert all(abs(command.angular) <= widest * abs(command.linear) for command in done.commands)


@settings(deadline=None, max_examples=4)
@given(st.floats(0.4, 0.6), st.sampled_from([-1.0, 1.0]))
def test_a_car_that_comes_past_the_dock_goes_back_and_tries_again(aside: float, side: float) -> None:
    start = Pose(CAR_DOCK.x - 1.5, CAR_DOCK.y + side * aside, 0.0)
    station = Station(YARD, start, CAR_DOCK, model=CAR)
    motion = station.docking(CAR_LIMITS)
    done = station.run.go(motion)
    assert (done.code, done.touched, station.is_charging) == ('', False, True)
    assert motion.retries > 0
    near = Station(YARD, start, CAR_DOCK, model=CAR)
    assert near.run.go(near.docking(replace(CAR_LIMITS, retries=0))).code == 'FAILED_TO_CONTROL'
    assert not near.run.touched


@given(st.floats(-math.pi, math.pi), st.booleans())
def test_the_law_leads_straight_where_the_way_is_straight(yaw: float, backward: bool) -> None:
    sign = -1.0 if backward else 1.0
    target = Pose(sign * 2.0 * math.cos(yaw), sign * 2.0 * math.sin(yaw), yaw)
    velocity = velocity_to(target, Pose(0.0, 0.0, yaw), ControlLaw(), backward=backward)
    assert velocity == pytest.approx((sign * 0.25, 0.0), abs=1e-9)


@settings(deadline=None, max_examples=200)
@given(*[st.floats(-5.0, 5.0)] * 4, st.booleans(), st.sampled_from([0.0, 0.5, 5.0]))
def test_the_law_keeps_its_bounds_anywhere(
    x: float, y: float, yaw: float, goal: float, backward: bool, radius: float
) -> None:
    law = ControlLaw(turning_radius=radius)
    velocity = velocity_to(Pose(x, y, wrap(goal)), Pose(0.0, 0.0, wrap(yaw)), law, backward=backward)
    assert abs(velocity.linear) >= radius * abs(velocity.angular) - 1e-9
    assert all(map(math.isfinite, velocity))
    assert abs(velocity.linear) <= 0.25 + 1e-9
    assert abs(velocity.angular) <= 0.75 + 1e-9
    assert velocity.linear * (-1.0 if backward else 1.0) >= 0.0


STAGING = Pose(DOCK.x - 0.7, DOCK.y, 0.0)


def test_a_dock_that_does_not_charge_is_left_and_tried_again_until_that_fails() -> None:
    station = Station(WALLED, STAGING, works=False)
    motion = station.docking(DockingLimits(retries=2, charge_seconds=1.0))
    seen: list[DockState] = []
    done = station.run.go(_Watched(motion, seen))
    assert (done.code, done.touched, motion.retries) == ('FAILED_TO_CHARGE', False, 2)
    once = [DockState.CONTROLLING, DockState.WAIT_FOR_CHARGE]
    again = [DockState.RETRY, DockState.INITIAL_PERCEPTION]
    assert seen == [*once, *again, *once, *again, *once]


class _Watched(Motion):
    """A motion whose states are noted."""

    def __init__(self, motion: DockMotion, seen: list[DockState]) -> None:
        self._motion, self._seen = motion, seen

    def step(self, pose: Pose, now: float) -> Velocity | None:
        velocity = self._motion.step(pose, now)
        if self._seen[-1:] != [self._motion.state]:
            self._seen.append(self._motion.state)
        return velocity

    def update(self, costmap: Costmap) -> None:
        self._motion.update(costmap)


def test_a_dock_that_begins_to_charge_at_the_second_time_is_a_success() -> None:
    station = Station(WALLED, STAGING, works=False)
    motion = station.docking(DockingLimits(charge_seconds=0.5))

    def step(pose: Pose, now: float) -> Velocity | None:
        station.works = motion.retries > 0
        return motion.step(pose, now)

    done = station.run.go(_Stepped(step))
    assert (done.code, motion.retries, station.is_charging) == ('', 1, True)


class _Stepped(Motion):
    """A motion by its step."""

    def __init__(self, step: Callable[[Pose, float], Velocity | None]) -> None:
        self._step = step

    def step(self, pose: Pose, now: float) -> Velocity | None:
        return self._step(pose, now)


def test_at_a_dock_that_does_not_charge_anything_nothing_is_waited_for() -> None:
    station = Station(WALLED, STAGING, works=False)
    assert station.run.go(station.docking(charges=False)).code == ''


def test_a_dock_that_nobody_sees_is_not_approached() -> None:
    station = Station(WALLED, STAGING)
    station.seen = None
    done = station.run.go(station.docking())
    assert done.code == 'FAILED_TO_DETECT_DOCK'
    assert done.robot.pose == STAGING
    assert PLAIN.perception_seconds < done.now < PLAIN.perception_seconds + 1.0


@pytest.mark.parametrize(('retries', 'code'), [(1, 'FAILED_TO_DETECT_DOCK'), (3, '')])
def test_a_dock_that_is_not_seen_for_a_while_is_tried_again(retries: int, code: str) -> None:
    station = Station(WALLED, STAGING)
    motion = station.docking(DockingLimits(retries=retries, perception_seconds=0.5))

    def step(pose: Pose, now: float) -> Velocity | None:
        station.seen = DOCK if motion.retries != 1 or motion.state is DockState.RETRY else None
        if motion.state is DockState.CONTROLLING and not motion.retries and pose.distance(STAGING) > 0.3:
            station.seen = None
        return motion.step(pose, now)

    done = station.run.go(_Stepped(step))
    assert (done.code, motion.retries) == (code, min(2, retries))


def test_a_dock_that_is_seen_elsewhere_is_approached_there() -> None:
    station = Station(WALLED, STAGING, works=False)
    station.seen = Pose(DOCK.x, DOCK.y + 0.1, 0.0)
    done = station.run.go(station.docking(charges=False))
    assert done.code == ''
    assert done.robot.pose.distance(station.seen) < 0.08


def test_an_obstacle_on_the_way_to_the_dock_or_back_is_not_driven_into() -> None:
    between = drawn(*['.' * 90 + '#' + '.' * 29] * 120)  # at x = 4.5
    to = Station(between, Pose(3.9, 3.0, 0.0), Pose(4.95, 3.0, 0.0))
    assert to.run.go(to.docking(DockingLimits(retries=0))).code == 'FAILED_TO_CONTROL'
    assert not to.run.touched
    back = Station(between, Pose(4.95, 3.0, 0.0), Pose(4.95, 3.0, 0.0))
    assert back.run.go(back.undocking()).code == 'FAILED_TO_CONTROL'
    assert not back.run.touched


@pytest.mark.parametrize('goes_back', [False, True])
def test_an_obstacle_that_comes_close_behind_the_robot_near_the_staging_pose_is_not_driven_into(
    goes_back: bool,
) -> None:
    station = Station(WALLED, DOCK, works=False)
    behind = Costmap(drawn(*['.' * 80 + '#' + '.' * 39] * 120), Inflation.of(MODEL.footprint))  # at x = 4.0
    limits = DockingLimits(retries=1, charge_seconds=0.1)
    motion = station.docking(limits) if goes_back else station.undocking(limits)

    def step(pose: Pose, now: float) -> Velocity | None:
        if pose.distance(DOCK) > 0.45:
            motion.update(behind)
        return motion.step(pose, now)

    done = station.run.go(_Stepped(step))
    assert done.code == 'FAILED_TO_CONTROL'
    assert not behind.in_collision(done.robot.pose)


def test_what_takes_too_long_is_given_up() -> None:
    slow = DockingLimits(retries=0, approach_seconds=1.0)
    to = Station(WALLED, STAGING)
    assert to.run.go(to.docking(slow)).code == 'FAILED_TO_CONTROL'
    off = Station(WALLED, DOCK)
    assert off.run.go(off.undocking(seconds=1.0)).code == 'FAILED_TO_CONTROL'
    patient = Station(WALLED, DOCK)
    assert patient.run.go(patient.undocking(slow)).code == ''
    stuck = Station(WALLED, DOCK)
    senses = Senses(lambda: True, lambda: DOCK)  # it says that it is charged wherever it is
    endless = UndockMotion(senses, PLAIN, stuck.costmap, charges=True, seconds=10.0)
    assert stuck.run.go(endless).code == 'FAILED_TO_CONTROL'


def test_a_robot_that_cannot_turn_at_the_staging_pose_gives_up() -> None:
    station = Station(WALLED, DOCK, works=False)
    motion = station.docking(DockingLimits(charge_seconds=0.1, approach_seconds=10.0))
    now = 0.0
    while motion.state is not DockState.RETRY:
        motion.step(DOCK, now)
        now += 0.1
    began = now
    with pytest.raises(NavigationError, match='not reached') as raised:
        while now < began + 60.0:
            motion.step(STAGING._replace(yaw=1.0), now)
            now += 0.1
    assert raised.value.code == 'FAILED_TO_CONTROL'


@pytest.mark.parametrize('offset', [-1.5, 1.6, 3.1])
def test_a_robot_is_off_the_dock_before_it_turns_to_the_heading_of_the_staging_pose(offset: float) -> None:
    station = Station(WALLED, DOCK)
    done = station.run.go(station.undocking(DockingLimits(staging_yaw_offset=offset)))
    assert (done.code, done.touched) == ('', False)
    assert done.robot.pose.distance(DOCK) == pytest.approx(0.7, abs=0.1)
    assert abs(wrap(done.robot.pose.yaw - offset)) < 0.2
    turned = [pose for pose in done.poses if abs(pose.yaw) > 0.1]
    assert min(pose.distance(DOCK) for pose in turned) > 0.6


@pytest.mark.parametrize('acceleration', [0.2, 1.0])
def test_the_turn_at_the_staging_pose_ends_at_its_heading_however_hard_the_robot_brakes(acceleration: float) -> None:
    drive = replace(MODEL.drive, linear_acceleration=0.05, angular_acceleration=acceleration)
    station = Station(WALLED, DOCK, model=replace(MODEL, drive=drive))
    limits = replace(DockingLimits.of(0.0, 0.05, acceleration), staging_yaw_offset=1.5)
    done = station.run.go(station.undocking(limits), late=1)
    assert (done.code, done.touched) == ('', False)
    assert abs(wrap(done.robot.pose.yaw - 1.5)) < 0.1


@pytest.mark.parametrize('deceleration', [0.05, 0.3, 2.5])
def test_a_robot_that_brakes_slowly_rolls_neither_over_its_dock_nor_over_the_staging_pose(deceleration: float) -> None:
    model = replace(MODEL, drive=replace(MODEL.drive, linear_acceleration=deceleration))
    limits = DockingLimits.of(0.0, deceleration)
    station = Station(WALLED, STAGING, model=model)
    done = station.run.go(station.docking(limits, charges=False), late=1)
    assert (done.code, done.touched) == ('', False)
    assert done.robot.pose.distance(DOCK) < limits.docked_within
    done = station.run.go(station.undocking(limits), late=1)
    assert (done.code, done.touched) == ('', False)
    assert done.robot.pose.distance(STAGING) < 0.06


def test_a_robot_that_is_no_circle_does_not_turn_into_a_wall_at_the_staging_pose() -> None:
    corridor = drawn(*['.' * 120] * 50, '#' * 120, *['.' * 120] * 14, '#' * 120, *['.' * 120] * 54)
    """Walls at y = 2.7 and 3.45 m."""
    station = Station(corridor, Pose(3.0, 3.1, 0.0), model=replace(MODEL, footprint=box(0.9, 0.3)))
    done = station.run.go(station.undocking(DockingLimits(staging_yaw_offset=1.5)))
    assert (done.code, done.touched) == ('FAILED_TO_CONTROL', False)


@pytest.mark.parametrize('follow', [lambda pose, now: Velocity(0.0, 0.1), lambda pose, now: _fails()])
def test_a_staging_pose_that_is_not_reached_is_no_start(follow: Callable[[Pose, float], Velocity]) -> None:
    station = Station(OPEN, Pose(1.0, 1.0, 0.0))
    staging = StagingMotion(_Stepped(follow), 2.0, lambda: None)
    motion = DockMotion(DOCK, station.senses(), PLAIN, station.costmap, charges=True, staging=staging)
    assert motion.state is DockState.NAV_TO_STAGING_POSE
    assert station.run.go(motion).code == 'FAILED_TO_STAGE'


def test_a_way_that_is_blocked_is_planned_again_as_often_as_by_the_default_tree_of_nav2() -> None:
    ways = [_Stepped(lambda pose, now: Velocity(0.1, 0.0)), None, _Stepped(lambda pose, now: _fails())]
    asked: list[float] = []

    def plan_again() -> None:
        asked.append(now)
        way = ways.pop() if ways else None
        if way is None:
            staging.fail('no path')
        else:
            staging.go_on(way)

    staging, now, driven = StagingMotion(_Stepped(lambda pose, now: _fails()), 1000.0, plan_again), 0.0, STOP
    while driven == STOP:
        driven = staging.step(DOCK, now) or STOP
        now += 0.1
    assert asked == pytest.approx([5.0, 10.1, 15.2], abs=0.25)
    staging.go_on(_Stepped(lambda pose, now: _fails()))
    with pytest.raises(NavigationError, match='not reached: no path'):
        while True:
            staging.step(DOCK, now)
            now += 0.1
    assert len(asked) == RETRIES


def _fails() -> Velocity:
    raise NavigationError('PATIENCE_EXCEEDED', 'an obstacle has been ahead')


# -- the database ------------------------------------------------------------------------------------------------------


def test_docks_are_read_as_nav2_reads_them_and_stations_of_a_world_file_are_docks_too(tmp_path: Path) -> None:
    docks = tmp_path / 'docks.yaml'
    docks.write_text(
        'docks:\n  home: {type: simple_charging_dock, frame: odom, pose: [0.3, 0.4, 0.0]}\n'
        '  shelf: {type: shelf, pose: [1, 2, 1.57], id: "7"}\n'
    )
    assert load_docks(docks) == {
        'home': Dock('home', Pose(0.3, 0.4, 0.0), 'odom', 'simple_charging_dock'),
        'shelf': Dock('shelf', Pose(1.0, 2.0, 1.57), 'map', 'shelf'),
    }
    world = tmp_path / 'world.yaml'
    world.write_text('robots: {}\nstations:\n  west: {pose: [1.0, 2.0, 0.5], reach: 0.2}\n')
    assert load_docks(world) == {'west': Dock('west', Pose(1.0, 2.0, 0.5))}


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('docks: [', 'cannot be read'),
        ('- a', 'has neither docks: nor stations:'),
        ('maps: {}', 'has neither docks: nor stations:'),
        ('docks: [a]', 'docks: expected docks by their names'),
        ('docks: {a: 1}', 'docks.a: expected a mapping'),
        ('docks: {a: {pose: [0, 0, 0]}}', 'docks.a.type'),
        ('docks: {a: {type: x}}', 'docks.a.pose: expected x, y and yaw'),
        ('docks: {a: {type: x, pose: [0, 0, 0, 0]}}', 'docks.a.pose'),
        ('docks: {a: {type: x, pose: [0, .nan, 0]}}', 'docks.a.pose'),
        ('docks: {a: {type: x, pose: [0, yes, 0]}}', 'docks.a.pose'),
        ('docks: {a: {type: x, pose: [0, 1.0e+300, 0]}}', 'docks.a.pose'),
        ('docks: {a: {type: x, pose: [0, 0]}}', 'docks.a.pose'),
        ('docks: {a: {type: x, pose: [0, ' + '9' * 400 + ', 0]}}', 'docks.a.pose'),
        ('docks: {a: {type: x, pose: [0, 0, 0], frame: 3}}', 'docks.a.frame'),
    ],
)
def test_what_is_no_database_is_refused(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / 'docks.yaml'
    file.write_text(text)
    with pytest.raises(DockError) as raised:
        load_docks(file)
    assert said in str(raised.value)
    assert str(file) in str(raised.value)


def test_a_world_file_is_read_as_the_simulator_reads_it(tmp_path: Path) -> None:
    file = tmp_path / 'world.yaml'
    file.write_text('seed: 3\nstations:\n  west: {pose: [1.0, 2.0]}\n')
    with pytest.raises(WorldError) as raised:
        load_docks(file)
    assert str(raised.value).startswith(f'{file}:3:10: stations.west.pose: expected a list of 3 numbers')


def test_a_file_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DockError, match='it is a directory'):
        load_docks(tmp_path)
