# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``demo``: demonstrations 1 and 2, at the console or with a scripted operator."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from flexbt_console.mirror.records import AutonomyLevel, Decision, DecisionKind
from flexbt_demo_behaviors.demonstration.demo_processes import (
    DemoSettings,
    Process,
    built_in_places,
    console_command,
    demo_processes,
    first_place,
)
from flexbt_demo_behaviors.demonstration.process_group import ProcessGroup
from flexbt_demo_behaviors.demonstration.report import DemoReport, RobotTrack, Timeline
from flexbt_demo_behaviors.demonstration.running import (
    DemoOptions,
    DemoSession,
    open_session,
    page_line,
    parse_options,
    run_console,
    run_demonstration,
    serve_page,
)
from flexbt_demo_behaviors.demonstration.scripted_operator import (
    ANSWER_TIMEOUT_S,
    DRIVE_TIMEOUT_S,
    DemoSimulation,
    ScriptedOperator,
    SimulatedBox,
)
from flexbt_sim.world import Point, RobotModel, World

ROBOT = 'robot'

INTRODUCTION = """
The robot is ready, and the behavior "{behavior}" asks you where to go: ":{place}" answers, "g" points at the map.
"?" shows the keys, "!" stops the robot, "q" ends the demonstration.
"""


def main() -> int:
    """Run the demonstration with the options of the command line. Return the exit code of the process."""
    terminal = sys.stdin.isatty() and sys.stdout.isatty()
    options = parse_options(sys.argv[1:], os.environ, terminal)
    return run_demonstration('demo', options, _run)


def _run(options: DemoOptions, group: ProcessGroup, timeline: Timeline) -> int:
    places = options.places or built_in_places()
    start = first_place(places) if options.map else None
    processes = demo_processes(DemoSettings(options.map, start, places, options.speed))
    if options.interactive:
        return _run_interactive(group, processes, DEMONSTRATIONS[options.demos[0]], timeline)
    return _run_scripts(options, processes, group, timeline)


def _run_interactive(
    group: ProcessGroup, processes: Sequence[Process], demonstration: Demonstration, timeline: Timeline
) -> int:
    """Start the processes and the behavior, run the console in the terminal, and return the console's exit code."""
    with open_session(group, processes, 'demo', timeline) as session:
        place = session.operator.places(('kitchen',))[0]
        session.operator.start(demonstration.behavior, AutonomyLevel.HIGH)
        session.operator.wait_state('/AskGoal')
    print(INTRODUCTION.format(behavior=demonstration.behavior, place=place), end='')
    page = serve_page(group)
    print(page_line(page), flush=True)
    return run_console(group, console_command(page=page))


def _run_scripts(options: DemoOptions, processes: Sequence[Process], group: ProcessGroup, timeline: Timeline) -> int:
    with open_session(group, processes, 'script', timeline) as session:
        timeline.tell('demo', 'everything is ready')
        for number in options.demos:
            simulation = DemoSimulation(session.runtime, timeline, options.speed)
            report = _run_script(DEMONSTRATIONS[number], session, None if options.map else simulation, timeline)
            world = _world(report, session.track, simulation.boxes)
            if exit_code := report.conclude(world, {ROBOT: session.track}, options.output / f'demo{number}.png'):
                return exit_code
    return 0


def _run_script(
    demonstration: Demonstration, session: DemoSession, simulation: DemoSimulation | None, timeline: Timeline
) -> DemoReport:
    report = demonstration.report(with_boxes=simulation is not None)
    timeline.tell('demo', report.title)
    session.track.restart()
    report.play(lambda: demonstration.script(session.operator, simulation, report))
    return report


def _world(report: DemoReport, track: RobotTrack, boxes: Mapping[str, SimulatedBox]) -> World:
    """Return the world of the picture: the robot at its start, the goals, and all boxes that were placed."""
    world = World(track.map, places={goal.label: goal.pose for goal in report.goals})
    world.add(ROBOT, RobotModel(), track.way[0][1])
    for name, box in boxes.items():
        world.add(name, box.model)
    return world


# The actions of the scripted operator in the two demonstrations, and the branches that each must take.
#
# On the included map the script puts boxes in the way. The robot drives round one; another blocks a doorway, so the
# robot only arrives after a recovery. On a user's own map the doorways are unknown.


