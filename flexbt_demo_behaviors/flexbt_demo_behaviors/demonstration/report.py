# SPDX-License-Identifier: BSD-3-Clause
"""The report of a demonstration while it runs, its result and its picture, and the tracks of robots.

A track has the poses, speed and plans of a robot, which subscriptions fill in.
"""

from __future__ import annotations

import copy
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as PathMessage
from PIL import Image
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import MESSAGE
from flexbt_common.values.message_fields import seconds_of
from flexbt_console.errors import ConsoleError
from flexbt_core import load_places
from flexbt_core.values.text import escape_lines
from flexbt_msgs.msg import TreeStatus, TreeStructure
from flexbt_sim.messages import map_of, pose_of
from flexbt_sim.world import OccupancyMap, Point, Pose, Trace, TraceFrame, World, draw_world, wrap

# Add a point to the driven path after the robot has moved this far, m.
POINT_DISTANCE = 0.02

# Speeds below which the robot counts as standing still: m/s and rad/s.
REST_SPEED = 0.005
REST_TURN = 0.01


def pose_text(pose: Pose | None) -> str:
    """Return a pose as text for a person, with the heading in degrees."""
    return 'nowhere' if pose is None else f'({pose.x:.2f}, {pose.y:.2f}, {math.degrees(pose.yaw):.0f}°)'


class RobotTrack:
    """The robot's track. The subscriptions write it and the scripted operator reads it, each on a separate thread.

    ``map`` and ``pose`` are None until they arrive. ``time`` is the simulated time of the pose, s. ``way`` lists the
    robot's places with their times, ``length`` is the length of that path, m. ``plans`` are the first plan to each
    planned place, in order. `on_change` is called after every change, on the writer's thread.
    """

    def __init__(self, on_change: Callable[[], None] = lambda: None) -> None:
        self.on_change = on_change
        self.map: OccupancyMap | None = None
        self.pose: Pose | None = None
        self.time = 0.0
        self.at_rest = True
        self.way: list[tuple[float, Pose]] = []
        self.length = 0.0
        self.plans: list[list[Point]] = []
        self._lock = threading.Lock()
        self._nodes: dict[str, Mapping[int, str]] = {}
        self._begun: set[tuple[str, int]] = set()

    def restart(self) -> None:
        """Clear the driven path, the plans and the tree events. The track restarts at the robot's pose."""
        with self._lock:
            self.way = [(self.time, self.pose)] if self.pose else []
            self.length = 0.0
            self.plans = []
            self._begun.clear()

    def set_map(self, grid: OccupancyMap) -> None:
        """Set the map."""
        self.map = grid
        self.on_change()

    def add_pose(self, pose: Pose, time: float) -> None:
        """Add the true pose of the robot at a simulated time, in seconds."""
        with self._lock:
            before, passed = self.pose, time - self.time
            if before is not None and passed > 0.0:
                turned = abs(wrap(pose.yaw - before.yaw))
                self.at_rest = before.distance(pose) <= REST_SPEED * passed and turned <= REST_TURN * passed
            self.pose = pose
            self.time = time
            last = self.way[-1][1] if self.way else None
            step = last.distance(pose) if last else 0.0
            if last is None or step >= POINT_DISTANCE:
                self.way.append((time, pose))
                self.length += step
        self.on_change()

    def add_plan(self, points: list[Point]) -> None:
        """Add a planned path, unless it ends where the last one does: then it is a replan on the way."""
        if len(points) < 2:
            return
        with self._lock:
            if not self.plans or math.dist(self.plans[-1][-1], points[-1]) > POINT_DISTANCE:
                self.plans.append(points)
        self.on_change()

    def add_tree(self, run: str, nodes: Mapping[int, str]) -> None:
        """Store the names of a tree's nodes, by uid, when the tree starts or has new nodes."""
        with self._lock:
            self._nodes[run] = nodes
        self.on_change()

    def add_begun(self, run: str, nodes: Iterable[int]) -> None:
        """Record the uids of tree nodes that have started to run. The structure of the tree may arrive later."""
        with self._lock:
            self._begun.update((run, node) for node in nodes)
        self.on_change()

    def has_begun(self, name: str) -> bool:
        """Return whether a node with this name has started to run in any tree."""
        with self._lock:
            return any(self._nodes.get(run, {}).get(node) == name for run, node in self._begun)

    @property
    def ready(self) -> bool:
        """True once a map and a pose have arrived."""
        return self.map is not None and self.pose is not None

    @property
    def began(self) -> float:
        """Simulated time at which the track starts, s."""
        return self.way[0][0] if self.way else 0.0


