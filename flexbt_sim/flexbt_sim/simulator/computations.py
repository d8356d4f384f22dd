# SPDX-License-Identifier: BSD-3-Clause
"""Who computes something that a robot waits for: goals of the actions of Nav2 whose servers compute, or are to drive.

A world that goes as fast as possible would be a minute older when a plan is there, and on a busy machine the time of a
motion would be over before its first command. Each server of an action says which
of its goals are being worked on; so it is known without its help, of Nav2's own servers too.
"""

from __future__ import annotations

from collections.abc import Set
from functools import partial
from typing import Any, Final

from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_sim.world import Pacer

COMPUTING: Final = (
    names.COMPUTE_PATH_TO_POSE,
    names.COMPUTE_PATH_THROUGH_POSES,
    names.SMOOTH_PATH,
    names.COMPUTE_ROUTE,
    names.FOLLOW_PATH,
    names.SPIN,
    names.BACKUP,
    names.DRIVE_ON_HEADING,
)
"""Actions whose goals take no simulated time; and those that drive a robot, which take none before the first command.
"""

_WORKING: Final = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)


class Computations:
    """Tells the pacer. On the executor thread."""

    def __init__(self, runtime: NodeRuntime, pacer: Pacer) -> None:
        self._node = runtime.node
        self._pacer = pacer
        self._subscriptions: dict[str, list[Any]] = {}

    def watch(self, namespaces: Set[str]) -> None:
        """Watch the servers in these namespaces ('' or 'robot1/'), and no others any more."""
        for namespace in self._subscriptions.keys() - namespaces:
            for action in COMPUTING:
                self._pacer.set_computing(f'{namespace}{action}', False)
            for subscription in self._subscriptions.pop(namespace):
                self._node.destroy_subscription(subscription)
        qos = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        for namespace in namespaces - self._subscriptions.keys():
            self._subscriptions[namespace] = [
                self._node.create_subscription(
                    GoalStatusArray,
                    f'{namespace}{action}/_action/status',
                    partial(self._tell, f'{namespace}{action}'),
                    qos,
                )
                for action in COMPUTING
            ]

    def _tell(self, action: str, message: Any) -> None:
        self._pacer.set_computing(action, any(one.status in _WORKING for one in message.status_list))
