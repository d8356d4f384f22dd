# SPDX-License-Identifier: BSD-3-Clause
"""PauseResumeController of Nav2 (branch main): a tree within a tree that can be paused from outside."""

from __future__ import annotations

import threading
from enum import Enum
from typing import Final

from flexbt_core.behavior_tree.engine import Control, NodeConfig
from flexbt_core.behavior_tree.model import FAILURE, RUNNING, STRING, SUCCESS, NodeStatus, input_port


class PauseState(Enum):
    """What a PauseResumeController is at. The value is the index of the child that is ticked."""

    RESUMED = 0
    PAUSED = 1
    ON_PAUSE = 2
    ON_RESUME = 3


_NEXT: Final = {PauseState.ON_PAUSE: PauseState.PAUSED, PauseState.ON_RESUME: PauseState.RESUMED}


class PauseResumeController(Control):
    """Ticks its first child. After a pause the third, until it completes, and then the second; after the resume the
    fourth, until it completes, and then the first again.

    A request halts the child that runs. The result of the first child is that of the node (skipped counts as SUCCESS);
    that of the others only takes it on, but a FAILURE of any is the node's. Children after the first may be left out.
    """

    # The host derives from this class, and calls pause and resume for requests to the services that the ports name.

    __slots__ = ('_lock', '_requested', '_state')

    ports = {
        'pause_service_name': input_port(STRING, optional=True, description='service that pauses'),
        'resume_service_name': input_port(STRING, optional=True, description='service that resumes'),
    }
    children_bounds = (1, 4)

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._lock = threading.Lock()
        self._state = PauseState.RESUMED
        self._requested: PauseState | None = None

    @property
    def state(self) -> PauseState:
        return self._state

    def pause(self) -> bool:
        """Asks for a pause, from any thread. False when the node is paused already, or is not RUNNING."""
        with self._lock:
            if self.status is not RUNNING or (self._state is PauseState.PAUSED and self._requested is None):
                return False
            self._requested = PauseState.ON_PAUSE
        self.wake()
        return True

    def resume(self) -> bool:
        """Asks for the end of a pause, from any thread. False when the node is not paused."""
        with self._lock:
            if self._state is not PauseState.PAUSED or self._requested is not None:
                return False
            self._requested = PauseState.ON_RESUME
        self.wake()
        return True

    def tick(self) -> NodeStatus:
        if not self.active:
            self._restart()
        self.status = RUNNING
        with self._lock:
            requested, self._requested = self._requested, None
            if requested is not None:
                self._state = requested
        if requested is not None:
            self.reset_children()
        index = self._state.value
        if index < len(self.children):
            status = self.tick_child(index)
            if status is RUNNING:
                return RUNNING
            self.reset_children()
            if status is FAILURE:
                return FAILURE
            if self._state is PauseState.RESUMED:
                return SUCCESS
        following = _NEXT.get(self._state)
        if following is not None:
            self._state = following
            self.context.woken = True
        return RUNNING

    def halt(self) -> None:
        self._restart()
        super().halt()

    def _restart(self) -> None:
        with self._lock:
            self._state = PauseState.RESUMED
            self._requested = None
