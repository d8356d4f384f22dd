# SPDX-License-Identifier: BSD-3-Clause
"""A robot, or several, with an operator, in one process: for tests of missions."""

from __future__ import annotations

import gc
import itertools
import math
import os
import random
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from importlib.resources.abc import Traversable
from pathlib import Path
from types import TracebackType
from typing import Any, Final
from unittest import mock

from .graph import DOMAIN
from .network import OPERATOR, Network
from .product import end, install, terminate
from .scheduler import BOOT, SCHEDULER, SECOND, Alarm, Process, StuckWorldError

install()

import numpy  # noqa: E402 - in the world, as all that follows
import yaml  # noqa: E402
from ament_index_python.packages import get_package_share_directory  # noqa: E402
from rclpy.action import ActionClient  # noqa: E402
from rclpy.node import Node  # noqa: E402
from simulation_interfaces.srv import DeleteEntity, SpawnEntity  # noqa: E402

from flexbt_common import names  # noqa: E402
from flexbt_common.files import resolve_file  # noqa: E402
from flexbt_common.runtime import node_runtime  # noqa: E402
from flexbt_common.runtime.node_runtime import NodeRuntime  # noqa: E402
from flexbt_common.runtime.parameters import unknown_parameters  # noqa: E402
from flexbt_common.values.message_fields import seconds_of  # noqa: E402
from flexbt_console.commands.command_builder import CommandBuilder  # noqa: E402
from flexbt_console.link.operator_link import ExecutiveLink  # noqa: E402
from flexbt_console.mirror.command_tracker import CommandState  # noqa: E402
from flexbt_console.mirror.mirror import Change, Mirror  # noqa: E402
from flexbt_console.mirror.records import AutonomyLevel, CommandKind, Decision, ExecutiveState  # noqa: E402
from flexbt_console.mirror.view import View  # noqa: E402
from flexbt_core.state_machine.model.definition import ROOT_PATH  # noqa: E402
from flexbt_core.values.text import did_you_mean, one_line  # noqa: E402
from flexbt_msgs.action import BtGetData, BtLoad  # noqa: E402
from flexbt_msgs.msg import BehaviorStructure, TreeStatus, TreeStructure  # noqa: E402
from flexbt_msgs.srv import SetFault  # noqa: E402
from flexbt_onboard.behaviors import behavior_library  # noqa: E402
from flexbt_onboard.behaviors.behavior import ParameterValue, parameter_text  # noqa: E402
from flexbt_onboard.link.event_stream import EventStream  # noqa: E402
from flexbt_onboard.node import executive  # noqa: E402
from flexbt_sim.messages import pose_of  # noqa: E402
from flexbt_sim.world import Pose  # noqa: E402

from .boundary import BOUNDARY  # noqa: E402
from .coverage import COVERAGE  # noqa: E402
from .disk import DISK, Disk  # noqa: E402
from .forks import Branch, Fork, Leaf, fork_world  # noqa: E402
from .launching import launch  # noqa: E402
from .programs import Program, robot_programs  # noqa: E402
from .topics import read_topic  # noqa: E402
from .what_if import TEST, TOLERANCE, Comparison, Course, Event, compare, executive_event, tree_event  # noqa: E402

ANSWER_SECONDS: Final = 60.0
"""Simulated time that the operator waits for a decision or for the effect of a command, s."""

READY_SECONDS: Final = 180.0
"""Simulated time within which the programs of a world have to be ready, s."""

REST_SPEED: Final = 0.01
REST_TURN: Final = 0.02
"""Speeds below which the robot is at rest, m/s and rad/s."""

_NODES: Final = frozenset(('bt_server', 'stop_guard', 'navigation', 'simulation', 'abstract_robot'))
"""Programs that the executive waits for."""

_STORY_LENGTH: Final = 40


class Condition:
    """A condition of the operator's view; ``what`` tells it in words, ``hint`` why it may never hold.

    It is true if it holds now, for the operator of ``mission``.
    """

    def __init__(self, mission: Mission, holds: Callable[[View], bool], what: str, hint: Callable[[], str]) -> None:
        self._mission, self._holds, self._what, self._hint = mission, holds, what, hint

    def __call__(self, view: View) -> bool:
        return self._holds(view)

    def __bool__(self) -> bool:
        return self._holds(self._mission.view)

    def __repr__(self) -> str:
        return self._what + self._hint()


