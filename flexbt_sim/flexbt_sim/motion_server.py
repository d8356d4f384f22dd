# SPDX-License-Identifier: BSD-3-Clause
"""Actions that move the robot: follow_path, spin, backup and drive_on_heading.

One motion at a time drives the robot: the newest. A new path takes a running follow_path over without a stop; any other
motion ends the one before, which is aborted. All of this happens on the executor thread, whenever a pose comes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.clock import Timer
from flexbt_common.node_runtime import NodeRuntime
from flexbt_sim.action_results import CANCELED, RESULT_TIMEOUT, SUCCEEDED, GoalEnd, finish
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose
from flexbt_sim.motions import STOP, Motion
from flexbt_sim.path_follower import PathFollower
from flexbt_sim.robot_interface import RobotInterface
from flexbt_sim.ros_messages import duration_message

FEEDBACK_EVERY: Final = 3
"""Poses per feedback message."""


@dataclass(eq=False)
class RunningMotion:
    """A goal that drives the robot. ``feedback`` makes a feedback message of the motion."""

    handle: ServerGoalHandle
    motion: Motion
    feedback: Callable[[Any], Any]
    future: Future
    poses: int = 0


class MotionArbiter:
    """Lets one motion drive."""

    def __init__(self, runtime: NodeRuntime, robot: RobotInterface, pose_timeout: float) -> None:
        self._runtime = runtime
        self._pose_timeout = pose_timeout
        self.robot = robot
        self._watch: Timer | None = None
        self.running: RunningMotion | None = None
        robot.on_pose, robot.on_map = self._on_pose, self._on_map

    def start(self, handle: ServerGoalHandle, motion: Motion, feedback: Callable[[Any], Any]) -> Future:
        """Let a motion drive; the future completes with its GoalEnd.

        A path that replaces a path is gone over to without a stop.
        """
        if self.running is not None:
            rolling = isinstance(motion, PathFollower) and isinstance(self.running.motion, PathFollower)
            self.end(GoalEnd(message='a newer motion has taken over'), stop=not rolling)
        future = Future(executor=self._runtime.node.executor)
        self.running = RunningMotion(handle, motion, feedback, future)
        self._look_for_pose_in(self._pose_timeout)
        return future

    def _on_pose(self, pose: Pose, now: float) -> None:
        running = self.running
        if running is None:
            return
        try:
            velocity = running.motion.step(pose, now)
        except NavigationError as error:
            self.end(GoalEnd(code=error.code, message=str(error)))
            return
        except Exception as error:
            self._runtime.report_fault(error, 'a motion')
            self.end(GoalEnd(code='UNKNOWN', message=f'fault in the navigation server: {error!r}'))
            return
        if velocity is None:
            self.end(SUCCEEDED)
            return
        self.robot.drive(velocity)
        running.poses += 1
        if running.poses % FEEDBACK_EVERY == 1:
            running.handle.publish_feedback(running.feedback(running.motion))

    def _on_map(self) -> None:
        if self.running is not None:
            self.running.motion.update(self.robot.costmap)

    def end(self, end: GoalEnd, *, stop: bool = True) -> None:
        """End the motion that drives, and stop the robot."""
        running, self.running = self.running, None
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        if running is None:
            return
        if stop:
            self.robot.drive(STOP)
        if not running.future.done():
            running.future.set_result(end)

    def cancel(self, handle: ServerGoalHandle) -> None:
        """The client does not want its goal any more."""
        if self.running is not None and self.running.handle is handle:
            self.end(CANCELED)

    def _look_for_pose_in(self, seconds: float) -> None:
        steady = self._runtime.steady
        self._watch = steady.call_at(steady.now() + seconds, lambda: self._runtime.post(self._look_for_pose))

    def _look_for_pose(self) -> None:
        if self.running is None:
            return
        silence = self.robot.silence
        if silence < self._pose_timeout:
            self._look_for_pose_in(self._pose_timeout - silence)
        else:
            self.end(GoalEnd(code='TF_ERROR', message=f'no pose of the robot for {silence:.1f} s'))


class MotionServer:
    """Serves one action. ``make(request, arbiter)`` gives the motion, or raises NavigationError."""

    def __init__(
        self,
        runtime: NodeRuntime,
        arbiter: MotionArbiter,
        action_type: Any,
        name: str,
        make: Callable[[Any], Motion],
        feedback: Callable[[Any], Any],
    ) -> None:
        self._runtime = runtime
        self._arbiter = arbiter
        self._action_type = action_type
        self._name = name
        self._make = make
        self._feedback = feedback
        server = ActionServer(
            runtime.node,
            action_type,
            name,
            self._execute,
            goal_callback=lambda request: GoalResponse.ACCEPT,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_TIMEOUT,
            **names.deep_action_services(),
        )
        runtime.on_close(lambda: runtime.call(server.destroy))

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        started = self._runtime.clock.now()
        end = await self._drive(handle)
        result = self._action_type.Result()
        if hasattr(result, 'total_elapsed_time'):
            result.total_elapsed_time = duration_message(max(0.0, self._runtime.clock.now() - started))
        return finish(handle, result, end)

    async def _drive(self, handle: ServerGoalHandle) -> GoalEnd:
        await self._arbiter.robot.known()
        if handle.is_cancel_requested:
            return CANCELED
        try:
            motion = self._make(handle.request)
        except NavigationError as error:
            return GoalEnd(code=error.code, message=str(error))
        except Exception as error:
            self._runtime.report_fault(error, f'a goal of {self._name}')
            return GoalEnd(code='UNKNOWN', message=f'fault in the navigation server: {error!r}')
        return await self._arbiter.start(handle, motion, self._feedback)

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        # rclpy makes the goal CANCELING only after this callback.
        self._runtime.post(lambda: self._arbiter.cancel(handle))
        return CancelResponse.ACCEPT
