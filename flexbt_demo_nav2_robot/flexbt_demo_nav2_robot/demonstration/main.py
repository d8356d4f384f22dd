# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the robot of Nav2: interactive in a terminal, driven by a scripted operator without one."""

from __future__ import annotations

from typing import Final

from flexbt_common import names
from flexbt_demo_behaviors.demonstration import (
    READY_TIMEOUT_S,
    DemoReport,
    EndedProcess,
    ProcessGroup,
    RunOptions,
    Session,
    Simulation,
    Timeline,
    call_service,
    console_command,
    join_robot,
    parse_run_options,
    run_console,
    run_demonstration,
    write_picture,
)
from flexbt_msgs.srv import ControlTree

from .robot_processes import PROGRAM, robot_processes, warehouse
from .script import BRANCHES, TITLE, Warehouse, supervise

ROBOT: Final = 'robot'
PEERS: Final = 3
"""Of the executive: simulator, navigation, BT server."""

INTRODUCTION = """
The program drives the robot to the shelf, and asks you then. "?" shows the keys, "!" stops what drives, "q" ends all.
"""


def main() -> int:
    """Run the demonstration of the command line; gives the exit code of the process."""
    options = parse_run_options('nav2_robot', 'A program drives a robot of Nav2, under an operator.')
    return run_demonstration(
        'nav2_robot', options.output / 'logs', options.interactive, lambda group, domain: _run(options, group, domain)
    )


def _run(options: RunOptions, group: ProcessGroup, domain: int) -> int:
    timeline = Timeline()
    timeline.tell('demo', f'starts its processes in ROS domain {domain}, at speed factor {options.speed:g}')
    for process in robot_processes(options.speed):
        group.start(process.name, process.command(), respawn=True)
    with join_robot('operator', timeline, is_on_call=True) as session:
        group.watch(lambda ended: session.operator.abandon(ended.report()))
        session.operator.wait_ready(PEERS, timeout=READY_TIMEOUT_S)
        if not options.interactive:
            return _run_script(options, group, session, timeline)
    group.start(PROGRAM.name, PROGRAM.command())
    print(INTRODUCTION, flush=True)
    return run_console(group, console_command())


def _run_script(options: RunOptions, group: ProcessGroup, session: Session, timeline: Timeline) -> int:
    scene = Warehouse(
        session.operator,
        Simulation(session.runtime, timeline, options.speed),
        timeline,
        lambda command: call_service(
            session.runtime, ControlTree, names.CONTROL_TREE, ControlTree.Request(command=command)
        ),
        lambda: group.start(PROGRAM.name, PROGRAM.command()),
        options.output / 'logs' / f'{PROGRAM.name}.log',
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
    report.play(lambda: supervise(scene, report))
    world = warehouse()
    for name, box in scene.simulation.boxes.items():
        world.add(name, box.model)
    file = options.output / 'demo4.png'
    write_picture(world, {ROBOT: session.track}, file)
    print(f'\n{report.text()}\n  picture {file}\n', flush=True)
    return 0 if report.passed else 1
