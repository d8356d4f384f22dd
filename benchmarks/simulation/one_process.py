# SPDX-License-Identifier: BSD-3-Clause
"""How fast missions run in one process, on a simulated clock: simulated seconds per second of processor time.

Robots in the built-in rooms drive from place to place, each with a BT server, a stop guard, an executive and an
operator. With full motion they share a simulator, and have a navigation each. The start does not count.

Usage: python3 benchmarks one_process [--robots N] [--motion MOTION] [--seconds S] [--profile FILE] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import cProfile
import os
import sys
import tempfile
from contextlib import nullcontext
from itertools import cycle
from pathlib import Path

from flexbt_testing.world import World  # isort: skip - it prepares this interpreter

from _figures import write_figures
from ament_index_python.packages import get_package_share_directory

from flexbt_console.mirror.records import DecisionKind
from flexbt_testing.one_process.programs import Program, named_programs

MAPS = Path(get_package_share_directory('flexbt_sim'), 'maps')
STARTS = ((0.8, 4.45), (3.4, 6.6), (6.8, 7.8), (9.6, 6.6), (10.0, 2.3))
PLACES = ('kitchen', 'dock', 'office', 'lounge', 'workshop', 'store')


def processor_time() -> float:
    """Return the processor time of this process, s; the clocks of ``time`` are those of the world."""
    used = os.times()
    return used.user + used.system


def fleet(directory: Path, robots: int) -> list[Program]:
    """Return the programs of the robots, and of their simulator."""
    file = directory / 'world.yaml'
    names = [f'robot{number}' for number in range(robots)]
    poses = zip(names, cycle(STARTS), strict=False)
    lines = [f'  {name}: {{model: waffle, pose: [{x}, {y}, 0]}}\n' for name, (x, y) in poses]
    file.write_text(f'map: {MAPS / "rooms.yaml"}\nrobots:\n{"".join(lines)}')
    simulated = {'use_sim_time': True}
    places = {**simulated, 'places': str(MAPS / 'rooms_places.yaml')}
    programs = [Program('flexbt_sim', 'simulator', {'odom_rate': 20.0, 'world': str(file)})]
    for name in names:
        programs += [
            Program('flexbt_navigation', 'navigation', simulated, name),
            Program('flexbt_server', 'bt_server', simulated, name),
            Program('flexbt_onboard', 'stop_guard', namespace=name),
            Program('flexbt_onboard', 'onboard_executive', places, name),
        ]
    return programs


def drive(world: World, seconds: float) -> None:
    """Let the robots drive from place to place."""
    nexts = {name: cycle(PLACES[number % len(PLACES) :] + PLACES) for number, name in enumerate(world.robots)}
    until = world.now + seconds
    while world.now < until:
        for name, mission in world.robots.items():
            for path, decision in mission.decisions.items():
                if decision.kind is DecisionKind.INPUT:
                    mission.answer(path, next(nexts[name]))
                else:
                    mission.choose(path, decision.outcomes[0])
        world.run(0.2)


def main() -> int:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=1)
    parser.add_argument('--motion', choices=('full', 'abstract'), default='full')
    parser.add_argument('--seconds', type=float, default=60.0, help='simulated time')
    parser.add_argument('--profile', type=Path, help='file for the profile (cProfile)')
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        programs = named_programs(
            '__main__:fleet', directory, directory, options.motion, directory=directory, robots=options.robots
        )
        began = processor_time()
        with World(0, programs) as world:
            for mission in world.robots.values():
                mission.start('Navigate', 'Full')
            drive(world, 1.0)  # everything is there, and compiled
            ready, driven = processor_time(), sum(mission.robot.length for mission in world.robots.values())
            with cProfile.Profile() if options.profile else nullcontext() as profile:
                drive(world, options.seconds)
            used = processor_time() - ready
            driven = sum(mission.robot.length for mission in world.robots.values()) - driven
            if profile:
                profile.dump_stats(options.profile)
    factor = options.seconds / used
    print(
        f'{options.robots} robots, {options.motion}: {factor:.1f} times real time; {options.seconds:g} s and '
        f'{driven:.1f} m in {used:.2f} s of processor, after {ready - began:.2f} s for the start'
    )
    if options.output:
        write_figures(options.output, {'times_real_time': round(factor, 1), 'processor_seconds': round(used, 2)})
    return 0


if __name__ == '__main__':
    sys.exit(main())
