# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that reach ROS: bases for one's own, and the one that runs a behavior."""

from flexbt_server.trees import DURATION, PATH, POSE_STAMPED, POSES, message_type

from .action_leaf import ACTION_PORTS, BASE, SERVER_PORTS, ActionLeaf, error_code_of
from .behavior_leaf import ExecuteBehavior
from .called_servers import called_servers, subscribed_topics
from .ending_goals import EndingGoals
from .leaf_services import LeafServices
from .pose_leaf import PoseLeaf
from .robot_frames import RobotFrames
from .service_leaf import SERVICE_PORTS, ServiceCondition, ServiceLeaf, ServiceNode, ServiceSyncAction
from .topic_cache import SubscribedTopic, TopicCache, TopicCaches
from .topic_leaf import TopicCondition
from .trigger_services import TriggerServices

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
    'EndingGoals',
    'ExecuteBehavior',
    'LeafServices',
    'PoseLeaf',
    'RobotFrames',
    'ServiceCondition',
    'ServiceLeaf',
    'ServiceNode',
    'ServiceSyncAction',
    'SubscribedTopic',
    'TopicCache',
    'TopicCaches',
    'TopicCondition',
    'TriggerServices',
    'called_servers',
    'error_code_of',
    'message_type',
    'subscribed_topics',
]
