# SPDX-License-Identifier: BSD-3-Clause
"""The executable of the demonstrations: interactive in a terminal, driven by a scripted operator without one."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping

from flexbt_sim.world import Pose, RobotModel, World

from .demo_processes import DemoSettings, built_in_places, first_place
from .interactive import run_interactive
from .options import DemoOptions, parse_options
from .picture import write_picture
from .process_group import ProcessGroup
from .report import DemoReport, Timeline
from .robot_track import RobotTrack
from .running import run_demonstration
from .scripts import DEMONSTRATIONS, Demonstration
from .session import Session, open_session
from .simulation import Box, Simulation

ROBOT = 'robot'


def main() -> int:
    """Run the demonstration of the command line; gives the exit code of the process."""
    terminal = sys.stdin.isatty() and sys.stdout.isatty()
    options = parse_options(sys.argv[1:], os.environ, terminal)
    return run_demonstration(
        'demo', options.output / 'logs', options.interactive, lambda group, domain: _run(options, group, domain)
    )


def _run(options: DemoOptions, group: ProcessGroup, domain: int) -> int:
    places = options.places or built_in_places()
    start = first_place(places) if options.map else None
    settings = DemoSettings(options.map, start, places, options.speed)
    timeline = Timeline()
    timeline.tell('demo', f'starts its processes in ROS domain {domain}, at speed factor {options.speed:g}')
    if options.interactive:
        return run_interactive(group, settings, DEMONSTRATIONS[options.demos[0]], timeline)
    return _run_scripts(options, settings, group, timeline)


def _run_scripts(options: DemoOptions, settings: DemoSettings, group: ProcessGroup, timeline: Timeline) -> int:
    reports = []
    with open_session(group, settings, 'script', timeline) as session:
        timeline.tell('demo', 'everything is ready')
        for number in options.demos:
            simulation = Simulation(session.runtime, timeline, options.speed)
            report = _run_script(DEMONSTRATIONS[number], session, None if options.map else simulation, timeline)
            reports.append(report)
            file = options.output / f'demo{number}.png'
            write_picture(_world(report, session.track, simulation.boxes), {ROBOT: session.track}, file)
            print(f'\n{report.text()}\n  picture {file}\n', flush=True)
            if report.problem:
                break
    return 0 if all(report.passed for report in reports) else 1


def _run_script(
    demonstration: Demonstration, session: Session, simulation: Simulation | None, timeline: Timeline
) -> DemoReport:
    report = demonstration.report(with_boxes=simulation is not None)
    timeline.tell('demo', report.title)
    session.track.restart()
    report.play(lambda: demonstration.script(session.operator, simulation, report))
    return report


def _world(report: DemoReport, track: RobotTrack, boxes: Mapping[str, Box]) -> World:
    """The world of the picture: the robot where it began, the goals, and all boxes that were somewhere."""
    places = {goal.label: Pose(goal.pose.x, goal.pose.y, goal.pose.yaw) for goal in report.goals}
    world = World(track.map, places=places)
    start = track.way[0][1]
    world.add(ROBOT, RobotModel(), Pose(start.x, start.y, start.yaw))
    for name, box in boxes.items():
        world.add(name, box.model)
    return world
