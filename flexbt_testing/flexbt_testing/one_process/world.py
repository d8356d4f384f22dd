# SPDX-License-Identifier: BSD-3-Clause
"""A robot with its operator in one process, for tests of missions."""

from __future__ import annotations

import importlib
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from .graph import DOMAIN
from .product import install, kill
from .scheduler import BOOT, EPOCH, SCHEDULER, SECOND, Process

install()

from ament_index_python.packages import get_package_share_directory  # noqa: E402 - in the world
from geometry_msgs.msg import PoseStamped  # noqa: E402

from flexbt_common import names  # noqa: E402
from flexbt_common.runtime.node_runtime import NodeRuntime  # noqa: E402
from flexbt_console.commands.command_builder import CommandBuilder  # noqa: E402
from flexbt_console.link.operator_link import ExecutiveLink  # noqa: E402
from flexbt_console.mirror.command_tracker import CommandState  # noqa: E402
from flexbt_console.mirror.mirror import Change, Mirror  # noqa: E402
from flexbt_console.mirror.records import AutonomyLevel, CommandKind, Decision, ExecutiveState  # noqa: E402
from flexbt_console.mirror.view import View  # noqa: E402
from flexbt_sim.world import Pose  # noqa: E402

ANSWER_SECONDS: Final = 60.0
"""Simulated time that the operator waits for a decision or for the effect of a command, s."""

REST_SPEED: Final = 0.01
REST_TURN: Final = 0.02
"""Speeds below which the robot is at rest, m/s and rad/s."""

Parameters = Mapping[str, Any]


@dataclass(frozen=True)
class Program:
    """An executable of a package, with the parameters of its node and its namespace."""

    package: str
    executable: str
    parameters: Parameters = field(default_factory=dict)
    namespace: str = ''

    def arguments(self) -> list[str]:
        """Return the ROS arguments of the process."""
        words = ['--ros-args']
        if self.namespace:
            words += ['-r', f'__ns:=/{self.namespace}']
        for name, value in self.parameters.items():
            words += ['-p', f'{name}:={_yaml(value)}']
        return words


def _yaml(value: Any) -> str:
    import yaml

    return str(yaml.safe_dump(value, default_flow_style=True, width=10_000)).removesuffix('\n').removesuffix('\n...')


def robot_programs(
    places: str = '', simulator: Parameters | None = None, server: Parameters | None = None
) -> list[Program]:
    """Return the programs of a simulated robot: simulator, navigation, BT server, stop guard and executive.

    ``places`` is the YAML file of named places, by default that of the built-in map. The others are further parameters.
    """
    built_in = Path(get_package_share_directory('flexbt_sim')) / 'maps' / 'rooms_places.yaml'
    clock = {'use_sim_time': True}
    return [
        Program('flexbt_sim', 'simulator', {'odom_rate': 20.0, **(simulator or {})}),
        Program('flexbt_navigation', 'navigation', clock),
        Program('flexbt_server', 'bt_server', {**clock, **(server or {})}),
        Program('flexbt_onboard', 'stop_guard'),
        Program('flexbt_onboard', 'onboard_executive', {**clock, 'places': places or str(built_in)}),
    ]


class TrackedRobot:
    """The simulated robot as it really is: no link is between it and the test."""

    def __init__(self, places: Callable[[str], Pose]) -> None:
        self.pose: Pose | None = None
        self.at_rest = True
        """True if it neither drives nor turns."""
        self.length = 0.0
        """Length of the path that it has driven, m."""
        self._places = places
        self._time = 0.0

    def near(self, place: str, distance: float) -> bool:
        """Return whether it is within a distance of a named place, m."""
        return self.pose is not None and self.pose.distance(self._places(place)) <= distance

    def add_pose(self, pose: Pose, time: float) -> None:
        """Add the pose at a simulated time, s."""
        before, passed = self.pose, time - self._time
        if before is not None and passed > 0.0:
            driven = before.distance(pose)
            turned = abs(math.remainder(pose.yaw - before.yaw, math.tau))
            self.at_rest = driven <= REST_SPEED * passed and turned <= REST_TURN * passed
            self.length += driven
        self.pose, self._time = pose, time


