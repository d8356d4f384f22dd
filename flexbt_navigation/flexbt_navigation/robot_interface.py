# SPDX-License-Identifier: BSD-3-Clause
"""The robot as the navigation servers use it: its pose, its costmaps, and its drive."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.calls.goal_server import ServedGoal
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, Received
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.errors import FlexbtError
from flexbt_navigation.common.demand import Demand
from flexbt_navigation.common.requests import (
    Asked,
    GoalEnd,
    Later,
    MapFrame,
    RobotParameters,
    check_canceled,
    check_frame,
    finite_pose,
)
from flexbt_navigation.costmaps.server import CostmapParameters, CostmapServer, KeepoutFilter
from flexbt_sim.intra_process import IntraProcessTopics
from flexbt_sim.messages import map_of
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from .errors import NavigationError

CHECK_SECONDS: Final = 0.1
"""Minimum time between two checks that poses still arrive, s of wall time."""

RETURN_SECONDS: Final = 3.0
"""Minimum time for which goals wait for the pose of a robot that was gone, s of wall time. A process that replaces a
killed one may be unreachable for 2.5 s after others have discovered it (:mod:`flexbt_common.lifecycle`)."""


class PoseWatch:
    """A watch that checks whether poses still arrive. It ends when none has arrived for ``timeout`` seconds, or with
    :meth:`cancel`.

    ``silence()`` returns the time since the last pose. ``on_lost`` is called once, with the end of the goal that needs
    the poses.
    """

    def __init__(
        self, runtime: NodeRuntime, timeout: float, silence: Callable[[], float], on_lost: Callable[[GoalEnd], None]
    ) -> None:
        self._runtime = runtime
        self._timeout = timeout
        self._silence = silence
        self._on_lost = on_lost
        self._look_after(timeout)

    def cancel(self) -> None:
        """Stop the watch."""
        self._timer.cancel()

    def _look_after(self, seconds: float) -> None:
        # Use wall time, by which a pose must be old, too: a timer of simulated time would wake the node for each
        # message of /clock. While the clock is paused, this timer fires repeatedly.
        self._timer = self._runtime.post_in(max(seconds, CHECK_SECONDS), self._look)

    def _look(self) -> None:
        silence = self._silence()
        if silence < self._timeout:
            self._look_after(self._timeout - silence)
        else:
            self._on_lost(GoalEnd(code='TF_ERROR', message=f'no pose of the robot for {silence:.1f} s'))


class RobotInterface:
    """The robot as the servers use it. Executor thread only.

    Each callback of ``on_pose`` is called for each new pose, with the pose and its time, s, on a clock that is never
    set back; ``on_map()`` for each new map.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: RobotParameters,
        costmaps: CostmapParameters,
        in_process: IntraProcessTopics | None = None,
    ) -> None:
        """``in_process`` are the topics of a robot that is simulated in this process."""
        in_process = in_process or IntraProcessTopics()
        self._runtime = runtime
        self.parameters = parameters
        self.on_pose: list[Callable[[Pose, float], None]] = []
        self.on_map: Callable[[], None] = lambda: None
        self._pose: Pose | None = None
        self._pose_heard = self._taken = self._stamp = -math.inf
        self._set_back = 0.0
        self._was_gone = False
        self._is_moving = False
        self._map: OccupancyMap | None = None
        self._mask: OccupancyMap | None = None
        self._waiting: list[Callable[[], None]] = []
        node = runtime.node
        self._demand = demand = Demand(runtime, in_process)
        demand.reasons.append(lambda: self._is_moving)  # another node drives: keep the obstacles seen on the way
        demand.subscribe(PoseStamped, parameters.pose_topic, QoSProfile(depth=1), self._receive_pose)
        node.create_subscription(OccupancyGrid, parameters.map_topic, self._receive_map, names.transient_local_qos())
        KeepoutFilter(runtime, costmaps, parameters.map_frame, self._receive_mask)
        self.map_frame = MapFrame(runtime, parameters)
        self.costmaps = CostmapServer(runtime, costmaps, parameters, self.map_frame, lambda: self.pose, demand)
        command_type: Any = TwistStamped if parameters.stamped_cmd_vel else Twist
        self._commands = in_process.publisher(node.create_publisher(command_type, parameters.cmd_vel_topic, 1))

    async def known(self, goal: ServedGoal) -> None:
        """Wait until pose and map are known, or for the pose timeout, in wall time. A server that has just started has
        neither; as in Nav2, the goal then waits for a moment instead of failing. The same holds for a robot that was
        gone and may have returned. A canceled goal does not wait.

        Raises:
            GoalCanceled: a cancel of the goal was requested.
        """
        if not self._is_known:
            await Later(partial(self._wait_until_known, goal))
        check_canceled(goal)

    def _wait_until_known(
        self, goal: ServedGoal, on_result: Callable[[None], None], _on_error: Callable[[Exception], None]
    ) -> None:
        go_on = partial(on_result, None)
        self._waiting.append(go_on)
        goal.on_cancel(lambda: self._waited_enough(go_on))
        seconds = max(self.parameters.pose_timeout, RETURN_SECONDS if self._was_gone else 0.0)
        self._runtime.post_in(seconds, lambda: self._waited_enough(go_on))

    async def poses(self, goal: ServedGoal, asked: Callable[[Any], Sequence[Asked]]) -> list[Pose]:
        """Return the poses that ``asked(request)`` lists, in the map frame. Waits as :meth:`known`.

        Raises:
            NavigationError: as :meth:`MapFrame.poses`.
            GoalCanceled: a cancel of the goal was requested.
        """
        await self.known(goal)
        poses = await Later(partial(self.map_frame.poses, asked(goal.request)))
        check_canceled(goal)
        return poses

    def _waited_enough(self, go_on: Callable[[], None]) -> None:
        if go_on in self._waiting:
            self._waiting.remove(go_on)
            go_on()

    @property
    def _is_known(self) -> bool:
        return self.silence < self.parameters.pose_timeout and self._map is not None

    def _tell_waiting(self) -> None:
        if self._waiting and self._is_known:
            waiting, self._waiting = self._waiting, []
            for go_on in waiting:
                go_on()

    def check_pose(self) -> None:
        """Raise NavigationError, as :attr:`pose`."""
        _ = self.pose

    @property
    def pose(self) -> Pose:
        """The robot's pose. Raises NavigationError TF_ERROR while it is unknown or out of date."""
        silence = self.silence
        if self._pose is None or silence >= self.parameters.pose_timeout:
            since = '' if self._pose is None else f' for {silence:.1f} s'
            raise NavigationError(
                'TF_ERROR', f'the pose of the robot is not known: nothing on {self.parameters.pose_topic}{since}'
            )
        return self._pose

    @property
    def silence(self) -> float:
        """Time since the last pose, s of ``NodeRuntime.listening_time``; infinite before the first."""
        self._demand.take()
        return self._runtime.listening_time.handled - self._pose_heard

    def watch_pose(self, on_lost: Callable[[GoalEnd], None]) -> PoseWatch:
        """Call ``on_lost`` when no pose arrives for the pose timeout, from now on."""
        return PoseWatch(self._runtime, self.parameters.pose_timeout, lambda: self.silence, on_lost)

    def forget_pose(self) -> None:
        """Forget the pose, because its source is gone."""
        self._demand.take_all()  # earlier poses of that source are not new
        self._pose, self._pose_heard, self._was_gone = None, -math.inf, True

    def drive(self, linear: float, angular: float) -> None:
        """Send a velocity command, m/s and rad/s."""
        command = Twist()
        command.linear.x, command.angular.z = float(linear), float(angular)
        if self.parameters.stamped_cmd_vel:
            message = TwistStamped(twist=command)
            message.header.stamp = self._runtime.clock.stamp()
            self._commands.publish(message)
        else:
            self._commands.publish(command)

    def _receive_pose(self, received: Received) -> None:
        before = self._pose
        looked = self._runtime.listening_time.looked
        # The message may have waited in the middleware for a while (demand.py), but it arrived after the previous one
        # was taken. That holds also if the sender has another clock. If this node was waiting for the message, it
        # waited in the middleware because this node was delayed: the sender was not silent.
        lain = 0.0 if self._demand.is_there else max(0.0, time.time() - received.sent)
        age = min(lain, looked - self._taken)
        self._taken = looked
        try:
            message = received.unpack(PoseStamped)
            check_limits(message)
            check_frame(message.header.frame_id, self.parameters.map_frame, 'the pose of the robot')
            self._pose = finite_pose(message.pose, 'the pose of the robot', 'TF_ERROR')
        except (FlexbtError, ValueError) as error:
            # Such messages arrive at a high rate.
            self._runtime.node.get_logger().error(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
            return
        self._pose_heard, self._was_gone = looked - age, False
        self._is_moving = self._pose != before
        stamp = seconds_of(message.header.stamp)
        self.costmaps.add_pose(stamp, self._pose)
        self._set_back += max(0.0, self._stamp - stamp)
        self._stamp = stamp
        self._tell_waiting()
        pose, now = self._pose, stamp + self._set_back
        for tell in tuple(self.on_pose):
            tell(pose, now)

    def _receive_map(self, grid: OccupancyGrid) -> None:
        try:
            check_limits(grid)
            check_frame(grid.header.frame_id, self.parameters.map_frame, 'the map')
            self._map = map_of(grid)
        except FlexbtError as error:
            self._runtime.node.get_logger().error(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
            return
        self._use_map(self._map)
        self._tell_waiting()

    def _receive_mask(self, mask: OccupancyMap) -> None:
        self._mask = mask
        if self._map is not None:
            self._use_map(self._map)

    def _use_map(self, world: OccupancyMap) -> None:
        self.costmaps.set_map(world if self._mask is None else world.masked(self._mask))
        self.on_map()
