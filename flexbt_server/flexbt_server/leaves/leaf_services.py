# SPDX-License-Identifier: BSD-3-Clause
"""What the BT server gives to the leaves of its trees: their way to ROS."""

from __future__ import annotations

from dataclasses import dataclass

from flexbt_common.calls import ActionLinks, ServiceLinks
from flexbt_common.runtime import NodeRuntime

from .topic_cache import TopicCaches
from .trigger_services import TriggerServices


@dataclass(frozen=True)
class LeafServices:
    """Shared by all leaves of a server; ``node.services`` of a leaf.

    ``runtime`` owns the node and the thread on which everything of rclpy happens; ``actions`` and ``services`` are
    the shared clients, ``topics`` the shared subscriptions, ``triggers`` the services that nodes of trees offer;
    ``pose_topic`` is the topic of the robot's pose. ``server_timeout`` and ``cancel_timeout`` are the deadlines for
    acceptance and for the confirmation of a cancel, in seconds of wall time.
    """

    runtime: NodeRuntime
    actions: ActionLinks
    services: ServiceLinks
    topics: TopicCaches
    triggers: TriggerServices
    pose_topic: str
    server_timeout: float
    cancel_timeout: float
