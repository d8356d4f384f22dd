# SPDX-License-Identifier: BSD-3-Clause
"""Actions that move the robot: follow_path, and the parts that it shares with spin, backup, drive_on_heading and
others; the topic that limits the speed; and the parameters of the controller with Nav2's names.

Only the newest motion drives the robot. A new path replaces the path of a running follow_path without a stop. Any other
motion aborts the one before, and so does a refused goal of the same action. All of this happens on the executor thread,
at each pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from builtin_interfaces.msg import Time
from nav2_msgs.action import FollowPath
from nav2_msgs.msg import SpeedLimit

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import duration_message
from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.common.requests import (
    CANCELED,
    SUCCEEDED,
    Asked,
    GoalEnd,
    asked_path,
    check_id,
    end_by,
    finish,
    follow,
)
from flexbt_navigation.robot_interface import PoseWatch, RobotInterface
from flexbt_sim.messages import stamped
from flexbt_sim.world.plane.geometry import Pose

from .motions import STOP, Motion, Velocity
from .path_follower import FollowerLimits, PathFollower

FEEDBACK_EVERY: Final = 3
"""Poses per feedback message."""

TAKEN_OVER: Final = GoalEnd(message='a newer motion has taken over')
REPLACED: Final = GoalEnd(message='a newer goal, which was refused, was to replace it')


class OnEnd(Protocol):
    """A callback that ends a goal of a motion that has taken this many seconds."""

    def __call__(self, end: GoalEnd, seconds: float = 0.0) -> None: ...


@dataclass(eq=False)
class RunningMotion:
    """A goal that drives the robot. ``feedback`` makes a feedback message of the motion; ``on_end`` ends the goal.

    ``asked``: the number of :meth:`MotionArbiter.ask`, for a motion that was prepared for a while.

    ``began`` and ``now`` are the times of the first and of the latest pose, s. The motion uses these, not the node's
    clock, which gets the time by another topic: on a busy machine it may lag behind.
    """

    goal: ServedGoal
    motion: Motion
    feedback: Callable[[Any], Any]
    on_end: OnEnd
    asked: int | None = None
    poses: int = 0
    began: float = 0.0
    now: float = 0.0


class MotionArbiter:
    """An arbiter that lets one motion at a time drive."""

    def __init__(self, runtime: NodeRuntime, robot: RobotInterface) -> None:
        self._runtime = runtime
        self.robot = robot
        self._watch: PoseWatch | None = None
        self.running: RunningMotion | None = None
        self._asked = self._newest = 0
        self.monitor: Callable[[Pose, Velocity], Velocity] = lambda _pose, command: command
        self.on_stop: Callable[[], None] = lambda: None
        """Called for each command to stop that no motion gives."""
        self._is_held = False
        self.speed_limit = math.inf
        robot.on_pose.append(self._on_pose)
        robot.on_map = self._on_map

    def ask(self) -> int:
        """Register a request for a motion, and return its number, which is greater than all earlier ones."""
        self._asked += 1
        return self._asked

    def start(self, newer: RunningMotion) -> None:
        """Start a motion, unless a newer one has started while this one was prepared.

        The robot changes to a replacement path without a stop.
        """
        asked = self.ask() if newer.asked is None else newer.asked
        if asked < self._newest:
            newer.on_end(TAKEN_OVER)
            return
        self._newest = asked
        if self.running is not None:
            rolling = isinstance(newer.motion, PathFollower) and isinstance(self.running.motion, PathFollower)
            self.end(TAKEN_OVER, stop=not rolling)
        self.running = newer
        self._watch = self.robot.watch_pose(self.end)

    def refuse(self, goal: ServedGoal, asked: int) -> None:
        """End the motion that a refused goal was to replace, an older one of the same action: as in Nav2, whose clients
        no longer watch that."""
        running = self.running
        if running is not None and asked > self._newest and type(running.goal.request) is type(goal.request):
            self.end(REPLACED)

    def limit_speed(self, limit: float) -> None:
        """Limit the speed of motions that follow a path, m/s, from now on."""
        self.speed_limit = limit
        if self.running is not None:
            self.running.motion.limit_speed(limit)

    def hold(self, is_held: bool) -> None:
        """Stop the robot, and let no motion drive until the hold is over. Motions are not ended."""
        self._is_held = is_held
        if is_held and self.running is not None:
            self._stop()

    def _on_pose(self, pose: Pose, now: float) -> None:
        running = self.running
        if running is None:
            return
        if not running.poses:
            running.began = now
        running.poses += 1
        running.now = now
        if self._is_held:
            self._stop()
            return
        try:
            velocity = running.motion.step(pose, now)
        except Exception as error:
            self.end(end_by(self._runtime, error, 'a motion'))
            return
        if velocity is None:
            self.end(SUCCEEDED)
            return
        self.robot.drive(*self.monitor(pose, velocity))
        if running.poses % FEEDBACK_EVERY == 1:
            running.goal.publish_feedback(running.feedback(running.motion))

    def _on_map(self) -> None:
        if self.running is not None:
            self.running.motion.update(self.robot.costmaps.local)

    def end(self, end: GoalEnd, *, stop: bool = True) -> None:
        """End the motion that drives, and stop the robot."""
        running, self.running = self.running, None
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        if running is None:
            return
        if stop:
            self._stop()
        running.on_end(end, max(0.0, running.now - running.began))

    def _stop(self) -> None:
        self.robot.drive(*STOP)
        self.on_stop()

    def cancel(self, goal: ServedGoal) -> None:
        """Cancel the goal for its client."""
        if self.running is not None and self.running.goal is goal:
            self.end(CANCELED)


class MotionServer:
    """A server of one action.

    ``make(request, *poses)`` returns the motion, or raises NavigationError. ``asked(request)`` returns the poses of a
    request, in any frame; ``make`` gets them in the map frame.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        arbiter: MotionArbiter,
        action_type: Any,
        name: str,
        make: Callable[..., Motion],
        feedback: Callable[[Any], Any],
        asked: Callable[[Any], Sequence[Asked]] = lambda _request: (),
    ) -> None:
        self._runtime = runtime
        self._arbiter = arbiter
        self._action_type = action_type
        self._name = name
        self._make = make
        self._feedback = feedback
        self._asked = asked
        GoalServer(runtime, action_type, name, lambda goal: follow(self._serve(goal)), arbiter.cancel)

    async def _serve(self, goal: ServedGoal) -> None:
        def on_end(end: GoalEnd, seconds: float = 0.0) -> None:
            result = self._action_type.Result()
            if hasattr(result, 'total_elapsed_time'):
                result.total_elapsed_time = duration_message(seconds)
            finish(goal, result, end)

        number = 0

        def asked(request: Any) -> Sequence[Asked]:
            nonlocal number
            number = self._arbiter.ask()
            return self._asked(request)

        try:
            poses = await self._arbiter.robot.poses(goal, asked)
            self._arbiter.robot.check_pose()
            motion = self._make(goal.request, *poses)
            self._arbiter.start(RunningMotion(goal, motion, self._feedback, on_end, number))
        except Exception as error:
            self._arbiter.refuse(goal, number)
            on_end(end_by(self._runtime, error, f'a goal of {self._name}'))


