# SPDX-License-Identifier: BSD-3-Clause
"""Random trips of robots among moving obstacles and doors, and what plans and costmaps cost. Without ROS.

Of each ten trips one has a goal that cannot be reached: in an obstacle, beside the map, or in a closed room. The robots
take turns; each has room to turn on the spot where its goals are. The car has the yard for itself. Doorways of rooms
have automatic doors. Times are those of the processor; the longest hold is for how long another thread did not get the
interpreter while costmaps and plans were made.

Usage: python3 benchmarks navigation [--maps NAME...] [--robots NAME...] [--pairs N] [--trips N...] [--reach M]
       [--seed N] [--pictures DIRECTORY] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy
from _figures import write_figures
from _maps import MAPS, drawn
from numpy.typing import NDArray

from flexbt_navigation.controller.path_follower import FollowerLimits
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.costmaps.layers import LayeredCostmap, Observation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.navigator import Navigator
from flexbt_navigation.planner.planners import planner_for
from flexbt_navigation.preparation import prepare_navigation
from flexbt_sim.errors import SimulationError
from flexbt_sim.executables import SWITCH_INTERVAL
from flexbt_sim.world import (
    MODELS,
    Circle,
    DoorModel,
    ObstacleModel,
    OccupancyMap,
    Pose,
    RobotModel,
    Trace,
    WalkModel,
    World,
    box,
    draw_world,
    wrap,
)

WALKERS = 6
"""Moving obstacles between start and goal."""

ROBOTS: dict[str, RobotModel] = {
    'burger': MODELS['burger'],
    'waffle': MODELS['waffle'],
    'cart': replace(MODELS['waffle'], footprint=box(0.6, 0.4)),
    'car': MODELS['car'],
}


def _largest(regions: NDArray[numpy.int32]) -> NDArray[numpy.bool_]:
    return regions == int(numpy.bincount(regions[regions > 0]).argmax())


class Places:
    """Draws places on a map."""

    def __init__(self, costmap: Costmap, room_to_turn: Costmap) -> None:
        """On both costmaps, those with room to turn; what is closed is so on the first."""
        self._costmap = costmap
        self.begin(0)
        self._free = numpy.argwhere(_largest(room_to_turn.regions))
        self._closed = numpy.argwhere((costmap.regions > 0) & ~_largest(costmap.regions))
        self._occupied = numpy.argwhere(costmap.obstacles)

    def begin(self, seed: int) -> None:
        """Make what is drawn from now on independent of what was drawn before."""
        self._random = numpy.random.default_rng(seed)

    def _pose(self, cells: NDArray[numpy.int64]) -> Pose:
        row, column = cells[self._random.integers(len(cells))].tolist()
        return Pose(*self._costmap.world.point(row, column), float(self._random.uniform(-math.pi, math.pi)))

    def free(self) -> Pose:
        """Return where the robot can be, and from where it can get to all other such places."""
        return self._pose(self._free)

    def free_near(self, place: Pose, least: float, most: float) -> Pose:
        """One at a distance, m."""
        while not least <= (found := self.free()).distance(place) <= most:
            pass
        return found

    def impossible(self, number: int) -> tuple[Pose, str]:
        """Return a goal that cannot be reached, and the code that says so."""
        if number % 3 == 0:
            return Pose(1e4, 0.0, 0.0), 'GOAL_OUTSIDE_MAP'
        if number % 3 == 1:
            return self._pose(self._occupied), 'GOAL_OCCUPIED'
        found = self._pose(self._closed)
        return found, 'GOAL_OCCUPIED' if self._costmap.in_collision(found) else 'NO_VALID_PATH'


@dataclass
class Result:
    """Of the trips on a map."""

    trips: int = 0
    reached: int = 0
    contacts: int = 0
    impossible: int = 0
    refused: int = 0
    metres: float = 0.0
    simulated: float = 0.0
    spent: float = 0.0
    failures: list[str] = field(default_factory=list)

    def as_figures(self) -> dict[str, Any]:
        """As numbers for a table."""
        return {
            'trips': self.trips,
            'reached': self.reached,
            'contacts': self.contacts,
            'impossible': self.impossible,
            'refused': self.refused,
            'metres': round(self.metres),
            'real_time_factor': round(self.simulated / self.spent, 1) if self.spent else None,
            'failures': self.failures,
        }


class Course:
    """A map with its doors, for one robot."""

    def __init__(self, robot: str, known: OccupancyMap, doors: list[DoorModel]) -> None:
        self.model = ROBOTS[robot]
        self.costmap = Costmap(known, Inflation.of(self.model.footprint))
        self.limits = FollowerLimits.of(self.model.drive)
        self._doors = doors
        self.places = Places(self.costmap, Costmap(known, Inflation(self.costmap.inflation.outer_radius)))

    def world(self, start: Pose, seed: int) -> World:
        """With the robot at a place. Raises SimulationError where a door is."""
        world = World(self.costmap.world, seed=seed)
        for number, door in enumerate(self._doors):
            world.add(f'door{number}', door)
        world.add('robot', self.model, start)
        return world


def drive(
    name: str, courses: list[Course], trips: Iterable[int], reach: float, seed: int, pictures: Path | None
) -> Result:
    """Random trips on a map."""
    result = Result()
    for number in trips:
        course = courses[number % len(courses)]
        places = course.places
        places.begin(seed + number)
        start = places.free()
        try:
            world = course.world(start, seed + number)
        except SimulationError:
            continue
        navigator = Navigator(world, 'robot', course.costmap, course.limits)
        if number % 10 == 9:
            goal, code = places.impossible(number // 10)
            trip = navigator.navigate(goal)
            result.impossible += 1
            result.refused += trip.code == code
            result.contacts += trip.contacts
            if trip.code != code:
                result.failures.append(f'{name} {number}: {trip.code} instead of {code} for {goal}')
            continue
        goal = places.free_near(start, 1.0, reach)
        add_walkers(world, places, start, goal)
        trace = Trace(world)
        navigator.on_step = every(1.0, world, trace.record)
        began = time.process_time()
        trip = navigator.navigate(goal, timeout=1800.0)
        result.spent += time.process_time() - began
        there = world.robots['robot'].pose
        arrived = there.distance(goal) <= 0.25 and abs(wrap(there.yaw - goal.yaw)) <= 0.25 and not trip.code
        result.trips += 1
        result.reached += arrived
        result.contacts += trip.contacts
        result.metres += trip.length
        result.simulated += trip.seconds
        if not arrived or trip.contacts:
            result.failures.append(
                f'{name} {number}: {trip.code or "ended"} at {there.distance(goal):.2f} m from the goal, '
                f'{trip.contacts} contacts: {trip.errors[-2:]}'
            )
            if pictures is not None:
                pictures.mkdir(parents=True, exist_ok=True)
                plan = {'robot': [(start.x, start.y), (goal.x, goal.y)]}
                draw_world(world, trace, paths=plan, pixels=3000).save(pictures / f'{name}_{number}.png')
    return result


def every(period: float, world: World, do: Callable[[], None]) -> Callable[[], None]:
    """Do something once in each period of simulated time, s."""
    done = -math.inf

    def step() -> None:
        nonlocal done
        if world.time - done >= period:
            done = world.time
            do()

    return step


def add_walkers(world: World, places: Places, start: Pose, goal: Pose) -> None:
    """Return moving obstacles near the way, not where the robot starts."""
    distance = start.distance(goal) / 2.0 + 2.0
    middle = Pose((start.x + goal.x) / 2.0, (start.y + goal.y) / 2.0, 0.0)
    for number in range(WALKERS):
        walk = WalkModel(speed=0.1 + 0.4 * number / WALKERS)
        while f'walker{number}' not in world.entities:
            place = places.free_near(middle, 0.0, 4.0 * distance)
            if place.distance(start) > 1.0:
                try:
                    world.add(f'walker{number}', ObstacleModel(place, Circle(0.2), random_walk=walk))
                except SimulationError:
                    continue


def measure(course: Course) -> dict[str, float]:
    """Return what plans and costmaps cost, and for how long they hold the interpreter, ms of the processor."""
    costmap, places = course.costmap, course.places

    def plan(start: Pose, goal: Pose) -> None:
        try:
            planner_for(costmap, course.limits.steering).plan(start, goal)
        except NavigationError as error:
            print(error)

    def build() -> None:
        Costmap(costmap.world, costmap.inflation)

    plans = [partial(plan, places.free(), places.free()) for _ in range(30)]
    took = [timed(one) for one in plans]
    layers = LayeredCostmap(costmap)
    works: list[Callable[[], object]] = [build, layers.clear, *plans[:5]]
    angles = numpy.linspace(0.0, math.tau, 360)
    updates = []
    for _ in range(50):
        robot = places.free()
        ranges = numpy.random.default_rng(1).uniform(0.5, 3.5, 360)
        observation = Observation(robot, angles, ranges)
        updates.append(timed(partial(layers.observe, observation, robot)))
    return {
        'plan_median_ms': round(statistics.median(took), 1),
        'plan_most_ms': round(max(took), 1),
        'costmap_ms': round(min(timed(build) for _ in range(5)), 1),
        'update_median_ms': round(statistics.median(updates), 2),
        'longest_hold_ms': round(max(map(held, works)), 1),
    }


def timed(work: Callable[[], object]) -> float:
    """Processor time, ms."""
    began = time.thread_time()
    work()
    return 1000.0 * (time.thread_time() - began)


def held(work: Callable[[], object]) -> float:
    """Return the longest processor time, ms, in which another thread did not get the interpreter, with the switch
    interval of the executables; the least of five tries, since the other one may have waited for a processor.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    clock = time.pthread_getcpuclockid(threading.get_ident())
    tries = []
    for _ in range(5):
        seen, done = [time.clock_gettime(clock)], threading.Event()

        def look(seen: list[float] = seen, done: threading.Event = done) -> None:
            while not done.wait(0.0001):
                seen.append(time.clock_gettime(clock))

        looking = threading.Thread(target=look)
        looking.start()
        work()
        done.set()
        looking.join()
        seen.append(time.clock_gettime(clock))
        tries.append(max(after - before for before, after in pairwise(seen)))
    return 1000.0 * min(tries)


