# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the night watch: interactive in a terminal, driven by a scripted operator without one."""

from __future__ import annotations

from flexbt_demo_behaviors.demonstration import (
    DemoReport,
    ProcessGroup,
    RunOptions,
    Timeline,
    parse_run_options,
    run_demonstration,
    write_picture,
)

from .interactive import run_interactive
from .script import BRANCHES, TITLE, night_watch
from .watch import open_watch
from .watch_processes import watch_world


def main() -> int:
    """Run the night watch of the command line; gives the exit code of the process."""
    options = parse_run_options('night_watch', 'Two simulated robots watch a building, under one operator.')
    return run_demonstration(
        'night_watch', options.output / 'logs', options.interactive, lambda group, domain: _run(options, group, domain)
    )


def _run(options: RunOptions, group: ProcessGroup, domain: int) -> int:
    print(f'night_watch: starts its processes in ROS domain {domain}, at speed factor {options.speed:g}', flush=True)
    if options.interactive:  # the terminal belongs to the operator
        with (
            (options.output / 'logs' / 'timeline.log').open('w') as log,
            open_watch(group, options.speed, Timeline(log)) as watch,
        ):
            run_interactive(watch)
        return 0
    with open_watch(group, options.speed, Timeline()) as watch:
        report = DemoReport(TITLE, dict.fromkeys(BRANCHES, False))
        report.play(lambda: night_watch(watch, report))
        file = options.output / 'demo3.png'
        write_picture(watch_world(), {name: session.track for name, session in watch.sessions.items()}, file)
        print(f'\n{report.text()}\n  picture {file}\n', flush=True)
    return 0 if report.passed else 1
