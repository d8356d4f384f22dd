# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of Nav2's trees that work on poses and paths of the blackboard."""

from __future__ import annotations

import math
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_core.behavior_tree import NodeConfig, NodeStatus, SyncAction, input_port, output_port
from flexbt_core.behavior_tree.model import DOUBLE, STRING
from flexbt_server.trees import PATH, POSES

from .topic_cache import TopicCache

MIN_POSES = 2
"""A truncated path keeps this many poses."""


def _distance(one: PoseStamped, other: PoseStamped) -> float:
    a, b = one.pose.position, other.pose.position
    return math.dist((a.x, a.y), (b.x, b.y))


class TruncatePath(SyncAction):
    """Takes the last ``distance`` metres off a path, and turns its new end toward the old one."""

    __slots__ = ()

    ports = {
        'input_path': input_port(PATH, description='the path'),
        'distance': input_port(DOUBLE, default='1.0', description='what is taken off, m'),
        'output_path': output_port(PATH, description='what is left'),
    }

    def tick(self) -> NodeStatus:
        path: Any = self.get_input('input_path')
        poses = list(path.poses)
        if poses:
            end = poses[-1]
            distance = float(self.get_input('distance'))
            while len(poses) > MIN_POSES and _distance(poses[-1], end) < distance:
                poses.pop()
            poses[-1] = _facing(poses[-1], end)
        self.set_output('output_path', Path(header=path.header, poses=poses))
        return NodeStatus.SUCCESS


def _facing(pose: PoseStamped, target: PoseStamped) -> PoseStamped:
    here, there = pose.pose.position, target.pose.position
    turned = PoseStamped(header=pose.header)
    turned.pose.position = here
    yaw = math.atan2(there.y - here.y, there.x - here.x)
    turned.pose.orientation.z, turned.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return turned


class RemovePassedGoals(SyncAction):
    """Drops the first goals as long as the robot is within ``radius`` of them; never the last one."""

    __slots__ = ('_pose',)

    ports = {
        'input_goals': input_port(POSES, description='goals to pass'),
        'output_goals': output_port(POSES, description='those that are left'),
        'radius': input_port(DOUBLE, default='0.5', description='m'),
        'global_frame': input_port(
            STRING, optional=True, description="not used: goals and robot are in the map's frame"
        ),
        'robot_base_frame': input_port(STRING, optional=True, description="not used: the robot's pose is a topic"),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._pose: TopicCache | None = None

    def tick(self) -> NodeStatus:
        goals = list(self.get_input('input_goals'))
        if self._pose is None:
            self._pose = self.services.topics.cache(PoseStamped, self.services.pose_topic, 1)
        cache = self._pose
        if len(goals) > 1:
            if cache.latest is None:
                return self.fail(f"the robot's pose is not known: nothing on {self.services.pose_topic}")
            radius = float(self.get_input('radius'))
            while len(goals) > 1 and _distance(cache.latest, goals[0]) <= radius:
                goals.pop(0)
        self.set_output('output_goals', goals)
        return NodeStatus.SUCCESS


NODES: Final = (TruncatePath, RemovePassedGoals)
