# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the night watch: interactive in a terminal, driven by a scripted operator without one."""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

from flexbt_demo_behaviors.demonstration import (
    DemoError,
    DemoReport,
    ProcessGroup,
    Timeline,
    run_demonstration,
    speed_factor,
    write_picture,
)

from .interactive import run_interactive
from .script import BRANCHES, TITLE, night_watch
from .watch import Watch, open_watch
from .watch_processes import watch_world

DEFAULT_SPEED = 1.0
DEFAULT_SCRIPT_SPEED = 10.0

EPILOG = """\
Without a terminal, or with --script, a scripted operator takes every branch; the exit code is 0 only when nothing
was otherwise than expected, and a picture is written. The environment variable SPEED stands for --speed.
"""


def main() -> int:
    """Run the night watch of the command line; gives the exit code of the process."""
    parser = argparse.ArgumentParser(
        prog='night_watch', description='Two simulated robots watch a building, under one operator.', epilog=EPILOG
    )
    parser.add_argument(
        '--speed',
        default=os.environ.get('SPEED', ''),
        help='seconds of simulated time in one second; default 1, with the scripted operator 10',
    )
    parser.add_argument('--output', type=Path, default=Path('out'), help='directory of picture and logs; default: out')
    parser.add_argument('--script', action='store_true', help='let the scripted operator act, also in a terminal')
    given = parser.parse_args()
    is_interactive = sys.stdin.isatty() and sys.stdout.isatty() and not given.script
    speed = speed_factor(parser, given.speed) or (DEFAULT_SPEED if is_interactive else DEFAULT_SCRIPT_SPEED)
    return run_demonstration(
        'night_watch',
        given.output / 'logs',
        is_interactive,
        lambda group, domain: _run(group, domain, speed, given.output, is_interactive),
    )


def _run(group: ProcessGroup, domain: int, speed: float, output: Path, is_interactive: bool) -> int:
    print(f'night_watch: starts its processes in ROS domain {domain}, at speed factor {speed:g}', flush=True)
    if is_interactive:  # the terminal belongs to the operator
        with (output / 'logs' / 'timeline.log').open('w') as log, open_watch(group, speed, Timeline(log)) as watch:
            run_interactive(watch)
        return 0
    with open_watch(group, speed, Timeline()) as watch:
        report = _run_script(watch)
        file = output / 'demo3.png'
        write_picture(watch_world(), {name: session.track for name, session in watch.sessions.items()}, file)
        print(f'\n{report.text()}\n  picture {file}\n', flush=True)
    return 0 if report.passed else 1


def _run_script(watch: Watch) -> DemoReport:
    report = DemoReport(TITLE, dict.fromkeys(BRANCHES, False))
    before = time.monotonic()
    try:
        night_watch(watch, report)
    except DemoError as error:
        report.problem = str(error)
    report.duration = time.monotonic() - before
    return report
