# SPDX-License-Identifier: BSD-3-Clause
"""Random trips of a robot among moving obstacles on three maps, and what plans and costmaps cost. Without ROS.

Of each ten trips one has a goal that cannot be reached: in an obstacle, beside the map, or in a closed room. Times are
those of the processor; the longest wait is how long another thread did not get the interpreter while plans were made.

Usage: python3 benchmarks navigation [--pairs N] [--reach M] [--seed N] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy
from _figures import write_figures
from numpy.typing import NDArray

from flexbt_sim.errors import NavigationError, SimulationError
from flexbt_sim.navigation import (
    Costmap,
    GridPlanner,
    Inflation,
    LayeredCostmap,
    Navigator,
    Observation,
    prepare_navigation,
)
from flexbt_sim.world import Circle, ObstacleModel, OccupancyMap, Pose, RobotModel, WalkModel, World, wrap

Cells = NDArray[numpy.int8]
WALKERS = 6
"""Moving obstacles between start and goal."""


def rooms(cells: Cells, resolution: float, random: numpy.random.Generator) -> None:
    """Rooms with walls of 0.15 m and doors of 0.9 to 1.2 m, each reached from another one."""
    thick = round(0.15 / resolution)

    def divide(bottom: int, top: int, left: int, right: int) -> None:
        height, width = top - bottom, right - left
        if max(height, width) * resolution < 7.0:
            return
        door = round(random.uniform(0.9, 1.2) / resolution)
        share = random.uniform(0.35, 0.65)
        if height > width:
            at = bottom + round(share * height)
            cells[at : at + thick, left:right] = 100
            begin = int(random.integers(left + 4, right - door - 4))
            cells[at : at + thick, begin : begin + door] = 0
            divide(bottom, at, left, right)
            divide(at + thick, top, left, right)
        else:
            at = left + round(share * width)
            cells[bottom:top, at : at + thick] = 100
            begin = int(random.integers(bottom + 4, top - door - 4))
            cells[begin : begin + door, at : at + thick] = 0
            divide(bottom, top, left, at)
            divide(bottom, top, at + thick, right)

    divide(0, cells.shape[0], 0, cells.shape[1])


def warehouse(cells: Cells, resolution: float, random: numpy.random.Generator) -> None:
    """Shelves with aisles, and pallets in these."""
    for row in range(80, cells.shape[0] - 60, 90):
        for column in range(60, cells.shape[1] - 150, 200):
            cells[row : row + 30, column : column + 150] = 100
    blocks(cells, resolution, random, 60, 0.8)


def clutter(cells: Cells, resolution: float, random: numpy.random.Generator) -> None:
    """Blocks of all sizes anywhere."""
    blocks(cells, resolution, random, round(cells.size * resolution**2 / 12.0), 2.5)


def blocks(cells: Cells, resolution: float, random: numpy.random.Generator, count: int, size: float) -> None:
    """Rectangles of sides of up to ``size`` m."""
    for row, column in random.integers(0, cells.shape, (count, 2)).tolist():
        height, width = random.integers(2, round(size / resolution), 2).tolist()
        cells[row : row + height, column : column + width] = 100


MAPS: dict[str, tuple[Callable[..., None], tuple[int, int], float]] = {
    'rooms': (rooms, (400, 400), 0.05),
    'warehouse': (warehouse, (1674, 1006), 0.03),
    'clutter': (clutter, (2000, 2000), 0.05),
}


def drawn(name: str, seed: int) -> OccupancyMap:
    """A map, with a closed room in its corner, that seeds tell apart."""
    draw, shape, resolution = MAPS[name]
    cells = numpy.zeros(shape, numpy.int8)
    draw(cells, resolution, numpy.random.default_rng(seed))
    cells[:60, :60] = 0
    cells[58:60, :60] = cells[:60, 58:60] = 100
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 100
    return OccupancyMap(cells, resolution, Pose(-5.0, -3.0, 0.0))


class Places:
    """Draws places on a map."""

    def __init__(self, costmap: Costmap, seed: int) -> None:
        self._costmap = costmap
        self._random = numpy.random.default_rng(seed)
        regions = costmap.regions
        self._largest = int(numpy.bincount(regions[regions > 0]).argmax())
        self._free = numpy.argwhere(regions == self._largest)
        self._closed = numpy.argwhere((regions > 0) & (regions != self._largest))
        self._occupied = numpy.argwhere(costmap.obstacles)

    def _pose(self, cells: NDArray[numpy.int64]) -> Pose:
        row, column = cells[self._random.integers(len(cells))].tolist()
        return Pose(*self._costmap.world.point(row, column), float(self._random.uniform(-math.pi, math.pi)))

    def free(self) -> Pose:
        """Where the robot can be, and from where it can get to all other such places."""
        return self._pose(self._free)

    def free_near(self, place: Pose, least: float, most: float) -> Pose:
        """One at a distance, m."""
        while not least <= (found := self.free()).distance(place) <= most:
            pass
        return found

    def impossible(self, number: int) -> tuple[Pose, str]:
        """A goal that cannot be reached, and the code that says so."""
        if number % 3 == 0:
            return Pose(1e4, 0.0, 0.0), 'GOAL_OUTSIDE_MAP'
        return (
            (self._pose(self._occupied), 'GOAL_OCCUPIED')
            if number % 3 == 1
            else (self._pose(self._closed), 'NO_VALID_PATH')
        )


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


def drive(name: str, costmap: Costmap, pairs: int, reach: float, seed: int) -> Result:
    """Random trips on a map."""
    places, result = Places(costmap, seed), Result()
    for number in range(pairs):
        start = places.free()
        world = World(costmap.world, seed=seed + number)
        world.add('robot', RobotModel(), start)
        navigator = Navigator(world, 'robot', costmap)
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
    return result


def add_walkers(world: World, places: Places, start: Pose, goal: Pose) -> None:
    """Moving obstacles near the way, not where the robot starts."""
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


def measure(costmap: Costmap, seed: int) -> dict[str, float]:
    """What plans and costmaps cost, ms of the processor; the longest wait of another thread, ms of the wall clock."""
    places = Places(costmap, seed)
    plans: list[float] = []
    with waits() as longest:
        for _ in range(30):
            start, goal = places.free(), places.free()
            began = time.thread_time()
            try:
                GridPlanner(costmap).plan(start, goal)
            except NavigationError as error:
                print(error)
            plans.append(1000.0 * (time.thread_time() - began))
    built = [timed(lambda: Costmap(costmap.world, costmap.inflation)) for _ in range(5)]
    layers = LayeredCostmap(costmap)
    angles = numpy.linspace(0.0, math.tau, 360)
    updates = []
    for _ in range(50):
        robot = places.free()
        ranges = numpy.random.default_rng(seed).uniform(0.5, 3.5, 360)
        observation = Observation(robot, angles, ranges)
        updates.append(timed(partial(layers.observe, observation, robot)))
    return {
        'plan_median_ms': round(statistics.median(plans), 1),
        'plan_most_ms': round(max(plans), 1),
        'costmap_ms': round(min(built), 1),
        'update_median_ms': round(statistics.median(updates), 2),
        'longest_wait_ms': round(1000.0 * longest[0], 1),
    }


def timed(work: Callable[[], object]) -> float:
    """Processor time, ms."""
    began = time.thread_time()
    work()
    return 1000.0 * (time.thread_time() - began)


@contextmanager
def waits() -> Iterator[list[float]]:
    """The longest time, s, for which a thread that only wants to look at the clock did not run."""
    longest, done = [0.0], threading.Event()

    def watch() -> None:
        last = time.perf_counter()
        while not done.is_set():
            time.sleep(0.0002)
            now = time.perf_counter()
            longest[0], last = max(longest[0], now - last), now

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield longest
    finally:
        done.set()
        watcher.join()


def main() -> int:
    """Measure, and print; 1 when fewer than 99 % of the goals are reached, something is touched or a code is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--pairs', type=int, default=500, help='on all maps together')
    parser.add_argument('--reach', type=float, default=15.0, help='distance of start and goal at most, m')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    prepare_navigation()
    figures: dict[str, Any] = {}
    total: Counter[str] = Counter()
    for name in MAPS:
        costmap = Costmap(drawn(name, options.seed), Inflation())
        result = drive(name, costmap, math.ceil(options.pairs / len(MAPS)), options.reach, options.seed)
        figures[name] = {**result.as_figures(), **measure(costmap, options.seed)}
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