@dataclass(frozen=True)
class Demonstration:
    """A demonstration: number, title, behavior, branches, the branches that need boxes, and its script.

    Without boxes the script gets no simulation.
    """

    number: int
    title: str
    behavior: str
    branches: tuple[str, ...]
    box_branches: tuple[str, ...]
    script: Callable[[ScriptedOperator, DemoSimulation | None, DemoReport], None]

    def report(self, with_boxes: bool = True) -> DemoReport:
        """Return an empty report for this demonstration."""
        branches = self.branches + (self.box_branches if with_boxes else ())
        return DemoReport(f'Demonstration {self.number}: {self.title}', branches)


CRATE = SimulatedBox(4.4, 2.67, 0.4, 0.4)
"""Crate in the office, with room to pass."""

LOUNGE_DOOR = SimulatedBox(10.1, 5.48, 0.9, 0.3)
"""Box in the only doorway of the lounge; nothing can pass it."""

STORE_PASSAGE = SimulatedBox(6.8, 5.25, 0.6, 0.3)
"""Box before the only passage to the store; the corridor has room for a recovery."""

INTERVENTION_SPEED = 3.0
"""Maximum speed factor while the operator intervenes: at ten times real time, a drive is over within three seconds."""

REACHED = 'goal reached'
DRIVEN_ROUND = 'a box on the way: driven round'
RECOVERED = 'a blocked doorway: recovery until it is free'
REPLACED = 'goal replaced on the way'
REPLACEMENT_REACHED = 'the goal in its place reached'
FINISHED = 'finished by the operator'


def navigate(operator: ScriptedOperator, simulation: DemoSimulation | None, report: DemoReport) -> None:
    """Drive to one goal, round a box. On the way to the second goal, replace it by a third, whose door is blocked."""
    first, second, third = operator.places(('kitchen', 'office', 'lounge'))
    operator.start('Navigate', AutonomyLevel.HIGH)

    with _slowly(simulation):
        operator.give_goal(first)
        operator.wait_state('/Drive')
        if simulation is not None:
            _put_ahead(operator, simulation, 'crate', CRATE)
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(REACHED)
    if simulation is not None:
        simulation.take_away('crate')
        report.take(DRIVEN_ROUND)

    with _slowly(simulation):
        operator.give_goal(second)
        operator.wait_driven(2.0)
        operator.force('/Drive', 'canceled')
    operator.wait_rest()
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('replaced on the way', must_reach=False))
    report.take(REPLACED)

    with _slowly(simulation):
        operator.give_goal(third)
        if simulation is not None:
            _free_by_recovery(operator, simulation)
            report.take(RECOVERED)
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(REPLACEMENT_REACHED)

    operator.decline()
    operator.wait_end('finished')
    report.take(FINISHED)


ACCEPTED = 'plan accepted, goal reached'
ANOTHER_GOAL = 'another goal instead of the plan'
REJECTED = 'plan sent to recovery'
RECOVERY_FORCED = 'driving sent to recovery'
STOPPED = 'behavior stopped while driving'
AUTONOMOUS = 'plan accepted by the robot itself'
RECOVERY_ABORTED = 'recovery aborted, behavior failed'
STUCK = 'following failed at a box: recovery by itself'


