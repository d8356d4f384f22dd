# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``night_watch``: two robots at the consoles of one person, or with a scripted operator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from flexbt_console.mirror.records import Decision, DecisionKind
from flexbt_core.values.text import escape_lines
from flexbt_demo_behaviors.demonstration.demo_processes import console_command
from flexbt_demo_behaviors.demonstration.process_group import ProcessGroup
from flexbt_demo_behaviors.demonstration.report import (
    DemoError,
    DemoReport,
    GoalResult,
    Timeline,
    pose_text,
    world_with_places,
)
from flexbt_demo_behaviors.demonstration.running import (
    RunOptions,
    page_line,
    parse_run_options,
    run_console,
    run_demonstration,
    serve_page,
    tell_ended,
)
from flexbt_demo_behaviors.demonstration.scripted_operator import ANSWER_TIMEOUT_S, DRIVE_TIMEOUT_S
from flexbt_sim.world import World

from .watch import PLACES, ROBOTS, WORLD, Watch, open_watch


def main() -> int:
    """Run the night watch of the command line; gives the exit code of the process."""
    options = parse_run_options('night_watch', 'Two simulated robots watch a building, under one operator.')
    return run_demonstration('night_watch', options, _run)


def _run(options: RunOptions, group: ProcessGroup, timeline: Timeline) -> int:
    if options.interactive:  # the terminal belongs to the operator
        with (
            (options.logs / 'timeline.log').open('w') as log,
            open_watch(group, options.speed, Timeline(log)) as watch,
        ):
            run_interactive(watch)
        return 0
    with open_watch(group, options.speed, timeline) as watch:
        report = DemoReport(TITLE, BRANCHES)
        report.play(lambda: night_watch(watch, report))
        tracks = {name: session.track for name, session in watch.sessions.items()}
        return report.conclude(world_with_places(WORLD, PLACES), tracks, options.output / 'demo3.png')


# The night watch with a person at the consoles of both robots, who also controls the events in the building.

INTRODUCTION = """
Both robots are on their rounds; the door of the archive is jammed. Which robot do you look after, or what happens?

  alpha, beta      its screen: "?" shows the keys, "o" both robots, "q" leads back here
  mend             the door is mended
  battery ROBOT    its battery runs low
  lose ROBOT       its computer dies
  end              the night is over
"""


def run_interactive(watch: Watch, read: Callable[[str], str] = input) -> None:
    """Begin the rounds, and do what the operator says until the night is over; lines come from `read`."""
    watch.start()
    page = serve_page(watch.group)
    print(INTRODUCTION + page_line(page), flush=True)
    while True:
        tell_ended(watch.group)
        try:
            words = read('night watch> ').split()
        except EOFError:
            return
        try:
            match words:
                case ['end']:
                    return
                case [robot] if robot in ROBOTS:
                    leaving = 'you are asked again which robot you look after'
                    run_console(watch.group, console_command(leaving, robot, page))
                case ['mend']:
                    watch.building.mend_door()
                case ['battery', robot] if robot in ROBOTS:
                    watch.building.lower_battery(robot)
                case ['lose', robot] if robot in ROBOTS:
                    watch.lose(robot)
                case []:
                    pass
                case _:
                    print(f'{" ".join(words)!r}: expected alpha, beta, mend, battery ROBOT, lose ROBOT, or end')
        except DemoError as error:
            print(*escape_lines(str(error)), sep='\n')


# The actions of the scripted operator of the night watch, and the branches that it takes.

DOOR_JAMMED: Final = 'a door jams: that room later'
CHARGED: Final = 'battery low: charged, the round goes on'
LOST: Final = 'a robot is lost: the other one takes over'
SWITCHED: Final = 'a further room, given at run time'
HARMLESS: Final = 'something found, judged harmless'
ALARM: Final = 'something found, alarm raised'
DOOR_OPENED: Final = 'the room behind the mended door'
FINISHED: Final = 'sent home by the operator'
BRANCHES: Final = (DOOR_JAMMED, CHARGED, LOST, SWITCHED, HARMLESS, ALARM, DOOR_OPENED, FINISHED)

TITLE: Final = 'Demonstration 3: two robots on night watch'

THERE: Final = 1.0
"""A robot that came so near to the place of a room was in it, m: on a busy computer not every pose is heard."""

