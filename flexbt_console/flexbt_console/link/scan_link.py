# SPDX-License-Identifier: BSD-3-Clause
"""The link that feeds a mirror with the points of a lidar scan, in the frame of the map.

Scans and transforms arrive many times a second, but a screen rarely shows a new scan. So this link leaves them in the
middleware, except from the time at which a scan is due until the place of one is known.

Even so, each message wakes the middleware, and most messages of an idle robot are transforms. While these have no
subscribers, the simulator publishes none, and publishes the time less often. So this link subscribes to transforms only
until the robot stands still, and again when its status has another pose or the scan changes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from flexbt_common import names
from flexbt_common.errors import TransformError
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.transform_buffer import Rigid, TransformBuffer
from flexbt_common.transform_listener import BROADCASTERS, take_transforms
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import seconds_of
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import FramedPose, Points
from flexbt_core.clock.clock import Clock
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import one_line

from .messages import FARTHEST, is_length

MOST_BEAMS: Final = 720
"""Maximum number of beams of a scan that are kept, evenly spaced."""

SCAN_SECONDS: Final = 3.0
"""Minimum age at which a scan is no longer shown, s. It must also be older than three periods, and the next one
overdue."""

SAME_RANGE: Final = 0.1
"""Difference of a beam that counts as noise, m."""

SAME_POSE: Final = 0.02
"""Difference of a pose that counts as no motion: m for positions; for rotations, rad or a component."""

SAME_SHARE: Final = 0.02
"""Share of beams that may differ more, because a beam at an edge hits either side of it."""

PLACE_SECONDS: Final = 2.0
"""Time after which a pose that is not found is reported as missing, s."""

STAND_SECONDS: Final = 5.0
"""Time for which robot and scan must be unchanged before transforms are no longer subscribed to, s."""

TOLERANCE: Final = 0.2
"""Tolerance of the time of the next look, as a part of the time until then; the executor need not wake for it."""

TF_DEPTH: Final = 10
"""Queue depth of transforms. A scan was taken between two of them."""

MESSAGE_BYTES: Final = 2_000_000
REPORT_SECONDS: Final = 10.0
REPORT_CHARACTERS: Final = 500

_NOTHING: Final = -1.0
"""The range of a beam that met nothing."""


class _Shown(NamedTuple):
    ranges: list[float]
    where: Rigid
    points: Points


class _Stand:
    """A measurement of the time for which a robot has been at the same pose, from its statuses."""

    def __init__(self, mirror: Mirror, clock: Clock) -> None:
        self._mirror = mirror
        self._clock = clock
        self._pose: FramedPose | None = None
        self._since = 0.0

    def start_over(self) -> None:
        """Note that the robot may have moved."""
        self._pose = None

    def seconds(self) -> float:
        """Return the time since the first call at the current pose, s; 0.0 for that call, or if no pose is known."""
        now = self._clock.now()
        if not self._is_there():
            self._pose, self._since = self._told(), now
        return now - self._since

    def is_over(self) -> bool:
        """Return whether the robot stood still, but is no longer known to be at that pose."""
        return self._pose is not None and not self._is_there()

    def _is_there(self) -> bool:
        pose = self._told()
        return pose is not None and self._pose is not None and _is_near(pose, self._pose)

    def _told(self) -> FramedPose | None:
        view = self._mirror.view()
        return view.snapshot.robot_pose if view.live and view.snapshot is not None else None


class ScanLink:
    """A link that feeds a mirror with a scan every ``period`` seconds. Executor thread only.

    The period is twice as long while the scan stays the same, and four times as long while no behavior runs and the
    robot stands.

    ``map_frame`` returns the frame of the map.
    """

    def __init__(
        self, runtime: NodeRuntime, mirror: Mirror, namespace: str, period: float, map_frame: Callable[[], str]
    ) -> None:
        from sensor_msgs.msg import LaserScan  # only needed by a screen
        from tf2_msgs.msg import TFMessage

        self._types = LaserScan, TFMessage
        self._runtime = runtime
        self._mirror = mirror
        self._namespace = namespace
        self._period = period
        self._map_frame = map_frame
        self._frames = TransformBuffer()
        self._looked_at = -math.inf
        self._scan: Any = None
        self._expires_at = math.inf
        self._shown: _Shown | None = None
        self._is_same = False
        self._stand = _Stand(mirror, runtime.steady)
        self._topic = names.of_robot(namespace, names.SCAN)
        fixed = functools.partial(self._on_transforms, is_static=True)
        self._subscriptions = [
            self._subscribe(TFMessage, names.TF_STATIC, names.transient_local_qos(BROADCASTERS), fixed),
            self._subscribe(LaserScan, names.SCAN, names.best_effort_qos(1), self._on_scan, self._is_due),
        ]
        self._moving: Subscription | None = None
        self._hear_transforms()

    def close(self) -> None:
        """Stop listening."""
        self._ignore_transforms()
        for subscription in self._subscriptions:
            self._runtime.node.destroy_subscription(subscription)

    def _subscribe(
        self,
        type: Any,
        topic: str,
        qos: QoSProfile,
        receive: Callable[[Received], object],
        is_awaited: Callable[[], bool] | None = None,
    ) -> Subscription:
        node, name = self._runtime.node, names.of_robot(self._namespace, topic)
        return ReceivedMessages(node, type, name, qos, receive, MESSAGE_BYTES, is_awaited=is_awaited).subscription

    def _hear_transforms(self) -> None:
        if self._moving is None:
            qos, receive = names.best_effort_qos(TF_DEPTH), functools.partial(self._on_transforms, is_static=False)
            self._moving = self._subscribe(self._types[1], names.TF, qos, receive, lambda: self._scan is not None)

    def _ignore_transforms(self) -> None:
        if self._moving is not None:
            self._runtime.node.destroy_subscription(self._moving)
            self._moving = None

    def _on_transforms(self, received: Received, *, is_static: bool) -> None:
        if not is_static and self._scan is None:
            return
        try:
            message = received.unpack(self._types[1])
            check_limits(message)
            take_transforms(self._frames, message, is_static=is_static)
        except (ValueError, FlexbtError) as error:
            self._tell(f'transforms are ignored: {error}')
        self._place()

    def _is_due(self) -> bool:
        """Return whether the next scan is due."""
        return self._runtime.steady.now() >= self._looked_at + (1.0 - TOLERANCE) * self._pause

    @property
    def _pause(self) -> float:
        """Time from the last check to the next, s."""
        if not self._is_same or self._stand.is_over():
            return self._period
        return self._period * (2.0 if self._mirror.view().running else 4.0)

    def _on_scan(self, received: Received) -> None:
        if not self._is_due():
            return
        if self._scan is None:
            try:
                scan = received.unpack(self._types[0])
                check_limits(scan)
            except (ValueError, FlexbtError) as error:
                self._tell(f'ignored: {error}')
                return
            if self._moving is None:
                shown = self._shown
                if shown is not None and self._stand.seconds() > 0.0 and _is_same(shown.ranges, _ranges(scan)):
                    self._show(shown)
                    return
                self._hear_transforms()
            self._scan = scan
            self._expires_at = min(self._expires_at, self._runtime.steady.now() + PLACE_SECONDS)
        self._place()

    def _place(self) -> None:
        """Show the scan if the pose at which it was taken is known; else wait for more transforms or another scan."""
        if self._scan is None:
            return
        scan, now = self._scan, self._runtime.steady.now()
        try:
            where = self._frames.lookup(self._map_frame(), scan.header.frame_id, seconds_of(scan.header.stamp))
            ranges, shown = _ranges(scan), self._shown
            self._is_same = False
            if shown is not None and _is_same_place(shown.where, where):
                self._is_same = _is_same(shown.ranges, ranges)
            if shown is None or not self._is_same:
                shown = self._shown = _Shown(ranges, where, points_of(scan, where))
                self._stand.start_over()
        except (TransformError, ValueError) as error:
            if now < self._expires_at:
                if not (isinstance(error, TransformError) and error.is_early):
                    self._scan = None  # another one may have its place
                return
            self._tell(f'the scan has no place on the map: {error}')
            self._is_same = False
            self._rest()
            return
        if self._stand.seconds() >= STAND_SECONDS:
            self._runtime.post(self._ignore_transforms)
        self._show(shown)

    def _show(self, shown: _Shown) -> None:
        held = max(SCAN_SECONDS, 3.0 * self._period, (1.0 + TOLERANCE) * self._pause + self._period)
        self._mirror.receive_scan(shown.points, held)
        self._rest()

    def _rest(self) -> None:
        self._scan, self._expires_at = None, math.inf
        self._frames.clear()
        self._looked_at = self._runtime.steady.now()
        self._runtime.call_near(self._looked_at + self._pause, TOLERANCE * self._pause, lambda: None)

    def _tell(self, text: str) -> None:
        log = self._runtime.node.get_logger()
        log.error(f'{self._topic}: {one_line(text, REPORT_CHARACTERS)}', throttle_duration_sec=REPORT_SECONDS)


def points_of(scan: Any, where: Rigid) -> Points:
    """Return the points (x, y) that the beams of a scan hit, in m; ``where`` is the pose of the lidar.

    Raises ValueError for an invalid scan or pose.
    """
    angles = scan.angle_min, scan.angle_increment * _step(scan)
    if not all(map(math.isfinite, angles)) or not all(map(is_length, where.translation)):
        raise ValueError(f'angles of {angles[0]:g} and {angles[1]:g} rad, taken at {where.translation}')
    x, y, _ = where.translation
    ahead, left = (_less(where.apply(axis), where.translation) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    points = []
    for number, one in enumerate(_ranges(scan)):
        if one != _NOTHING:
            angle = angles[0] + number * angles[1]
            along, across = one * math.cos(angle), one * math.sin(angle)
            points.append((x + along * ahead[0] + across * left[0], y + along * ahead[1] + across * left[1]))
    return tuple(points)


def _ranges(scan: Any) -> list[float]:
    """Return the ranges of the kept beams, m; _NOTHING for a beam without a valid range."""
    low, high = max(0.0, scan.range_min), min(scan.range_max, FARTHEST)
    return [one if low <= one < high else _NOTHING for one in scan.ranges[:: _step(scan)]]


def _step(scan: Any) -> int:
    return -(-len(scan.ranges) // MOST_BEAMS) or 1


def _less(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(one - other for one, other in zip(a, b, strict=True))


def _is_same(before: list[float], now: list[float]) -> bool:
    """Return whether the lidar sees the same as before, within its noise."""
    different = sum(abs(one - other) > SAME_RANGE for one, other in zip(before, now, strict=False))
    return len(before) == len(now) and different <= SAME_SHARE * len(now)


def _is_same_place(there: Rigid, here: Rigid) -> bool:
    moved = (*_less(there.translation, here.translation), *_less(there.rotation, here.rotation))
    return all(abs(one) <= SAME_POSE for one in moved)


def _is_near(pose: FramedPose, other: FramedPose) -> bool:
    turned = math.remainder(pose.yaw - other.yaw, math.tau)
    return pose.frame == other.frame and math.dist((pose.x, pose.y, turned), (other.x, other.y, 0.0)) <= SAME_POSE
