# SPDX-License-Identifier: BSD-3-Clause
"""The goals that leaves have canceled, and that are not known to have ended: a server may ignore its cancels."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import islice
from typing import Final

from flexbt_core.clock import Clock, Timer

_MOST_TOLD: Final = 16


@dataclass(frozen=True, eq=False)
class EndingGoal:
    """A goal of the action ``action`` that was canceled, and of which ``resources`` are the actuators. ``server`` is
    the action's full name, which trees may give in other ways, too; ``since`` is on the steady clock, ``time_of_day``
    for people."""

    action: str
    server: str
    resources: frozenset[str]
    since: float
    time_of_day: str

    @property
    def description(self) -> str:
        """What goes on, for a person."""
        return f'canceling the goal of {self.action}'


class EndingGoals:
    """Those of all trees of a server. From any thread.

    A tree is over when its time to halt is; what its goals do is not: as long as one may move an actuator, no other
    goal for that actuator, or for the same server, is sent, by whatever tree.

    ``warn(message)`` is told when a goal has not ended ``patience`` seconds after its cancel, and when it has after
    that; ``resolve(action)`` gives the full name of an action.
    """

    def __init__(
        self, steady: Clock, patience: float, warn: Callable[[str], None], resolve: Callable[[str], str]
    ) -> None:
        self._steady = steady
        self._patience = patience
        self._warn = warn
        self._resolve = resolve
        self._alarms: dict[EndingGoal, Timer] = {}
        self._overdue: set[EndingGoal] = set()
        self._waiting: set[Callable[[], None]] = set()
        self._lock = threading.Lock()

    def add(self, action: str, resources: Collection[str]) -> EndingGoal:
        """A goal was canceled; it is given to :meth:`remove` when it is known to have ended."""
        goal = EndingGoal(
            action, self._resolve(action), frozenset(resources), self._steady.now(), time.strftime('%H:%M:%S')
        )
        with self._lock:
            self._alarms[goal] = self._steady.call_at(goal.since + self._patience, lambda: self._late(goal))
        return goal

    def remove(self, goal: EndingGoal) -> None:
        """The goal has ended: who waits looks again."""
        with self._lock:
            self._alarms.pop(goal).cancel()
            was_overdue = goal in self._overdue
            self._overdue.discard(goal)
            waiting = tuple(self._waiting)
        if was_overdue:
            self._warn(f'{goal.action}: the goal has ended {self._steady.now() - goal.since:.1f} s after its cancel')
        for wake in waiting:
            wake()

    def overdue(self, given_up: Collection[str] = ()) -> list[str]:
        """What goes on although its server had its time to end it, and what to do, for a person; the 16 oldest.

        ``given_up``: descriptions of goals that a tree has waited for in vain, which counts as well.
        """
        with self._lock:
            late = (goal for goal in self._alarms if goal in self._overdue or goal.description in given_up)
            goals = list(islice(late, _MOST_TOLD))
        return [
            f'{goal.action}: its server has not ended the goal canceled at {goal.time_of_day}: '
            f'{"the robot may move; STOP keeps it at rest," if goal.resources else "what it does goes on;"} restart a '
            'server that hangs'
            for goal in goals
        ]

    def in_the_way_of(self, action: str, resources: Collection[str]) -> tuple[str, ...]:
        """What has to end before a goal for this action with these actuators is sent."""
        if not self._alarms:
            return ()
        server = self._resolve(action)
        with self._lock:
            return tuple(
                goal.description
                for goal in self._alarms
                if goal.server == server or not goal.resources.isdisjoint(resources)
            )

    def wait(self, wake: Callable[[], None]) -> None:
        """Call ``wake()`` whenever a goal has ended, until :meth:`stop_waiting`."""
        with self._lock:
            self._waiting.add(wake)

    def stop_waiting(self, wake: Callable[[], None]) -> None:
        """Harmless when it does not wait."""
        with self._lock:
            self._waiting.discard(wake)

    def _late(self, goal: EndingGoal) -> None:
        with self._lock:
            if goal not in self._alarms:
                return
            self._overdue.add(goal)
        held = ', '.join(sorted(goal.resources))
        self._warn(
            f'{goal.action}: its server has not ended the goal {self._patience:g} s after its cancel, so what it does '
            f'goes on. It is asked again and again; no other goal is sent to it{f" or to {held}" if held else ""} '
            'before. To stop the robot: STOP at the executive; restart the server if it hangs'
        )
