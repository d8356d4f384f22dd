# SPDX-License-Identifier: BSD-3-Clause
"""The command line of the demonstration, with defaults from the environment as `make demo` gives them."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexbt_common.command_line import SuggestingArgumentParser

DEFAULT_SPEED = 1.0
DEFAULT_SCRIPT_SPEED = 10.0

EPILOG = """\
Without a terminal, or with --script, a scripted operator drives the demonstrations (both, unless one is
chosen); the exit code is 0 only when the robot was at its goals and every branch was taken, and a summary
picture of each is written. The environment variables DEMO, SPEED and OUTPUT stand for --demo, --speed and --output.
"""


SCRIPT_EPILOG = """\
Without a terminal, or with --script, a scripted operator takes every branch; the exit code is 0 only when nothing
was otherwise than expected, and a picture is written. The environment variables SPEED and OUTPUT stand for --speed
and --output.
"""


@dataclass(frozen=True)
class RunOptions:
    """Options of any demonstration: the operator, the speed factor, and the directory of pictures and logs."""

    interactive: bool
    speed: float
    output: Path

    @property
    def logs(self) -> Path:
        """Directory of the logs of the processes."""
        return self.output / 'logs'


@dataclass(frozen=True)
class DemoOptions(RunOptions):
    """Options of the demonstration Navigate. `map` and `places` are empty for the ones that come along."""

    demos: tuple[int, ...]
    map: str
    places: str


def parse_run_options(program: str, description: str) -> RunOptions:
    """Read the command line of a program with one demonstration; ends the process with a message when it is wrong."""
    parser = SuggestingArgumentParser(prog=program, description=description, epilog=SCRIPT_EPILOG)
    _add_run_options(parser, os.environ)
    return _run_options(parser, parser.parse_args(), sys.stdin.isatty() and sys.stdout.isatty())


def parse_options(arguments: Sequence[str], environment: Mapping[str, str], terminal: bool) -> DemoOptions:
    """Read the command line; ends the process with a message for the user when it is wrong (exit code 2)."""
    parser = SuggestingArgumentParser(
        prog='demo', description='Run the FlexBT demonstrations in simulation.', epilog=EPILOG
    )
    parser.add_argument('--demo', default=environment.get('DEMO', ''), help='1: one tree navigates; 2: three trees')
    _add_run_options(parser, environment)
    parser.add_argument('--map', default='', help='ROS map YAML file; default: the built-in map')
    parser.add_argument(
        '--places',
        default='',
        help='YAML file of named places; on a map of your own, the robot starts at the first of them',
    )
    given = parser.parse_args(arguments)

    if given.demo not in ('', '1', '2'):
        parser.error(f'--demo {given.demo}: there are the demonstrations 1 and 2')
    if given.map and not given.places:
        parser.error('--map needs --places: the places in that map, {name: {x: 1.0, y: 2.0, yaw: 0.0}}')
    for name in ('map', 'places'):
        if getattr(given, name) and not Path(getattr(given, name)).is_file():
            parser.error(f'--{name} {getattr(given, name)}: there is no such file')
    run = _run_options(parser, given, terminal)
    return DemoOptions(
        run.interactive,
        run.speed,
        run.output,
        demos=(int(given.demo),) if given.demo else ((1,) if run.interactive else (1, 2)),
        map=str(Path(given.map).resolve()) if given.map else '',
        places=str(Path(given.places).resolve()) if given.places else '',
    )


def _add_run_options(parser: argparse.ArgumentParser, environment: Mapping[str, str]) -> None:
    parser.add_argument(
        '--speed',
        default=environment.get('SPEED', ''),
        help='seconds of simulated time in one second; default 1, with the scripted operator 10',
    )
    output = Path(environment.get('OUTPUT') or 'out')
    parser.add_argument('--output', type=Path, default=output, help='directory of pictures and logs; default: out')
    parser.add_argument('--script', action='store_true', help='let the scripted operator act, also in a terminal')


def _run_options(parser: argparse.ArgumentParser, given: argparse.Namespace, terminal: bool) -> RunOptions:
    interactive = terminal and not given.script
    speed = _speed_factor(parser, given.speed) or (DEFAULT_SPEED if interactive else DEFAULT_SCRIPT_SPEED)
    return RunOptions(interactive, speed, given.output)


def _speed_factor(parser: argparse.ArgumentParser, text: str) -> float:
    """Return the speed factor of an option --speed, 0 when none is given; ends the process with a message when it is
    none."""
    if not text:
        return 0.0
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 0.0 < speed <= 100.0:
        parser.error(f'--speed {text}: expected a number above 0, up to 100')
    return speed
