# SPDX-License-Identifier: BSD-3-Clause
"""What the BT server gives to the leaves of its trees: their way to ROS."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Final

from flexbt_common.calls import ActionLinks, ServiceLinks
from flexbt_common.liveness import STARTED
from flexbt_common.runtime import NodeRuntime
from flexbt_server.trees import TreeStore

from .ending_goals import EndingGoals
from .robot_frames import RobotFrames
from .topic_cache import TopicCaches
from .trigger_services import TriggerServices

MOST_TOLD: Final = 1_000
"""Things that people are told once: trees may have any names."""


@dataclass(frozen=True)
class LeafServices:
    """Shared by all leaves of a server; ``node.services`` of a leaf.

    ``runtime`` owns the node and the thread on which everything of rclpy happens; ``actions`` and ``services`` are
    the shared clients, ``topics`` the shared subscriptions, ``triggers`` the services that nodes of trees offer;
    ``ending`` are canceled goals that may go on; ``frames`` knows where the robot is; ``trees`` has the node types, and
    reads files. ``server_timeout`` and ``cancel_timeout`` are the deadlines for acceptance and for the confirmation of
    a cancel, in seconds of wall time; ``start_timeout`` is the age of this process up to which a server is waited for
    in any case. ``goal_reached_tol`` is Nav2's parameter of this name, m.
    """

    runtime: NodeRuntime
    actions: ActionLinks
    services: ServiceLinks
    topics: TopicCaches
    triggers: TriggerServices
    ending: EndingGoals
    frames: RobotFrames
    trees: TreeStore
    server_timeout: float
    cancel_timeout: float
    start_timeout: float = 0.0
    goal_reached_tol: float = 0.25
    _told: set[str] = field(default_factory=set)

    def appear_timeout(self, timeout: float) -> float:
        """How long to wait for a server to appear, s of wall time, where ``timeout`` is how long it has otherwise.

        The processes of a robot begin together, in any order: as long as this one is young, that one may be starting.
        """
        return max(timeout, self.start_timeout - (time.monotonic() - STARTED))

    def warn_once(self, message: str) -> None:
        """Warn people of something that a tree asks for and that cannot be, once in the life of the server."""
        if message not in self._told and len(self._told) < MOST_TOLD:
            self._told.add(message)
            self.runtime.node.get_logger().warning(message)