class World:
    """Processes of a robot, a scripted operator, and a clock that jumps to the next event.

    The same seed gives the same run, message for message. Seed 0 keeps the order in which tasks become ready; another
    one draws it. Open a world with ``with``; its files are in a directory of its own, which is removed at the end. An
    interpreter has one world at a time.
    """

    def __init__(self, seed: int = 0, programs: Sequence[Program] | None = None, operator: str = 'engineer') -> None:
        SCHEDULER.reset(seed)
        DOMAIN.reset()
        self.seed = seed
        self.programs = {program.executable: program for program in programs or robot_programs()}
        self.processes: dict[str, Process] = {}
        self.states: list[str] = []
        """The active states that the operator has seen, in order, several at a time joined by a comma."""
        self.robot = TrackedRobot(self.place)
        self._operator = operator
        self._answered: set[str] = set()

    def __enter__(self) -> World:
        self._home = Path(tempfile.mkdtemp(prefix='flexbt_world_'))
        self._environment = {name: os.environ.get(name) for name in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR')}
        os.environ.update(HOME=str(self._home), ROS_HOME=str(self._home / 'ros'), ROS_LOG_DIR=str(self._home / 'log'))
        for name in self.programs:
            self.launch(name)
        self._observer = NodeRuntime('observer', args=[])
        self._observer.call(self._observe)
        station = SCHEDULER.process('operator')
        with _acting_as(station):
            self._station = NodeRuntime('operator', args=[])
            self.mirror = Mirror(self._station.steady)
            self._link = ExecutiveLink(self._station, self.mirror)
        self._make = CommandBuilder(self._operator)
        self.mirror.add_listener(self._on_change)
        self.run_until(self._is_ready, 180.0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End all processes in order, those that are killed or stopped aside."""
        self._station.close()
        self._observer.close()
        for name in self.processes:
            self.terminate(name)
        self.run(3.0)
        for process in self.processes.values():
            if process.is_alive:
                kill(process)
        for name, value in self._environment.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
        shutil.rmtree(self._home, ignore_errors=True)

    # -- time

    @property
    def now(self) -> float:
        """Simulated time since the world began, s."""
        return (SCHEDULER.now - BOOT) / SECOND

    @property
    def wall(self) -> float:
        """Wall time of the world, s since the epoch."""
        return (EPOCH - BOOT + SCHEDULER.now) / SECOND

    def run(self, seconds: float) -> None:
        """Let the world go on for this time, s."""
        SCHEDULER.sleep(seconds)

    def run_until(self, condition: Callable[[View], object], within: float) -> None:
        """Let the world go on until a condition of the operator's view holds.

        Raises:
            AssertionError: it did not hold within this time, s.
        """
        until = SCHEDULER.after(within)
        while not condition(self.view):
            view = self.view
            assert SCHEDULER.now < until, (
                f'not within {within:g} s: the executive is {view.snapshot and view.snapshot.state.name} in '
                f'{", ".join(view.active_paths) or "no state"}, link {view.link.value}; states: {self.states}'
            )
            SCHEDULER.sleep(0.02)

    def at(self, time: float, act: Callable[[], object]) -> None:
        """Call ``act`` at a time of this world, s, on a thread of its own."""
        SCHEDULER.call_at(
            BOOT + int(time * SECOND), lambda: SCHEDULER.spawn(act, f'at {time:g} s', SCHEDULER.main.process)
        )

    # -- processes

    def launch(self, name: str) -> Process:
        """Start a program of the world."""
        program = self.programs[name]
        process = SCHEDULER.process(name)
        process.arguments = program.arguments()
        main: Callable[[], int] = getattr(importlib.import_module(f'{program.package}.executables'), program.executable)

        def body() -> None:
            try:
                process.exit_code = main()
            finally:
                process.is_alive = False

        self.processes[name] = process
        SCHEDULER.spawn(body, 'MainThread', process)
        return process

    def kill(self, name: str) -> None:
        """End a process as SIGKILL does."""
        kill(self._alive(name))

    def terminate(self, name: str) -> None:
        """Send SIGTERM; no effect on a process that has ended."""
        process = self.processes[name]
        if process.is_alive and process.signal is not None:
            process.signal()

    def restart(self, name: str) -> None:
        """Start a process that has ended again."""
        assert not self.processes[name].is_alive, f'{name} runs; kill or terminate it first'
        self.launch(name)

    def hold_up(self, name: str) -> None:
        """Stop a process as SIGSTOP does, until :meth:`resume`."""
        SCHEDULER.hold_up(self._alive(name))

    def resume(self, name: str) -> None:
        """Let a stopped process continue, as SIGCONT does."""
        SCHEDULER.resume(self._alive(name))

    def _alive(self, name: str) -> Process:
        process = self.processes[name]
        assert process.is_alive, f'{name} has ended already, with exit code {process.exit_code}'
        return process

    # -- the operator

    @property
    def view(self) -> View:
        """What the operator sees."""
        return self.mirror.view()

    def start(self, behavior: str, autonomy: str = 'High', **arguments: str) -> None:
        """Start a behavior at a level of autonomy: Off, Low, High or Full."""
        level = AutonomyLevel[autonomy.upper()]
        self._give(self._make.start(self.view, behavior, list(arguments.items()), level))
        self.run_until(lambda view: view.running, ANSWER_SECONDS)

    def answer(self, state: str, answer: str) -> None:
        """Answer the question of a state, once it asks: with a place, an outcome, or a value as text."""
        self.run_until(self.asks(state), ANSWER_SECONDS)
        decision = next(one for one in self.view.decisions if self._is_open(one, state))
        self._answered.add(decision.id)
        self._give(self._make.answer(self.view, decision.id, answer))

    def choose(self, state: str, outcome: str) -> None:
        """Choose an outcome of a state that waits for it, or confirm or overrule its transition."""
        self.run_until(self.asks(state), ANSWER_SECONDS)
        decision = next(one for one in self.view.decisions if self._is_open(one, state))
        self._answered.add(decision.id)
        self._give(self._make.choose(self.view, decision, outcome))

    def force(self, state: str, outcome: str) -> None:
        """Leave an active state that has not asked."""
        self._give(self._make.force(self.view, state, outcome))

    def stop(self) -> None:
        """Stop the run."""
        self._give(self._make.command(self.view, CommandKind.STOP))

    def asks(self, state: str) -> Callable[[View], bool]:
        """Return the condition that a state asks something that is not answered yet."""
        return lambda view: any(self._is_open(one, state) and not view.lacks(one) for one in view.decisions)

    def ended(self, outcome: str) -> Callable[[View], bool]:
        """Return the condition that the run has ended with this outcome."""

        def has_ended(view: View) -> bool:
            snapshot = view.snapshot
            return snapshot is not None and snapshot.state is ExecutiveState.IDLE and snapshot.outcome == outcome

        return has_ended

    def place(self, name: str) -> Pose:
        """Return the pose of a named place."""
        place = self.view.places[name]
        return Pose(place.x, place.y, place.yaw)

    def _is_open(self, decision: Decision, state: str) -> bool:
        return decision.path == state and decision.id not in self._answered

    def _give(self, command: Any) -> None:
        """Send a command and wait until it is applied."""
        tracked = self._link.send(replace(command, reason='of a test'), ANSWER_SECONDS)

        def is_settled(_view: View) -> bool:
            nonlocal tracked
            tracked = self.mirror.command(command.id) or tracked
            return tracked.state is not CommandState.PENDING

        self.run_until(is_settled, 2.0 * ANSWER_SECONDS)
        assert tracked.state is CommandState.APPLIED, f'{command.kind.name}: {tracked.state.value}, {tracked.reason}'

    def _is_ready(self, view: View) -> bool:
        peers = view.snapshot.peers if view.snapshot else ()
        nodes = len(self.programs) - 1
        is_there = len(peers) >= nodes and all(peer.alive and peer.ready for peer in peers)
        return view.live and is_there and view.behaviors is not None and view.has_places and self.robot.pose is not None

    def _on_change(self, change: Change) -> None:
        if change is not Change.STATUS:
            return
        active = ', '.join(self.view.active_paths)
        if active and (not self.states or active != self.states[-1]):
            self.states.append(active)

    def _observe(self) -> None:
        def on_pose(message: Any) -> None:
            stamp, place, turn = message.header.stamp, message.pose.position, message.pose.orientation
            pose = Pose(place.x, place.y, 2.0 * math.atan2(turn.z, turn.w))
            self.robot.add_pose(pose, stamp.sec + 1e-9 * stamp.nanosec)

        self._observer.node.create_subscription(PoseStamped, names.POSE, on_pose, 100)


@contextmanager
def _acting_as(process: Process) -> Iterator[None]:
    """Make the current task one of another process."""
    before, SCHEDULER.current.process = SCHEDULER.current.process, process
    try:
        yield
    finally:
        SCHEDULER.current.process = before
