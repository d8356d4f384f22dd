# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that use ROS: base classes for user-defined leaves, and the leaf that runs a behavior."""

from flexbt_server.trees.ros_ports import DURATION, PATH, POSE_STAMPED, POSES, message_type

from .action_leaf import ACTION_PORTS, BASE, SERVER_PORTS, ActionLeaf, error_code_of
from .behavior_leaf import ExecuteBehavior
from .leaf_services import LeafServices, RobotFrames
from .service_leaf import SERVICE_PORTS, ServiceCondition, ServiceLeaf, ServiceNode, ServiceSyncAction
from .topic_cache import SubscribedTopic
from .topic_leaf import PoseLeaf, TopicCondition

__all__ = [
    'ACTION_PORTS',
    'BASE',
    'DURATION',
    'PATH',
    'POSES',
    'POSE_STAMPED',
    'SERVER_PORTS',
    'SERVICE_PORTS',
    'ActionLeaf',
    'ExecuteBehavior',
    'LeafServices',
    'PoseLeaf',
    'RobotFrames',
    'ServiceCondition',
    'ServiceLeaf',
    'ServiceNode',
    'ServiceSyncAction',
    'SubscribedTopic',
    'TopicCondition',
    'error_code_of',
    'message_type',
]
