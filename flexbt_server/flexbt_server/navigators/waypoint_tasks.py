# SPDX-License-Identifier: BSD-3-Clause
"""What is done at each waypoint of follow_waypoints: Nav2's waypoint task executors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from std_msgs.msg import Empty

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer

from .parameters import InputParameters


class WaypointTask(Protocol):
    """Used on the executor thread; once at a time."""

    def begin(self, on_end: Callable[[str], None]) -> None:
        """Begin; ``on_end`` is called on the executor thread with why the task has failed, or ''."""

    def cancel(self) -> None:
        """End without a word. Harmless if nothing has begun."""


class WaitAtWaypoint:
    """``wait_at_waypoint``: lets some time pass, s of the clock of the node."""

    def __init__(self, runtime: NodeRuntime, pause: float) -> None:
        self._runtime = runtime
        self._pause = pause
        self._timer: Timer | None = None

    def begin(self, on_end: Callable[[str], None]) -> None:
        """See WaypointTask."""
        if not self._pause:
            on_end('')
            return
        clock = self._runtime.clock
        self._timer = clock.call_at(clock.now() + self._pause, lambda: on_end(''))

    def cancel(self) -> None:
        """See WaypointTask."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class InputAtWaypoint:
    """``input_at_waypoint``: waits for a message on a topic, and fails when none comes in time."""

    def __init__(self, runtime: NodeRuntime, parameters: InputParameters) -> None:
        self._parameters = parameters
        self._timeout = WaitAtWaypoint(runtime, parameters.timeout)
        self._on_end: Callable[[str], None] | None = None
        runtime.node.create_subscription(Empty, parameters.topic, lambda _: self._end(''), names.INPUT_DEPTH)

    def begin(self, on_end: Callable[[str], None]) -> None:
        """See WaypointTask."""
        self._on_end = on_end
        why = f'nothing has come on {self._parameters.topic} within {self._parameters.timeout:g} s'
        self._timeout.begin(lambda _: self._end(why))

    def cancel(self) -> None:
        """See WaypointTask."""
        self._timeout.cancel()
        self._on_end = None

    def _end(self, why: str) -> None:
        on_end = self._on_end
        if on_end is not None:
            self.cancel()
            on_end(why)
