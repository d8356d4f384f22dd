# SPDX-License-Identifier: BSD-3-Clause
"""Where the robot can drive, each by a goal of NavigateToPose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_core.behavior_tree import NodeStatus, input_port
from flexbt_core.behavior_tree.model import STRING
from flexbt_server.leaves import ACTION_PORTS, ActionLeaf, SubscribedTopic

from .rooms import table_of
from .scene import THINGS, position_of

BESIDE: Final = 0.5
"""The robot drives so near to a thing, m."""


def _goal(x: float, y: float, yaw: float) -> NavigateToPose.Goal:
    pose = PoseStamped()
    pose.header.frame_id = 'map'
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
    return NavigateToPose.Goal(pose=pose)


class DriveToTable(ActionLeaf):
    """Drives to where the robot puts things down in a room."""

    __slots__ = ()

    action_type = NavigateToPose
    default_server = names.NAVIGATE_TO_POSE
    ports = ACTION_PORTS | {'room': input_port(STRING, description='name of the room')}

    def make_goal(self) -> Any:
        table = table_of(str(self.get_input('room')))
        return _goal(table.x, table.y, table.yaw)


class EnterRoom(DriveToTable):
    """Drives into a room that has no door. Whoever waits for the robot to be in it halts the drive there."""

    __slots__ = ()


class PassDoor(DriveToTable):
    """Drives into a room through its door."""

    __slots__ = ()

    ports = DriveToTable.ports | {'door': input_port(STRING, description='the door that has to be open')}


class Approach(ActionLeaf):
    """Drives to where a thing can be picked up."""

    __slots__ = ()

    action_type = NavigateToPose
    default_server = names.NAVIGATE_TO_POSE
    ports = ACTION_PORTS | {'thing': input_port(STRING, description='name of the thing')}

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [THINGS]

    def on_start(self) -> NodeStatus:
        self.host.topics.cache(THINGS).on_message(self.context)
        return super().on_start()

    def make_goal(self) -> Any:
        thing = str(self.get_input('thing'))
        position = position_of(self.host.topics.cache(THINGS).latest, thing)
        if position is None:
            raise ValueError(f'the robot does not see the {thing}')
        try:
            robot = self.host.frames.robot_pose().pose.position
        except TransformError as error:
            raise ValueError(f'where the robot is, is not known: {error}') from error
        yaw = math.atan2(position[1] - robot.y, position[0] - robot.x)
        return _goal(position[0] - BESIDE * math.cos(yaw), position[1] - BESIDE * math.sin(yaw), yaw)
