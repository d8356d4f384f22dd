# SPDX-License-Identifier: BSD-3-Clause
"""What the robot can see: the sensors of the mission's predicates."""

from __future__ import annotations

import math
from typing import Any, Final

from flexbt_common.errors import TransformError
from flexbt_core.behavior_tree import Condition, NodeStatus, input_port
from flexbt_core.behavior_tree.model import STRING
from flexbt_server.leaves import LeafServices, PoseLeaf, TopicCondition

from .rooms import room_at, table_of
from .scene import DOORS, REACH, THINGS, is_held, is_open, position_of

AT_TABLE: Final = 0.4
"""The robot is at the table of a room when it stands so near to its place, m."""

_ROOM: Final = input_port(STRING, description='name of the room')
_THING: Final = input_port(STRING, description='name of the thing')


class IsInRoom(PoseLeaf, Condition):
    """SUCCESS when the robot is in a room."""

    __slots__ = ()

    ports = {'room': _ROOM}

    def evaluate(self) -> NodeStatus:
        position = self.frames.robot_pose().pose.position
        room = room_at(position.x, position.y)
        return NodeStatus.SUCCESS if room == self.get_input('room') else self.fail(f'the robot is in {room}')


class IsAtTable(PoseLeaf, Condition):
    """SUCCESS when the robot is where it puts things down in a room."""

    __slots__ = ()

    ports = {'room': _ROOM}

    def evaluate(self) -> NodeStatus:
        position, table = self.frames.robot_pose().pose.position, table_of(str(self.get_input('room')))
        distance = math.hypot(position.x - table.x, position.y - table.y)
        return NodeStatus.SUCCESS if distance <= AT_TABLE else self.fail(f'the robot is {distance:.2f} m away')


class _ThingCondition(TopicCondition):
    """Asks the topic of things about one of them."""

    __slots__ = ()

    message_type, default_topic, qos = THINGS.message_type, THINGS.name, THINGS.qos
    ports = {**TopicCondition.ports, 'thing': _THING}


class IsThingIn(_ThingCondition):
    """SUCCESS when a thing is in a room, and nobody holds it."""

    __slots__ = ()

    ports = {**_ThingCondition.ports, 'room': _ROOM}

    def holds(self, message: Any | None) -> bool:
        position = position_of(message, str(self.get_input('thing')))
        return position is not None and room_at(*position) == self.get_input('room')


class IsNear(_ThingCondition):
    """SUCCESS when a thing is near enough to be picked up."""

    __slots__ = ()

    def holds(self, message: Any | None) -> bool:
        position = position_of(message, str(self.get_input('thing')))
        services: LeafServices = self.services
        try:
            robot = services.frames.robot_pose().pose.position
        except TransformError:
            return False
        return position is not None and math.dist(position, (robot.x, robot.y)) <= REACH


class IsHolding(_ThingCondition):
    """SUCCESS when the robot has a thing in its gripper."""

    __slots__ = ()

    def holds(self, message: Any | None) -> bool:
        return is_held(message, str(self.get_input('thing')))


class IsDoorOpen(TopicCondition):
    """SUCCESS when a door is open."""

    __slots__ = ()

    message_type, default_topic, qos = DOORS.message_type, DOORS.name, DOORS.qos
    ports = {**TopicCondition.ports, 'door': input_port(STRING, description='name of the door')}

    def holds(self, message: Any | None) -> bool:
        return is_open(message, str(self.get_input('door')))
