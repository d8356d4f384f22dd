# SPDX-License-Identifier: BSD-3-Clause
"""The report of a demonstration while it runs, its result, and its picture."""

from __future__ import annotations

import copy
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from PIL import Image

from flexbt_core import load_places
from flexbt_sim.world import Pose, Trace, TraceFrame, World, draw_world

from .robot_track import RobotTrack, pose_text

# A goal counts as reached when the robot is this near to it, in metres, as the simulator knows it.
GOAL_TOLERANCE = 0.25


class DemoError(RuntimeError):
    """A demonstration did not do what it shall show; the message says what, and what was there instead."""


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
        """Return the same timeline for one of several robots, whose name precedes every line."""
        own = copy.copy(self)
        own._robot = f'{robot}: '
        return own

    def tell(self, who: str, what: str) -> None:
        """Print one event; further lines of `what` are indented below the first."""
        first, *rest = what.splitlines() or ['']
        lines = [f'{self.elapsed:6.1f} s  {who:<9} {self._robot}{first}', *(f'{"":20}{line}' for line in rest)]
        with self._lock:
            print('\n'.join(lines), file=self._stream, flush=True)


@dataclass(frozen=True)
class GoalResult:
    """The result of one goal. `error` is the distance to it in metres when the drive was over. `seconds` of simulated
    time and `metres` driven count from when it was sent, if that is known.
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
        """Note that a branch which the demonstration shall take was taken."""
        if branch not in self.branches:
            raise KeyError(f'{self.title} does not promise the branch {branch!r}')
        self.taken.add(branch)

    def play(self, script: Callable[[], None]) -> None:
        """Play the part of the operator. A deviation from the expected result is the problem of the report."""
        before = time.monotonic()
        try:
            script()
        except DemoError as error:
            self.problem = str(error)
        self.duration = time.monotonic() - before

    @property
    def passed(self) -> bool:
        """True if every branch was taken and every goal that should be reached was reached."""
        return not self.problem and bool(self.goals) and self.taken.issuperset(self.branches)

    def text(self) -> str:
        """Return the summary for a person; times of goals are simulated seconds."""
        lines = [f'{self.title}: {"passed" if self.passed else "FAILED"} after {self.duration:.1f} s']
        lines += [f'  goal    {goal.line()}' for goal in self.goals]
        for name in self.branches:
            lines.append(f'  branch  {name:<41} {"taken" if name in self.taken else "NOT TAKEN"}')
        if self.problem:
            lines += [f'  {line}' for line in f'problem {self.problem}'.splitlines()]
        return '\n'.join(lines)

    def conclude(self, world: World, tracks: Mapping[str, RobotTrack], file: Path) -> int:
        """Write the picture, print the summary, and return the exit code of the demonstration."""
        write_picture(world, tracks, file)
        print(f'\n{self.text()}\n  picture {file}\n', flush=True)
        return 0 if self.passed else 1


# The picture of a demonstration: a world, and what its robots have planned and driven.


def write_picture(world: World, tracks: Mapping[str, RobotTrack], file: Path) -> None:
    """Draw what :func:`draw_tracks` draws and write it as PNG to `file`, whose directory is made when missing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draw_tracks(world, tracks).quantize(64).save(file, optimize=True)


def draw_tracks(world: World, tracks: Mapping[str, RobotTrack]) -> Image.Image:
    """Return a world, whose robots are put where they are now, with their tracks by the names of the robots: the ways
    that they have driven, the plans dashed. The time is that since the tracks began.
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
    """Return the world of a file, as it is at the start, with the places of another file."""
    loaded = World.load(world)
    loaded.places = {name: Pose(place.x, place.y, place.yaw) for name, place in load_places(Path(places)).items()}
    return loaded
