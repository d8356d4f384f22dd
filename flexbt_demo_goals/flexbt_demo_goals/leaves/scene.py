# SPDX-License-Identifier: BSD-3-Clause
"""What the robot sees of the flat, by the topics of the simulator."""

from __future__ import annotations

from typing import Final

from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_server.leaves import SubscribedTopic

THINGS: Final = SubscribedTopic(TFMessage, 'simulator/things', qos=names.latched())
"""Where things are: on the map, or in the gripper."""

DOORS: Final = SubscribedTopic(JointState, 'simulator/doors', qos=names.latched())
"""How far doors are open."""

MAP: Final = 'map'

REACH: Final = 0.75
"""From so near the robot picks a thing up, m; its gripper reaches a little farther."""

OPEN: Final = 0.95
"""A door that is so far open, of 1, can be passed."""


def position_of(message: TFMessage | None, thing: str) -> tuple[float, float] | None:
    """Where a thing is on the map, m; None where it is not seen, or held."""
    for one in [] if message is None else message.transforms:
        if one.child_frame_id == thing and one.header.frame_id == MAP:
            return one.transform.translation.x, one.transform.translation.y
    return None


def is_held(message: TFMessage | None, thing: str) -> bool:
    """Whether a thing is in the gripper."""
    transforms = [] if message is None else message.transforms
    return any(one.child_frame_id == thing and one.header.frame_id != MAP for one in transforms)


def is_open(message: JointState | None, door: str) -> bool:
    """Whether a door can be passed."""
    return message is not None and door in message.name and message.position[message.name.index(door)] >= OPEN
