# SPDX-License-Identifier: BSD-3-Clause
"""Pacing of simulated time: in step with wall time, in step with the program that acts in the world, or paused.

As fast as possible (factor 0) means as fast as the nodes that the world waits for keep up:

- a *driver*, which answers messages of its robot with velocity commands: the world continues when each has answered;
- a node that *computes* something that the robot waits for, such as a plan or the first command of a motion: the
  world continues in real time meanwhile, since a plan takes time on a robot, too;
- with neither, at :data:`IDLE_FACTOR`: if it were faster, the clock alone would keep the nodes of a robot busy.

A node may have started to act while its message is not handled yet, because the computer is busy. So the world runs in
real time until the messages that have arrived are handled (:data:`LOOK_SECONDS`), and does not catch up afterwards.
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
"""Maximum lag of the simulation, s of wall time, that it catches up."""

IDLE_FACTOR: Final = 50.0
"""Speed factor of 'as fast as possible' while no node acts."""

LOOK_SECONDS: Final = 0.02
"""Wall time, s, between two checks for arrived messages at :data:`IDLE_FACTOR`. It is also the maximum lag of 'as fast
as possible' behind its schedule: more is dropped immediately, since catching up would rush past nodes that are about to
act."""

COMPUTING_FACTOR: Final = 1.0
"""Speed factor of 'as fast as possible' while a node computes."""

ANSWER_SECONDS: Final = 0.02
"""Maximum wall time for which 'as fast as possible' waits for the command that an odometry message causes, s."""

STALL_SECONDS: Final = 0.5
"""Maximum duration of one such wait while the robot moves, s: a computer may be busy for this long. In total, these
waits never make the world slower than real time."""

Post = Callable[[Callable[[], object]], object]
"""A function that schedules a call after all messages that have arrived so far are handled."""

OnStepped = Callable[[int, bool], None]
"""See :meth:`Pacer.step`."""


class Schedule:
    """A schedule of simulated time on the wall clock. Wall time is the argument ``now``; all times in s.

    ``factor`` is simulated seconds per second of wall time; 0 for as fast as possible.
    """

    def __init__(self, factor: float, now: float) -> None:
        """Raise ValueError if the factor is negative or not finite."""
        if not 0.0 <= factor < math.inf:
            raise ValueError(f'speed factor {factor}: give 0 or a positive, finite number')
        self.factor = factor
        self.due = now

    def advance(self, simulated: float, now: float, fastest: float = IDLE_FACTOR) -> float:
        """Advance by a piece of simulated time, and return the wall time at which the world should get there.

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
    """Time at which the robot starts to brake by itself."""
    is_stopping: bool
    """True if its last command was to stop: no further command may follow."""
    intervals: deque[float] = field(default_factory=lambda: deque(maxlen=9))

    def is_due(self, now: float) -> bool:
        """Return whether its next command is due, by the usual interval of its commands."""
        usual = median_low(self.intervals) if self.intervals else 0.0
        return self.commanded_at < now < self.until and now - self.commanded_at > usual - 1e-6


class Drivers:
    """The drivers of robots and the due times of their commands. Simulated time is the argument ``now``; all times in
    s."""

    def __init__(self) -> None:
        self._drivers: dict[str, _Driver] = {}

    def commanded(self, robot: str, now: float, until: float, *, is_stopping: bool) -> None:
        """Record a command, which the robot follows ``until`` a time; ``is_stopping`` is True if it stops the robot."""
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
        """Return whether any robot has a driver."""
        for robot in [name for name, driver in self._drivers.items() if now >= driver.until]:
            self.forget(robot)
        return bool(self._drivers)

    def due(self, now: float) -> list[str]:
        """Return the robots whose next command is due."""
        return [robot for robot, driver in self._drivers.items() if driver.is_due(now)]

    def did_not_answer(self, robot: str) -> None:
        """Record that no command of this robot arrived. If its last command was to stop, expect no other."""
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
    """A pacer that waits on the wall clock after each piece of simulated time. ``stop`` ends all waiting.
    Thread-safe."""

    def __init__(self, factor: float, post: Post = lambda told: told()) -> None:
        """Use the default ``post`` if messages are handled immediately. Raises ValueError, as :class:`Schedule`."""
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
        """The request of the steps in progress."""

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

    # -- nodes that act ----------------------------------------------------------------------------------------------

    def command_received(self, robot: str, now: float, until: float, *, is_stopping: bool) -> None:
        """Record a velocity command; see :meth:`Drivers.commanded`."""
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

    # -- pausing -----------------------------------------------------------------------------------------------------

    @property
    def is_paused(self) -> bool:
        """True if time is paused, except for steps."""
        return self._is_paused

    def pause(self) -> None:
        """Pause time."""
        with self._event:
            self._is_paused = True
            self._event.notify_all()

    def play(self) -> None:
        """Resume time. Remaining steps are dropped."""
        with self._event:
            self._is_paused = False
            self._schedule = Schedule(self._schedule.factor, time.monotonic())
        self.cancel_steps()

    def step(self, count: int, on_stepped: OnStepped, piece: int) -> bool:
        """Request this many steps while time is paused. Return False, without effect, if time is not paused or other
        steps are in progress.

        ``on_stepped(left, is_over)`` is called after at most ``piece`` steps each, on the thread that steps.
        ``is_over`` is True if no more steps follow, for whatever reason.
        """
        with self._event:
            if not self._is_paused or self._request is not None or self._stopped:
                return False
            self._request = _StepRequest(count, on_stepped, piece)
            self._event.notify_all()
            return True

    def cancel_steps(self) -> None:
        """Cancel the remaining steps."""
        with self._event:
            request, self._request = self._request, None
            self._event.notify_all()
        if request is not None:
            request.on_stepped(request.left, True)

    def begin(self, most: int) -> tuple[int, bool]:
        """Return the number of steps to make now, up to ``most``, and whether they were requested with :meth:`step`.
        While time is paused, wait for such a request. Return 0 steps after :meth:`stop`."""
        with self._event:
            self._event.wait_for(lambda: self._stopped or not self._is_paused or self._request is not None)
            if self._stopped:
                return 0, False
            self._begun = request = self._request if self._is_paused else None
            return (most, False) if request is None else (min(most, request.left, request.piece), True)

    def may_step(self, *, is_requested: bool) -> bool:
        """Return whether to make the next one of the steps that :meth:`begin` has returned; False if time was paused or
        resumed meanwhile, or the steps were canceled. ``is_requested`` is what it has returned with them."""
        return self._is_paused is is_requested and (not is_requested or self._begun is self._request)

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
        """Wait until the wall time for ``steps`` has passed: ``simulated`` seconds, up to the simulated time
        ``now``."""
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
        while not (self._stopped or self._is_paused) and (left := self._schedule.due - time.monotonic()) > 0.0:
            is_over = self._drivers.acting(now) or (computing and not self._computing)
            if is_over and self._schedule.factor == 0.0:
                self._schedule = Schedule(0.0, time.monotonic())  # the computation is done: stop waiting for it
                return
            self._event.wait(min(left, threading.TIMEOUT_MAX)) if left > 0.005 else self._sleep(left)

    def _look(self, simulated: float) -> None:
        """Check regularly that the messages that have arrived are handled; wait for that in real time."""
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
        """Wait for a short time for the drivers to answer. Simulated time continues from then."""
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
