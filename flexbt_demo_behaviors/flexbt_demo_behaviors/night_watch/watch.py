# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``night_watch``: two robots supervised by one person at consoles, or by a scripted operator.

It contains the process table that it shares with the launch file, an operator for each robot, and the events in the
building.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.mirror.records import AutonomyLevel, Decision, DecisionKind
from flexbt_core.values.text import escape_lines
from flexbt_demo_behaviors.demonstration.demo_processes import (
    ODOM_RATE,
    SIMULATED,
    Process,
    console_command,
    demo_file,
    mission_processes,
)
from flexbt_demo_behaviors.demonstration.process_group import EndedProcess, ProcessGroup
from flexbt_demo_behaviors.demonstration.report import (
    DemoError,
    DemoReport,
    GoalResult,
    RobotTrack,
    Timeline,
    pose_text,
    world_with_places,
)
from flexbt_demo_behaviors.demonstration.running import (
    READY_TIMEOUT_S,
    DemoSession,
    RunOptions,
    join_robot,
    page_line,
    parse_run_options,
    run_console,
    run_demonstration,
    serve_page,
    tell_ended,
)
from flexbt_demo_behaviors.demonstration.scripted_operator import (
    ANSWER_TIMEOUT_S,
    DRIVE_TIMEOUT_S,
    DemoSimulation,
    ScriptedOperator,
)
from flexbt_sim.messages import pose_of
from flexbt_sim.world import Pose, World

from .states import ROOMS_LEFT

ROBOTS: Final = ('alpha', 'beta')

SPEED: Final = 0.7
"""Speed on a free, straight path, m/s: the maximum speed of the robots in the world file."""


WORLD: Final = demo_file('night_watch/building.yaml')
PLACES: Final = demo_file('night_watch/places.yaml')


def watch_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulator, and for each robot navigation, BT server, stop guard and executive.

    ``speed`` is in simulated seconds per second.
    """
    world = Process('flexbt_sim', 'simulator', {'speed_factor': speed, 'world': WORLD, 'odom_rate': ODOM_RATE})
    return (world, *(process for robot in ROBOTS for process in robot_processes(robot)))


def robot_processes(robot: str) -> tuple[Process, ...]:
    """Return the processes of one robot."""
    return (
        Process('flexbt_navigation', 'navigation', {**SIMULATED, 'desired_linear_vel': SPEED}, robot),
        *mission_processes(PLACES, namespace=robot),
    )


def log_name(process: Process) -> str:
    """Return the name of a process, also that of its log file."""
    return f'{process.namespace}_{process.name}' if process.namespace else process.name


ROUNDS: Mapping[str, Mapping[str, str]] = {
    'alpha': {'rooms': 'lab store office', 'home': 'alpha_dock', 'partner': 'beta'},
    'beta': {'rooms': 'archive lobby', 'home': 'beta_dock', 'partner': 'alpha'},
}
"""Arguments for the start of each robot's behavior."""


@dataclass
class Watch:
    """A night watch that is ready to start."""

    group: ProcessGroup
    building: Building
    sessions: Mapping[str, DemoSession]
    timeline: Timeline

    def operator(self, robot: str) -> ScriptedOperator:
        """Return the operator of a robot."""
        return self.sessions[robot].operator

    def track(self, robot: str) -> RobotTrack:
        """Return the track of a robot."""
        return self.sessions[robot].track

    def start(self) -> None:
        """Start the rounds of both robots."""
        for robot in ROBOTS:
            self.operator(robot).start('Night Watch', AutonomyLevel.HIGH, **ROUNDS[robot])

    def lose(self, robot: str) -> None:
        """Kill all processes of a robot at once, as a failure of its computer would."""
        self.timeline.tell('building', f'{robot} is lost')
        self.group.kill(*(log_name(process) for process in robot_processes(robot)))

    def notify(self) -> None:
        """Notify the operators to check their conditions again."""
        for session in self.sessions.values():
            session.operator.notify()

    def on_end(self, ended: EndedProcess) -> None:
        """Abort the scripts because a process has ended unexpectedly."""
        for session in self.sessions.values():
            session.operator.abandon(ended.report())


