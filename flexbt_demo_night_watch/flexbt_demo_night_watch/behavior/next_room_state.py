# SPDX-License-Identifier: BSD-3-Clause
"""A state of the night watch: choose the room to look at next."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from geometry_msgs.msg import PoseStamped
from rclpy.publisher import Publisher
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime import resolve_file
from flexbt_core.state_machine import EventState, UserData
from flexbt_core.values import Place, load_places
from flexbt_onboard.behaviors import state_services
from flexbt_states.errors import StateParameterError

ROOMS_LEFT = 'rooms_left'
"""Topic (std_msgs/String, latched) of the rooms that a robot has not looked at yet, apart by spaces."""


class NextRoomState(EventState):
    """
    Choose the room to look at next, and tell on the topic "rooms_left" what is left of the round.

    -- rooms        string[]    Rooms of this robot, in the order of its round
    -- places       string      File of the places, as package/path.yaml

    ># inherited    string[]    Rooms that it has taken over from its partner
    ># checked      string[]    Rooms that it has looked at in this round
    ># postponed    string[]    Rooms that it tries again after all others

    #> room         string      The room
    #> goal         geometry_msgs/PoseStamped   The place in the room from which it is looked at
    #> entrance     geometry_msgs/PoseStamped   The place from which the door of the room is opened, if it has one

    <= room                     The room has no door.
    <= door                     The room has a door: there is a place ROOM_door.
    <= done                     All rooms have been looked at in this round.
    """

    is_instant = True

    def __init__(self, rooms: Iterable[str], places: str) -> None:
        super().__init__(
            outcomes=['room', 'door', 'done'],
            input_keys=['inherited', 'checked', 'postponed'],
            output_keys=['room', 'goal', 'entrance'],
            desired_rate=None,
        )
        self._rooms = tuple(rooms)
        self._places = places_in(places)
        if not self._rooms:
            raise StateParameterError(self, 'rooms', 'there are none; give at least one')
        for room in self._rooms:
            if room not in self._places:
                raise StateParameterError(self, 'rooms', f'{room!r} is no place of {places}')
        self._publisher: Publisher | None = None

    def on_start(self) -> None:
        runtime = state_services(self).runtime
        self._publisher = runtime.call(lambda: runtime.node.create_publisher(String, ROOMS_LEFT, names.latched()))

    def execute(self, userdata: UserData) -> str:
        left = rooms_left([*self._rooms, *userdata.inherited], userdata.checked, userdata.postponed)
        assert self._publisher is not None
        self._publisher.publish(String(data=' '.join(left)))
        if not left:
            return 'done'
        room = left[0]
        entrance = self._places.get(f'{room}_door')
        userdata.room = room
        userdata.goal = pose_of(self._places[room])
        userdata.entrance = pose_of(entrance or self._places[room])
        return 'door' if entrance else 'room'

    def on_stop(self) -> None:
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            runtime = state_services(self).runtime
            runtime.post(lambda: runtime.node.destroy_publisher(publisher))


def places_in(file: str) -> dict[str, Place]:
    """The places of a file package/path.yaml.

    Raises:
        ResourceError: there is no such file.
        ValueError: it is no file of places.
    """
    return load_places(resolve_file(file, allowed=[Path('/')]))


def rooms_left(rooms: Iterable[str], checked: Sequence[str], postponed: Sequence[str]) -> list[str]:
    """What is left of a round, in order: each room once, none that was looked at, those that were postponed last."""
    left = [room for room in dict.fromkeys(rooms) if room not in checked]
    return [room for room in left if room not in postponed] + [room for room in postponed if room in left]


def pose_of(place: Place) -> PoseStamped:
    """A place as a goal, with a zero stamp."""
    message = PoseStamped()
    message.header.frame_id = place.frame
    message.pose.position.x, message.pose.position.y = place.x, place.y
    message.pose.orientation.z, message.pose.orientation.w = math.sin(place.yaw / 2.0), math.cos(place.yaw / 2.0)
    return message
