# SPDX-License-Identifier: BSD-3-Clause
"""The actions dock_robot and undock_robot, the service that reloads the database of docks, and the parameters of both
with Nav2's names.

battery_state reports the charge of the robot. If detection is used, detected_dock_pose reports the pose of the dock.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import DockRobot, UndockRobot
from nav2_msgs.srv import ReloadDockDatabase
from sensor_msgs.msg import BatteryState

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.errors import UnfitParameterError
from flexbt_common.files import resolve_file
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_common.values.message_fields import duration_message, seconds_of
from flexbt_core.errors import FlexbtError
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import short_repr
from flexbt_navigation.common.requests import (
    SUCCEEDED,
    Computation,
    GoalEnd,
    Later,
    asked_pose,
    end_by,
    finish,
    follow,
)
from flexbt_navigation.controller.motions import STOP, Motion, Velocity
from flexbt_navigation.controller.path_follower import FollowerLimits, PathFollower
from flexbt_navigation.controller.server import ControllerParameters, MotionArbiter, RunningMotion
from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_navigation.errors import GoalCanceled, NavigationError
from flexbt_navigation.planner.planners import StopFlag, planner_for
from flexbt_sim.messages import stamped
from flexbt_sim.world.plane.geometry import Pose, wrap

from .motions import (
    Dock,
    DockingLimits,
    DockMotion,
    DockState,
    DockType,
    Senses,
    StagingMotion,
    UndockMotion,
    load_docks,
)

CHARGING: Final = (BatteryState.POWER_SUPPLY_STATUS_CHARGING, BatteryState.POWER_SUPPLY_STATUS_FULL)
CHARGING_CURRENT: Final = 0.5
"""Current, A, from which a battery counts as charging whatever its status: Nav2's charging_threshold."""

CHARGING_WITHIN: Final = 0.3
"""Distance, m, by which the robot may have moved since its battery reported a charge: off its dock it has none, whether
or not the battery says so."""

LONGEST: Final = 1e6
"""Longest time limit, s; a longer one means no limit."""


