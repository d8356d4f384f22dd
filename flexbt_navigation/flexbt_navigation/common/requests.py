# SPDX-License-Identifier: BSD-3-Clause
"""Requests of all servers: checks of their values, and their poses and paths, brought to the frame of the map; goals of
their actions, with their ends and results; and the parameters of the robot that all servers share.

The middleware transports NaN and infinity like any other number. In a path, a pose or a speed they could make a robot
turn or drive endlessly.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Generic, NamedTuple, TypeVar

from geometry_msgs.msg import Pose as PoseMessage
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.calls.goal_server import ServedGoal, set_error
from flexbt_common.errors import TransformError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.transform_buffer import Rigid
from flexbt_common.transform_listener import TRANSFORM_TIMEOUT, TransformListener, transformed
from flexbt_common.values.message_fields import duration_message, seconds_of
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import short_repr
from flexbt_navigation.errors import GoalCanceled, NavigationError
from flexbt_sim.messages import pose_of
from flexbt_sim.world.plane.geometry import FARTHEST, Pose


@dataclass(frozen=True)
class GoalEnd:
    """The end of a goal: succeeded, canceled, or failed with the name of an error code."""

    succeeded: bool = False
    canceled: bool = False
    code: str = 'NONE'
    message: str = ''


SUCCEEDED: Final = GoalEnd(succeeded=True)
CANCELED: Final = GoalEnd(canceled=True, message='canceled by the client')


def end_by(runtime: NodeRuntime, error: Exception, what: str) -> GoalEnd:
    """Return the end of a goal that failed with an error. An internal error is reported as one of ``what``."""
    if isinstance(error, GoalCanceled):
        return CANCELED
    if isinstance(error, NavigationError):
        return GoalEnd(code=error.code, message=str(error))
    runtime.report_fault(error, what)
    return GoalEnd(code='UNKNOWN', message=f'fault in the navigation server: {error!r}')


def finish(goal: ServedGoal, result: Any, end: GoalEnd) -> None:
    """Fill in error code and message, and end the goal.

    A code that the action does not define becomes its UNKNOWN. (Wait has none at all, only the message;
    the actions of routes have none.)
    """
    set_error(result, int(getattr(result, end.code, getattr(result, 'UNKNOWN', 0))), end.message)
    if end.succeeded:
        goal.succeed(result)
    elif end.canceled:
        goal.canceled(result)
    else:
        goal.abort(result)


# Goals executed by coroutines, and results computed on a separate thread.

T = TypeVar('T')


class Later(Generic[T]):
    """A result to await: ``begin(on_result, on_error)`` calls one of the two, once, on the executor thread."""

    def __init__(self, begin: Callable[[Callable[[T], None], Callable[[Exception], None]], object]) -> None:
        self.begin = begin

    def __await__(self) -> Generator[Later[T], T, T]:
        return (yield self)


def follow(steps: Coroutine[Later[Any], Any, None]) -> None:
    """Run a coroutine that awaits only :class:`Later`. It continues directly in the callback, not in a later turn of
    the executor."""

    def go_on(resume: Callable[[Any], Later[Any]], value: Any) -> None:
        with suppress(StopIteration):
            later = resume(value)
            later.begin(partial(go_on, steps.send), partial(go_on, steps.throw))

    go_on(steps.send, None)


def served(
    runtime: NodeRuntime,
    action_type: Any,
    elapsed: str,
    what: str,
    work: Callable[[ServedGoal], Awaitable[Mapping[str, Any]]],
    end_goal: Callable[[ServedGoal, Any, GoalEnd], None] = finish,
) -> Callable[[ServedGoal], None]:
    """Return a callback that runs a coroutine for each goal of an action.

    ``work(goal)`` returns fields of the result, or raises the error that ends the goal; an internal error is one of
    ``what``. The result field ``elapsed`` is set to the wall time since the goal arrived.
    """

    async def run(goal: ServedGoal) -> None:
        began, end = runtime.steady.now(), SUCCEEDED
        fields: Mapping[str, Any] = {}
        try:
            fields = await work(goal)
        except Exception as error:
            end = end_by(runtime, error, what)
            fields = error.fields if isinstance(error, NavigationError) else {}
        spent = duration_message(runtime.steady.now() - began)
        end_goal(goal, action_type.Result(**{elapsed: spent, **fields}), end)

    return lambda goal: follow(run(goal))


def check_canceled(goal: ServedGoal | None) -> None:
    """Raise GoalCanceled if the client has canceled a goal."""
    if goal is not None and goal.cancel_requested:
        raise GoalCanceled


class Computation:
    """A thread that computes results in the order of the goals, and skips those of canceled goals. Executor thread
    only."""

    def __init__(self, runtime: NodeRuntime, name: str) -> None:
        self._runtime = runtime
        self._waiting: deque[Callable[[], None]] = deque()
        self._is_busy = False
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix=name)
        self._pool.submit(lambda: None)  # start the thread now: when a goal arrives, the system might have none left
        runtime.on_close(lambda: self._pool.shutdown(wait=False, cancel_futures=True))

    async def run(self, prepare: Callable[[], Callable[[], T]], goal: ServedGoal | None = None) -> T:
        """Return what a function returns on the thread, or raise what it raises; GoalCanceled if ``goal`` was canceled
        meanwhile.

        ``prepare()`` returns the function when its turn has come, so that it can use the pose and the costmap of that
        moment.
        """
        await Later(partial(self._wait, goal))
        try:
            check_canceled(goal)
            return await Later(partial(self._compute, prepare()))
        finally:
            self._runtime.post(self._begin_next)
            check_canceled(goal)

    def _wait(
        self, goal: ServedGoal | None, on_result: Callable[[None], None], on_error: Callable[[Exception], None]
    ) -> None:
        begin = partial(on_result, None)

        def leave() -> None:
            if begin in self._waiting:
                self._waiting.remove(begin)
                on_error(GoalCanceled())

        self._waiting.append(begin)
        if not self._is_busy:
            self._begin_next()
        elif goal is not None:
            goal.on_cancel(leave)

    def _begin_next(self) -> None:
        self._is_busy = bool(self._waiting)
        if self._waiting:
            self._waiting.popleft()()

    def _compute(
        self, compute: Callable[[], T], on_result: Callable[[T], None], on_error: Callable[[Exception], None]
    ) -> None:
        def work() -> None:
            try:
                self._runtime.post(partial(on_result, compute()))
            except Exception as error:
                self._runtime.post(partial(on_error, error))

        self._pool.submit(work)


@dataclass(frozen=True)
class RobotParameters:
    """Parameters of the robot. Services load files from the ``allowed_directories``."""

    map_frame: str = parameter('global_frame', 'map', 'frame of map, poses and paths')
    transform_tolerance: float = parameter(
        'transform_tolerance', 0.3, 'how long the transform of a request is waited for, s of wall time', 0.0, 10.0
    )
    pose_topic: str = parameter('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped")
    map_topic: str = parameter('map_topic', names.MAP, 'topic of the map')
    base_frame: str = parameter('robot_base_frame', 'base_link', 'frame of the robot, in which the lidar is mounted')
    cmd_vel_topic: str = parameter('cmd_vel_topic', names.CMD_VEL, 'topic of the velocity commands')
    stamped_cmd_vel: bool = parameter('enable_stamped_cmd_vel', False, 'commands are TwistStamped instead of Twist')
    pose_timeout: float = parameter(
        'pose_timeout',
        1.0,
        'time without a pose after which motions fail, s; a pause of simulated time does not count',
        0.1,
        60.0,
    )
    allowed_directories: tuple[Path, ...] = ()


def bounded(value: float, name: str, most: float) -> float:
    """Return ``value`` unchanged, as a float.

    Raises:
        NavigationError: INVALID_INPUT if it is NaN, or its magnitude exceeds ``most``.
    """
    if not abs(value) <= most:
        raise NavigationError('INVALID_INPUT', f'{name} is {value:g}; give a number within ±{most:g}')
    return float(value)


def finite_pose(message: Any, name: str, code: str) -> Pose:
    """Return the pose of a geometry_msgs/Pose.

    Raises:
        NavigationError: with ``code`` if it is not a valid place: NaN, infinite, or beyond FARTHEST.
    """
    pose = pose_of(message)
    if not pose.is_place:
        raise NavigationError(
            code,
            f'{name} is not a pose: x {pose.x}, y {pose.y}, yaw {pose.yaw}; give finite numbers, at most {FARTHEST:g}',
        )
    return pose


def check_frame(frame: str, map_frame: str, name: str) -> None:
    """Check that a frame is the map frame, or empty.

    Raises:
        NavigationError: TF_ERROR for any other frame.
    """
    if frame not in ('', map_frame):
        raise NavigationError(
            'TF_ERROR',
            f'{name} is in frame {short_repr(frame)}, from which no transform is known; give it in {map_frame!r}',
        )


def check_id(asked: str, known: Sequence[str], what: str, code: str) -> None:
    """Check the name of a plug-in; an empty name means the default. Raises NavigationError ``code`` if unknown."""
    if asked and asked not in known:
        raise NavigationError(code, f'there is no {what} {short_repr(asked)}; known: {", ".join(known)}')


# Fields of Nav2's interfaces differ between its branches jazzy and main: use those that the installed ones have.


def set_success(response: Any) -> None:
    """Report success, if the response has that field: those of jazzy's costmap services do not."""
    if hasattr(response, 'success'):
        response.success = True