class TrackedRobot:
    """The simulated robot as it really is: no link is between it and the test."""

    def __init__(self, mission: Mission) -> None:
        self.pose: Pose | None = None
        self.at_rest = True
        """True if it neither drives nor turns."""
        self.length = 0.0
        """Length of the path that it has driven, m."""
        self._mission = mission
        self._time = 0.0

    def near(self, place: str, distance: float = 0.3) -> bool:
        """Return whether it is within a distance of a named place, m."""
        pose, goal = self.pose, self._mission.place(place)
        is_near = pose is not None and pose.distance(goal) <= distance
        if not is_near and pose is not None:
            self._mission.tell(f'test: the robot is {pose.distance(goal):.2f} m from {place}, more than {distance:g} m')
        return is_near

    def add_pose(self, pose: Pose, time: float) -> None:
        """Add the pose at a simulated time, s."""
        before, passed = self.pose, time - self._time
        if before is not None and passed > 0.0:
            driven = before.distance(pose)
            turned = abs(math.remainder(pose.yaw - before.yaw, math.tau))
            self.at_rest = driven <= REST_SPEED * passed and turned <= REST_TURN * passed
            self.length += driven
        self.pose, self._time = pose, time

    def __repr__(self) -> str:
        return f'<robot at {self.pose}, {"at rest" if self.at_rest else "moving"}, {self.length:.2f} m driven>'


