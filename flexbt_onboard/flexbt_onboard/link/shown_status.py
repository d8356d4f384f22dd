# SPDX-License-Identifier: BSD-3-Clause
"""The status, and what else others are shown of a run: only what a crash cannot undo."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from flexbt_common.runtime import NodeRuntime
from flexbt_msgs.msg import DecisionSubjects, ExecutiveStatus


class Picture(NamedTuple):
    """The status, and what its decisions are about."""

    status: ExecutiveStatus
    subjects: DecisionSubjects


class ShownStatus:
    """Shows a status when the journal has all that is in it. Used on the executor thread.

    While the disk takes its time, what was shown before is shown again, so that the heartbeat goes on. ``make`` gives
    the status of now, ``publish`` sends one, ``when_durable`` is that of the journal, and ``changed`` is told when what
    is shown is not the newest any more.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        make: Callable[[], Picture],
        publish: Callable[[Picture], None],
        when_durable: Callable[[Callable[[], object]], None],
        changed: Callable[[], None],
    ) -> None:
        """Must be called before anything happens: what was found in the journal is durable."""
        self._picture = make()
        self._runtime = runtime
        self._make = make
        self._publish = publish
        self._when_durable = when_durable
        self._changed = changed
        self._to_show: deque[Callable[[], None]] = deque()
        self._is_waiting = False
        self._is_outdated = False

    @property
    def message(self) -> ExecutiveStatus:
        """Return what is shown, or is going to be shown first."""
        return self._picture.status

    def show(self, publish: Callable[[], None]) -> None:
        """Have ``publish`` called when the journal has all that has happened so far, in the order of these calls."""
        self._to_show.append(publish)
        self._when_durable(lambda: self._on_executor(self._show_next))

    def refresh(self) -> None:
        """Show the status of now as soon as that is possible, or that of before."""
        if self._is_waiting:
            self._is_outdated = True
            self._publish(self._picture)
            return
        self._is_waiting = True
        picture = self._make()
        self.show(lambda: self._show(picture))

    def _show_next(self) -> None:
        # The first of them, whichever is told: what came before is durable as well.
        self._to_show.popleft()()

    def _on_executor(self, fn: Callable[[], None]) -> None:
        if self._runtime.on_executor_thread:
            fn()
        else:
            self._runtime.post(fn)

    def _show(self, picture: Picture) -> None:
        self._is_waiting, self._picture = False, picture
        self._publish(picture)
        if self._is_outdated:
            self._is_outdated = False
            self._changed()
