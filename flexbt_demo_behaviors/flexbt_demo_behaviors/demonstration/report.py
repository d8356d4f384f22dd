# SPDX-License-Identifier: BSD-3-Clause
"""What a demonstration told while it ran, and what came of it."""

from __future__ import annotations

import copy
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TextIO

from .robot_track import Pose

# A goal counts as reached when the robot is this near to it, in metres, as the simulator knows it.
GOAL_TOLERANCE = 0.25


class DemoError(RuntimeError):
    """A demonstration did not do what it shall show; the message says what, and what was there instead."""


class Timeline:
    """Prints what happens, one line each, with the seconds since the start and who speaks. Thread-safe."""

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
        """The same timeline for what concerns one of several robots, whose name comes before all that is told."""
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
    """What became of one goal. `error` is the distance to it in metres when the drive was over; `seconds` are
    of simulated time and `metres` driven, both since it was given, if that is known.
    """

    label: str
    pose: Pose
    ending: str
    error: float
    reached: bool
    seconds: float | None = None
    metres: float | None = None

    def line(self) -> str:
        """The result for a person, on one line."""
        way = '' if self.seconds is None else f'  {self.metres:5.1f} m driven in {self.seconds:5.1f} s'
        return f'{self.label:<16} {self.pose!s:<24} {self.ending:<24} {self.error:5.2f} m off{way}'


@dataclass
class DemoReport:
    """The result of one demonstration."""

    title: str
    branches: dict[str, bool]
    goals: list[GoalResult] = field(default_factory=list)
    duration: float = 0.0
    problem: str = ''

    def take(self, branch: str) -> None:
        """Note that a branch which the demonstration shall take was taken."""
        if branch not in self.branches:
            raise KeyError(f'{self.title} does not promise the branch {branch!r}')
        self.branches[branch] = True

    def play(self, script: Callable[[], None]) -> None:
        """Play the part of the operator. What was otherwise than expected is the problem of the report."""
        before = time.monotonic()
        try:
            script()
        except DemoError as error:
            self.problem = str(error)
        self.duration = time.monotonic() - before

    @property
    def passed(self) -> bool:
        """Whether every branch was taken and every goal that should be reached was reached."""
        return not self.problem and bool(self.goals) and all(self.branches.values())

    def text(self) -> str:
        """The summary for a person; times of goals are simulated seconds."""
        lines = [f'{self.title}: {"passed" if self.passed else "FAILED"} after {self.duration:.1f} s']
        lines += [f'  goal    {goal.line()}' for goal in self.goals]
        for name, taken in self.branches.items():
            lines.append(f'  branch  {name:<41} {"taken" if taken else "NOT TAKEN"}')
        if self.problem:
            lines += [f'  {line}' for line in f'problem {self.problem}'.splitlines()]
        return '\n'.join(lines)