# Subscriptions that fill the track of the robot from messages of the simulator and the planner.

EACH = 1000
"""Queue size of topics on which no message may be lost: poses, for the driven path, and tree events."""

POSE_BYTES = 2_000


def subscribe_to_robot(runtime: NodeRuntime, track: RobotTrack) -> None:
    """Subscribe to map, true pose, plans and tree events, for the lifetime of the node.

    Do not subscribe to the odometry: with a subscriber, the simulator always publishes it at the rate of a moving
    robot.
    """

    def on_pose(received: Received) -> None:
        message: PoseStamped = received.unpack(PoseStamped)
        track.add_pose(pose_of(message.pose), seconds_of(message.header.stamp))

    def on_plan(message: PathMessage) -> None:
        track.add_plan([(pose.pose.position.x, pose.pose.position.y) for pose in message.poses])

    def on_structure(received: Received) -> None:
        message: TreeStructure = received.unpack(TreeStructure)
        track.add_tree(f'{message.run_id}/{message.number}', {node.uid: node.name for node in message.nodes})

    def on_tree_status(received: Received) -> None:
        message: TreeStatus = received.unpack(TreeStatus)
        begun = [change.uid for change in message.changes if change.status == TreeStatus.RUNNING]
        track.add_begun(f'{message.run_id}/{message.structure}', begun)

    def subscribe() -> None:
        node = runtime.node
        node.create_subscription(
            OccupancyGrid, names.MAP, lambda grid: track.set_map(map_of(grid)), names.transient_local_qos()
        )
        node.create_subscription(PathMessage, names.PLAN, on_plan, 10)
        # Process all waiting messages at once: one per cycle of the executor would be seconds late on a busy computer.
        ReceivedMessages(node, PoseStamped, names.POSE, QoSProfile(depth=EACH), on_pose, POSE_BYTES)
        ReceivedMessages(
            node, TreeStructure, names.TREE_STRUCTURE, names.transient_local_qos(EACH), on_structure, MESSAGE
        )
        ReceivedMessages(node, TreeStatus, names.TREE_STATUS, names.transient_local_qos(EACH), on_tree_status, MESSAGE)

    runtime.call(subscribe)


# A goal counts as reached within this distance, m, measured by the simulator's true pose.
GOAL_TOLERANCE = 0.25


class DemoError(RuntimeError):
    """A demonstration has failed. The message has the expected and the actual result."""


