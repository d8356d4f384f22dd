# SPDX-License-Identifier: BSD-3-Clause
"""What the robot sees of the flat, by the topics of the simulator."""

from __future__ import annotations

from typing import Final

from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_server.leaves import LeafServices, TopicCache

THINGS: Final = 'simulator/things'
DOORS: Final = 'simulator/doors'

REACH: Final = 0.75
"""From so near the robot picks a thing up, m; its gripper reaches a little farther."""

OPEN: Final = 0.95
"""A door that is so far open, of 1, can be passed."""


def things_cache(services: LeafServices) -> TopicCache:
    """The topic that tells where things are which nobody holds."""
    return services.topics.cache(TFMessage, THINGS, names.latched())


def doors_cache(services: LeafServices) -> TopicCache:
    """The topic that tells how far doors are open."""
    return services.topics.cache(JointState, DOORS, names.latched())


def holds_cache(services: LeafServices) -> TopicCache:
    """The topic that tells what the gripper holds."""
    return services.topics.cache(String, names.GRIPPER_HOLDS, names.latched())


def position_of(message: TFMessage | None, thing: str) -> tuple[float, float] | None:
    """Where a thing is on the map, m; None where it is not seen."""
    for one in [] if message is None else message.transforms:
        if one.child_frame_id == thing:
            return one.transform.translation.x, one.transform.translation.y
    return None


def is_open(message: JointState | None, door: str) -> bool:
    """Whether a door can be passed."""
    return message is not None and door in message.name and message.position[message.name.index(door)] >= OPEN
