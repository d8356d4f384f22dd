# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of the robot in the flat: its sensors, drives, and handling of things and doors."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateToPose
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_core import STRING, Condition, NodeRegistry, NodeStatus, input_port
from flexbt_server.leaves import (
    ACTION_PORTS,
    SERVICE_PORTS,
    ActionLeaf,
    LeafServices,
    PoseLeaf,
    ServiceLeaf,
    SubscribedTopic,
    TopicCondition,
)

from .rooms import room_at, table_of

THINGS: Final = SubscribedTopic(TFMessage, 'simulator/things', qos=names.transient_local_qos())
"""Topic of the things: their place on the map, or in the gripper."""

DOORS: Final = SubscribedTopic(JointState, 'simulator/doors', qos=names.transient_local_qos())
"""Topic of how far the doors are open."""

MAP: Final = 'map'

REACH: Final = 0.75
"""Distance from which the robot picks up a thing, m; its gripper reaches a little farther."""

OPEN: Final = 0.95
"""A door can be passed if it is this far open, of 1."""


def position_of(message: TFMessage | None, thing: str) -> tuple[float, float] | None:
    """Return the place of a thing on the map, m; None if it is not seen, or is held."""
    for one in [] if message is None else message.transforms:
        if one.child_frame_id == thing and one.header.frame_id == MAP:
            return one.transform.translation.x, one.transform.translation.y
    return None


def is_held(message: TFMessage | None, thing: str) -> bool:
    """Return whether a thing is in the gripper."""
    transforms = [] if message is None else message.transforms
    return any(one.child_frame_id == thing and one.header.frame_id != MAP for one in transforms)


def is_open(message: JointState | None, door: str) -> bool:
    """Return whether a door can be passed."""
    return message is not None and door in message.name and message.position[message.name.index(door)] >= OPEN


# Conditions that sense the predicates of the mission.

AT_TABLE: Final = 0.4
"""Maximum distance of the robot from its place in a room at which it counts as at the table, m."""

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
    """A condition about one of the things on their topic."""

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


# Driving: leaves that send a goal of NavigateToPose.

BESIDE: Final = 0.5
"""Distance to a thing at which the robot stops, m."""


def _goal(x: float, y: float, yaw: float) -> NavigateToPose.Goal:
    pose = PoseStamped()
    pose.header.frame_id = 'map'
    pose.pose.position.x, pose.pose.position.y = x, y
    pose.pose.orientation.z, pose.pose.orientation.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
    return NavigateToPose.Goal(pose=pose)


class DriveToTable(ActionLeaf):
    """Drives to the place in a room where the robot puts things down."""

    __slots__ = ()

    action_type = NavigateToPose
    default_server = names.NAVIGATE_TO_POSE
    ports = ACTION_PORTS | {'room': input_port(STRING, description='name of the room')}

    def make_goal(self) -> Any:
        table = table_of(str(self.get_input('room')))
        return _goal(table.x, table.y, table.yaw)


class EnterRoom(DriveToTable):
    """Drives into a room that has no door. The drive is halted by the leaf that waits for the robot to be inside."""

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


# Handling of things and doors. Each action ends when the sensors show its effect.


class _Switched(ServiceLeaf):
    """A leaf that switches something through SetBool, and waits until the topic ``tells`` shows the effect."""

    __slots__ = ('_cache',)

    service_type = SetBool
    wanted: ClassVar[bool] = True
    tells: ClassVar[SubscribedTopic]

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [cls.tells]

    def make_request(self) -> Any:
        self._cache = self.host.topics.cache(self.tells)
        self._cache.on_message(self.context)
        return SetBool.Request(data=self.wanted)

    def on_response(self, response: Any) -> NodeStatus:
        if not response.success:
            return self.fail(response.message)
        return NodeStatus.SUCCESS if self.is_done(self._cache.latest) else NodeStatus.RUNNING

    @abstractmethod
    def is_done(self, message: Any | None) -> bool:
        """Return whether the effect is visible in the last message, which is None before the first."""


class PickUp(_Switched):
    """Picks up the thing that is nearest to the gripper, and waits until it is held."""

    __slots__ = ()

    default_service = names.GRIPPER
    tells = THINGS
    ports = SERVICE_PORTS | {'thing': input_port(STRING, description='name of the thing')}

    def is_done(self, message: Any | None) -> bool:
        return is_held(message, str(self.get_input('thing')))


class PutDown(_Switched):
    """Puts down what is in the gripper, and waits until it is seen."""

    __slots__ = ()

    default_service = names.GRIPPER
    tells = THINGS
    wanted = False
    ports = PickUp.ports

    def is_done(self, message: Any | None) -> bool:
        return position_of(message, str(self.get_input('thing'))) is not None


class OpenDoor(_Switched):
    """Opens a door, and waits until it is open."""

    __slots__ = ()

    tells = DOORS
    ports = SERVICE_PORTS | {'door': input_port(STRING, description='name of the door')}

    @property
    def service_name(self) -> str:
        return str(self.get_input_or('service_name', '') or f'simulator/doors/{self.get_input("door")}')

    def is_done(self, message: Any | None) -> bool:
        return is_open(message, str(self.get_input('door')))


# Registration of the leaves.

_CONDITIONS: Final = (IsInRoom, IsAtTable, IsThingIn, IsNear, IsHolding, IsDoorOpen)
_ACTIONS: Final = (EnterRoom, PassDoor, Approach, DriveToTable, PickUp, PutDown, OpenDoor)


def register(registry: NodeRegistry) -> None:
    """Register the leaves with the BT server: the entry point.

    All packages share the names of node types, and others have an OpenDoor too: so here it is FlatOpenDoor.
    """
    for leaf in (*_CONDITIONS, *_ACTIONS):
        registry.register(f'Flat{leaf.__name__}', leaf)