class Timeline:
    """A printer of events, one line each, with the seconds since the start and their source. Thread-safe."""

    def __init__(self, stream: TextIO = sys.stdout, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._clock = clock
        self._start = clock()
        self._lock = threading.Lock()
        self._robot = ''

    @property
    def elapsed(self) -> float:
        """Seconds of wall time since the start."""
        return self._clock() - self._start

    def of(self, robot: str) -> Timeline:
        """Return this timeline for one of several robots, with the robot's name before every line."""
        own = copy.copy(self)
        own._robot = f'{robot}: '
        return own

    def tell(self, who: str, what: str) -> None:
        """Print one event; indent further lines of `what` below the first. It may come from the network."""
        first, *rest = escape_lines(what)
        lines = [f'{self.elapsed:6.1f} s  {who:<9} {self._robot}{first}', *(f'{"":20}{line}' for line in rest)]
        with self._lock:
            print('\n'.join(lines), file=self._stream, flush=True)


@dataclass(frozen=True)
class GoalResult:
    """The result of one goal.

    `error` is the distance to it at the end of the drive, m. `seconds` of simulated time and driven `metres` count from
    when the goal was sent, if that is known.
    """

    label: str
    pose: Pose
    ending: str
    error: float
    reached: bool
    seconds: float | None = None
    metres: float | None = None

    def line(self) -> str:
        """Return the result for a person, on one line."""
        way = '' if self.seconds is None else f'  {self.metres:5.1f} m driven in {self.seconds:5.1f} s'
        return f'{self.label:<16} {pose_text(self.pose):<24} {self.ending:<24} {self.error:5.2f} m off{way}'


@dataclass
class DemoReport:
    """The result of one demonstration."""

    title: str
    branches: Sequence[str]
    taken: set[str] = field(default_factory=set)
    goals: list[GoalResult] = field(default_factory=list)
    duration: float = 0.0
    problem: str = ''

    def take(self, branch: str) -> None:
        """Record that a required branch was taken."""
        if branch not in self.branches:
            raise KeyError(f'{self.title} does not promise the branch {branch!r}')
        self.taken.add(branch)

    def play(self, script: Callable[[], None]) -> None:
        """Run the script of the operator. Any deviation from the expected result becomes the problem of the report."""
        before = time.monotonic()
        try:
            script()
        except (DemoError, ConsoleError) as error:
            self.problem = str(error)
        self.duration = time.monotonic() - before

    @property
    def passed(self) -> bool:
        """True if every branch was taken and every required goal was reached."""
        return not self.problem and bool(self.goals) and self.taken.issuperset(self.branches)

    def text(self) -> str:
        """Return the summary for a person; times of goals are simulated seconds."""
        lines = [f'{self.title}: {"passed" if self.passed else "FAILED"} after {self.duration:.1f} s']
        lines += [f'  goal    {goal.line()}' for goal in self.goals]
        width = max(map(len, self.branches), default=0)
        for name in self.branches:
            lines.append(f'  branch  {name:<{width}}  {"taken" if name in self.taken else "NOT TAKEN"}')
        if self.problem:
            lines += [f'  {line}' for line in f'problem {self.problem}'.splitlines()]
        return '\n'.join(lines)

    def conclude(self, world: World, tracks: Mapping[str, RobotTrack], file: Path) -> int:
        """Print the summary, write the picture, and return the exit code of the demonstration."""
        print(f'\n{self.text()}', flush=True)
        write_picture(world, tracks, file)
        print(f'  picture {file}\n', flush=True)
        return 0 if self.passed else 1


# The picture of a demonstration: a world with the plans and driven paths of its robots.


def write_picture(world: World, tracks: Mapping[str, RobotTrack], file: Path) -> None:
    """Draw the picture of :func:`draw_tracks` and write it as PNG to `file`. Create its directory if missing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draw_tracks(world, tracks).quantize(64).save(file, optimize=True)


def draw_tracks(world: World, tracks: Mapping[str, RobotTrack]) -> Image.Image:
    """Return a picture of a world with its robots at their current poses, and their tracks by robot name.

    The picture shows the driven paths, and the plans as dashed lines. The time counts from the start of the tracks.
    """
    trace = Trace(world)
    for name, track in tracks.items():
        shape = world.robots[name].shape
        trace.frames += [TraceFrame(time - track.began, {name: (shape, pose)}, {}) for time, pose in list(track.way)]
        if track.pose is not None:
            world.robots[name].place(track.pose)
    plans = {f'{name}{number}': plan for name, track in tracks.items() for number, plan in enumerate(track.plans)}
    last = max((track.time - track.began for track in tracks.values()), default=0.0)
    return draw_world(world, trace, paths=plans, time=last)


def world_with_places(world: str, places: str) -> World:
    """Return the world of a file in its initial state, with the places of another file."""
    loaded = World.load(world)
    loaded.places = {name: Pose(place.x, place.y, place.yaw) for name, place in load_places(Path(places)).items()}
    return loaded
