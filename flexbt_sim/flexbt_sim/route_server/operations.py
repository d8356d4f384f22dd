# SPDX-License-Identifier: BSD-3-Clause
"""What is done while a route is tracked: the operations of Nav2's route server."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from nav2_msgs.msg import SpeedLimit
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.runtime import NodeRuntime
from flexbt_sim.navigation_errors import NavigationError
from flexbt_sim.routes import Operation, RouteTracker, blocked_edge, speed_limit
from flexbt_sim.server_common import (
    ADJUST_SPEED_LIMIT,
    COLLISION_MONITOR,
    REROUTING_SERVICE,
    TIME_MARKER,
    RobotInterface,
    RouteParameters,
)
from flexbt_sim.world import Pose

NO_LIMIT: Final = 0.0
"""What takes a limit back: NO_SPEED_LIMIT of nav2_costmap_2d."""


@dataclass
class Done:
    """Names of the operations that did something, and whether the route has to be another one, without some edges."""

    triggered: list[str] = field(default_factory=list)
    reroute: bool = False
    blocked: frozenset[int] = frozenset()


class RouteOperations:
    """On the executor thread. For one route at a time: ``begin``, ``process`` at each pose of the robot, ``finish``."""

    def __init__(self, runtime: NodeRuntime, parameters: RouteParameters, robot: RobotInterface) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._services = ServiceLinks(runtime)
        self._speed_limits = runtime.node.create_publisher(SpeedLimit, names.SPEED_LIMIT, 1)
        self._frame = robot.parameters.map_frame
        runtime.node.create_service(Trigger, names.REROUTE, self._on_reroute)
        self._run = 0
        self.begin()

    def begin(self) -> None:
        """There is a new goal."""
        self._run += 1  # what was triggered before does not concern it
        self._is_reroute_wanted = False
        self._is_limited = False
        self._checked_at = self._entered_at = -math.inf
        self._failure: str | None = None

    def finish(self) -> None:
        """The goal has ended: the robot may be as fast as ever."""
        self._run += 1
        if self._is_limited:
            self._limit(NO_LIMIT)

    def process(self, changed: bool, tracker: RouteTracker, pose: Pose, now: float) -> Done:
        """Do what is due at a pose, at a time in s. ``changed``: a node was just achieved.

        Raises:
            NavigationError: OPERATION_FAILED.
        """
        if self._failure is not None:
            raise NavigationError('OPERATION_FAILED', self._failure)
        done = Done()
        if changed:
            for operation in tracker.operations():
                self._trigger(operation)
                done.triggered.append(operation.type)
        for name in self._parameters.operations:
            if self._OPERATIONS[name](self, done, changed, tracker, pose, now):
                done.triggered.append(name)
        return done

    def _adjust_speed_limit(self, _done: Done, changed: bool, tracker: RouteTracker, _pose: Pose, _now: float) -> bool:
        if not changed or tracker.edge is None:
            return False
        percent = 100.0 * speed_limit(tracker.edge)
        if percent == 100.0 and not self._is_limited:
            return False
        self._is_limited = percent < 100.0
        self._limit(percent)
        return True

    def _limit(self, percent: float) -> None:
        message = SpeedLimit(percentage=True, speed_limit=percent)
        message.header.frame_id, message.header.stamp = self._frame, self._runtime.clock.stamp()
        self._speed_limits.publish(message)

    def _reroute(self, done: Done, _changed: bool, tracker: RouteTracker, _pose: Pose, _now: float) -> bool:
        wanted, self._is_reroute_wanted = self._is_reroute_wanted, False
        if wanted and not tracker.is_complete:
            done.reroute = True
        return wanted

    def _on_reroute(self, _request: Any, response: Any) -> Any:
        self._is_reroute_wanted = True
        response.success = True
        return response

    def _watch_collisions(self, done: Done, _changed: bool, tracker: RouteTracker, pose: Pose, now: float) -> bool:
        if now - self._checked_at < 1.0 / self._parameters.collision_rate:
            return False
        self._checked_at = now
        edge = blocked_edge(tracker, pose, self._robot.costmaps.shared, self._parameters.collision_distance)
        if edge is None:
            return False
        done.reroute, done.blocked = True, done.blocked | {edge.id}
        return True

    def _mark_time(self, _done: Done, changed: bool, tracker: RouteTracker, _pose: Pose, now: float) -> bool:
        if not changed:
            return False
        began, self._entered_at = self._entered_at, now
        if tracker.left is None or began == -math.inf:
            return False
        tracker.left.metadata['abs_time_taken'] = now - began
        return True

    def _trigger(self, operation: Operation) -> None:
        if operation.type not in self._parameters.trigger_events:
            raise NavigationError(
                'OPERATION_FAILED',
                f'the graph wants the operation {operation.type!r}, which trigger_events does not name',
            )
        service = operation.metadata.get('service_name')
        if not isinstance(service, str) or not service:
            raise NavigationError(
                'OPERATION_FAILED', f'the metadata of the operation {operation.name!r} have no service_name'
            )
        link = self._services.link(Trigger, service)
        ServiceCall(link, Trigger.Request(), on_done=partial(self._on_triggered, self._run, service))

    def _on_triggered(self, run: int, service: str, outcome: ServiceOutcome) -> None:
        if run != self._run:
            return
        if outcome.response is None:
            self._failure = f'{service}: {outcome.reason}'
        elif not outcome.response.success:
            self._failure = f'{service} has failed: {outcome.response.message}'

    _OPERATIONS: Final[dict[str, Callable[..., bool]]] = {
        ADJUST_SPEED_LIMIT: _adjust_speed_limit,
        REROUTING_SERVICE: _reroute,
        COLLISION_MONITOR: _watch_collisions,
        TIME_MARKER: _mark_time,
    }
