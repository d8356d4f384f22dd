# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``nav2_robot``: a Nav2 robot and its program, with a console or a scripted operator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from flexbt_common import names
from flexbt_console.mirror.records import DecisionKind
from flexbt_demo_behaviors.demonstration.demo_processes import (
    ParameterValue,
    Process,
    console_command,
    demo_file,
    mission_processes,
    only_robot,
)
from flexbt_demo_behaviors.demonstration.process_group import EndedProcess, ProcessGroup
from flexbt_demo_behaviors.demonstration.report import DemoError, DemoReport, Timeline, world_with_places
from flexbt_demo_behaviors.demonstration.running import (
    DemoSession,
    RunOptions,
    open_session,
    parse_run_options,
    run_console,
    run_demonstration,
)
from flexbt_demo_behaviors.demonstration.scripted_operator import (
    DRIVE_TIMEOUT_S,
    DemoSimulation,
    SimulatedBox,
    call_service,
)
from flexbt_msgs.srv import ControlTree

FOLDER: Final = 'flexbt_demo_behaviors/nav2_robot'

PROGRAM: Final = Process('flexbt_demo_behaviors', 'deliveries')
"""The program that drives the robot."""

WORLD: Final = demo_file('nav2_robot/warehouse.yaml')
PLACES: Final = demo_file('nav2_robot/places.yaml')


def robot_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulation with its navigation, and the other processes of the robot, except the program.

    ``speed`` is in simulated seconds per second.
    """
    navigators: Mapping[str, ParameterValue] = {
        'navigators': (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS),
        'default_nav_to_pose_bt_xml': f'{FOLDER}/navigate_to_pose.xml',
        'default_nav_through_poses_bt_xml': f'{FOLDER}/navigate_through_poses.xml',
    }
    return only_robot(speed, WORLD), *mission_processes(PLACES, navigators)


INTRODUCTION = """
The program drives the robot to the shelf, and asks you then. "?" shows the keys, "!" stops what drives, "q" ends all.
"""


def main() -> int:
    """Run the demonstration with the options of the command line. Return the exit code of the process."""
    options = parse_run_options('nav2_robot', 'A program drives a robot of Nav2, under an operator.')
    return run_demonstration('nav2_robot', options, _run)


def _run(options: RunOptions, group: ProcessGroup, timeline: Timeline) -> int:
    processes = robot_processes(options.speed)
    with open_session(group, processes, 'operator', timeline, is_on_call=True) as session:
        if not options.interactive:
            return _run_script(options, group, session, timeline)
    group.start(PROGRAM.name, PROGRAM.command())
    print(INTRODUCTION, flush=True)
    return run_console(group, console_command())


def _run_script(options: RunOptions, group: ProcessGroup, session: DemoSession, timeline: Timeline) -> int:
    warehouse = Warehouse(options, group, session, timeline)
    session.track.restart()
    report = DemoReport(TITLE, BRANCHES)
    report.play(lambda: supervise(warehouse, report))
    world = world_with_places(WORLD, PLACES)
    for name, box in warehouse.simulation.boxes.items():
        world.add(name, box.model)
    return report.conclude(world, {'robot': session.track}, options.output / 'demo4.png')


# The actions of the scripted operator while the program drives, and the branches that must be taken.

PAUSED: Final = "the program's drive paused, and resumed"
CONFIRMED: Final = 'the program asks, and continues as confirmed'
RECOVERED: Final = 'a blocked doorway: recovery until it is free'
REROUTED: Final = 'sent elsewhere before the program continues'
PREEMPTED: Final = "the program's round stopped by the operator"
HOME: Final = 'sent home, and arrived there'
BRANCHES: Final = (PAUSED, CONFIRMED, RECOVERED, REROUTED, PREEMPTED, HOME)

TITLE: Final = 'Demonstration 4: a robot of Nav2'

PACKING_DOOR: Final = SimulatedBox(7.5, 4.0, 1.1, 0.3)
"""Box in the only doorway of the packing room; nothing can pass it."""

TOLD: Final = (
    'to the shelf: SUCCEEDED',
    'Is the robot loaded? go_on',
    'to the packing room: SUCCEEDED',
    'Is the robot unloaded? go_on',
    'another round: CANCELED',
    'The round was broken off. What now? home',
    'home: SUCCEEDED',
)
"""Lines that the program prints about its tasks if everything goes as expected."""


class Warehouse:
    """The operator's view of the warehouse: the robot, the world, and the program with its log file."""

    def __init__(self, options: RunOptions, group: ProcessGroup, session: DemoSession, timeline: Timeline) -> None:
        self.operator = session.operator
        self.simulation = DemoSimulation(session.runtime, timeline, options.speed)
        self.timeline = timeline
        self.log = options.logs / f'{PROGRAM.name}.log'
        self.has_ended = False
        self._group = group
        self._runtime = session.runtime
        group.watch(self._on_end)

    def start_program(self) -> None:
        """Start the program that drives the robot."""
        self._group.start(PROGRAM.name, PROGRAM.command())

    def control_tree(self, command: int) -> ControlTree.Response:
        """Send the BT server a command for the tree that drives, and return the response."""
        request = ControlTree.Request(command=command)
        response: ControlTree.Response = call_service(self._runtime, ControlTree, names.CONTROL_TREE, request)
        return response

    def _on_end(self, ended: EndedProcess) -> None:
        if ended.name == PROGRAM.name and ended.exit_code == 0:
            self.has_ended = True
            self.operator.notify()
        else:
            self.operator.abandon(ended.report())


