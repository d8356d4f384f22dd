# SPDX-License-Identifier: BSD-3-Clause
"""A robot as URDF (https://wiki.ros.org/urdf/XML), for displays: its outline, its lidar and the frames of both."""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from flexbt_sim.world import Circle, Pose, RobotModel

HEIGHT = 0.15
"""Drawn height of a robot, m: the world is flat."""

LIDAR_SIZE = (0.04, 0.04)
"""Radius and height of the drawn lidar, m."""


def robot_description(name: str, model: RobotModel, base_frame: str, footprint_frame: str, scan_frame: str) -> str:
    """The URDF of a robot.

    The frame of the footprint is that of the base on the ground, which is the same in a flat world; Nav2's robots have
    both. A footprint that is no circle is drawn as a wall along its sides.
    """
    robot = Element('robot', name=name)
    base = SubElement(robot, 'link', name=base_frame)
    if isinstance(model.footprint, Circle):
        _visual(base, Pose(0.0, 0.0, 0.0), 'cylinder', radius=f'{model.footprint.radius:g}', length=f'{HEIGHT:g}')
    else:
        for x0, y0, x1, y1 in model.footprint.sides(Pose(0.0, 0.0, 0.0)):
            middle = Pose((x0 + x1) / 2.0, (y0 + y1) / 2.0, math.atan2(y1 - y0, x1 - x0))
            _visual(base, middle, 'box', size=f'{math.hypot(x1 - x0, y1 - y0):g} 0.02 {HEIGHT:g}')
    _link(robot, footprint_frame, base_frame, Pose(0.0, 0.0, 0.0))
    if model.lidar is not None:
        lidar = _link(robot, scan_frame, base_frame, model.lidar.pose)
        radius, height = LIDAR_SIZE
        _visual(lidar, Pose(0.0, 0.0, 0.0), 'cylinder', radius=f'{radius:g}', length=f'{height:g}')
    indent(robot)
    return tostring(robot, encoding='unicode', xml_declaration=True)


def _link(robot: Element, frame: str, parent: str, pose: Pose) -> Element:
    """A link that is fixed to another one."""
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
