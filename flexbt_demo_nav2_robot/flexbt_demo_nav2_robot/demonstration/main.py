# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the robot of Nav2: interactive in a terminal, driven by a scripted operator without one."""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Final

from flexbt_common import names
from flexbt_demo_behaviors.demonstration import (
    READY_TIMEOUT_S,
    DemoError,
    DemoReport,
    EndedProcess,
    ProcessGroup,
    Session,
    Simulation,
    Timeline,
    call_service,
    console_command,
    join_robot,
    run_console,
    run_demonstration,
    speed_factor,
    write_picture,
)
from flexbt_msgs.srv import ControlTree

from .robot_processes import PROGRAM, robot_processes, warehouse
from .script import BRANCHES, TITLE, Warehouse, supervise

ROBOT: Final = 'robot'
DEFAULT_SPEED = 1.0
DEFAULT_SCRIPT_SPEED = 10.0

INTRODUCTION = """
The program drives the robot to the shelf, and asks you then. "?" shows the keys, "!" stops what drives, "q" ends all.
"""

EPILOG = """\
Without a terminal, or with --script, a scripted operator takes every branch; the exit code is 0 only when nothing
was otherwise than expected, and a picture is written. The environment variable SPEED stands for --speed.
"""


def main() -> int:
    """Run the demonstration of the command line; gives the exit code of the process."""
    parser = argparse.ArgumentParser(
        prog='nav2_robot', description='A program drives a robot of Nav2, under an operator.', epilog=EPILOG
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
        'nav2_robot',
        given.output / 'logs',
        is_interactive,
        lambda group, domain: _run(group, domain, speed, given.output, is_interactive),
    )


def _run(group: ProcessGroup, domain: int, speed: float, output: Path, is_interactive: bool) -> int:
    timeline = Timeline()
    timeline.tell('demo', f'starts its processes in ROS domain {domain}, at speed factor {speed:g}')
    processes = robot_processes(speed)
    for process in processes:
        group.start(process.name, process.command())
    with join_robot('operator', timeline, is_on_call=True) as session:
        group.watch(lambda ended: session.operator.abandon(ended.report()))
        session.operator.wait_ready(peers=len(processes) - 1, timeout=READY_TIMEOUT_S)
        if not is_interactive:
            return _run_script(group, session, speed, output, timeline)
    group.start(PROGRAM.name, PROGRAM.command())
    print(INTRODUCTION, flush=True)
    return run_console(console_command())


def _run_script(group: ProcessGroup, session: Session, speed: float, output: Path, timeline: Timeline) -> int:
    scene = Warehouse(
        session.operator,
        Simulation(session.runtime, timeline, speed),
        timeline,
        lambda command: call_service(
            session.runtime, ControlTree, names.CONTROL_TREE, ControlTree.Request(command=command)
        ),
        lambda: group.start(PROGRAM.name, PROGRAM.command()),
        output / 'logs' / f'{PROGRAM.name}.log',
    )

    def on_end(ended: EndedProcess) -> None:
        if ended.name == PROGRAM.name and ended.exit_code == 0:
            scene.ended.set()
            session.operator.notify()
        else:
            session.operator.abandon(ended.report())

    group.watch(on_end)
    session.track.restart()
    report = DemoReport(TITLE, dict.fromkeys(BRANCHES, False))
    before = time.monotonic()
    try:
        supervise(scene, report)
    except DemoError as error:
        report.problem = str(error)
    report.duration = time.monotonic() - before
    world = warehouse()
    for name, box in scene.simulation.boxes.items():
        world.add(name, box.model)
    file = output / 'demo4.png'
    write_picture(world, {ROBOT: session.track}, file)
    print(f'\n{report.text()}\n  picture {file}\n', flush=True)
    return 0 if report.passed else 1
