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
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose
from flexbt_sim.motions import STOP, Motion
from flexbt_sim.robot_interface import RobotInterface
from flexbt_sim.ros_messages import duration_message

RESULT_TIMEOUT: Final = 15
"""How long the result of a finished goal can be asked for again, s."""

FEEDBACK_EVERY: Final = 3
"""Poses per feedback message."""


@dataclass(frozen=True)
class MotionEnd:
    """How a motion ended: succeeded, canceled, or failed with the name of an error code."""

    succeeded: bool = False
    canceled: bool = False
    code: str = 'NONE'
    message: str = ''


@dataclass(eq=False)
class RunningMotion:
    """A goal that drives the robot. ``feedback`` makes a feedback message of the motion."""

    handle: ServerGoalHandle
    motion: Motion
    feedback: Callable[[Any], Any]
    future: Future
    started: float
    poses: int = 0


class MotionArbiter:
    """Lets one motion drive."""

    def __init__(self, runtime: NodeRuntime, pose_timeout: float) -> None:
        self._runtime = runtime
        self._pose_timeout = pose_timeout
        self._robot: RobotInterface | None = None
        self._watch: Timer | None = None
        self._last_pose = 0.0
        self.running: RunningMotion | None = None

    def attach(self, robot: RobotInterface) -> None:
        """Give it the robot to drive."""
        self._robot = robot

    def start(self, running: RunningMotion, *, rolling: bool) -> None:
        """Let a motion drive; ``rolling``: it takes over from one of its kind without a stop."""
        if self.running is not None:
            self.end(MotionEnd(code='NONE', message='a newer motion has taken over'), stop=not rolling)
        self.running = running
        self._last_pose = self._runtime.steady.now()
        self._watch_poses()

    def on_pose(self, pose: Pose, now: float) -> None:
        """Take a step."""
        running = self.running
        self._last_pose = self._runtime.steady.now()
        if running is None or self._robot is None:
            return
        try:
            velocity = running.motion.step(pose, now)
        except NavigationError as error:
            self.end(MotionEnd(code=error.code, message=str(error)))
            return
        except Exception as error:
            self._runtime.report_fault(error, 'a motion')
            self.end(MotionEnd(code='UNKNOWN', message=f'fault in the navigation server: {error!r}'))
            return
        if velocity is None:
            self.end(MotionEnd(succeeded=True))
            return
        self._robot.drive(velocity)
        running.poses += 1
        if running.poses % FEEDBACK_EVERY == 1:
            running.handle.publish_feedback(running.feedback(running.motion))

    def end(self, end: MotionEnd, *, stop: bool = True) -> None:
        """End the motion that drives, and stop the robot."""
        running, self.running = self.running, None
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        if running is None:
            return
        if stop and self._robot is not None:
            self._robot.drive(STOP)
        if not running.future.done():
            running.future.set_result(end)

    def cancel(self, handle: ServerGoalHandle) -> None:
        """The client does not want its goal any more."""
        if self.running is not None and self.running.handle is handle:
            self.end(MotionEnd(canceled=True, message='canceled by the client'))

    def _watch_poses(self) -> None:
        steady = self._runtime.steady
        self._watch = steady.call_at(
            self._last_pose + self._pose_timeout, lambda: self._runtime.post(self._look_for_pose)
        )

    def _look_for_pose(self) -> None:
        if self.running is None:
            return
        silence = self._runtime.steady.now() - self._last_pose
        if silence >= self._pose_timeout:
            self.end(MotionEnd(code='TF_ERROR', message=f'no pose of the robot for {silence:.1f} s'))
        else:
            self._watch_poses()


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
        try:
            motion = self._make(handle.request)
        except NavigationError as error:
            end = MotionEnd(code=error.code, message=str(error))
        else:
            future = Future(executor=self._runtime.node.executor)
            running = self._arbiter.running
            rolling = running is not None and type(running.motion) is type(motion) and self._name == names.FOLLOW_PATH
            self._arbiter.start(RunningMotion(handle, motion, self._feedback, future, started), rolling=rolling)
            if handle.is_cancel_requested:
                self._arbiter.cancel(handle)
            end = await future
        return self._finish(handle, end, started)

    def _finish(self, handle: ServerGoalHandle, end: MotionEnd, started: float) -> Any:
        result = self._action_type.Result()
        result.error_code = int(getattr(self._action_type.Result, end.code, 0))
        result.error_msg = end.message
        if hasattr(result, 'total_elapsed_time'):
            result.total_elapsed_time = duration_message(max(0.0, self._runtime.clock.now() - started))
        if end.succeeded:
            handle.succeed()
        elif end.canceled and handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        # rclpy makes the goal CANCELING only after this callback.
        self._runtime.post(lambda: self._arbiter.cancel(handle))
        return CancelResponse.ACCEPT