NEAR: Final = 1.0
"""An alarm is about something that is so near to where it says, m."""


def night_watch(watch: Watch, report: DemoReport) -> None:
    """Run a night in which everything happens that can."""
    alpha, beta, building = watch.operator('alpha'), watch.operator('beta'), watch.building
    watch.start()

    door = _wait_choice(watch, 'beta', '/Watch/Round/JudgeDoor')
    building.mend_door()
    beta.choose(door, 'later')
    report.take(DOOR_JAMMED)
    building.lower_battery('beta')

    # Before it is judged what alpha has found, its battery is low; it drives to its dock, and is lost there.
    _wait_choice(watch, 'alpha', '/Watch/Round/JudgeFinding')
    building.lower_battery('alpha')
    alpha.wait_tree_node('Charging', DRIVE_TIMEOUT_S)

    beta.wait(lambda _view: 'beta' in building.charged, 'beta charged', DRIVE_TIMEOUT_S)
    _wait_choice(watch, 'beta', '/Watch/Round/JudgeFinding')
    report.take(CHARGED)

    behind = set(building.rooms_left['alpha'])
    watch.lose('alpha')
    beta.choose(_wait_choice(watch, 'beta', '/Watch/Partner/JudgeLoss'), 'take_over')

    beta.switch('Night Watch', rooms='archive lobby workshop', home='beta_dock', partner='alpha')
    beta.choose(_wait_choice(watch, 'beta', '/Watch/Round/JudgeFinding'), 'harmless')
    report.take(HARMLESS)

    again = _wait_choice(watch, 'beta', '/Watch/Round/JudgeFinding')
    _wait_looked_at(watch, {'workshop'})
    report.take(SWITCHED)
    beta.choose(again, 'alarm')
    _check_alarm(watch, 'crate')
    report.take(ALARM)

    home = _wait_choice(watch, 'beta', '/Watch/Round/JudgeRound')
    _wait_looked_at(watch, behind)
    report.take(LOST)
    _wait_looked_at(watch, {'archive'})
    report.take(DOOR_OPENED)
    beta.choose(home, 'home')
    beta.wait_end('finished', DRIVE_TIMEOUT_S)
    report.take(FINISHED)

    for room in ('lab', 'store'):
        report.goals.append(_visit(watch, 'alpha', room))
    for room in ('lobby', 'workshop', 'store', 'office', 'archive', 'beta_dock'):
        report.goals.append(_visit(watch, 'beta', room))


def _wait_choice(watch: Watch, robot: str, path: str) -> Decision:
    """Wait until a state of a robot asks the operator how to go on."""
    return watch.operator(robot).wait_decision(DecisionKind.CHOICE, path, DRIVE_TIMEOUT_S)


def _wait_looked_at(watch: Watch, rooms: set[str]) -> None:
    """Wait until beta says that it has none of the rooms left."""
    watch.operator('beta').wait(
        lambda _view: not rooms & set(watch.building.rooms_left['beta']),
        f'{", ".join(sorted(rooms))} looked at by beta',
        ANSWER_TIMEOUT_S,
    )


def _check_alarm(watch: Watch, name: str) -> None:
    """Check that the first alarm is about an obstacle of the world file."""
    building = watch.building
    robot, pose = watch.operator('beta').wait(
        lambda _view: building.alarms[0] if building.alarms else None, 'alarm', ANSWER_TIMEOUT_S
    )  # fmt: skip
    distance = pose.distance(World.load(WORLD).obstacles[name].pose)
    watch.timeline.tell('building', f'{robot} raises the alarm: {distance:.2f} m from the {name}')
    if distance > NEAR:
        raise DemoError(f'the alarm of {robot} is about {pose_text(pose)}, {distance:.2f} m from the {name}')


def _visit(watch: Watch, robot: str, room: str) -> GoalResult:
    """Return how near a robot came to a place; raises DemoError when it was not there."""
    place = world_with_places(WORLD, PLACES).places[room]
    error = min(place.distance(pose) for _, pose in watch.track(robot).way)
    result = GoalResult(room, place, f'{robot} was there', error, error <= THERE)
    if not result.reached:
        raise DemoError(f'{robot} was never nearer than {error:.2f} m to {room} {pose_text(place)}')
    return result