class Mission:
    """The mission of one robot: what its operator sees and commands, and what it really does."""

    def __init__(self, world: World, namespace: str) -> None:
        self.namespace = namespace
        self.label = f'{namespace}: ' if namespace else ''
        """What begins each line about one of several robots."""
        self.states: list[str] = []
        """The active states that the operator has seen, in order, several at a time joined by a comma."""
        self.transitions: list[tuple[str, str]] = []
        """The states that were left, in order, each with its outcome."""
        self.robot = TrackedRobot(self)
        self._world = world
        self._answered: set[tuple[str, str]] = set()
        """Runs and identifiers of questions, which repeat in each run, and after each start of the executive."""
        self._trees: dict[tuple[str, int], Any] = {}

    def tell(self, text: str) -> None:
        """Add a line to what the report of a failed test says."""
        self._world.story.append(f'{self._world.now:8.2f} s  {self.label}{text}')

    def open(self, station: NodeRuntime, observer: NodeRuntime, operator: str) -> None:
        """Join the robot, as an operator and as an observer whom no link separates from it."""
        self.mirror = Mirror(station.steady)
        self._link = ExecutiveLink(station, self.mirror, operator, self._own)
        self._make = CommandBuilder(operator)
        self.mirror.add_listener(self._on_change)
        observer.call(lambda: self._observe(observer.node))

    # -- observation

    @property
    def view(self) -> View:
        """What the operator sees."""
        assert hasattr(self, 'mirror'), 'no program of this world is an onboard_executive, so it has no operator'
        return self.mirror.view()

    @property
    def decisions(self) -> dict[str, Decision]:
        """What waits for an answer of the operator, by the path of the state."""
        return {one.path: one for one in self.view.decisions if self._waits(one)}

    @property
    def outcome(self) -> str:
        """The outcome of the last run; '' before its end."""
        snapshot = self.view.snapshot
        return snapshot.outcome if snapshot is not None and not self.view.running else ''

    def run_until(self, condition: Callable[[View], object], within: float = ANSWER_SECONDS, what: str = '') -> None:
        """Let the world go on until a condition of the operator's view holds; ``what`` says which in the message.

        Raises:
            AssertionError: it did not hold within this time, s.
        """
        until = SCHEDULER.after(within)
        while not condition(self.view):
            assert SCHEDULER.now < until, f'{what or _told(condition)}: not within {within:g} s; {self._situation()}'
            SCHEDULER.sleep(0.02)

    def asks(self, state: str) -> Condition:
        """Return the condition that a state asks something that is not answered yet."""

        def asks(view: View) -> bool:
            return any(self._is_open(one, state) and not view.lacks(one) for one in view.decisions)

        return Condition(self, asks, f'a question of {state}', lambda: self._hint(state))

    def ended(self, outcome: str = '') -> Condition:
        """Return the condition that the run has ended, with this outcome if one is given."""

        def has_ended(view: View) -> bool:
            snapshot = view.snapshot
            if snapshot is None or snapshot.state is not ExecutiveState.IDLE:
                return False
            return snapshot.outcome == outcome if outcome else bool(snapshot.outcome)

        def hint() -> str:
            states = self.view.structure.states if self.view.structure else ()
            known = [name for one in states if one.path == '/' for name in one.outcomes]
            is_known = outcome in ('', *known) or not known
            return '' if is_known else f' (the behavior has no such outcome{did_you_mean(outcome, known)})'

        return Condition(self, has_ended, f'the end of the run{outcome and f" by {outcome}"}', hint)

    def place(self, name: str) -> Pose:
        """Return the pose of a named place."""
        known = self.view.places
        assert name in known, f'there is no place {name!r}; there are {", ".join(known)}'
        return Pose(known[name].x, known[name].y, known[name].yaw)

    def blackboard(self, key: str, blackboard: str = '') -> Any:
        """Return an entry of a blackboard of the BT server, by default of the one that all trees share.

        A message is a dictionary. Raises AssertionError if there is no such entry.
        """
        request = BtGetData.Goal(blackboard=blackboard, keys=[key], encoding=BtGetData.Goal.TEXT)
        return yaml.safe_load(self._ask_server(BtGetData, names.BT_GET_DATA, request).entries[0].text)

    def load_tree(self, file: str) -> None:
        """Let the BT server read a file of trees, ``package/relative/path``. Raises AssertionError if it is refused."""
        self._ask_server(BtLoad, names.BT_LOADER, BtLoad.Goal(files=[file]))

    def _ask_server(self, kind: Any, name: str, request: Any) -> Any:
        client = ActionClient(self._world.observer.node, kind, names.of_robot(self._own, name))
        try:
            self._world.run_while(lambda: not client.server_is_ready(), 'the BT server')
            goal = self._world.result(client.send_goal_async(request), 'the BT server')
            result = self._world.result(goal.get_result_async(), 'the BT server').result
        finally:
            client.destroy()
        assert result.code == kind.Result.SUCCESS, result.message
        return result

    # -- the operator

    def start(self, behavior: str, autonomy: str = 'High', **arguments: ParameterValue) -> None:
        """Start a behavior at a level of autonomy: Off, Low, High or Full. Arguments are values, or text."""
        levels = {one.name.title(): one for one in AutonomyLevel}
        level = str(autonomy).title()
        assert level in levels, f'there is no level {autonomy!r}; there are {", ".join(levels)}'
        self.tell(f'operator: starts {behavior!r} at autonomy {autonomy}')
        before = self._run_id
        given = [(name, parameter_text(value)) for name, value in arguments.items()]
        self._give(self._make.start(self.view, behavior, given, levels[level]))
        self.run_until(lambda view: view.running or self._run_id != before, what=f'the start of {behavior}')

    def answer(self, state: str, answer: ParameterValue) -> None:
        """Answer the question of a state, once it asks: with a place, an outcome, or a value, also as text."""
        with self._asked(state) as decision:
            self.tell(f'operator: answers {state} with {answer}')
            self._give(self._make.answer(self.view, decision.id, parameter_text(answer)))

    def decline(self, state: str) -> None:
        """Decline the question of a state, once it asks."""
        with self._asked(state) as decision:
            self.tell(f'operator: declines {state}')
            self._give(self._make.decline(self.view, decision.id))

    def choose(self, state: str, outcome: str) -> None:
        """Choose an outcome of a state that waits for it, or confirm or overrule its transition."""
        with self._asked(state) as decision:
            self.tell(f'operator: chooses {outcome} of {state}')
            self._give(self._make.choose(self.view, decision, outcome))

    def confirm(self, state: str) -> None:
        """Confirm the outcome that a state suggests, once it asks."""
        with self._asked(state) as decision:
            self.tell(f'operator: confirms {decision.outcome} of {state}')
            self._give(self._make.confirm(self.view, decision.id))

    def force(self, state: str, outcome: str) -> None:
        """Leave a state that has not asked, once it is active."""
        self.run_until(lambda view: state in view.active_levels, what=f'{state} active{self._hint(state)}')
        self.tell(f'operator: forces {outcome} of {state}')
        self._give(self._make.force(self.view, state, outcome))

    def pause(self) -> None:
        """Pause the run, until :meth:`resume`."""
        self._command(CommandKind.PAUSE)

    def resume(self) -> None:
        """Let a paused run go on."""
        self.tell('operator: RESUME')
        self._give(self._make.resume(self.view))

    def stop(self) -> None:
        """Stop the run."""
        self._command(CommandKind.STOP)

    # -- faults

    def fail_goal(self, action: str, seconds: float = 1.0, message: str = 'a fault of the test') -> None:
        """Let a navigation server abort its goal, and each one of the next seconds: ``follow_path`` and the like."""
        self.tell(f'test: {action} fails for {seconds:g} s')
        fault = yaml.safe_dump({'server': action, 'error_msg': message})
        request = SetFault.Request(
            entity=self.namespace, fault='server_fails', parameters=fault, duration=float(seconds)
        )
        response = self._world.ask(SetFault, 'set_fault', request, self._own)
        assert response.success, response.message

    # -- inside

    @property
    def _own(self) -> str:
        return f'/{self.namespace}' if self.namespace else ''

    @contextmanager
    def _asked(self, state: str) -> Iterator[Decision]:
        """Wait for the question of a state, and yield it; it is answered unless an error is raised meanwhile."""
        self.run_until(self.asks(state))
        decision = next(one for one in self.view.decisions if self._is_open(one, state))
        question = self._run_id, decision.id
        yield decision
        self._answered.add(question)

    def _is_open(self, decision: Decision, state: str) -> bool:
        return decision.path == state and self._waits(decision)

    def _waits(self, decision: Decision) -> bool:
        return (self._run_id, decision.id) not in self._answered

    @property
    def _run_id(self) -> str:
        snapshot = self.view.snapshot
        return f'{snapshot.executive_id} {snapshot.run_id}' if snapshot is not None else ''

    def _command(self, kind: CommandKind) -> None:
        self.tell(f'operator: {kind.name}')
        self._give(self._make.command(self.view, kind))

    def _give(self, command: Any) -> None:
        """Send a command and wait until it is applied."""
        tracked = self._link.send(replace(command, reason='of a test'), ANSWER_SECONDS)

        def is_settled(_view: View) -> bool:
            nonlocal tracked
            tracked = self.mirror.command(command.id) or tracked
            return tracked.state is not CommandState.PENDING

        self.run_until(is_settled, 2.0 * ANSWER_SECONDS)
        assert tracked.state is CommandState.APPLIED, (
            f'{command.kind.name}: {tracked.state.value}, {tracked.reason}; {self._situation()}'
        )

    def _hint(self, state: str) -> str:
        """Return what to say of a state that the running behavior does not have; '' if it has it."""
        known = [one.path for one in self.view.structure.states] if self.view.structure else [state]
        return '' if state in known else f' (there is no such state{did_you_mean(state, known)})'

    def _situation(self) -> str:
        view = self.view
        asked = ', '.join(f'{one.path} ({one.kind.name.lower()})' for one in view.decisions)
        return (
            f'the executive is {view.snapshot.state.name if view.snapshot else "unknown"} in '
            f'{", ".join(view.active_paths) or self.outcome or "no state"}, asked by {asked or "nobody"}; '
            f'link {view.link.value}; {self.robot!r}; states: {self.states}'
        )

    def ready(self, nodes: set[str]) -> Condition:
        """Return the condition that the robot is there, with these nodes."""

        def missing(view: View) -> list[str]:
            if view.snapshot is None or not view.live:
                return ['the executive']
            there = {peer.name.rpartition('/')[2] for peer in view.snapshot.peers if peer.alive and peer.ready}
            parts = {node: node in there for node in sorted(nodes)}
            parts |= {'behaviors': view.behaviors is not None, 'places': view.has_places}
            parts['the pose of the robot'] = self.robot.pose is not None
            return [what for what, is_there in parts.items() if not is_there]

        def hint() -> str:
            return ''.join(f' (missing: {", ".join(those)})' for those in [missing(self.view)] if those)

        return Condition(self, lambda view: not missing(view), f'{self.label}a robot that is ready', hint)

    def _on_change(self, change: Change) -> None:
        if change is not Change.STATUS:
            return
        active = ', '.join(self.view.active_paths)
        if active and (not self.states or active != self.states[-1]):
            self.states.append(active)

    def _observe(self, node: Any) -> None:
        read_topic(node.handle, names.of_robot(self._own, names.POSE), self._read_pose)
        for kind, name, read, qos in (
            (BehaviorStructure, names.EXECUTIVE_STRUCTURE, COVERAGE.add_behavior, names.transient_local_qos()),
            (TreeStructure, names.TREE_STRUCTURE, self._read_tree, names.transient_local_qos(50)),
            (TreeStatus, names.TREE_STATUS, self._read_status, 1000),
        ):
            node.create_subscription(kind, names.of_robot(self._own, name), read, qos)

    def _read_pose(self, message: Any) -> None:
        self.robot.add_pose(pose_of(message.pose), seconds_of(message.header.stamp))

    def add_transition(self, behavior: str, path: str, outcome: str, reason: str) -> None:
        """Add a transition of the executive, at the moment at which it happens."""
        self.transitions.append((path, outcome))
        self.tell(f'executive: {path} left by {outcome} ({reason})')
        COVERAGE.add_transition(behavior, path, outcome)

    def add_event(self, event: str, fields: Mapping[str, Any]) -> None:
        """Add an event of the executive."""
        if what := executive_event(event, fields):
            self._add_event('executive', what)

    def _add_event(self, who: str, what: str, node: int = 0) -> None:
        self._world.events.append(Event(self._world.now, f'{self.label}{who}', what, node))

    def end(self) -> str:
        """Return where the run and the robot are now, as one line."""
        run = self.outcome or f'in {", ".join(self.view.active_paths) or "no state"}'
        pose = self.robot.pose
        place = f'({pose.x:.2f}, {pose.y:.2f})' if pose else 'an unknown place'
        return f'{self.label}{run}; the robot at {place}, {self.robot.length:.2f} m driven'

    def _read_tree(self, message: Any) -> None:
        if (message.run_id, message.number) not in self._trees:
            self._trees[message.run_id, message.number] = message
            COVERAGE.add_tree(message)

    def _read_status(self, message: Any) -> None:
        tree = self._trees.get((message.run_id, message.structure))
        if tree is None:
            return
        for change in message.changes:
            if what := tree_event(tree, change):
                self._add_event(f'tree {tree.behavior_tree}', what, change.uid)
            node = tree.nodes[change.uid - 1]
            COVERAGE.add_status(tree.behavior_tree, node.path, change.status)
            if (
                change.previous_status == TreeStatus.RUNNING
                and change.status == TreeStatus.FAILURE
                and node.kind == node.ACTION
            ):
                self.tell(f'tree {tree.behavior_tree}: {node.path} failed')