@dataclass
class ControllerParameters:
    """Parameters of the controller.

    While the servers run, ``follower`` may be replaced on the executor thread. Later goals use the new one.
    """

    controller_ids: tuple[str, ...] = parameter(
        'controller_ids', ('FollowPath',), 'names under which the controller is known'
    )
    goal_checker_ids: tuple[str, ...] = parameter(
        'goal_checker_ids', ('general_goal_checker', 'goal_checker'), 'names under which the goal checker is known'
    )
    progress_checker_ids: tuple[str, ...] = parameter(
        'progress_checker_ids', ('progress_checker',), 'names under which the progress checker is known'
    )
    follower: FollowerLimits = field(default_factory=FollowerLimits)


class ControllerServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime, parameters: ControllerParameters, arbiter: MotionArbiter) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._arbiter = arbiter
        MotionServer(
            runtime,
            arbiter,
            FollowPath,
            names.FOLLOW_PATH,
            self._follow,
            self._feedback,
            lambda request: asked_path(request.path),
        )
        runtime.node.create_subscription(SpeedLimit, names.SPEED_LIMIT, self._limit_speed, 10)

    def _follow(self, request: Any, *path: Pose) -> PathFollower:
        parameters, robot = self._parameters, self._arbiter.robot
        check_id(request.controller_id, parameters.controller_ids, 'controller', 'INVALID_CONTROLLER')
        check_id(request.goal_checker_id, parameters.goal_checker_ids, 'goal checker', 'UNKNOWN')
        check_id(request.progress_checker_id, parameters.progress_checker_ids, 'progress checker', 'UNKNOWN')
        running = self._arbiter.running
        before = running.motion if running is not None and isinstance(running.motion, PathFollower) else None
        drift = robot.map_frame.drift(request.path.header)
        follower = PathFollower(path, robot.costmaps.local, parameters.follower, before, drift)
        follower.limit_speed(self._arbiter.speed_limit)
        return follower

    def _limit_speed(self, message: SpeedLimit) -> None:
        """Set a speed limit as Nav2's controller server does: percent of the desired speed, or m/s; 0 for none."""
        limit = float(message.speed_limit)
        if not 0.0 <= limit < math.inf:
            self._runtime.node.get_logger().error(
                f'{names.SPEED_LIMIT}: {limit:g} is not a limit of the speed: ignored',
                throttle_duration_sec=COMPLAINT_SECONDS,
            )
            return
        share = self._parameters.follower.speed / 100.0 if message.percentage else 1.0
        self._arbiter.limit_speed(limit * share or math.inf)

    def _feedback(self, motion: PathFollower) -> FollowPath.Feedback:
        robot = self._arbiter.robot
        return following(motion, robot.pose, robot.parameters.map_frame, self._runtime.clock.stamp())


def following(motion: PathFollower, pose: Pose, frame: str, stamp: Time) -> FollowPath.Feedback:
    """Return how the robot, at ``pose`` in ``frame``, follows its path; in main with all of
    nav2_msgs/TrackingFeedback."""
    feedback = FollowPath.Feedback()
    if not hasattr(feedback, 'tracking_feedback'):
        feedback.distance_to_goal, feedback.speed = float(motion.distance_to_goal), float(motion.speed)
        return feedback
    told, place = feedback.tracking_feedback, motion.place(pose)
    told.robot_pose = stamped(pose, frame, stamp)
    told.header = told.robot_pose.header
    told.position_tracking_error, told.heading_tracking_error = place.left, place.turned
    told.current_path_index, told.distance_to_goal = place.passed, place.to_goal
    told.remaining_path_length, told.speed = float(motion.distance_to_goal), float(motion.speed)
    return feedback
