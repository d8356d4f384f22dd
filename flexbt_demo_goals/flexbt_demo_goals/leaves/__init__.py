# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of the robot in the flat: what it can do, and what it can see."""

from typing import Final

from flexbt_core.behavior_tree import NodeRegistry

from .conditions import IsAtTable, IsDoorOpen, IsHolding, IsInRoom, IsNear, IsThingIn
from .driving import Approach, DriveToTable, EnterRoom, PassDoor
from .handling import OpenDoor, PickUp, PutDown
from .rooms import ROOMS, config_file, room_at, table_of

__all__ = ['ROOMS', 'config_file', 'register', 'room_at', 'table_of']


_CONDITIONS: Final = (IsInRoom, IsAtTable, IsThingIn, IsNear, IsHolding, IsDoorOpen)
_ACTIONS: Final = (EnterRoom, PassDoor, Approach, DriveToTable, PickUp, PutDown, OpenDoor)


def register(registry: NodeRegistry) -> None:
    """The entry point: makes the leaves known to the BT server.

    The names of node types are shared by all packages, and others have an OpenDoor, too: here it is FlatOpenDoor.
    """
    for leaf in (*_CONDITIONS, *_ACTIONS):
        registry.register(f'Flat{leaf.__name__}', leaf)
