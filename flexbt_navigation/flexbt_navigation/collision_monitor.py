# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's collision monitor, between the motions and the robot, and the service that switches it on and off."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from nav2_msgs.msg import CollisionMonitorState
from nav2_msgs.srv import Toggle

from flexbt_common import names
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.controller.motions import STOP, Velocity, slowed
from flexbt_navigation.controller.server import MotionArbiter
from flexbt_sim.world.plane.geometry import Pose

POLYGON: Final = 'FootprintApproach'
"""The polygon of Nav2's bringup that slows down, which is the footprint."""


@dataclass(frozen=True)
class CollisionMonitorParameters:
    """Parameters of the collision monitor."""

    is_on: bool = parameter(
        'collision_monitor', False, 'whether commands are slowed down before collisions, as the service toggles it'
    )
    seconds: float = parameter('time_before_collision', 1.2, 'how far ahead the collision monitor looks, s', 0.1, 10.0)


class CollisionMonitor:
    """On the executor thread. Publishes its state on change. While the managed node of its name is not active, it
    blocks all commands, as in Nav2."""

    def __init__(self, runtime: NodeRuntime, parameters: CollisionMonitorParameters, arbiter: MotionArbiter) -> None:
        self._parameters = parameters
        self._robot = arbiter.robot
        self._is_on = parameters.is_on
        self._acts = False
        self._states = runtime.node.create_publisher(CollisionMonitorState, names.COLLISION_MONITOR_STATE, 1)
        runtime.node.create_service(Toggle, names.TOGGLE_COLLISION_MONITOR, self._toggle)
        self._part = LifecycleSubnode(runtime, names.COLLISION_MONITOR)
        arbiter.monitor = self._checked
        arbiter.on_stop = partial(self._tell, acts=False)

    def _checked(self, pose: Pose, command: Velocity) -> Velocity:
        if not self._part.is_active:
            return STOP
        if not self._is_on:
            return command
        safe = slowed(self._robot.costmaps.local, pose, command, self._parameters.seconds)
        self._tell(acts=safe != command)
        return safe

    def _tell(self, *, acts: bool) -> None:
        if acts != self._acts:
            self._acts = acts
            action = CollisionMonitorState.APPROACH if acts else CollisionMonitorState.DO_NOTHING
            self._states.publish(CollisionMonitorState(action_type=action, polygon_name=POLYGON if acts else ''))

    def _toggle(self, request: Any, response: Any) -> Any:
        self._is_on = request.enable
        if not self._is_on:
            self._tell(acts=False)
        response.success = True
        response.message = f'the collision monitor is {"on" if self._is_on else "off"}'
        return response
