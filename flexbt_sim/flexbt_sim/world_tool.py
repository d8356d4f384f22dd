# SPDX-License-Identifier: BSD-3-Clause
"""The command ``world_tool``: checks world files, draws them, and runs them without ROS."""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final

from flexbt_common.command_line import SuggestingArgumentParser, run_program
from flexbt_core.values.json_data import finite_number
from flexbt_core.values.text import escape_lines, pluralize
from flexbt_sim.world.pictures import Trace, draw_world
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.robot import COMMAND_PERIOD
from flexbt_sim.world.world import World

from .errors import SimulationError

NAVIGATORS: Final = 'flexbt.navigators'
"""Entry-point group of classes that drive a robot of a world to goals, such as flexbt_navigation's."""

FORMATS: Final = ('.png', '.gif')

FRAMES = 200
"""Maximum number of frames of an animation."""


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``world_tool``; returns 1 if the file or the request is invalid."""
    return run_program('world_tool', lambda: _answer(args))


def _answer(args: list[str] | None) -> int:
    options = _parser().parse_args(args)
    try:
        world = World.load(options.file, seed=options.seed)
        report: str = options.command(world, options)
    except (SimulationError, OSError, ValueError) as error:
        print(*escape_lines(str(error)), sep='\n', file=sys.stderr)
        return 1
    print(report)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = SuggestingArgumentParser(prog='world_tool', description=__doc__)
    commands = parser.add_subparsers(required=True)
    check = commands.add_parser('check', help='read a world file, and tell all that is wrong with it')
    draw = commands.add_parser('draw', help='draw the world as it is at the start')
    run = commands.add_parser('run', help='let time pass, and draw what happened')
    for command, function in ((check, _check), (draw, _draw), (run, _run)):
        command.set_defaults(command=function)
        command.add_argument('file', type=Path, help='a world file')
        command.add_argument('--seed', type=int, help='in place of that of the file')
    for command in (draw, run):
        command.add_argument('picture', type=_picture, help='PNG; of a run also GIF, which moves')
        command.add_argument('--pixels', type=int, default=900, help='longer side of the picture')
    run.add_argument('--seconds', type=float, default=30.0, help='simulated time')
    run.add_argument(
        '--drive', action='append', default=[], metavar='ROBOT=LINEAR,ANGULAR', help='drive a robot: m/s, rad/s'
    )
    run.add_argument(
        '--goal', action='append', default=[], metavar='ROBOT=PLACE',
        help='have navigation drive a robot to a place of the file, or to X,Y,YAW: m, m, rad',
    )  # fmt: skip
    return parser


def _picture(text: str) -> Path:
    """Return a file that a picture can be written to, before a long run is simulated for it."""
    picture = Path(text)
    if picture.suffix.lower() not in FORMATS:
        raise argparse.ArgumentTypeError(f'{text!r} is no picture; give it the suffix {" or ".join(FORMATS)}')
    if not picture.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(f'{text!r}: there is no directory {str(picture.parent)!r}')
    return picture


def _check(world: World, options: argparse.Namespace) -> str:
    kinds = ('robot', 'obstacle', 'door', 'station', 'zone', 'place', 'fault')
    return f'{options.file}: ' + ', '.join(pluralize(len(getattr(world, f'{kind}s')), kind) for kind in kinds)


def _draw(world: World, options: argparse.Namespace) -> str:
    draw_world(world, pixels=options.pixels).save(options.picture)
    return f'{options.picture} is written'


def _run(world: World, options: argparse.Namespace) -> str:
    drives = dict(_drive(world, text) for text in options.drive)
    goals = dict(_goal(world, text) for text in options.goal)
    if not 0.0 < options.seconds <= 86_400.0:
        raise SimulationError(f'--seconds {options.seconds:g}: give more than 0, and at most a day')
    trace = Trace(world)
    navigators = {name: _navigator(world, name) for name in goals}
    trips = {name: navigators[name].start(goal) for name, goal in goals.items()}
    driven = set(goals)
    steps = max(1, round(options.seconds / COMMAND_PERIOD))
    for number in range(steps):
        for name, (linear, angular) in drives.items():
            world.robots[name].command(linear, angular, world.time)
        driven = {name for name in driven if navigators[name].step()}
        world.step(options.seconds / steps)
        if (number + 1) * FRAMES // steps > number * FRAMES // steps:
            trace.record()
    if options.picture.suffix.lower() == '.gif':
        trace.animate(options.picture, pixels=options.pixels)
    else:
        draw_world(world, trace, pixels=options.pixels).save(options.picture)
    contacts = {name: robot.contacts for name, robot in world.robots.items() if robot.contacts}
    violations = {name: robot.violations for name, robot in world.robots.items() if robot.violations}
    report = [
        f'{options.picture} is written, after {world.time:g} s; contacts: {contacts or "none"}; '
        f'no-go zones entered: {violations or "none"}'
    ]
    for name, trip in trips.items():
        ended = f'{trip.code or "reached"} after {trip.seconds:.1f} s, {trip.length:.1f} m'
        report.append(f'{name}: ' + ('on its way' if name in driven else ended))
    return '\n'.join(report)


def _navigator(world: World, robot: str) -> Any:
    """Return a navigator that drives a robot to goals. Raises SimulationError if the package is not installed."""
    points = sorted(entry_points(group=NAVIGATORS), key=lambda point: point.name)
    if not points:
        raise SimulationError('--goal: nothing is installed that navigates; install the package flexbt_navigation')
    return points[0].load()(world, robot)


def _drive(world: World, text: str) -> tuple[str, tuple[float, float]]:
    name, _, speeds = text.partition('=')
    numbers = _numbers(speeds)
    if name not in world.robots or len(numbers) != 2:
        raise SimulationError(f'--drive {text}: give ROBOT=LINEAR,ANGULAR; robots: {", ".join(world.robots) or "none"}')
    return name, (numbers[0], numbers[1])


def _goal(world: World, text: str) -> tuple[str, Pose]:
    name, _, place = text.partition('=')
    pose = world.places.get(place) or _numbers(place)
    if name not in world.robots or len(pose) != 3:
        raise SimulationError(
            f'--goal {text}: give ROBOT=PLACE or ROBOT=X,Y,YAW; robots: {", ".join(world.robots) or "none"}; '
            f'places: {", ".join(world.places) or "none"}'
        )
    return name, Pose(*pose)


def _numbers(text: str) -> tuple[float, ...]:
    """Return comma-separated numbers; an empty tuple if one of them is not a finite number."""
    numbers = [finite_number(number) for number in text.split(',')]
    found = tuple(number for number in numbers if number is not None)
    return found if len(found) == len(numbers) else ()


if __name__ == '__main__':
    sys.exit(main())
