# SPDX-License-Identifier: BSD-3-Clause
"""Keeps simulated time in step with wall time, or with whoever drives the robot."""

from __future__ import annotations

import math
import threading
import time
from typing import Final

MAX_LAG: Final = 0.2
"""Wall time, s, by which the simulation may fall behind before the loss is given up."""

IDLE_FACTOR: Final = 50.0
"""Speed factor of 'as fast as possible' while nobody drives."""

ANSWER_SECONDS: Final = 0.02
"""How long 'as fast as possible' waits for the command that an odometry message causes, s of wall time."""


class Schedule:
    """When simulated time is due on the wall clock. Wall time, ``now``, is handed in; all times in s.

    ``factor`` is the seconds of the simulated world per second; 0 for as fast as whoever drives the robot keeps up.
    """

    def __init__(self, factor: float, now: float) -> None:
        """Raises ValueError for a factor that is negative or not finite."""
        if not 0.0 <= factor < math.inf:
            raise ValueError(f'speed factor {factor}: give 0 or a positive, finite number')
        self.factor = factor
        self.due = now

    def advance(self, simulated: float, now: float) -> float:
        """Go on by a piece of simulated time; when the world is to have got there."""
        self.due += simulated / (self.factor or IDLE_FACTOR)
        if now - self.due > MAX_LAG:
            self.due = now
        return self.due


class Pacer:
    """Waits after each piece of simulated time, on the wall clock. ``stop`` ends all waiting."""

    def __init__(self, factor: float) -> None:
        """Raises ValueError, as :class:`Schedule`."""
        self._schedule = Schedule(factor, time.monotonic())
        self._event = threading.Condition()
        self._commands = 0
        self._stopped = False

    @property
    def factor(self) -> float:
        """See :class:`Schedule`."""
        return self._schedule.factor

    @factor.setter
    def factor(self, factor: float) -> None:
        # What is being waited for now was long at the old factor: it is over.
        with self._event:
            self._schedule = Schedule(factor, time.monotonic())
            self._event.notify_all()

    def command_received(self) -> None:
        """A velocity command has come; from any thread."""
        with self._event:
            self._commands += 1
            self._event.notify_all()

    def stop(self) -> None:
        """End all waiting, now and later."""
        with self._event:
            self._stopped = True
            self._event.notify_all()

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` was called."""
        return self._stopped

    @property
    def commands(self) -> int:
        """How many commands have come."""
        return self._commands

    def wait(self, simulated: float) -> None:
        """Let ``simulated`` seconds pass, at the speed factor."""
        with self._event:
            self._schedule.advance(simulated, time.monotonic())
            while not self._stopped and (left := self._schedule.due - time.monotonic()) > 0.0:
                self._event.wait(min(left, threading.TIMEOUT_MAX)) if left > 0.005 else self._sleep(left)

    def wait_for_answer(self, commands_before: int) -> None:
        """Let whoever drives answer an odometry message, for a short time. Simulated time goes on from then."""
        with self._event:
            self._event.wait_for(lambda: self._stopped or self._commands > commands_before, ANSWER_SECONDS)
            self._schedule = Schedule(self._schedule.factor, time.monotonic())

    def _sleep(self, seconds: float) -> None:
        # Conditions wake up late by more than this on some machines.
        self._event.release()
        try:
            time.sleep(seconds)
        finally:
            self._event.acquire()