def main() -> int:
    """Measure, and print; 1 when fewer than 99 % of the goals are reached, something is touched or a code is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--maps', nargs='+', choices=MAPS, default=list(MAPS))
    parser.add_argument('--robots', nargs='+', choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument('--pairs', type=int, default=500, help='on all maps together')
    parser.add_argument('--trips', type=int, nargs='+', help='only these, by their numbers on each map')
    parser.add_argument('--reach', type=float, default=15.0, help='distance of start and goal at most, m')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--pictures', type=Path, help='a directory for a picture of each trip that failed')
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    if not any((robot == 'car') == (name == 'yard') for robot in options.robots for name in options.maps):
        parser.error('the car has the yard for itself: these robots have no trip on these maps')
    prepare_navigation(FollowerLimits.of(MODELS['car'].drive).steering)
    figures: dict[str, Any] = {}
    total: Counter[str] = Counter()
    for name in options.maps:
        known, doors = drawn(name, options.seed)
        robots = [robot for robot in options.robots if (robot == 'car') == (name == 'yard')]
        if not robots:
            continue
        courses = [Course(robot, known, doors) for robot in robots]
        trips = options.trips or range(math.ceil(options.pairs / len(options.maps)))
        result = drive(name, courses, trips, options.reach, options.seed, options.pictures)
        figures[name] = {**result.as_figures(), **measure(courses[0])}
        for key in ('trips', 'reached', 'contacts', 'impossible', 'refused'):
            total[key] += figures[name][key]
        print(name, ', '.join(f'{key} {value}' for key, value in figures[name].items() if key != 'failures'))
        for failure in result.failures:
            print('  ', failure)
    print(f'{total["reached"]} of {total["trips"]} goals reached, {total["contacts"]} contacts;', end=' ')
    print(f'{total["refused"]} of {total["impossible"]} others refused with the right code')
    if options.output is not None:
        write_figures(options.output, {'navigation': figures})
    good = total['reached'] >= 0.99 * total['trips'] and total['refused'] == total['impossible']
    return 0 if good and not total['contacts'] else 1


if __name__ == '__main__':
    sys.exit(main())
