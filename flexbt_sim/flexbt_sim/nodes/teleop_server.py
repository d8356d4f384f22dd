# SPDX-License-Identifier: BSD-3-Clause
"""The action assisted_teleop: what an operator commands on cmd_vel_teleop drives the robot, slower before obstacles.

A message on preempt_teleop says that the operator has done what was to be done: the goal succeeds.
"""

from __future__ import annotations

import math
from typing import Any, Final

from geometry_msgs.msg import Twist, TwistStamped
from nav2_msgs.action import AssistedTeleop as AssistedTeleopAction
from std_msgs.msg import Empty

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import duration_message, seconds_of
from flexbt_sim.navigation import STOP, AssistedTeleop, Velocity
from flexbt_sim.server_common import MotionArbiter, MotionServer

COMMAND_SECONDS: Final = 0.5
"""For how long, of wall time, a command counts: an operator whose link is cut drives no robot any further."""


class TeleopServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime, arbiter: MotionArbiter) -> None:
        self._runtime = runtime
        self._arbiter = arbiter
        self._command = STOP
        self._commanded_at = -math.inf
        command_type: Any = TwistStamped if arbiter.robot.parameters.stamped_cmd_vel else Twist
        node = runtime.node
        node.create_subscription(command_type, names.CMD_VEL_TELEOP, self._on_command, 1)
        node.create_subscription(Empty, names.PREEMPT_TELEOP, self._on_preempt, 1)
        MotionServer(
            runtime,
            arbiter,
            AssistedTeleopAction,
            names.ASSISTED_TELEOP,
            self._begin,
            lambda motion: AssistedTeleopAction.Feedback(current_teleop_duration=duration_message(motion.elapsed)),
        )

    def _begin(self, request: Any) -> AssistedTeleop:
        self._commanded_at = -math.inf  # what was commanded before counts no more
        return AssistedTeleop(self._latest, seconds_of(request.time_allowance), self._arbiter.robot.costmaps.local)

    def _latest(self) -> Velocity:
        age = self._runtime.steady.now() - self._commanded_at
        return self._command if age < COMMAND_SECONDS else STOP

    def _on_command(self, message: Any) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        command = Velocity(twist.linear.x, twist.angular.z)
        # As the robot itself has it: one that is not finite means to stop.
        self._command = command if all(map(math.isfinite, command)) else STOP
        self._commanded_at = self._runtime.steady.now()

    def _on_preempt(self, _message: Empty) -> None:
        running = self._arbiter.running
        if running is not None and isinstance(running.motion, AssistedTeleop):
            running.motion.finish()
