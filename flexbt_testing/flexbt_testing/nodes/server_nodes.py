# SPDX-License-Identifier: BSD-3-Clause
"""Nodes of a separate package, as its entry point registers them: faulty leaves, and one that subscribes to a topic."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Bool

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_server.leaves import TopicCondition
from flexbt_testing.behavior_trees import faulty_leaves


class DoorOpen(TopicCondition):
    """A condition that returns SUCCESS while the last message on 'door' is true."""

    message_type = Bool
    default_topic = 'door'

    def holds(self, message: Any | None) -> bool:
        return message is not None and message.data


def register(registry: NodeRegistry) -> None:
    """Register the nodes, like the entry point of a package."""
    registry.register_classes((DoorOpen,))
    faulty_leaves.register(registry)