def navigate_split(operator: ScriptedOperator, simulation: DemoSimulation | None, report: DemoReport) -> None:
    """Take every branch of the second behavior.

    On the way to the first goal a box blocks the passage until the robot has failed to follow its path and recovers.
    Then the goal is sent again.
    """
    first, second, third = operator.places(('store', 'workshop', 'kitchen'))
    operator.start('Navigate Split', AutonomyLevel.HIGH)

    operator.give_goal(first)
    with _slowly(simulation):
        operator.choose(_wait_plan(operator), 'done')
        if simulation is not None:
            _put_ahead(operator, simulation, 'cupboard', STORE_PASSAGE)
    if simulation is not None:
        operator.wait_begun('Recover')
        simulation.take_away('cupboard')
        _wait_asked_again(operator)
        report.goals.append(operator.close_goal('blocked, recovered', must_reach=False))
        report.take(STUCK)
        operator.give_goal(first)
        operator.choose(_wait_plan(operator), 'done')
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(ACCEPTED)

    operator.give_goal(second)
    operator.choose(_wait_plan(operator), 'canceled')
    _wait_asked_again(operator)
    report.take(ANOTHER_GOAL)

    operator.give_goal(third)
    with _slowly(simulation):
        operator.choose(_wait_plan(operator), 'failed')
        operator.wait_state('/Recover')
    _wait_asked_again(operator)
    report.take(REJECTED)

    operator.give_goal(third)
    with _slowly(simulation):
        operator.choose(_wait_plan(operator), 'done')
        operator.wait_driven(3.2)
        operator.force('/FollowPath', 'failed')
        operator.wait_state('/Recover')
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('sent to recovery', must_reach=False))
    report.take(RECOVERY_FORCED)

    operator.give_goal(third)
    with _slowly(simulation):
        operator.choose(_wait_plan(operator), 'done')
        operator.wait_driven(1.0)
        operator.stop()
    operator.wait_rest()
    operator.wait_end('preempted')
    report.goals.append(operator.close_goal('stopped by the operator', must_reach=False))
    report.take(STOPPED)

    operator.start('Navigate Split', AutonomyLevel.FULL)
    operator.give_goal(third)
    _wait_asked_again(operator)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(AUTONOMOUS)

    with _slowly(simulation):
        operator.give_goal(second)
        operator.wait_driven(1.0)
        operator.force('/FollowPath', 'failed')
        operator.wait_state('/Recover')
        operator.force('/Recover', 'failed')
    operator.wait_rest()
    operator.wait_end('failed')
    report.goals.append(operator.close_goal('given up', must_reach=False))
    report.take(RECOVERY_ABORTED)


DEMONSTRATIONS = {
    1: Demonstration(
        1,
        'one tree navigates',
        'Navigate',
        (REACHED, REPLACED, REPLACEMENT_REACHED, FINISHED),
        (DRIVEN_ROUND, RECOVERED),
        navigate,
    ),
    2: Demonstration(
        2,
        'planner, controller and recovery are three trees',
        'Navigate Split',
        (ACCEPTED, ANOTHER_GOAL, REJECTED, RECOVERY_FORCED, STOPPED, AUTONOMOUS, RECOVERY_ABORTED),
        (STUCK,),
        navigate_split,
    ),
}


def _slowly(simulation: DemoSimulation | None) -> AbstractContextManager[None]:
    """Limit the speed so that an operator on a busy computer can intervene on the way."""
    return nullcontext() if simulation is None else simulation.no_faster_than(INTERVENTION_SPEED)


def _put_ahead(operator: ScriptedOperator, simulation: DemoSimulation, name: str, box: SimulatedBox) -> None:
    """Wait until the robot drives, then put a box on its path, far ahead of it."""
    with simulation.in_real_time():
        operator.wait_driven(0.2)
        where = f'a plan that leads over ({box.x:g}, {box.y:g}), where the {name} shall be left'
        operator.wait(lambda _view: _crosses(operator.track.plans[-1:], box), where, ANSWER_TIMEOUT_S)
        simulation.put(name, box)


def _crosses(plans: Sequence[Sequence[Point]], box: SimulatedBox) -> bool:
    """Return whether a planned path crosses a box."""
    points = (point for plan in plans for point in plan)
    return any(abs(x - box.x) < box.length / 2.0 and abs(y - box.y) < box.width / 2.0 for x, y in points)


def _free_by_recovery(operator: ScriptedOperator, simulation: DemoSimulation) -> None:
    """Block the only doorway, and free it when the tree starts a recovery; without recovery the drive would fail.

    Run in real time, because the recoveries take only about ten seconds.
    """
    _put_ahead(operator, simulation, 'cupboard', LOUNGE_DOOR)
    with simulation.in_real_time():
        operator.wait_begun('RecoveryActions')
        simulation.take_away('cupboard')


def _wait_asked_again(operator: ScriptedOperator) -> Decision:
    """Wait until the behavior asks for the next goal, after the drive."""
    return operator.wait_decision(DecisionKind.INPUT, '/AskGoal', DRIVE_TIMEOUT_S)


def _wait_plan(operator: ScriptedOperator) -> Decision:
    """Wait until the operator is asked to judge the plan."""
    return operator.wait_decision(DecisionKind.CHOICE, '/JudgePath', ANSWER_TIMEOUT_S)