class DockingServer:
    """The server of both actions and the reload service. Executor thread only."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: DockingParameters,
        controller: ControllerParameters,
        arbiter: MotionArbiter,
    ) -> None:
        """Raise DockError if the parameter ``dock_database`` is not a valid database."""
        self.runtime = runtime
        self.parameters = parameters
        self.controller = controller
        self.arbiter = arbiter
        self.computation = Computation(runtime, 'the planner of docking')
        self._types = {
            **{name: DockType(name, charges=False) for name in parameters.other_types},
            **{name: DockType(name, charges=True) for name in parameters.charging_types},
        }
        self._docks = load_docks(Path(parameters.database)) if parameters.database else {}
        self._is_charging = False
        self._charging_at: Pose | None = None
        """Pose of the robot at the last report of a charge, or the first one that is known after it."""
        self._seen: tuple[float, Pose] | None = None
        self._docked: tuple[DockType, Pose] | None = None
        arbiter.robot.on_pose.append(self._on_pose)
        node = runtime.node
        node.create_subscription(BatteryState, names.BATTERY_STATE, self._on_battery, 1)
        if parameters.uses_detection:
            node.create_subscription(PoseStamped, names.DETECTED_DOCK_POSE, self._on_detection, 1)
        self._dock_poses = node.create_publisher(PoseStamped, names.DOCK_POSE, 1)
        self._staging_poses = node.create_publisher(PoseStamped, names.STAGING_POSE, 1)
        node.create_service(ReloadDockDatabase, names.RELOAD_DOCKS, self._reload)
        for action_type, name, serve in (
            (DockRobot, names.DOCK_ROBOT, self._dock),
            (UndockRobot, names.UNDOCK_ROBOT, self._undock),
        ):
            GoalServer(runtime, action_type, name, serve, arbiter.cancel, partial(_refused, action_type))

    def show(self, dock: Pose, staging: Pose) -> None:
        """Publish both poses for display."""
        frame, stamp = self.arbiter.robot.parameters.map_frame, self.runtime.clock.stamp()
        self._dock_poses.publish(stamped(dock, frame, stamp))
        self._staging_poses.publish(stamped(staging, frame, stamp))

    # -- inputs ------------------------------------------------------------------------------------------------------

    def _on_battery(self, message: BatteryState) -> None:
        self._is_charging = message.power_supply_status in CHARGING or message.current > CHARGING_CURRENT
        self._charging_at = None
        if self._is_charging:
            with suppress(NavigationError):
                self._charging_at = self.arbiter.robot.pose

    def _on_pose(self, pose: Pose, _now: float) -> None:
        """Forget a charge that was reported elsewhere: the battery may be silent since."""
        if self._is_charging:
            self._charging_at = self._charging_at or pose
            self._is_charging = pose.distance(self._charging_at) <= CHARGING_WITHIN

    def _on_detection(self, message: PoseStamped) -> None:
        seen_at = seconds_of(message.header.stamp) or self.runtime.clock.now()

        def on_poses(poses: list[Pose]) -> None:
            self._seen = seen_at, poses[0]

        def on_error(error: Exception) -> None:
            self.runtime.node.get_logger().warning(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)

        asked = asked_pose(message, 'the detected dock', 'TF_ERROR')
        self.arbiter.robot.map_frame.poses([asked], on_poses, on_error)

    def senses(self, dock: Pose) -> Senses:
        """Return the senses for a dock. Without detection, the dock counts as seen at its expected pose."""

        def seen_dock() -> Pose | None:
            if not self.parameters.uses_detection:
                return dock
            # A pose from after now is from before the clock was set back.
            age = abs(self.runtime.clock.now() - self._seen[0]) if self._seen is not None else math.inf
            return self._seen[1] if self._seen and age <= self.parameters.detection_seconds else None

        return Senses(lambda: self._is_charging, seen_dock)

    def _reload(self, request: Any, response: Any) -> Any:
        logger = self.runtime.node.get_logger()
        try:
            self._docks = load_docks(resolve_file(request.filepath, self.arbiter.robot.parameters.allowed_directories))
        except FlexbtError as error:
            logger.error(f'the docks stay as they are: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
            return response
        logger.info(f'{len(self._docks)} docks', throttle_duration_sec=COMPLAINT_SECONDS)
        response.success = True
        return response

    def dock(self, request: Any) -> tuple[Dock, DockType]:
        """Return the dock of a request and its type. A request without an id has the pose of the dock itself.

        Raises:
            NavigationError: DOCK_NOT_IN_DB or DOCK_NOT_VALID.
        """
        if not request.use_dock_id:
            return Dock('', Pose(0.0, 0.0, 0.0), type=request.dock_type), self._type(request.dock_type)
        if request.dock_id not in self._docks:
            known = ', '.join(sorted(self._docks)[:20]) or 'none; set the parameter dock_database'
            raise NavigationError('DOCK_NOT_IN_DB', f'there is no dock {short_repr(request.dock_id)}; known: {known}')
        dock = self._docks[request.dock_id]
        return dock, self._type(dock.type)

    def _type(self, name: str) -> DockType:
        """Return the type with this name; without a name, the first type that charges. Raises NavigationError
        DOCK_NOT_VALID."""
        docking = self.parameters
        kind = self._types.get(name or next(iter((*docking.charging_types, *docking.other_types)), ''))
        if kind is None:
            raise NavigationError(
                'DOCK_NOT_VALID', f'there is no type of docks {short_repr(name)}; known: {", ".join(self._types)}'
            )
        return kind

    # -- goals -------------------------------------------------------------------------------------------------------

    def _dock(self, goal: ServedGoal) -> None:
        follow(DockGoal(self, goal).begin())

    def docked(self, kind: DockType) -> None:
        """Record that the robot is on a dock, where it is now."""
        self._docked = kind, self.arbiter.robot.pose

    def is_docked(self, dock: Pose) -> bool:
        """Return whether the robot is charging or stands on the dock. Raises NavigationError if its pose is unknown."""
        near = self.arbiter.robot.pose.distance(dock) < self.parameters.limits.docked_within
        return near or self._is_charging

    def _undock(self, goal: ServedGoal) -> None:
        follow(self._leave(goal))

    async def _leave(self, goal: ServedGoal) -> None:
        def on_end(end: GoalEnd, seconds: float = 0.0) -> None:
            if end.succeeded:
                self._docked = None
            finish(goal, UndockRobot.Result(success=end.succeeded), end)

        request, asked = goal.request, self.arbiter.ask()
        try:
            await self.arbiter.robot.known(goal)
            here = self.arbiter.robot.pose
            kind, place = self._docked or (self._type(request.dock_type), here)
            if request.dock_type:
                kind = self._type(request.dock_type)
            if kind.charges and not self._is_charging and (self._docked is None or not self.is_docked(place)):
                raise NavigationError('NONE', 'the robot is on no dock: there is nothing to leave')
            motion = UndockMotion(
                self.senses(here),
                self.parameters.limits,
                self.arbiter.robot.costmaps.local,
                charges=kind.charges,
                seconds=limited(request.max_undocking_time),
            )
        except Exception as error:
            self.arbiter.refuse(goal, asked)
            on_end(end_by(self.runtime, error, 'a goal of undock_robot'))
            return
        self.arbiter.start(RunningMotion(goal, motion, lambda _motion: UndockRobot.Feedback(), on_end, asked))


class DockGoal(Motion):
    """A goal of dock_robot: a motion that holds the robot until the path to the dock is known, then docks."""

    def __init__(self, server: DockingServer, goal: ServedGoal) -> None:
        self._server = server
        self._goal = goal
        self._motion: DockMotion | None = None
        self._staging: StagingMotion | None = None
        self._began = server.runtime.clock.now()
        self._pose = Pose(0.0, 0.0, 0.0)
        self._stop = StopFlag()

    async def begin(self) -> None:
        """Preempt the motion that drives the robot, find the dock, and go there."""
        server, request = self._server, self._goal.request
        robot = server.arbiter.robot
        try:
            dock, self._kind = server.dock(request)
            message = stamped(dock.pose, dock.frame, server.runtime.clock.stamp())
            asked = asked_pose(message if request.use_dock_id else request.dock_pose, 'the dock', 'DOCK_NOT_VALID')
        except Exception as error:
            server.arbiter.refuse(self._goal, server.arbiter.ask())
            self._fail(error)
            return
        try:
            server.arbiter.start(RunningMotion(self._goal, self, lambda _motion: self._feedback(), self._on_end))
            (self._pose,) = await Later(partial(robot.map_frame.poses, [asked]))
            await robot.known(self._goal)
            if not self._goal.active:
                return
            if self._kind.charges and server.is_docked(self._pose):
                self._end(SUCCEEDED)
            else:
                await self._stage()
        except Exception as error:
            self._fail(error)

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`Motion`."""
        return STOP if self._motion is None else self._motion.step(pose, now)

    def update(self, costmap: Costmap) -> None:
        """See :class:`Motion`."""
        if self._motion is not None:
            self._motion.update(costmap)

    def limit_speed(self, limit: float) -> None:
        """See :class:`Motion`."""
        if self._staging is not None:
            self._staging.limit_speed(limit)

    def _on_end(self, end: GoalEnd, seconds: float = 0.0) -> None:
        self._stop.set()  # so that the next goal does not wait for an obsolete search
        if end.succeeded:
            self._server.docked(self._kind)
        retries = self._motion.retries if self._motion is not None else 0
        finish(self._goal, DockRobot.Result(success=end.succeeded, num_retries=retries), end)

    def _end(self, end: GoalEnd) -> None:
        """End the goal: through the arbiter while that holds it."""
        running = self._server.arbiter.running
        if running is not None and running.goal is self._goal:
            self._server.arbiter.end(end)
        elif self._goal.active:
            self._on_end(end)

    def _fail(self, error: Exception) -> None:
        self._end(end_by(self._server.runtime, error, 'a goal of dock_robot'))

    async def _stage(self) -> None:
        """Plan a path to the staging pose, unless the robot is there."""
        server, robot = self._server, self._server.arbiter.robot
        limits = server.parameters.limits
        staging = limits.staging_pose(self._pose)
        server.show(self._pose, staging)
        away = math.hypot(robot.pose.distance(staging), wrap(staging.yaw - robot.pose.yaw))
        if not self._goal.request.navigate_to_staging_pose or away < limits.prestaging_tolerance:
            self._drive(None)
            return
        planner = planner_for(robot.costmaps.shared, server.controller.follower.steering)
        start, stop = robot.pose, self._stop
        try:
            path = await server.computation.run(lambda: partial(planner.plan, start, staging, stop), self._goal)
        except GoalCanceled:
            raise
        except Exception as error:
            why = end_by(server.runtime, error, 'the planner of docking').message
            if self._staging is None:
                raise NavigationError('FAILED_TO_STAGE', why) from None
            self._staging.fail(why)
            return
        if not self._goal.active:
            return
        follower = PathFollower(path, robot.costmaps.local, server.controller.follower)
        follower.limit_speed(server.arbiter.speed_limit)
        if self._staging is None:
            self._staging = StagingMotion(follower, limited(self._goal.request.max_staging_time), self._stage_again)
            self._drive(self._staging)
        else:
            self._staging.go_on(follower)

    def _stage_again(self) -> None:
        async def stage() -> None:
            try:
                await self._stage()
            except Exception as error:
                self._fail(error)

        follow(stage())

    def _drive(self, staging: StagingMotion | None) -> None:
        server = self._server
        self._motion = DockMotion(
            self._pose,
            server.senses(self._pose),
            server.parameters.limits,
            server.arbiter.robot.costmaps.local,
            charges=self._kind.charges,
            staging=staging,
        )

    def _feedback(self) -> DockRobot.Feedback:
        state, retries = DockState.NAV_TO_STAGING_POSE, 0
        if self._motion is not None:
            state, retries = self._motion.state, self._motion.retries
        spent = max(0.0, self._server.runtime.clock.now() - self._began)
        return DockRobot.Feedback(state=state.value, docking_time=duration_message(spent), num_retries=retries)


