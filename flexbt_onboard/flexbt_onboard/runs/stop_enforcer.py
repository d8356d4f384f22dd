# SPDX-License-Identifier: BSD-3-Clause
"""The enforcement of stops, from the request to stop a run until all of it has stopped.

The run cancels its own goals. If that is not confirmed within a short time, :class:`MotionStop` stops the robot, and
the operator sees the parts that have not stopped. After a timeout the run is aborted. A server may continue to move the
robot after its client has given up, so the robot is held until the server has ended its goals.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.link.reporter import Reporter

from .behavior_run import BehaviorRun
from .motion_stop import MotionStop

MOTION_SECONDS: Final = 0.3
"""Time after which an unconfirmed stop is enforced with :class:`MotionStop`, s. A cancel that passes a BT server and a
navigation server takes a tenth of a second, and the robot must stand still within a second."""

HALT_SECONDS: Final = 5.0
"""Minimum time for which a STOP without a run holds the robot, s."""

_PERIOD: Final = 0.5


class StopEnforcer:
    """The enforcer of stops. Used on the executor thread only.

    ``timeout`` is in seconds of wall time since the stop of the run. It reports to operators the actions that continue
    after the stop, and their end.
    """

    def __init__(self, runtime: Runtime, robot: MotionStop, timeout: float, report: Reporter) -> None:
        self.timeout = timeout
        self._runtime = runtime
        self._robot = robot
        self._report = report
        self._told: Mapping[tuple[str, bytes], str] = {}
        self._run: BehaviorRun | None = None
        self._timer: Timer | None = None

    def prepare(self) -> None:
        """Discover the servers that move the robot, so that a STOP need not wait for that."""
        self._robot.prepare()

    def begins(self) -> None:
        """Prepare for a new run: release the robot, and drop cancels that are still pending.

        A server that has just started might otherwise receive an old cancel during the new run.
        """
        self._leave()
        self._robot.drop_cancels()
        self._robot.prepare()

    def halt_robot(self, is_running: bool) -> None:
        """Stop the robot for a STOP of an operator, no matter which program drives it.

        ``is_running`` is True if a run exists, which the caller has stopped.
        """
        run = self._run  # a run that has ended may still have active goals
        if is_running or (run is not None and (run.has_goals or self._robot.is_holding)):
            self._robot.cancel_others()
            return
        self._leave()
        self._robot.hold()
        self._halt_for(HALT_SECONDS)

    def _halt_for(self, seconds: float) -> None:
        self._timer = self._runtime.post_in(seconds, self._leave_halted)

    def _leave_halted(self) -> None:
        if self.goes_on():
            self._halt_for(_PERIOD)
        else:
            self._leave()

    def stopping(self, run: BehaviorRun) -> None:
        """Enforce the stop of a run.

        The robot is held until the goals of the run and all other goals that move the robot have ended, or until the
        next run begins. The first check comes after a short time, even if the run ends at once, since a server may
        still be moving the robot.
        """
        self._run = run
        self._robot.prepare()  # for servers that have started since the run began
        self._check_in(MOTION_SECONDS, run, self._runtime.steady.now())

    def _leave(self) -> None:
        self._run = None
        self._told = {}
        if self._timer is not None:
            self._timer.cancel()
        self._robot.release()

    def _check_in(self, seconds: float, run: BehaviorRun, stopped_at: float) -> None:
        self._timer = self._runtime.post_in(seconds, lambda: self._check(run, stopped_at))

    def _check(self, run: BehaviorRun, stopped_at: float) -> None:
        if run.has_ended and not run.has_goals and not self.goes_on():
            self._leave()
            return
        self._robot.hold()
        seconds = self._runtime.steady.now() - stopped_at
        if seconds >= self.timeout:
            run.abort(f'aborted {self.timeout:g} s after the stop')
        run.show_not_stopped(seconds)
        self._check_in(_PERIOD, run, stopped_at)

    def goes_on(self) -> bool:
        """Return True if a server still moves the robot. Report changes to operators."""
        going_on = self._robot.going_on
        if going_on and going_on.keys() != self._told.keys():
            self._report.log(
                ExecutiveLog.WARN,
                f'the robot is kept at rest until the next start: {_listed(going_on)} continued after the stop. '
                'Restart the node if it does not end the goal; a node that was killed is taken for running '
                'for up to 30 s: wait, or start the next run',
            )
        elif self._told and not going_on:
            text = f'{_listed(self._told)} has ended: the robot is not kept at rest any more'
            self._report.log(ExecutiveLog.WARN, text)
        self._told = going_on
        return bool(going_on)


def _listed(going_on: Mapping[tuple[str, bytes], str]) -> str:
    return ', '.join(sorted({*going_on.values()}))
