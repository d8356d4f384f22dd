# SPDX-License-Identifier: BSD-3-Clause
"""Pacing of simulated time: in step with wall time or with the program that acts in the world, or paused.

As fast as possible (factor 0) means as fast as everybody keeps up whose work the world waits for:

- a *driver*, which answers messages of its robot by velocity commands: the world goes on when each has answered;
- a node that *computes* something that the robot waits for, such as a plan or the first command of a motion: the
  world goes on in real time meanwhile, since on a robot a plan takes time too;
- with neither, at :data:`IDLE_FACTOR`: faster, and the clock alone would keep the nodes of a robot busy.

Somebody may have begun to act, and his message not be handled yet, because the computer is busy. So until what has
arrived is handled (:data:`LOOK_SECONDS`) the world goes on in real time, and no lag is made good.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median_low
from typing import Final

MAX_LAG: Final = 0.2
"""Wall time, s, by which the simulation may fall behind before the loss is given up."""

IDLE_FACTOR: Final = 50.0
"""Speed factor of 'as fast as possible' while nobody acts."""

LOOK_SECONDS: Final = 0.02
"""Wall time, s, from one look whether messages have arrived to the next, at :data:`IDLE_FACTOR`; and maximum delay of
'as fast as possible' behind its schedule: more is given up at once, since catching up would rush past nodes that are
about to act.
"""

COMPUTING_FACTOR: Final = 1.0
"""Speed factor of 'as fast as possible' while a node computes."""

ANSWER_SECONDS: Final = 0.02
"""Maximum wall time for which 'as fast as possible' waits for the command that an odometry message causes, s."""

STALL_SECONDS: Final = 0.5
"""Maximum duration of one such wait while the robot moves, s: a computer may be busy for this long. In total, these
waits never make the world slower than real time."""

Post = Callable[[Callable[[], object]], object]
"""A function that schedules a call after everything that has arrived until now was handled."""

OnStepped = Callable[[int, bool], None]
"""See :meth:`Pacer.step`."""


class Schedule:
    """A schedule of simulated time on the wall clock. Wall time is the argument ``now``; all times in s.

    ``factor`` is the seconds of the simulated world per second; 0 for as fast as possible.
    """

    def __init__(self, factor: float, now: float) -> None:
        """Raise ValueError for a factor that is negative or not finite."""
        if not 0.0 <= factor < math.inf:
            raise ValueError(f'speed factor {factor}: give 0 or a positive, finite number')
        self.factor = factor
        self.due = now

    def advance(self, simulated: float, now: float, fastest: float = IDLE_FACTOR) -> float:
        """Go on by a piece of simulated time; when the world is to have got there.

        ``fastest`` is the factor of 'as fast as possible' for this piece.
        """
        self.due += simulated / (self.factor or fastest)
        if now - self.due > (MAX_LAG if self.factor else LOOK_SECONDS):
            self.due = now
        return self.due


@dataclass
class _Driver:
    commanded_at: float
    until: float
    """Time from which the robot brakes by itself."""
    is_stopping: bool
    """True if its last command was to stop: there may be no further command."""
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=9))

    def is_due(self, now: float) -> bool:
        """Return whether its next command should have come, by the interval that its commands usually have."""
        usual = median_low(self.intervals) if self.intervals else 0.0
        return self.commanded_at < now < self.until and now - self.commanded_at > usual - 1e-6


class Drivers:
    """The drivers of robots, and whose next command is due. Simulated time is the argument ``now``; all times in s."""

    def __init__(self) -> None:
        self._drivers: dict[str, _Driver] = {}

    def commanded(self, robot: str, now: float, until: float, *, is_stopping: bool) -> None:
        """Note a command: the robot follows it ``until`` a time; ``is_stopping`` if it is to stop."""
        driver = self._drivers.get(robot)
        if driver is None:
            self._drivers[robot] = _Driver(now, until, is_stopping)
            return
        if now > driver.commanded_at:
            driver.intervals.append(now - driver.commanded_at)
        driver.commanded_at, driver.until, driver.is_stopping = now, until, is_stopping

    def forget(self, robot: str) -> None:
        """Forget the driver of a robot, if it has one."""
        self._drivers.pop(robot, None)

    def clear(self) -> None:
        """Forget all drivers."""
        self._drivers.clear()

    def acting(self, now: float) -> bool:
        """Return whether anybody drives."""
        for robot in [name for name, driver in self._drivers.items() if now >= driver.until]:
            self.forget(robot)
        return bool(self._drivers)

    def due(self, now: float) -> list[str]:
        """Return the robots whose next command should have come."""
        return [robot for robot, driver in self._drivers.items() if driver.is_due(now)]

    def did_not_answer(self, robot: str) -> None:
        """Note that the command of this robot did not come. If its last command was to stop, expect no other."""
        driver = self._drivers.get(robot)
        if driver is not None and driver.is_stopping:
            self.forget(robot)


@dataclass
class _StepRequest:
    """See :meth:`Pacer.step`."""

    left: int
    on_stepped: OnStepped
    piece: int


class Pacer:
    """A pacer that waits on the wall clock after each piece of simulated time. ``stop`` ends all waiting. From any
    thread."""

    def __init__(self, factor: float, post: Post = lambda told: told()) -> None:
        """Use the default ``post`` if messages are handled at once. Raises ValueError, as :class:`Schedule`."""
        self._schedule = Schedule(factor, time.monotonic())
        self._post = post
        self._looked = -math.inf
        self._has_handled = True
        self._event = threading.Condition()
        self._drivers = Drivers()
        self._computing: set[object] = set()
        self._patience = STALL_SECONDS
        self._stopped = False
        self._is_paused = False
        self._request: _StepRequest | None = None
        """The remaining steps that were requested while time is paused."""
        self._begun: _StepRequest | None = None
        """The request that the steps being made belong to."""

    @property
    def factor(self) -> float:
        """See :class:`Schedule`."""
        return self._schedule.factor

    @factor.setter
    def factor(self, factor: float) -> None:
        # The current wait was computed with the old factor: end it.
        with self._event:
            self._schedule = Schedule(factor, time.monotonic())
            self._event.notify_all()

    # -- who acts ----------------------------------------------------------------------------------------------------

    def command_received(self, robot: str, now: float, until: float, *, is_stopping: bool) -> None:
        """Note a velocity command; see :meth:`Drivers.commanded`."""
        with self._event:
            self._drivers.commanded(robot, now, until, is_stopping=is_stopping)
            self._event.notify_all()

    def forget_driver(self, robot: str) -> None:
        """Forget the driver of a robot that is gone, or was placed elsewhere."""
        with self._event:
            self._drivers.forget(robot)
            self._event.notify_all()

    def forget_drivers(self) -> None:
        """Forget all drivers: the robots were placed elsewhere."""
        with self._event:
            self._drivers.clear()
            self._event.notify_all()

    def set_computing(self, who: object, is_computing: bool) -> None:
        """Record that a node starts or ends a computation that a robot waits for."""
        with self._event:
            (self._computing.add if is_computing else self._computing.discard)(who)
            self._event.notify_all()

    # -- standing still ----------------------------------------------------------------------------------------------

    @property
    def is_paused(self) -> bool:
        """True if time is paused, except for steps."""
        return self._is_paused

    def pause(self) -> None:
        """Let time stand still."""
        with self._event:
            self._is_paused = True
            self._event.notify_all()

    def play(self) -> None:
        """Let time go on. Steps that were left are not made."""
        with self._event:
            self._is_paused = False
            self._schedule = Schedule(self._schedule.factor, time.monotonic())
        self.cancel_steps()

    def step(self, count: int, on_stepped: OnStepped, piece: int) -> bool:
        """Have this many steps made while time is paused; False, and nothing, while others are being made, or it does
        not stand still.

        ``on_stepped(left, is_over)`` is called after each ``piece`` of them or less, on the thread that steps; when no
        more are made, for whatever reason, ``is_over``.
        """
        with self._event:
            if not self._is_paused or self._request is not None or self._stopped:
                return False
            self._request = _StepRequest(count, on_stepped, piece)
            self._event.notify_all()
            return True

    def cancel_steps(self) -> None:
        """Make no more steps."""
        with self._event:
            request, self._request = self._request, None
            self._event.notify_all()
        if request is not None:
            request.on_stepped(request.left, True)

    def begin(self, most: int) -> tuple[int, bool]:
        """Return how many steps may be made now, up to ``most``, and whether they are those that were asked for while
        time stands still; it waits for them then. 0 after :meth:`stop`.
        """
        with self._event:
            self._event.wait_for(lambda: self._stopped or not self._is_paused or self._request is not None)
            if self._stopped:
                return 0, False
            self._begun = request = self._request if self._is_paused else None
            return (most, False) if request is None else (min(most, request.left, request.piece), True)

    def stop(self) -> None:
        """End all waiting, now and later."""
        with self._event:
            self._stopped = True
            self._event.notify_all()

    @property
    def stopped(self) -> bool:
        """True if :meth:`stop` was called."""
        return self._stopped

    # -- on the thread that steps ------------------------------------------------------------------------------------

    def wait(self, steps: int, simulated: float, now: float) -> None:
        """Let the wall time of ``steps`` pass that took ``simulated`` seconds, until the simulated time ``now``."""
        with self._event:
            request = self._begun if self._begun is self._request else None
            if request is not None:
                request.left -= steps
                if not request.left:
                    self._request = None
            elif not self._is_paused:
                self._wait(simulated, now)
        if request is not None:
            request.on_stepped(request.left, request.left == 0)

    def _wait(self, simulated: float, now: float) -> None:
        fastest = IDLE_FACTOR
        if self._schedule.factor == 0.0:
            if self._drivers.acting(now):
                self._wait_for_answers(simulated, now)
                return
            self._look(simulated)
            if self._computing:
                fastest = COMPUTING_FACTOR
        self._schedule.advance(simulated, time.monotonic(), fastest)
        computing = bool(self._computing)
        while not self._stopped and (left := self._schedule.due - time.monotonic()) > 0.0:
            is_over = self._drivers.acting(now) or (computing and not self._computing)
            if is_over and self._schedule.factor == 0.0:
                self._schedule = Schedule(0.0, time.monotonic())  # it is done, and waited for no longer
                return
            self._event.wait(min(left, threading.TIMEOUT_MAX)) if left > 0.005 else self._sleep(left)

    def _look(self, simulated: float) -> None:
        """See now and then that what has arrived is handled. It is waited for in real time."""
        now, schedule = time.monotonic(), self._schedule
        if self._has_handled and now - self._looked >= LOOK_SECONDS:
            self._looked, self._has_handled = now, False
            self._post(self._handled)

        def is_over() -> bool:
            return self._has_handled or self._stopped or self._is_paused or self._schedule is not schedule

        self._event.wait_for(is_over, simulated / COMPUTING_FACTOR)

    def _handled(self) -> None:
        with self._event:
            self._has_handled = True
            self._event.notify_all()

    def _wait_for_answers(self, simulated: float, now: float) -> None:
        """Let the drivers answer, for a short time. Simulated time goes on from then."""
        schedule, began = self._schedule, time.monotonic()

        def is_over() -> bool:
            return self._stopped or self._is_paused or self._schedule is not schedule or not self._drivers.due(now)

        self._patience = min(STALL_SECONDS, self._patience + simulated)
        if not self._event.wait_for(is_over, ANSWER_SECONDS):
            for robot in self._drivers.due(now):
                self._drivers.did_not_answer(robot)
            self._event.wait_for(is_over, self._patience - ANSWER_SECONDS)
        ended = time.monotonic()
        self._patience = max(0.0, self._patience - (ended - began))
        self._schedule = Schedule(self._schedule.factor, ended)

    def _sleep(self, seconds: float) -> None:
        # Conditions wake up late by more than this on some machines.
        self._event.release()
        try:
            time.sleep(seconds)
        finally:
            self._event.acquire()