def limited(seconds: float) -> float:
    """Return the time limit, s: infinity if it is too long; NaN counts as 0."""
    return min(seconds, LONGEST) if seconds > 0.0 else 0.0


def _refused(action_type: Any, why: str) -> Any:
    result = action_type.Result(success=False, error_code=action_type.Result.UNKNOWN)
    result.error_msg = why
    return result


# The parameters of the docking server, with Nav2's names.


@dataclass(frozen=True)
class DockingParameters:
    """Parameters of the docking server."""

    database: str = parameter(
        'dock_database', '', 'YAML file with docks:, or a world file, whose stations are docks; none if empty'
    )
    charging_types: tuple[str, ...] = parameter(
        'charging_docks',
        ('simple_charging_dock',),
        'types of docks that charge; the first one is that of stations',
    )
    other_types: tuple[str, ...] = parameter(
        'non_charging_docks', ('simple_non_charging_dock',), 'types of docks without a charge'
    )
    uses_detection: bool = parameter(
        'use_external_detection_pose', False, 'whether docks are where detected_dock_pose says, not the database'
    )
    detection_seconds: float = parameter(
        'external_detection_timeout', 1.0, 'for how long a detected pose counts, s', 0.01, 60.0
    )
    limits: DockingLimits = field(default_factory=DockingLimits)


def declare_docking_parameters(declare: ParameterDeclarer, robot: FollowerLimits) -> DockingParameters:
    """Declare the parameters and read them, for a robot that follows paths within these limits.

    Raises:
        UnfitParameterError: a value is not usable.
    """
    turning_radius = robot.turning_radius
    limits = DockingLimits.of(turning_radius, robot.linear_acceleration, robot.angular_acceleration)
    docking = declare.fields(DockingParameters(limits=limits))
    if turning_radius and docking.limits.staging_yaw_offset:
        raise UnfitParameterError(
            'staging_yaw_offset',
            f'{docking.limits.staging_yaw_offset:g} rad: a robot with a minimum_turning_radius ({turning_radius:g} m) '
            'cannot turn on the spot at the staging pose; give 0',
        )
    return docking
