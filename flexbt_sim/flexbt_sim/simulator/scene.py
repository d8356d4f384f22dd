# SPDX-License-Identifier: BSD-3-Clause
"""What somebody who looks at the world would see of doors and things, as latched topics, told when it changes.

``simulator/doors`` (JointState) has the doors by name, position 0 (closed) to 1 (open); ``simulator/things``
(TFMessage) the poses of the obstacles: in the map, or, of one in a gripper, in the robot of this name. So one message
tells where a thing is and who holds it.
"""

from __future__ import annotations

from typing import Final

from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime
from flexbt_sim.ros_messages import transform
from flexbt_sim.world import Pose, World

_IN_GRIPPER: Final = Pose(0.0, 0.0, 0.0)


class Scene:
    """Told of the world by whoever changes it, under its lock."""

    def __init__(self, runtime: NodeRuntime, frame: str) -> None:
        """``frame`` is that of the map."""
        self._frame = frame
        self._doors = runtime.node.create_publisher(JointState, '~/doors', names.latched())
        self._things = runtime.node.create_publisher(TFMessage, '~/things', names.latched())
        self._told_doors: dict[str, float] | None = None
        self._told_things: dict[str, tuple[str, Pose]] | None = None

    def tell(self, world: World, stamp: Time) -> None:
        """Say what is not as it was said before."""
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
