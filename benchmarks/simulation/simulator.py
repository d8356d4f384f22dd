# SPDX-License-Identifier: BSD-3-Clause
"""What the world costs without middleware: a scan, a step, and the seconds that it simulates in a second.

Robots with a lidar of 360 beams at 5 Hz drive about in the built-in map (TurtleBot3 waffle, steps of 0.02 s), and
obstacles walk. A second table is beside IR-SIM, on the same map with the same commands in the same run: steps of 0.1 s
with a scan of each robot, while this world makes five steps of 0.02 s. IR-SIM is no dependency; it is measured when
``--irsim``, or IRSIM in the environment, names the Python of a virtual environment that has it:

    python3 -m venv VENV; VENV/bin/pip install ir-sim; make bench IRSIM=VENV/bin/python

Usage: python3 benchmarks simulator [--seconds S] [--robots 1,10,50] [--irsim PYTHON] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy
import yaml
from _figures import write_figures

from flexbt_sim.errors import SimulationError
from flexbt_sim.simulator.parameters import built_in_map
from flexbt_sim.world import MODELS, Circle, ObstacleModel, OccupancyMap, Pose, WalkModel, World, load_map
from flexbt_sim.world.plane.loops import cast
from flexbt_sim.world.plane.ray_casting import Beams, RayCaster, outlines

HERE: Final = Path(__file__).resolve().parent
TARGETS: Final = {1: 1000.0, 50: 20.0}
"""Least factor, by the number of robots."""

ROUNDS: Final = 5
ROBOT: Final = MODELS['waffle']


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=20.0, help='simulated time of a round with one robot')
    parser.add_argument('--robots', default='1,10,50')
    parser.add_argument('--irsim', type=Path, default=os.environ.get('IRSIM'), help='Python that has IR-SIM')
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    counts = [int(one) for one in options.robots.split(',')]
    figures: dict[str, Any] = {'scan_us': scans(), 'worlds': {}, 'irsim': {}}
    for what, cost in figures['scan_us'].items():
        print(f'scan of 360 beams, {what:14} {cost:8.1f} us')
    print('\nrobots  obstacles  us a step  factor  target')
    for robots, obstacles in [*((count, 0) for count in counts), (1, 20)]:
        step, factor = costs(robots, obstacles, options.seconds / robots)
        figures['worlds'][f'{robots} robots, {obstacles} obstacles'] = {'step_us': step, 'factor': factor}
        target = TARGETS.get(robots, '') if not obstacles else ''
        print(f'{robots:6d}  {obstacles:9d}  {step:9.1f}  {factor:6.0f}  {target}')
    if options.irsim is None:
        print('\nIR-SIM is not measured: --irsim, or IRSIM, names a Python that has it (pip: ir-sim)')
    else:
        print('\nrobots  us a step of 0.1 s  IR-SIM  times')
        for count in counts:
            ours, theirs = beside_irsim(count, options.irsim)
            figures['irsim'][count] = {'step_us': ours, 'irsim_step_us': theirs, 'times': theirs / ours}
            print(f'{count:6d}  {ours:18.1f}  {theirs:6.0f}  {theirs / ours:5.0f}')
    if options.output is not None:
        write_figures(options.output, figures)
    return 0


def places(grid: OccupancyMap, count: int) -> list[Pose]:
    """Place with room round them, at random; always the same."""
    random = numpy.random.default_rng(1)
    free = random.permutation(numpy.argwhere(grid.distances > 0.3))
    chosen: list[Pose] = []
    for row, column in free:
        pose = Pose(*grid.point(row, column), float(random.uniform(-3.0, 3.0)))
        if all(pose.distance(other) > 0.55 for other in chosen):
            chosen.append(Pose(*map(float, pose)))
        if len(chosen) == count:
            return chosen
    raise SystemExit(f'there is no room for {count} robots on the map')


def commands(robots: int, steps: int) -> list[list[list[float]]]:
    """For each step of 0.1 s and each robot, speeds that lead it about."""
    random = numpy.random.default_rng(2)
    rounds = steps // 20 + 1
    turns = numpy.repeat(random.uniform(-1.0, 1.0, (rounds, robots)), 20, axis=0)[:steps]
    ways = numpy.repeat(0.2 * (-1.0) ** numpy.arange(rounds), 20)[:steps, None]  # to and fro
    made: list[list[list[float]]] = numpy.stack([ways + 0.0 * turns, turns], axis=2).tolist()
    return made


def costs(robots: int, obstacles: int, seconds: float) -> tuple[float, float]:
    """Least processor time of a step, us, and greatest factor of the rounds."""
    grid = load_map(built_in_map())
    world = World(grid)
    starts = places(grid, robots + obstacles)
    for number, pose in enumerate(starts[:robots]):
        world.add(f'robot{number}', ROBOT, pose)
    for number, pose in enumerate(starts[robots:]):
        try:
            model = ObstacleModel(pose=pose, shape=Circle(0.2), random_walk=WalkModel())
            world.add(f'obstacle{number}', model)
        except SimulationError:
            continue
    steps = max(10, round(seconds / 0.1))
    drives = commands(robots, steps)
    run(world, drives)  # what is compiled and looked up for the first time
    took = min(run(world, drives) for _ in range(ROUNDS))
    return took / (5 * steps) * 1e6, steps * 0.1 / took


def run(world: World, drives: list[list[list[float]]]) -> float:
    """Processor time of driving so, s."""
    world.reset()
    robots = list(world.robots.values())
    start = time.process_time()
    for step in drives:
        for robot, (linear, angular) in zip(robots, step, strict=True):
            robot.command(linear, angular, world.time)
        world.step(0.1)
    return time.process_time() - start


def scans() -> dict[str, float]:
    """Least cost of a scan, us, with numba and without."""
    grid = load_map(built_in_map())
    caster = RayCaster(grid)
    sensors = [Beams(pose, 0.0, numpy.pi / 180.0, 360, 3.5, -1) for pose in places(grid, 40)]
    nothing = outlines([])
    found = {}
    compiled = cast.compiled
    for what, function in (('compiled', compiled), ('interpreted', None)):
        cast.compiled = function
        caster.cast(sensors, nothing)
        took = []
        for _ in range(20):
            start = time.process_time()
            caster.cast(sensors, nothing)
            took.append(time.process_time() - start)
        found[what] = min(took) / len(sensors) * 1e6
    cast.compiled = compiled
    return found


def beside_irsim(robots: int, python: Path) -> tuple[float, float]:
    """Processor time of a step of 0.1 s with a scan of each robot, us: of this world and of IR-SIM."""
    steps = max(5, 60 // robots)
    grid = load_map(built_in_map())
    starts, drives = places(grid, robots), commands(robots, steps)
    world = World(grid)
    assert ROBOT.lidar is not None
    model = replace(ROBOT, lidar=replace(ROBOT.lidar, rate=10.0))
    for number, pose in enumerate(starts):
        world.add(f'robot{number}', model, pose)
    run(world, drives)
    ours = min(run(world, drives) for _ in range(ROUNDS)) / steps * 1e6
    lidar = {'name': 'lidar2d', 'range_min': 0.12, 'range_max': 3.5, 'angle_range': 6.283, 'number': 360, 'noise': True,
             'std': 0.01}  # fmt: skip
    described = {
        'world': {
            'width': grid.width * grid.resolution, 'height': grid.height * grid.resolution, 'step_time': 0.1,
            'sample_time': 0.1, 'collision_mode': 'stop', 'obstacle_map': str(built_in_map().with_suffix('.png')),
            'mdownsample': 1,
        },
        'robot': [
            {
                'kinematics': {'name': 'diff'}, 'shape': {'name': 'circle', 'radius': 0.22}, 'state': [x, y, yaw],
                'vel_max': [0.26, 1.82], 'sensors': [lidar],
            }
            for x, y, yaw in starts
        ],
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as directory:
        file, driven = Path(directory) / 'world.yaml', Path(directory) / 'commands.json'
        file.write_text(yaml.safe_dump(described))
        driven.write_text(json.dumps(drives))
        done = subprocess.run(
            [python, HERE / '_irsim_probe.py', file, driven], capture_output=True, text=True, check=False
        )
    if done.returncode:
        raise SystemExit(f'IR-SIM: {done.stderr}')
    told = json.loads(done.stdout.splitlines()[-1])
    assert max(told['moved']) > 0.05, told
    return ours, told['processor'] / (steps - 1) * 1e6


if __name__ == '__main__':
    sys.exit(main())
