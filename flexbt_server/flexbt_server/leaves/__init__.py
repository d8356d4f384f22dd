# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that reach ROS: bases for one's own, and those of Nav2's trees."""

from flexbt_server.trees import DURATION, PATH, POSE_STAMPED, POSES, message_type

from .action_leaf import ACTION_PORTS, ActionLeaf
from .leaf_services import LeafServices
from .register import register_leaves
from .service_leaf import ServiceLeaf
from .topic_cache import TopicCaches
from .topic_leaf import TopicCondition
from .trigger_services import TriggerServices

__all__ = [
    'ACTION_PORTS',
    'DURATION',
    'PATH',
    'POSES',
    'POSE_STAMPED',
    'ActionLeaf',
    'LeafServices',
    'ServiceLeaf',
    'TopicCaches',
    'TopicCondition',
    'TriggerServices',
    'message_type',
    'register_leaves',
]
