# SPDX-License-Identifier: BSD-3-Clause
"""A listener to ``tf`` and ``tf_static`` of a robot, for nodes that need frames other than the map's.

Most goals are in the frame of the map, and transforms arrive often, so a node starts to listen when it first needs
another frame, and waits for the transform up to its timeout. A node that needs frames at the stamps of its first
requests creates the listener at its start. While nothing waits, messages stay in the middleware for some tenths of a
second (node_executor.py).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

from geometry_msgs.msg import Pose, PoseStamped
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.limits import MESSAGE, check_limits
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.errors import FlexbtError

from . import names
from .errors import TransformError
from .transform_buffer import Rigid, TransformBuffer

TRANSFORM_TIMEOUT: Final = 1.0
"""Default time to wait for a transform, s of wall time: a new listener knows none yet."""

TRANSFORM_QUEUE: Final = 100
REST_SECONDS: Final = 0.1
"""Minimum time between two reads of the queue while nothing waits, s: it holds a thousand messages a second."""

BROADCASTERS: Final = 100
"""Maximum number of static broadcasters whose messages a late listener gets."""

OnPose = Callable[[PoseStamped], object]
OnTransform = Callable[[Rigid], object]
OnError = Callable[[TransformError], object]


class TransformListener:
    """The transforms of the robot in whose namespace the node is. On the executor thread."""

    def __init__(self, runtime: Runtime) -> None:
        self._buffer = TransformBuffer()
        self._runtime = runtime
        self._waiting: list[Callable[[bool], bool]] = []
        self._heard_at = 0.0
        node = runtime.node
        self._messages = [
            ReceivedMessages(
                node,
                TFMessage,
                topic,
                qos,
                partial(self._on_message, is_static=is_static),
                MESSAGE,
                is_awaited=self._is_awaited,
            )
            for topic, qos, is_static in (
                (names.TF_STATIC, names.transient_local_qos(BROADCASTERS), True),
                (names.TF, QoSProfile(depth=TRANSFORM_QUEUE), False),
            )
        ]
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
        # Keep the handle: rclpy reports jumps only as long as it exists.
        self._jumps = node.get_clock().create_jump_callback(
            threshold, post_callback=lambda _jump: runtime.post(lambda: self.buffer.clear())
        )

    @property
    def buffer(self) -> TransformBuffer:
        """Buffer with the transforms known by now."""
        self._take()
        return self._buffer

    @classmethod
    def of(cls, runtime: Runtime) -> TransformListener:
        """Return the listener of a node. The first call creates it."""
        return runtime.once('transform listener', cls)

    def transform_pose(
        self,
        pose: PoseStamped,
        target: str,
        on_pose: OnPose,
        on_error: OnError,
        timeout: float = TRANSFORM_TIMEOUT,
    ) -> None:
        """Transform ``pose`` to the frame ``target``, at the time of its header or, if that is 0, the latest.

        See :meth:`lookup`.
        """

        def on_transform(transform: Rigid) -> None:
            there = PoseStamped(pose=transformed(pose.pose, transform))
            there.header.frame_id, there.header.stamp = target, pose.header.stamp
            on_pose(there)

        self.lookup(
            target, pose.header.frame_id, seconds_of(pose.header.stamp) or None, on_transform, on_error, timeout
        )

    def lookup(
        self,
        target: str,
        source: str,
        time: float | None,
        on_transform: OnTransform,
        on_error: OnError,
        timeout: float = TRANSFORM_TIMEOUT,
    ) -> None:
        """Look up the transform of the frame ``source`` in ``target`` at a time, s; None for the latest.

        ``on_transform`` or ``on_error`` is called once: immediately, when the transform is known, or after ``timeout``
        seconds of wall time.
        """

        def attempt(is_last: bool) -> bool:
            try:
                transform = self._buffer.lookup(target, source, time)
            except TransformError as error:
                if error.is_early and not is_last:
                    return False
                on_error(error)
                return True
            on_transform(transform)
            return True

        self._take()
        if attempt(timeout <= 0.0):
            return
        self._waiting.append(attempt)
        self._runtime.post_in(timeout, lambda: self._end(attempt))

    def _is_awaited(self) -> bool:
        return bool(self._waiting) or self._runtime.steady.now() - self._heard_at >= REST_SECONDS

    def _take(self) -> None:
        for messages in self._messages:
            messages.take()

    def _end(self, attempt: Callable[[bool], bool]) -> None:
        self._take()
        if attempt in self._waiting:
            self._waiting.remove(attempt)
            attempt(True)

    def _on_message(self, received: Received, is_static: bool) -> None:
        self._heard_at = self._runtime.steady.now()
        try:
            message = received.unpack(TFMessage)
            check_limits(message)
            take_transforms(self._buffer, message, is_static=is_static)
        except (FlexbtError, ValueError) as error:
            self._runtime.node.get_logger().error(f'ignored: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
        for attempt in list(self._waiting):
            if attempt in self._waiting:
                self._waiting.remove(attempt)  # before the call, which may request transforms and so process messages
                if not attempt(False):
                    self._waiting.append(attempt)


def take_transforms(buffer: TransformBuffer, message: Any, *, is_static: bool) -> None:
    """Add the valid transforms of a tf2_msgs/TFMessage to a buffer.

    Raises:
        TransformError: the first one that is not valid. The others were added, as by tf2.
    """
    invalid: TransformError | None = None
    for stamped in message.transforms:
        parent, frame, stamp = stamped.header.frame_id, stamped.child_frame_id, stamped.header.stamp
        try:
            buffer.set(parent, frame, _rigid_of(stamped.transform), seconds_of(stamp), is_static=is_static)
        except TransformError as error:
            invalid = invalid or error
    if invalid is not None:
        raise invalid


def transformed(pose: Pose, transform: Rigid) -> Pose:
    """Return a geometry_msgs/Pose, transformed by ``transform``. A quaternion of zeros counts as no rotation."""
    at, turned = pose.position, pose.orientation
    local = Rigid.of((at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w))
    (x, y, z), rotation = transform @ local
    result = Pose()
    result.position.x, result.position.y, result.position.z = x, y, z
    turned = result.orientation
    turned.x, turned.y, turned.z, turned.w = rotation
    return result


def _rigid_of(message: Any) -> Rigid:
    """Return a geometry_msgs/Transform as plain numbers."""
    at, turned = message.translation, message.rotation
    return Rigid((at.x, at.y, at.z), (turned.x, turned.y, turned.z, turned.w))
