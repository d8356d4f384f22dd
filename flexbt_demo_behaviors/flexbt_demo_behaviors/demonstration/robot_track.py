# SPDX-License-Identifier: BSD-3-Clause
"""What the simulator knows of the robot during a demonstration: where it was, how fast, and what was planned."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from flexbt_sim.world import OccupancyMap

Point = tuple[float, float]

# A new point of the driven path is kept when the robot has moved this far, in metres.
POINT_DISTANCE = 0.02

# Slower than this the robot is at rest: m/s and rad/s.
REST_SPEED = 0.005
REST_TURN = 0.01


@dataclass(frozen=True)
class Pose:
    """A pose in the map frame: metres, metres, radians."""

    x: float
    y: float
    yaw: float

    def distance(self, other: Pose) -> float:
        """Straight-line distance between the positions, in metres."""
        return math.hypot(self.x - other.x, self.y - other.y)

    def __str__(self) -> str:
        """The pose for a person, with the heading in degrees."""
        return f'({self.x:.2f}, {self.y:.2f}, {math.degrees(self.yaw):.0f}°)'


class RobotTrack:
    """The robot's track. Written by the subscriptions, read by the scripted operator, each on its own thread.

    `on_change` is called after every change, on the writer's thread.
    """

    def __init__(self, on_change: Callable[[], None] = lambda: None) -> None:
        self.on_change = on_change
        self._lock = threading.Lock()
        self._map: OccupancyMap | None = None
        self._pose: Pose | None = None
        self._time = 0.0
        self._moving = False
        self._way: list[tuple[float, Pose]] = []
        self._length = 0.0
        self._plans: list[list[Point]] = []
        self._nodes: dict[str, Mapping[int, str]] = {}
        self._begun: set[tuple[str, int]] = set()

    def restart(self) -> None:
        """Forget the driven path, the plans and what trees have done; the track begins where the robot is."""
        with self._lock:
            self._way = [(self._time, self._pose)] if self._pose else []
            self._length = 0.0
            self._plans = []
            self._begun.clear()

    def set_map(self, grid: OccupancyMap) -> None:
        """Take the map."""
        with self._lock:
            self._map = grid
        self.on_change()

    def add_pose(self, pose: Pose, time: float) -> None:
        """Take the true pose of the robot at a simulated time, in seconds."""
        with self._lock:
            before, passed = self._pose, time - self._time
            if before is not None and passed > 0.0:
                turned = math.remainder(pose.yaw - before.yaw, math.tau)
                self._moving = before.distance(pose) > REST_SPEED * passed or abs(turned) > REST_TURN * passed
            self._pose = pose
            self._time = time
            last = self._way[-1][1] if self._way else None
            step = last.distance(pose) if last else 0.0
            if last is None or step >= POINT_DISTANCE:
                self._way.append((time, pose))
                self._length += step
        self.on_change()

    def add_plan(self, points: list[Point]) -> None:
        """Take a planned path. A plan to the same end as the last one is a replan on the way and is not kept."""
        if len(points) < 2:
            return
        with self._lock:
            if not self._plans or math.dist(self._plans[-1][-1], points[-1]) > POINT_DISTANCE:
                self._plans.append(points)
        self.on_change()

    def add_tree(self, run: str, nodes: Mapping[int, str]) -> None:
        """Take the names of the nodes, by their uids, of a tree that begins, or that has others now."""
        with self._lock:
            self._nodes[run] = nodes
        self.on_change()

    def add_begun(self, run: str, nodes: Iterable[int]) -> None:
        """Take the uids of nodes of a tree that have begun to run; its structure may come later."""
        with self._lock:
            self._begun.update((run, node) for node in nodes)
        self.on_change()

    def has_begun(self, name: str) -> bool:
        """Whether a node of this name has begun to run in any tree."""
        with self._lock:
            return any(self._nodes.get(run, {}).get(node) == name for run, node in self._begun)

    @property
    def map(self) -> OccupancyMap | None:
        """The map, once it has come."""
        with self._lock:
            return self._map

    @property
    def pose(self) -> Pose | None:
        """The newest pose, once one has come."""
        with self._lock:
            return self._pose

    @property
    def ready(self) -> bool:
        """Whether the map and a pose have come."""
        with self._lock:
            return self._map is not None and self._pose is not None

    @property
    def time(self) -> float:
        """Simulated time of the newest pose, in seconds."""
        with self._lock:
            return self._time

    @property
    def at_rest(self) -> bool:
        """Whether the robot stands still."""
        with self._lock:
            return not self._moving

    @property
    def way(self) -> list[tuple[float, Pose]]:
        """Where the robot was, and at which simulated time, in seconds."""
        with self._lock:
            return list(self._way)

    @property
    def began(self) -> float:
        """Simulated time at which the track began, in seconds."""
        with self._lock:
            return self._way[0][0] if self._way else 0.0

    @property
    def driven(self) -> list[Point]:
        """The driven path."""
        return [(pose.x, pose.y) for _, pose in self.way]

    @property
    def length(self) -> float:
        """Length of the driven path, in metres."""
        with self._lock:
            return self._length

    @property
    def plans(self) -> list[list[Point]]:
        """The first plan for each place that was planned to, in order."""
        with self._lock:
            return [list(plan) for plan in self._plans]
