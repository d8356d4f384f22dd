# SPDX-License-Identifier: BSD-3-Clause
"""The devices of a robot that touch things: its bumper and its gripper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexbt_sim.world.devices.device import Device
from flexbt_sim.world.specification import ModelSpecification, key


class Bumper(Device):
    """A bumper, which feels contacts."""

    name = 'bumper'
    topics = ('bumper',)
    message = 'std_msgs/Bool'
    fields = (('', 'data'),)
    is_latched = True

    @property
    def news(self) -> bool:
        return self.robot.in_contact

    @property
    def state(self) -> bool:
        return self.robot.in_contact

    def values(self) -> tuple[bool]:
        return (self.robot.in_contact,)


@dataclass(frozen=True)
class GripperModel(ModelSpecification):
    """An arm with a gripper, which picks up obstacles that rest, and puts them down straight ahead."""

    title: ClassVar[str] = 'gripper'

    reach: float = key('how far from the middle of the robot it picks up and puts down', 0.6, unit='m', low=0.01,
                       high=10.0)  # fmt: skip
    opening: float = key('greatest radius of what it picks up', 0.1, unit='m', low=0.001, high=10.0)


class Gripper(Device):
    """A gripper. ``holds`` is the name of the obstacle in it, '' for none."""

    name = 'gripper'
    topics = ('gripper_holds',)
    message = 'std_msgs/String'
    fields = (('', 'data'),)
    is_latched = True
    model: GripperModel
    holds = ''

    @property
    def news(self) -> str:
        return self.holds

    @property
    def state(self) -> str:
        return self.holds

    def values(self) -> tuple[str]:
        return (self.holds,)
