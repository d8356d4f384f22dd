# SPDX-License-Identifier: BSD-3-Clause
"""The actions of Nav2's behavior server: spin, backup, drive_on_heading, assisted_teleop and wait."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from geometry_msgs.msg import Twist, TwistStamped
from nav2_msgs.action import AssistedTeleop as AssistedTeleopAction
from nav2_msgs.action import BackUp, DriveOnHeading, Spin, Wait
from std_msgs.msg import Empty

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import duration_message, seconds_of
from flexbt_core.clock.clock import Timer
from flexbt_navigation.common.requests import CANCELED, SUCCEEDED, GoalEnd, bounded, finish
from flexbt_navigation.controller.motions import STOP, Velocity
from flexbt_navigation.controller.server import ControllerParameters, MotionArbiter, MotionServer
from flexbt_navigation.errors import NavigationError

from .motions import SPIN_LIMITS, AssistedTeleopMotion, DriveMotion, SpinMotion

MOST_TURN: Final = 10_000.0
MOST_DISTANCE: Final = 100_000.0
MOST_SPEED: Final = 10.0
"""Bounds of one motion: rad, m, m/s. For each pose of the robot, collisions are looked for over two seconds of
driving."""


class BehaviorServer:
    """On the executor thread. A robot whose controller has a turning radius cannot spin."""

    def __init__(self, runtime: NodeRuntime, controller: ControllerParameters, arbiter: MotionArbiter) -> None:
        self._controller = controller
        self._arbiter = arbiter
        motions = (
            (
                Spin,
                names.SPIN,
                self._spin,
                lambda motion: Spin.Feedback(angular_distance_traveled=float(motion.turned)),
            ),
            (
                BackUp,
                names.BACKUP,
                self._back_up,
                lambda motion: BackUp.Feedback(distance_traveled=float(motion.driven)),
            ),
            (
                DriveOnHeading,
                names.DRIVE_ON_HEADING,
                self._drive,
                lambda motion: DriveOnHeading.Feedback(distance_traveled=float(motion.driven)),
            ),
        )
        for motion in motions:
            MotionServer(runtime, arbiter, *motion)

    def _spin(self, request: Any) -> SpinMotion:
        follower = self._controller.follower
        if radius := follower.turning_radius:
            raise NavigationError('UNKNOWN', f'a robot with a minimum_turning_radius of {radius:g} m cannot spin')
        return SpinMotion(
            bounded(request.target_yaw, 'target_yaw', MOST_TURN),
            seconds_of(request.time_allowance),
            self._arbiter.robot.costmaps.local,
            SPIN_LIMITS.braking_with(follower.angular_acceleration),
        )

    def _back_up(self, request: Any) -> DriveMotion:
        return self._straight(-abs(request.target.x), -abs(request.speed), request)

    def _drive(self, request: Any) -> DriveMotion:
        return self._straight(request.target.x, request.speed, request)

    def _straight(self, distance: float, speed: float, request: Any) -> DriveMotion:
        bounded(distance, 'target.x', MOST_DISTANCE)
        bounded(speed, 'speed', MOST_SPEED)
        if request.target.y or request.target.z:
            raise NavigationError(
                'INVALID_INPUT', 'only straight motions are possible: target.y and target.z have to be 0'
            )
        if speed == 0.0:
            raise NavigationError('INVALID_INPUT', 'the speed is 0')
        if distance * speed < 0.0:
            raise NavigationError('INVALID_INPUT', f'distance {distance:g} and speed {speed:g} have opposite signs')
        return DriveMotion(
            distance,
            speed,
            seconds_of(request.time_allowance),
            self._arbiter.robot.costmaps.local,
            self._controller.follower.linear_acceleration,
        )


# The action assisted_teleop: the operator's commands on cmd_vel_teleop drive the robot, slower before obstacles.
#
# A message on preempt_teleop reports that the operator is done: the goal succeeds.

COMMAND_SECONDS: Final = 0.5
"""Time for which a command is valid, s of wall time: an operator whose link is cut drives the robot no further."""


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

    def _begin(self, request: Any) -> AssistedTeleopMotion:
        self._commanded_at = -math.inf  # discard earlier commands
        return AssistedTeleopMotion(
            self._latest, seconds_of(request.time_allowance), self._arbiter.robot.costmaps.local
        )

    def _latest(self) -> Velocity:
        age = self._runtime.steady.now() - self._commanded_at
        return self._command if age < COMMAND_SECONDS else STOP

    def _on_command(self, message: Any) -> None:
        twist = message.twist if isinstance(message, TwistStamped) else message
        command = Velocity(twist.linear.x, twist.angular.z)
        # As on the robot itself, a command that is not finite means stop.
        self._command = command if all(map(math.isfinite, command)) else STOP
        self._commanded_at = self._runtime.steady.now()

    def _on_preempt(self, _message: Empty) -> None:
        running = self._arbiter.running
        if running is not None and isinstance(running.motion, AssistedTeleopMotion):
            running.motion.finish()


# The action wait: waits on the node's clock, for any number of goals at the same time.

FEEDBACK_SECONDS: Final = 0.5
"""Time between two feedback messages, s."""


@dataclass(frozen=True)
class _Waiting:
    goal: ServedGoal
    began: float
    alarm: Timer


class WaitServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._waiting: dict[bytes, _Waiting] = {}
        GoalServer(runtime, Wait, names.WAIT, self._serve, lambda goal: self._end(goal.id, CANCELED))

    def end_all(self, end: GoalEnd) -> None:
        """End every goal."""
        for goal_id in list(self._waiting):
            self._end(goal_id, end)

    def _serve(self, goal: ServedGoal) -> None:
        clock = self._runtime.clock
        began = clock.now()
        until = began + seconds_of(goal.request.time)
        alarm = clock.call_at(until, partial(self._end, goal.id, SUCCEEDED))
        self._waiting[goal.id] = _Waiting(goal, began, alarm)
        self._tell_time_left(goal, until)

    def _end(self, goal_id: bytes, end: GoalEnd) -> None:
        waiting = self._waiting.pop(goal_id, None)
        if waiting is None:
            return
        waiting.alarm.cancel()
        elapsed = duration_message(max(0.0, self._runtime.clock.now() - waiting.began))
        finish(waiting.goal, Wait.Result(total_elapsed_time=elapsed), end)

    def _tell_time_left(self, goal: ServedGoal, until: float) -> None:
        if not goal.active:
            return
        clock = self._runtime.clock
        now = clock.now()
        goal.publish_feedback(Wait.Feedback(time_left=duration_message(max(0.0, until - now))))
        if now + FEEDBACK_SECONDS < until:
            clock.call_at(now + FEEDBACK_SECONDS, partial(self._tell_time_left, goal, until))