def supervise(warehouse: Warehouse, report: DemoReport) -> None:
    """Supervise a program from start to end."""
    operator, simulation = warehouse.operator, warehouse.simulation

    operator.expect_goal('shelf')
    with simulation.in_real_time():  # at ten times real time, an operator delayed by 1 s is too late
        warehouse.start_program()
        operator.wait_driven(1.0)
        _pause(warehouse)
    report.take(PAUSED)
    decision = operator.wait_decision(DecisionKind.CHOICE, '/Ask', DRIVE_TIMEOUT_S)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    operator.expect_goal('packing')
    with simulation.in_real_time():  # the recoveries of a tree take about ten seconds
        simulation.put('cupboard', PACKING_DOOR)  # while the robot stands, so that it cannot be past the door
        operator.choose(decision, 'go_on')
        report.take(CONFIRMED)
        operator.wait_begun('RecoveryActions')
        simulation.take_away('cupboard')
    decision = operator.wait_decision(DecisionKind.CHOICE, '/Ask', DRIVE_TIMEOUT_S)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    report.take(RECOVERED)

    operator.choose(decision, 'elsewhere')
    operator.give_goal('hatch', '/AskPlace')
    decision = operator.wait_decision(DecisionKind.CHOICE, '/Ask', DRIVE_TIMEOUT_S)
    report.goals.append(operator.close_goal('sent there', must_reach=True))
    report.take(REROUTED)

    operator.expect_goal('shelf')
    with simulation.in_real_time():
        operator.choose(decision, 'go_on')
        operator.wait_driven(1.0)
        operator.stop()
        operator.wait_rest()
    decision = operator.wait_decision(DecisionKind.CHOICE, '/Ask', DRIVE_TIMEOUT_S)
    report.goals.append(operator.close_goal('stopped on the way', must_reach=False))
    report.take(PREEMPTED)

    operator.expect_goal('dock')
    operator.choose(decision, 'home')
    operator.wait(lambda _view: warehouse.has_ended, 'end of the program', DRIVE_TIMEOUT_S)
    report.goals.append(operator.close_goal('arrived', must_reach=True))
    _check_told(warehouse.log, TOLD)
    report.take(HOME)


def _pause(warehouse: Warehouse) -> None:
    """Pause the tree that drives for the program, check that the robot stands still, and resume the tree."""
    for command, name in ((ControlTree.Request.PAUSE, 'pauses'), (ControlTree.Request.RESUME, 'resumes')):
        warehouse.timeline.tell('operator', f'{name} the tree that drives for the program')
        response = warehouse.control_tree(command)
        if not response.success:
            raise DemoError(f'the operator {name} the tree: {response.message}')
        if command == ControlTree.Request.PAUSE:
            warehouse.operator.wait_rest()
    warehouse.operator.wait_driven(1.0)


def _check_told(log: Path, expected: Sequence[str]) -> None:
    """Check the lines that the program has printed about its tasks."""
    told = [line for line in log.read_text().splitlines() if not line.startswith('[')]  # lines of loggers
    if told != list(expected):
        raise DemoError(f'the program says {told}, not {list(expected)}')
