# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that reach ROS: bases for one's own, and those of Nav2's trees."""

from .action_leaf import ActionLeaf
from .register import register_leaves
from .ros_ports import DURATION, PATH, POSE_STAMPED, POSES, message_type
from .service_leaf import ServiceLeaf
from .topic_leaf import TopicCondition

__all__ = [
    'DURATION',
    'PATH',
    'POSES',
    'POSE_STAMPED',
    'ActionLeaf',
    'ServiceLeaf',
    'TopicCondition',
    'message_type',
    'register_leaves',
]
