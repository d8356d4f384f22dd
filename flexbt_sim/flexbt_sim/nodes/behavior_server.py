# SPDX-License-Identifier: BSD-3-Clause
"""The actions spin, backup and drive_on_heading."""

from __future__ import annotations

from typing import Any, Final

from nav2_msgs.action import BackUp, DriveOnHeading, Spin

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import seconds_of
from flexbt_sim.navigation import DriveMotion, SpinMotion
from flexbt_sim.navigation_errors import NavigationError
from flexbt_sim.server_common import MotionArbiter, MotionServer, bounded

from .controller_server import ControllerParameters

MOST_TURN: Final = 10_000.0
MOST_DISTANCE: Final = 100_000.0
MOST_SPEED: Final = 10.0
"""Of one motion: rad, m, m/s. For each pose of the robot collisions are looked for over two seconds of driving."""


class BehaviorServer:
    """On the executor thread. A robot whose controller has a turning radius does not spin."""

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
        radius = self._controller.follower.turning_radius
        if radius:
            raise NavigationError('UNKNOWN', f'a robot with a minimum_turning_radius of {radius:g} m cannot spin')
        return SpinMotion(
            bounded(request.target_yaw, 'target_yaw', MOST_TURN),
            seconds_of(request.time_allowance),
            self._arbiter.robot.costmaps.local,
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
        return DriveMotion(distance, speed, seconds_of(request.time_allowance), self._arbiter.robot.costmaps.local)
