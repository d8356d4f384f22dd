# SPDX-License-Identifier: BSD-3-Clause
"""Data for displays such as RViz: the URDF of a robot, and the bodies of the world as joints and transforms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_sim.messages import transform
from flexbt_sim.world.plane.geometry import ORIGIN, Circle, Pose, Shape
from flexbt_sim.world.world import World

HEIGHT = 0.15
"""Drawn height of a robot, m: the world is flat."""

SENSOR_SIZE = (0.04, 0.04)
"""Radius and height of a drawn sensor, m."""


def robot_description(
    name: str, footprint: Shape, base_frame: str, footprint_frame: str, sensors: Mapping[str, Pose]
) -> str:  # fmt: skip
    """Return the URDF of a robot; ``sensors`` are the poses of its sensors by their frames.

    The frame of the footprint is that of the base on the ground, which is the same in a flat world; Nav2's robots have
    both. A footprint that is not a circle is drawn as a wall along its sides.
    """
    robot = Element('robot', name=name)
    base = SubElement(robot, 'link', name=base_frame)
    if isinstance(footprint, Circle):
        _visual(base, ORIGIN, 'cylinder', radius=f'{footprint.radius:g}', length=f'{HEIGHT:g}')
    else:
        for x0, y0, x1, y1 in footprint.sides(ORIGIN):
            middle = Pose((x0 + x1) / 2.0, (y0 + y1) / 2.0, math.atan2(y1 - y0, x1 - x0))
            _visual(base, middle, 'box', size=f'{math.hypot(x1 - x0, y1 - y0):g} 0.02 {HEIGHT:g}')
    _link(robot, footprint_frame, base_frame, ORIGIN)
    for frame, pose in sensors.items():
        radius, height = SENSOR_SIZE
        _visual(_link(robot, frame, base_frame, pose), ORIGIN, 'cylinder', radius=f'{radius:g}', length=f'{height:g}')
    indent(robot)
    return tostring(robot, encoding='unicode', xml_declaration=True)


def _link(robot: Element, frame: str, parent: str, pose: Pose) -> Element:
    """Return a link that is fixed to another one."""
    link = SubElement(robot, 'link', name=frame)
    joint = SubElement(robot, 'joint', name=f'{parent}_to_{frame}', type='fixed')
    SubElement(joint, 'parent', link=parent)
    SubElement(joint, 'child', link=frame)
    _origin(joint, pose)
    return link


def _visual(link: Element, pose: Pose, shape: str, **sizes: str) -> None:
    visual = SubElement(link, 'visual')
    _origin(visual, pose)
    SubElement(SubElement(visual, 'geometry'), shape, sizes)


def _origin(element: Element, pose: Pose) -> None:
    SubElement(element, 'origin', xyz=f'{pose.x:g} {pose.y:g} 0', rpy=f'0 0 {pose.yaw:g}')


# The visible state of doors and things, as latched topics, published when it changes.
#
# ``simulator/doors`` (JointState) has the doors by name, position 0 (closed) to 1 (open); ``simulator/things``
# (TFMessage) the poses of the obstacles: in the map, or, of one in a gripper, in the robot of this name. So one message
# has the place of a thing and the robot that holds it.

_IN_GRIPPER: Final = Pose(0.0, 0.0, 0.0)


class Scene:
    """The topics of doors and things. The caller that changes the world notifies it, under the lock of the world."""

    def __init__(self, runtime: NodeRuntime, frame: str) -> None:
        """``frame`` is that of the map."""
        self._frame = frame
        self._doors = runtime.node.create_publisher(JointState, '~/doors', names.transient_local_qos())
        self._things = runtime.node.create_publisher(TFMessage, '~/things', names.transient_local_qos())
        self._told_doors: dict[str, float] | None = None
        self._told_things: dict[str, tuple[str, Pose]] | None = None

    def tell(self, world: World, stamp: Time) -> None:
        """Publish what has changed since the last call."""
        doors = {name: door.opening for name, door in world.doors.items()}
        if doors != self._told_doors:
            self._told_doors = doors
            message = JointState(name=list(doors), position=list(doors.values()))
            message.header.stamp = stamp
            self._doors.publish(message)
        things = {name: (self._frame, one.pose) for name, one in world.obstacles.items()}
        things |= {one.name: (robot, _IN_GRIPPER) for robot, one in world.held.items()}
        if things != self._told_things:
            self._told_things = things
            transforms = [transform(frame, name, pose, stamp) for name, (frame, pose) in things.items()]
            self._things.publish(TFMessage(transforms=transforms))