@contextlib.contextmanager
def open_watch(group: ProcessGroup, speed: float, timeline: Timeline) -> Iterator[Watch]:
    """Start the processes in `group`, wait until both robots are ready, and connect to them while the context is open.

    Raises DemoError if they are not ready in time, or if one of the processes dies meanwhile.
    """
    for process in watch_processes(speed):
        group.start(log_name(process), process.command(), respawn=True)
    with contextlib.ExitStack() as stack:
        runtime = stack.enter_context(NodeRuntime.open('night_watch'))
        sessions = {
            robot: stack.enter_context(join_robot('watchman', timeline.of(robot), robot)) for robot in ROBOTS
        }  # fmt: skip
        building = Building(runtime, ROBOTS, timeline, lambda: watch.notify())
        watch = Watch(group, building, sessions, timeline)
        group.watch(watch.on_end)
        for robot in ROBOTS:
            watch.operator(robot).wait_ready(peers=len(robot_processes(robot)), timeout=READY_TIMEOUT_S)
        yield watch


# Events in the building during a watch, caused through services of the simulator, and the reports of the robots.

DOOR: Final = 'archive_door'

LOW: Final = 0.25
FULL: Final = 0.85
"""Fractions of the capacity at which a battery counts as low, and as charged."""


class Building:
    """A building with simulated faults, whose rooms and alarms are observed.

    It calls `on_change` on another thread at each observation.
    """

    def __init__(
        self, runtime: NodeRuntime, robots: Sequence[str], timeline: Timeline, on_change: Callable[[], None]
    ) -> None:
        self._simulation = DemoSimulation(runtime, timeline)
        self._timeline = timeline
        self._on_change = on_change
        self.rooms_left: Mapping[str, tuple[str, ...]] = {}
        """Rooms that each robot has yet to look at, from its last report."""
        self.alarms: list[tuple[str, Pose]] = []
        """Alarms so far: the robot that raised each, and the reported pose."""
        self.charged: set[str] = set()
        """Robots whose battery was low and is charged again."""
        self._low: set[str] = set()
        runtime.call(lambda: self._subscribe(runtime, robots))

    def lower_battery(self, robot: str) -> None:
        """Drain the battery of a robot to a low level."""
        self._simulation.set_fault(robot, 'battery_low', 'level: 0.1')
        self._timeline.tell('building', f'the battery of {robot} runs low')

    def mend_door(self) -> None:
        """Repair the jammed door."""
        self._simulation.set_fault(DOOR, 'door_jammed', clear=True)
        self._timeline.tell('building', f'{DOOR} is mended')

    def _subscribe(self, runtime: NodeRuntime, robots: Sequence[str]) -> None:
        node = runtime.node
        for robot in robots:
            node.create_subscription(
                String, f'{robot}/{ROOMS_LEFT}', partial(self._on_left, robot), names.transient_local_qos()
            )
            battery = partial(self._on_battery, robot)
            node.create_subscription(BatteryState, f'{robot}/battery_state', battery, QoSProfile(depth=10))
            alarm = partial(self._on_alarm, robot)
            node.create_subscription(PoseStamped, f'{robot}/alarm', alarm, QoSProfile(depth=10))

    def _on_left(self, robot: str, message: String) -> None:
        self.rooms_left = {**self.rooms_left, robot: tuple(message.data.split())}
        self._on_change()

    def _on_battery(self, robot: str, message: BatteryState) -> None:
        if message.percentage <= LOW:
            self._low.add(robot)
        elif message.percentage >= FULL and robot in self._low:
            self.charged.add(robot)
            self._on_change()

    def _on_alarm(self, robot: str, message: PoseStamped) -> None:
        self.alarms.append((robot, pose_of(message.pose)))
        self._on_change()


def main() -> int:
    """Run the night watch with the options of the command line. Return the exit code of the process."""
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


# The interactive night watch: a person at the consoles of both robots also controls the events in the building.

