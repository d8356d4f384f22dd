# SPDX-License-Identifier: BSD-3-Clause
"""The link to a robot as user interfaces use it. Needs no ROS."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from typing import ClassVar

from flexbt_console.errors import RefusedError
from flexbt_console.mirror.records import (
    OperatorCommand,
    Synthesis,
    SynthesisRequest,
    TreeBlackboard,
    UserdataScope,
)
from flexbt_console.mirror.view import View


class RobotLink:
    """A robot to query and command. This base class is not connected: it refuses everything for the reason ``why``.

    The methods are not for the executor thread; each raises ConsoleError.
    """

    why: ClassVar[str] = 'there is no robot to ask'

    def send(self, command: OperatorCommand, timeout: float, label: str) -> object:
        """Send a command with ``timeout`` seconds for its answer; the mirror follows its result."""
        raise RefusedError(self.why)

    def userdata(self, path: str, keys: Sequence[str], timeout: float) -> tuple[UserdataScope, ...]:
        """Return the userdata of the run; '' is the path of every active machine, and no keys are all."""
        raise RefusedError(self.why)

    def blackboard(self, run_id: str, keys: Sequence[str], timeout: float) -> TreeBlackboard:
        """Return the blackboards of a running tree, '' for the only one; no keys are all."""
        raise RefusedError(self.why)

    def write_incident(self, timeout: float) -> str:
        """Have the black box write an incident; return its folder on the robot."""
        raise RefusedError(self.why)

    def synthesis(
        self, request: SynthesisRequest, timeout: float, tell: Callable[[str], None], left: Future[None] | None = None
    ) -> Synthesis:
        """Request a behavior, or the reason why none is possible; ``tell`` receives progress from time to time.

        The search is canceled once ``left`` is done, i.e. the requester has left.
        """
        raise RefusedError(self.why)

    def cancel_synthesis(self, timeout: float) -> int:
        """Cancel the running searches; return their number."""
        raise RefusedError(self.why)

    def surroundings(self, has_arrived: Callable[[View], bool], timeout: float, scan_period: float = 0.0) -> View:
        """Return the picture with trees, map and plan, and with the scan if its period in seconds is given; as soon as
        what is wanted ``has_arrived``, or what there is after ``timeout`` seconds.
        """
        raise RefusedError(self.why)