# Poses and paths of requests, transformed from any frame to the map frame, for all servers.

OnPoses = Callable[[list[Pose]], None]
OnError = Callable[[Exception], None]


class Asked(NamedTuple):
    """A geometry_msgs/Pose of a request with its header, its name in messages, and the error code if it is invalid."""

    header: Any
    pose: Any
    name: str
    code: str

    @property
    def source(self) -> tuple[str, int, int]:
        """Frame and time from which to transform."""
        stamp = self.header.stamp
        return self.header.frame_id, stamp.sec, stamp.nanosec


def asked_pose(stamped: Any, name: str, code: str) -> Asked:
    """Return a geometry_msgs/PoseStamped."""
    return Asked(stamped.header, stamped.pose, name, code)


def asked_path(path: Any) -> list[Asked]:
    """Return the poses of a nav_msgs/Path, with the header of the path instead of their own."""
    return [
        Asked(path.header, stamped.pose, f'pose {index} of the path', 'INVALID_PATH')
        for index, stamped in enumerate(path.poses)
    ]


class MapFrame:
    """Transforms to the map frame, on the executor thread. An empty frame means the map frame.

    As in Nav2 a stamp of 0 means the latest transform, any other one the transform at that time. A request waits for an
    unknown transform for the parameter ``transform_tolerance`` at most. The first one waits for TRANSFORM_TIMEOUT,
    because only then does the node subscribe to ``tf``: requests in the map frame need no subscription.
    """

    def __init__(self, runtime: NodeRuntime, parameters: RobotParameters) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._name = parameters.map_frame
        self._timeout = TRANSFORM_TIMEOUT

    def poses(
        self,
        asked: Sequence[Asked],
        on_poses: OnPoses,
        on_error: OnError,
        timeout: float | None = None,
    ) -> None:
        """Call ``on_poses`` with the poses in the map frame, as soon as their transforms are known. ``timeout`` (s of
        wall time) replaces the default one.

        On failure call ``on_error`` with NavigationError: TF_ERROR without a transform, or the code of an invalid pose.
        """
        firsts = {one.source: one for one in asked if one.header.frame_id not in ('', self._name)}
        transforms: dict[tuple[str, int, int], Rigid] = {}
        failed: list[Exception] = []

        def finish() -> None:
            try:
                poses = [self._pose(one, transforms.get(one.source)) for one in asked]
            except NavigationError as error:
                on_error(error)
                return
            on_poses(poses)

        def on_transform(source: tuple[str, int, int], transform: Rigid) -> None:
            transforms[source] = transform
            if len(transforms) == len(firsts) and not failed:
                finish()

        def fail(one: Asked, error: TransformError) -> None:
            if not failed:
                failed.append(error)
                on_error(self._error(one, error))

        if not firsts:
            finish()
            return
        if timeout is None:
            timeout, self._timeout = self._timeout, self._parameters.transform_tolerance
        listener = TransformListener.of(self._runtime)
        for source, one in firsts.items():
            at = seconds_of(one.header.stamp) or None
            listener.lookup(
                self._name, one.header.frame_id, at, partial(on_transform, source), partial(fail, one), timeout
            )

    async def known(self, asked: Sequence[Asked]) -> list[Pose]:
        """Return poses as :meth:`poses`, for services. Raises NavigationError."""
        done = Future(executor=self._runtime.node.executor)
        self.poses(asked, done.set_result, done.set_exception)
        poses: list[Pose] = await done
        return poses

    def drift(self, header: Any) -> Callable[[], Pose]:
        """Return a function that returns the motion of a header's frame in the map since the time of the header, as a
        pose. Call it repeatedly for poses fixed to that frame. The transform of the frame must be known already.

        A frame that the robot carries has no drift: poses in it refer to the time of the header. The function raises
        NavigationError TF_ERROR when the transform is lost, or was not updated for ``pose_timeout``.
        """
        frame, target = header.frame_id, self._name
        if frame in ('', target):
            return lambda: Pose(0.0, 0.0, 0.0)
        listener = TransformListener.of(self._runtime)
        if listener.buffer.carries(self._parameters.base_frame, frame):
            return lambda: Pose(0.0, 0.0, 0.0)

        def lookup(time: float | None = None) -> Rigid:
            try:
                return listener.buffer.lookup(target, frame, time)
            except TransformError as error:
                raise NavigationError('TF_ERROR', f'the path is in frame {short_repr(frame)}: {error}') from None

        back = lookup(seconds_of(header.stamp) or None).inverse()
        latest, heard = -math.inf, 0.0

        def drift() -> Pose:
            nonlocal latest, heard
            moved, newest = lookup() @ back, listener.buffer.latest(target, frame)
            now = self._runtime.listening_time.handled
            if newest != latest or newest == math.inf:
                latest, heard = newest, now
            silence = now - heard
            if silence >= self._parameters.pose_timeout:
                raise NavigationError(
                    'TF_ERROR',
                    f'the path is in frame {short_repr(frame)}, whose transform to {target!r} has not come on tf for '
                    f'{silence:.1f} s',
                )
            return pose_of(transformed(PoseMessage(), moved))

        return drift

    @staticmethod
    def _pose(one: Asked, transform: Rigid | None) -> Pose:
        pose = one.pose if transform is None else transformed(one.pose, transform)
        return finite_pose(pose, one.name, one.code)

    def _error(self, one: Asked, error: TransformError) -> NavigationError:
        stamp = seconds_of(one.header.stamp)
        age = f', of {seconds_of(self._runtime.clock.stamp()) - stamp:.3f} s ago' if stamp else ''
        return NavigationError(
            'TF_ERROR',
            f'{one.name} is in frame {short_repr(one.header.frame_id)}{age}, from which no transform leads to '
            f'{self._name!r}: {error}; see that somebody publishes it on tf, or give it in {self._name!r}',
        )