INTRODUCTION = """
Both robots are on their rounds; the door of the archive is jammed. Which robot do you look after, or what happens?

  alpha, beta      its screen: "?" shows the keys, "o" both robots, "q" leads back here
  mend             the door is mended
  battery ROBOT    its battery runs low
  lose ROBOT       its computer dies
  end              the night is over
"""


def run_interactive(watch: Watch, read: Callable[[str], str] = input) -> None:
    """Start the rounds, and execute the operator's commands until the night is over; `read` returns the lines."""
    watch.start()
    page = serve_page(watch.group)
    print(INTRODUCTION + page_line(page), flush=True)
    while True:
        tell_ended(watch.group)
        try:
            words = read('night watch> ').split()
        except EOFError:
            return
        except UnicodeDecodeError:  # some terminals erase only a part of a character
            words = ['?']
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


# The actions of the scripted operator of the night watch, and the branches that must be taken.

DOOR_JAMMED: Final = 'a door jams: that room later'
CHARGED: Final = 'battery low: charged, the round continues'
LOST: Final = 'a robot is lost: the other one takes over'
SWITCHED: Final = 'a further room, given at run time'
HARMLESS: Final = 'something found, judged harmless'
ALARM: Final = 'something found, alarm raised'
DOOR_OPENED: Final = 'the room behind the mended door'
FINISHED: Final = 'sent home by the operator'
BRANCHES: Final = (DOOR_JAMMED, CHARGED, LOST, SWITCHED, HARMLESS, ALARM, DOOR_OPENED, FINISHED)

TITLE: Final = 'Demonstration 3: two robots on night watch'

THERE: Final = 1.0
"""A robot that came this near to the place of a room was in it, m. On a busy computer some poses are missed."""

NEAR: Final = 1.0
"""Maximum distance between an alarm and the obstacle that it reports, m."""


def night_watch(watch: Watch, report: DemoReport) -> None:
    """Run a night with all events of the script."""
    alpha, beta, building = watch.operator('alpha'), watch.operator('beta'), watch.building
    watch.start()

    door = _wait_choice(watch, 'beta', '/Watch/Round/JudgeDoor')
    building.mend_door()
    beta.choose(door, 'later')
    report.take(DOOR_JAMMED)
    building.lower_battery('beta')

    # Before the operator judges alpha's finding, its battery gets low. It drives to its dock, and is lost there.
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
    """Wait until a state of a robot asks the operator for a decision."""
    return watch.operator(robot).wait_decision(DecisionKind.CHOICE, path, DRIVE_TIMEOUT_S)


def _wait_looked_at(watch: Watch, rooms: set[str]) -> None:
    """Wait until beta reports none of the rooms as left."""
    watch.operator('beta').wait(
        lambda _view: not rooms & set(watch.building.rooms_left['beta']),
        f'{", ".join(sorted(rooms))} looked at by beta',
        ANSWER_TIMEOUT_S,
    )


def _check_alarm(watch: Watch, name: str) -> None:
    """Check that the first alarm is at an obstacle of the world file."""
    building = watch.building
    robot, pose = watch.operator('beta').wait(
        lambda _view: building.alarms[0] if building.alarms else None, 'alarm', ANSWER_TIMEOUT_S
    )  # fmt: skip
    distance = pose.distance(World.load(WORLD).obstacles[name].pose)
    watch.timeline.tell('building', f'{robot} raises the alarm: {distance:.2f} m from the {name}')
    if distance > NEAR:
        raise DemoError(f'the alarm of {robot} is about {pose_text(pose)}, {distance:.2f} m from the {name}')


def _visit(watch: Watch, robot: str, room: str) -> GoalResult:
    """Return how near a robot came to a place. Raises DemoError if it was not there."""
    place = world_with_places(WORLD, PLACES).places[room]
    error = min(place.distance(pose) for _, pose in watch.track(robot).way)
    result = GoalResult(room, place, f'{robot} was there', error, error <= THERE)
    if not result.reached:
        raise DemoError(f'{robot} was never nearer than {error:.2f} m to {room} {pose_text(place)}')
    return result
