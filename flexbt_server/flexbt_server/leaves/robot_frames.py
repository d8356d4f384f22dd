# SPDX-License-Identifier: BSD-3-Clause
"""Where the robot is, and poses in other frames, for the leaves of a server."""

from __future__ import annotations

import queue
from typing import Final

from geometry_msgs.msg import PoseStamped

from flexbt_common.errors import TransformError
from flexbt_common.runtime import CALL_SECONDS, NodeRuntime
from flexbt_common.transforms import TransformListener

from .topic_cache import TopicCache

FIRST_TIMEOUT: Final = 0.5
TRANSFORM_TOLERANCE: Final = 0.1
"""How long a leaf waits for a transform, s of wall time: as in Nav2, but the first one of a server, since the node
begins to hear tf then. It must not be so long that the thread of the tree counts as one that hangs."""


class RobotFrames:
    """The pose of the robot, by the topic of the pose or by tf, and poses in other frames, by tf. From any thread.

    ``global_frame`` and ``robot_base_frame`` are those that are meant where a node names none.
    """

    def __init__(self, runtime: NodeRuntime, pose: TopicCache, global_frame: str, robot_base_frame: str) -> None:
        self._runtime = runtime
        self._pose = pose
        self._timeout = FIRST_TIMEOUT
        self.global_frame = global_frame
        self.robot_base_frame = robot_base_frame

    def robot_pose(self, frame: str = '', base: str = '') -> PoseStamped:
        """Where the frame ``base`` of the robot is in ``frame``.

        The topic of the pose tells it of the robot's base, also in other frames as far as tf knows them; where nothing
        was published there, and for other frames of the robot, tf does.

        Raises:
            TransformError: it is not known.
        """
        base = base or self.robot_base_frame
        pose = self._pose.latest if base == self.robot_base_frame else None
        if pose is None:
            pose = PoseStamped()
            pose.header.frame_id = base
            pose.pose.orientation.w = 1.0
            try:
                return self.pose_in(pose, frame or self.global_frame)
            except TransformError as error:
                if base != self.robot_base_frame:
                    raise
                raise TransformError(self._pose.without_message(str(error))) from None
        return self.pose_in(pose, frame or self.global_frame)

    def pose_in(self, pose: PoseStamped, frame: str) -> PoseStamped:
        """``pose`` in ``frame``. One without a frame is in the global frame.

        Raises:
            TransformError: no transform between the frames is known, now or in a moment.
        """
        source = pose.header.frame_id or self.global_frame
        if source == frame:
            return pose
        asked = PoseStamped(pose=pose.pose)
        asked.header.frame_id = source  # without a stamp: by the newest transforms, as Nav2 asks for them
        answers: queue.SimpleQueue[PoseStamped | TransformError] = queue.SimpleQueue()
        timeout = self._timeout
        self._runtime.post(
            lambda: TransformListener.of(self._runtime).transform_pose(asked, frame, answers.put, answers.put, timeout)
        )
        try:
            answer = answers.get(timeout=timeout + CALL_SECONDS)
        except queue.Empty:
            raise TransformError(f'the node did not look for the transform of {source!r} to {frame!r}') from None
        self._timeout = TRANSFORM_TOLERANCE
        if isinstance(answer, TransformError):
            raise answer
        answer.header.stamp = pose.header.stamp
        return answer
