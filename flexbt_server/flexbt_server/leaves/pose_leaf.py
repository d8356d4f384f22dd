# SPDX-License-Identifier: BSD-3-Clause
"""What leaves about poses, paths and goals have in common: what is not known is no error, they fail with the reason."""

from __future__ import annotations

from abc import abstractmethod

from geometry_msgs.msg import PoseStamped

from flexbt_common.errors import TransformError
from flexbt_core.behavior_tree import NodeStatus, PortError
from flexbt_core.behavior_tree.engine import LeafNode

from .leaf_services import LeafServices
from .robot_frames import RobotFrames


class PoseLeaf(LeafNode):
    """A leaf that fails while an input is not on the blackboard, and while a transform is not known.

    To be named before the base SyncAction or Condition.
    """

    __slots__ = ('_is_informed',)

    @abstractmethod
    def evaluate(self) -> NodeStatus:
        """The tick. May raise PortError and TransformError."""

    @property
    def is_informed(self) -> bool:
        return self._is_informed

    def tick(self) -> NodeStatus:
        self._is_informed = True
        try:
            return self.evaluate()
        except PortError as error:
            return self.fail(str(error))
        except TransformError as error:
            self._is_informed = False
            return self.fail(f'no pose is known there: {error}')

    @property
    def frames(self) -> RobotFrames:
        """Where the robot is, and poses in other frames."""
        services: LeafServices = self.services
        return services.frames

    def robot_pose(self, frame: str | None = None) -> PoseStamped:
        """Where the robot is, by the ports ``robot_base_frame`` and, unless a frame is given, ``global_frame``.

        Raises:
            TransformError: it is not known.
        """
        if frame is None:
            frame = str(self.get_input_or('global_frame', ''))
        return self.frames.robot_pose(frame, str(self.get_input_or('robot_base_frame', '')))
