# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the robot that plans: interactive in a terminal, driven by a scripted operator without one."""

from __future__ import annotations

from typing import Final

from flexbt_console.mirror import AutonomyLevel
from flexbt_demo_behaviors.demonstration import (
    READY_TIMEOUT_S,
    DemoReport,
    ProcessGroup,
    RunOptions,
    Session,
    Timeline,
    console_command,
    join_robot,
    parse_run_options,
    run_console,
    run_demonstration,
    write_picture,
)
from flexbt_sim.world import Pose

from .household import CUP, Household
from .robot_processes import flat, robot_processes
from .script import BRANCHES, TITLE, Flat, reach_goals

ROBOT: Final = 'robot'
PEERS: Final = 3
"""Of the executive: simulator, navigation, BT server."""

INTRODUCTION = """
The robot brings the cup from the kitchen to the office. Shut the door meanwhile, from another terminal:
  ros2 service call /simulator/doors/kitchen_door std_srvs/srv/SetBool "{data: false}"
"?" shows the keys, "!" stops what drives, "q" ends all.
"""


def main() -> int:
    """Run the demonstration of the command line; gives the exit code of the process."""
    options = parse_run_options('goals', 'A robot plans its way to a goal, under an operator.')
    return run_demonstration(
        'goals', options.output / 'logs', options.interactive, lambda group, domain: _run(options, group, domain)
    )


def _run(options: RunOptions, group: ProcessGroup, domain: int) -> int:
    timeline = Timeline()
    timeline.tell('demo', f'starts its processes in ROS domain {domain}, at speed factor {options.speed:g}')
    for process in robot_processes(options.speed):
        group.start(process.name, process.command(), respawn=True)
    with join_robot('operator', timeline) as session:
        group.watch(lambda ended: session.operator.abandon(ended.report()))
        session.operator.wait_ready(PEERS, timeout=READY_TIMEOUT_S)
        if not options.interactive:
            return _run_script(options, session, timeline)
        session.operator.start('Reach Goal', AutonomyLevel.HIGH)
    print(INTRODUCTION, flush=True)
    return run_console(group, console_command())


def _run_script(options: RunOptions, session: Session, timeline: Timeline) -> int:
    operator = session.operator
    household = Household(session.runtime, timeline, options.speed, operator.notify)
    session.track.restart()
    report = DemoReport(TITLE, dict.fromkeys(BRANCHES, False))
    report.play(lambda: reach_goals(Flat(operator, household), report))
    file = options.output / 'demo5.png'
    world = flat()
    for goal in report.goals:
        world.move(CUP, Pose(goal.pose.x, goal.pose.y, 0.0))
    write_picture(world, {ROBOT: session.track}, file)
    print(f'\n{report.text()}\n  picture {file}\n', flush=True)
    return 0 if report.passed else 1