class World(Mission):
    """Processes of a robot, a scripted operator, and a clock that jumps to the next event.

    The same seed gives the same run, message for message. Seed 0 keeps the order in which tasks become ready; another
    one draws it. Open a world with ``with``; its files are in a directory of its own, which is removed at the end. An
    interpreter has one world at a time.

    With several robots it is itself the mission of the first one; :attr:`robots` has all, by their namespaces.
    """

    current: World | None = None
    """The world that is open."""

    def __init__(
        self,
        seed: int = 0,
        programs: Sequence[Program] | None = None,
        operator: str = 'engineer',
        writable: Sequence[Path] = (),
    ) -> None:
        """``writable`` are directories in which the programs may write files, besides that of the world.

        Raises:
            RuntimeError: another world is open.
        """
        if World.current is not None:
            raise RuntimeError(
                f'the world of {World.current.opened_by} is open: leave its with block first; an interpreter has one '
                'world at a time'
            )
        SCHEDULER.reset(seed)
        DOMAIN.reset()
        DISK.begin()
        random.seed(seed)
        numpy.random.seed(seed % 2**32)
        self._alarms: list[Alarm] = []
        self.seed = seed
        self.story: list[str] = []
        """What has happened, a line each, for the report of a failed test."""
        self.events: list[Event] = []
        """What the executives and trees have decided."""
        self.machines: dict[str, Path] = {}
        """The files of behaviors in YAML that were swapped, by their entry points."""
        self.programs = {one.name: one for one in (robot_programs() if programs is None else programs)}
        self.processes: dict[str, Process] = {}
        namespaces = [one.namespace for one in self.programs.values() if one.executable == 'onboard_executive']
        super().__init__(self, namespaces[0] if namespaces else '')
        self.robots: dict[str, Mission] = {self.namespace: self} if namespaces else {}
        self.robots |= {name: Mission(self, name) for name in namespaces[1:]}
        self._operator = operator
        self._writable = list(writable)

    def __enter__(self) -> World:
        self.opened_by = os.environ.get('PYTEST_CURRENT_TEST', 'this interpreter').partition(' ')[0]
        self.outside = dict(os.environ)
        with ExitStack() as stack:
            made = tempfile.TemporaryDirectory(prefix='flexbt_world_', ignore_cleanup_errors=True)
            self._folder = Path(stack.enter_context(made)).resolve()  # as open files name it
            self._directory = os.open(self._folder, os.O_RDONLY)
            stack.callback(os.close, self._directory)
            self.home = home = Path(f'/proc/self/fd/{self._directory}')  # by which each fork finds files of its own
            variables = {'HOME': str(home), 'ROS_HOME': f'{home}/ros', 'ROS_LOG_DIR': f'{home}/log'}
            stack.enter_context(mock.patch.dict(os.environ, variables))
            stack.callback(os.chdir, Path.cwd())  # which a program may change
            stack.callback(BOUNDARY.open)
            BOUNDARY.close_around([self.home, self._folder, *self._writable])
            stack.callback(setattr, World, 'current', None)
            World.current = self
            stack.callback(self._end_programs)
            stack.enter_context(_collected_by_the_world())
            for name in self.programs:
                self.launch(name)
            self.observer = NodeRuntime('observer', args=[])
            stack.callback(self.observer.close)
            with mock.patch.object(SCHEDULER.current, 'process', SCHEDULER.process(OPERATOR)):
                self._station = NodeRuntime('operator', args=[])
                stack.callback(self._station.close)
                for mission in self.robots.values():
                    mission.open(self._station, self.observer, self._operator)
            self._wait_ready()
            stack.callback(self._cancel_alarms)
            self._at_end = stack.pop_all()
        return self

    def _wait_ready(self) -> None:
        for name, mission in self.robots.items():
            own = {one.executable for one in self.programs.values() if one.namespace == name}
            here = {'navigation' if node in ('simulation', 'abstract_robot') else node for node in own & _NODES}
            mission.run_until(mission.ready(here), READY_SECONDS)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End all processes in order, those that are killed or stopped aside."""
        self._at_end.close()

    def _cancel_alarms(self) -> None:
        for alarm in self._alarms:
            alarm.cancel()

    def _end_programs(self) -> None:
        for process in self.processes.values():
            if process.is_alive:
                terminate(process)
        try:
            self.run(3.0)
        finally:
            for process in self.processes.values():
                if process.is_alive:
                    end(process)

    def report(self) -> str:
        """Return what the robots did, for a failed test."""
        lines = [*self.story[-_STORY_LENGTH:], *(f'stopped: {crossing}' for crossing in BOUNDARY.crossings)]
        for mission in self.robots.values() if hasattr(self, 'observer') else ():
            lines.append(f'at {self.now:.2f} s {mission.namespace or "the robot"}: {mission._situation()}')
        ended = [f'{name} ({one.exit_code})' for name, one in self.processes.items() if not one.is_alive]
        return '\n'.join(lines + ([f'ended: {", ".join(ended)}'] if ended else []))

    # -- time

    @property
    def now(self) -> float:
        """Simulated time since the world began, s."""
        return (SCHEDULER.now - BOOT) / SECOND

    @property
    def wall(self) -> float:
        """Wall time of the world, s since the epoch."""
        return SCHEDULER.wall / SECOND

    def run(self, seconds: float) -> None:
        """Let the world go on for this time, s."""
        SCHEDULER.sleep(seconds)

    def at(self, time: float, act: Callable[[], object]) -> None:
        """Call ``act`` at a time of this world, s, on a thread of its own. A wait of the test raises what it raises."""

        def body() -> None:
            try:
                act()
            except BaseException as error:
                SCHEDULER.throw(error)

        self._call_at(time, lambda: SCHEDULER.spawn(body, f'at {time:g} s', SCHEDULER.main.process))

    def _call_at(self, time: float, fn: Callable[[], object]) -> Alarm:
        """Call a function at a time of this world, s, unless the world has ended then."""
        self._alarms.append(SCHEDULER.call_at(BOOT + int(time * SECOND), fn))
        return self._alarms[-1]

    def run_while(self, condition: Callable[[], object], what: str) -> None:
        """Let the world go on while a condition holds. Raises AssertionError if it still does after a minute."""
        until = SCHEDULER.after(ANSWER_SECONDS)
        while condition():
            assert SCHEDULER.now < until, f'{what} does not answer within {ANSWER_SECONDS:g} s'
            SCHEDULER.sleep(0.02)

    def result(self, future: Any, what: str) -> Any:
        """Let the world go on until a future of rclpy is done, and return its result."""
        self.run_while(lambda: not future.done(), what)
        return future.result()

    # -- what if

    def fork(self, act: Callable[[World], Any]) -> Fork:
        """Let a child of this process go on from here with ``act``, whose result :meth:`Fork.result` returns.

        This world does not notice. The child has files of its own, but shares those of ``writable``.
        """
        side = fork_world(self._folder, self._directory)
        if isinstance(side, Leaf):
            side.end(lambda: act(self))
        return side

    def what_if(
        self, change: Callable[[World], object], go_on: Callable[[World], object], tolerance: float = TOLERANCE
    ) -> Comparison:
        """Compare how the mission goes on from here with how it would after a change.

        Two children go on with ``go_on``, one of them after ``change``. An assertion that fails ends a course.
        ``tolerance`` is how much earlier or later an event may be without being another one, s.
        """

        def changed(world: World) -> None:
            change(world)
            go_on(world)

        forks = [self.fork(lambda world, act=act: world.course(act)) for act in (go_on, changed)]  # type: ignore[misc]
        before, after = (fork.result() for fork in forks)
        return compare(before, after, tolerance)

    def course(self, act: Callable[[World], object]) -> Course:
        """Do something, and return what has happened meanwhile."""
        first = len(self.events)
        try:
            act(self)
        except (AssertionError, StuckWorldError) as error:
            return self.course_since(first, error)
        return self.course_since(first)

    def course_since(self, first: int, error: BaseException | None = None) -> Course:
        """Return what has happened since there were ``first`` events, and which error has ended it."""
        events, ends = self.events[first:], [mission.end() for mission in self.robots.values()]
        if error is not None:
            events.append(Event(self.now, TEST, 'fails'))
            ends.append(f'{type(error).__name__}: {one_line(str(error))}')
        return Course(events, self.now, ends)

    def branch_at(self, time: float, change: Callable[[World], object]) -> Branch:
        """Fork the program at a time, s, whatever it does then: only the child has the change."""

        def fork() -> None:
            branch.first, branch.side = len(self.events), fork_world(self._folder, self._directory)
            if isinstance(branch.side, Leaf):
                self.at(time, make)

        def make() -> None:
            try:
                change(self)
            finally:
                branch.is_over = True

        branch = Branch(self._call_at(time, fork))
        return branch

    def swap(self, name: str, file: Path | str) -> None:
        """Replace an installed file, such as a tree or a behavior in YAML, in this world only.

        ``name`` is ``package/relative/path``. A tree that runs goes on as it is; its next run is of the new file.

        Raises:
            AssertionError: there is no such file, or the BT server refuses its trees.
            ResourceError: there is no installed file of this name.
        """
        assert Path(file).is_file(), f'there is no file {file}'
        package, _, inside = name.partition('/')
        resolve_file(name)
        share, prefix = Path(get_package_share_directory(package)), self.home / 'overlay'
        overlay = prefix / 'share' / package
        if not overlay.exists():
            shutil.copytree(share, overlay)
            index = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages'
            index.mkdir(parents=True, exist_ok=True)
            (index / package).touch()
            os.environ['AMENT_PREFIX_PATH'] = f'{prefix}:{os.environ["AMENT_PREFIX_PATH"]}'
        before = (overlay / inside).read_bytes()
        shutil.copy(file, overlay / inside)
        for point in entry_points(group=behavior_library.ENTRY_POINT_GROUP):  # whose files are beside Python modules
            if point.attr == Path(inside).name and behavior_library.machine_file(point).read_bytes() == before:
                self.machines[point.value] = overlay / inside
        self.tell(f'test: {name} is {file}')
        for mission in self.robots.values() if name.endswith('.xml') else ():
            mission.load_tree(name)

    # -- processes

    def launch(self, program: str | Program | Callable[[], Any]) -> Process:
        """Start a program of the world, or a further one: ``package/executable``, a Program with parameters of its
        node, or a function."""
        if isinstance(program, Program):
            made = program
        elif callable(program):
            made = Program('', self._free_name(program), main=program)
        elif program in self.programs:
            made = self.programs[program]
        else:
            package, _, executable = program.partition('/')
            known = did_you_mean(program, self.programs, f'; there are {", ".join(self.programs)}.')
            assert executable, f'there is no program {program!r}{known} Give others as package/executable'
            made = Program(package, executable)
        running = self.processes.get(made.name)
        assert running is None or not running.is_alive, f'{made.name} runs already'
        told = lambda error: self.tell(f'{made.name}: {type(error).__name__}: {error}')  # noqa: E731
        process = launch(made, made.arguments(), told)
        self.programs.setdefault(made.name, made)
        self.processes[made.name] = process
        return process

    def _free_name(self, function: Callable[[], Any]) -> str:
        """Return the name of a function, with a number if a process of this name runs."""
        name = str(getattr(getattr(function, 'func', function), '__name__', type(function).__name__))
        names = (name if number == 1 else f'{name}_{number}' for number in itertools.count(1))
        return next(one for one in names if one not in self.processes or not self.processes[one].is_alive)

    def kill(self, name: str) -> None:
        """End a process as SIGKILL does."""
        self.tell(f'test: kills {name}')
        end(self._alive(name))

    def lose_power(self, *names: str) -> None:
        """End processes, by default all; what of their files was not synced is lost, or not, as the seed draws it."""
        self.tell(f'test: {", ".join(names) or "everything"} loses power')
        processes = [self._alive(name) for name in names] or [one for one in self.processes.values() if one.is_alive]
        for process in processes:
            end(process)
        for process in processes if names else DISK.users:  # also those that have ended before
            DISK.lose(process)

    def terminate(self, name: str) -> None:
        """Send SIGTERM; no effect on a process that has ended."""
        process = self._known(name)
        if process.is_alive:
            self.tell(f'test: terminates {name}')
            terminate(process)

    def restart(self, name: str) -> None:
        """Start a process that has ended again."""
        assert not self._known(name).is_alive, f'{name} runs; kill it, or terminate it and wait for its end, first'
        self.tell(f'test: starts {name} again')
        self.launch(name)

    def hold_up(self, name: str) -> None:
        """Stop a process as SIGSTOP does, until :meth:`resume`."""
        self.tell(f'test: holds {name} up')
        SCHEDULER.hold_up(self._alive(name))

    def resume(self, name: str = '') -> None:
        """Let a paused run go on; with a name, let a stopped process continue, as SIGCONT does."""
        if not name:
            super().resume()
            return
        self.tell(f'test: lets {name} continue')
        SCHEDULER.resume(self._alive(name))

    def _known(self, name: str) -> Process:
        remedy = did_you_mean(name, self.processes, f'; there are {", ".join(self.processes)}')
        assert name in self.processes, f'there is no process {name!r}{remedy}'
        return self.processes[name]

    def _alive(self, name: str) -> Process:
        process = self._known(name)
        assert process.is_alive, f'{name} has ended already, with exit code {process.exit_code}'
        return process

    # -- what is around the robot

    def drop_obstacle(self, name: str, x: float, y: float, length: float = 0.4, width: float = 0.4) -> None:
        """Put a box into the world: its centre and its sides along the axes of the map, m."""
        self.tell(f'test: puts {name} at ({x:g}, {y:g})')
        box = {'obstacles': {name: {'pose': [x, y, 0.0], 'shape': [length, width]}}}
        self._change(SpawnEntity, 'spawn_entity', SpawnEntity.Request(name=name, resource_string=yaml.safe_dump(box)))

    def take_away(self, name: str) -> None:
        """Remove a box."""
        self.tell(f'test: takes {name} away')
        self._change(DeleteEntity, 'delete_entity', DeleteEntity.Request(entity=name))

    def _change(self, kind: Any, name: str, request: Any) -> None:
        assert 'abstract_robot' not in {one.executable for one in self.programs.values()}, (
            "an abstract robot meets no obstacles; leave out motion='abstract'"
        )
        result = self.ask(kind, name, request).result
        assert result.result == result.RESULT_OK, result.error_message

    def ask(self, kind: Any, name: str, request: Any, namespace: str = '') -> Any:
        """Call a service of the simulator, and return the response."""
        is_abstract = 'abstract_robot' in {one.executable for one in self.programs.values()}
        service = names.of_robot(namespace if is_abstract else '', f'{names.SIMULATOR}/{name}')
        client = self.observer.node.create_client(kind, service)
        try:
            self.run_while(lambda: not client.service_is_ready(), service)
            return self.result(client.call_async(request), service)
        finally:
            self.observer.node.destroy_client(client)

    def jump_clock(self, seconds: float) -> None:
        """Let the system clock jump, as who sets it does; the steady clock, by which programs wait, goes on."""
        self.tell(f'test: the system clock jumps by {seconds:g} s')
        SCHEDULER.jumped += int(seconds * SECOND)

    @property
    def disk(self) -> Disk:
        """The disk of the robots."""
        return DISK

    @property
    def network(self) -> Network:
        """The network between the hosts of this world: the robot, and the operator."""
        if not isinstance(DOMAIN.network, Network):
            DOMAIN.network = Network()
        return DOMAIN.network

    def cut(self, name: str, seconds: float) -> None:
        """Cut the operator, or a process, off from the others: what is reliable arrives later, the rest is lost."""
        self.tell(f'test: cuts {name} off for {seconds:g} s')
        if name == OPERATOR:
            self.network.cut(seconds)
        else:
            self.network.cut_off(self._known(name).name, seconds)


def _told(condition: object) -> str:
    """Return a condition in words, if it has any."""
    return str(condition) if isinstance(condition, Condition) else 'the condition'


class _ToldEvents(EventStream):
    """The events of an executive, of which the world is told at once: the topic limits how many are sent."""

    def add(self, event: str, fields: Mapping[str, Any]) -> None:
        super().add(event, fields)
        namespace = self._runtime.node.get_namespace().strip('/')
        mission = World.current.robots.get(namespace) if World.current else None
        if mission is None:
            return
        mission.add_event(event, fields)
        if event == 'left':
            mission.add_transition(self._behavior, *(str(fields.get(key, '')) for key in ('path', 'outcome', 'reason')))
        elif event == 'ended':
            COVERAGE.add_transition(fields['behavior'], ROOT_PATH, fields['outcome'])


setattr(executive, 'EventStream', _ToldEvents)  # noqa: B010 - a name that it has imported
_installed_machine: Final = behavior_library.machine_file


def _machine_file(point: EntryPoint) -> Traversable:
    """Return the file of a behavior in YAML, or what has taken its place in this world."""
    swapped = World.current.machines.get(point.value) if World.current else None
    return swapped or _installed_machine(point)


setattr(behavior_library, 'machine_file', _machine_file)  # noqa: B010 - as above


def _unknown_parameters(nodes: Sequence[Node]) -> Iterator[str]:
    """Yield what a node logs of misspelled parameters, and warn the test, which shows no logs."""
    for line in unknown_parameters(nodes):
        warnings.warn(f'{SCHEDULER.current.process.name}: {line}', stacklevel=2)
        yield line


setattr(node_runtime, 'unknown_parameters', _unknown_parameters)  # noqa: B010 - as above


@contextmanager
def _collected_by_the_world() -> Iterator[None]:
    """Let a task collect the garbage of this world, and leave all that is older alone."""

    def collect() -> None:
        while True:
            SCHEDULER.block('garbage')
            gc.collect(1)  # what is new: all of a large world would take a second

    was_enabled = gc.isenabled()
    gc.disable()
    gc.freeze()
    SCHEDULER.collector = SCHEDULER.spawn(collect, 'collector')
    try:
        yield
    finally:
        gc.unfreeze()
        if was_enabled:
            gc.enable()
