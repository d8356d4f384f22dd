# SPDX-License-Identifier: BSD-3-Clause
"""Detect a robot that moves although its run is paused with nothing active, or was stopped."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from .records import ExecutiveSnapshot, ExecutiveState, FramedPose

BRAKING_SECONDS: Final = 3.0
"""Time within which a robot that is to stop may still move, s on the clock of the executive."""

MOVED_METRES: Final = 0.1
TURNED_RADIANS: Final = 0.2
"""Bounds of motion from the place where the robot should stand, above which it is reported."""

NOISE_METRES: Final = 0.01
NOISE_RADIANS: Final = 0.02
"""Bounds of the differences between poses of a robot that stands still, however many there are."""

CALM_SECONDS: Final = 5.0
"""Time after which a robot that stands still again no longer raises an alarm, s."""


@dataclass(frozen=True, slots=True)
class UnexpectedMotion:
    """A motion of a robot that should stand still, in m and rad; ``why`` is the reason why it should."""

    why: str
    metres: float
    radians: float


class UnexpectedMotionDetector:
    """A detector that watches one robot through its snapshots."""

    def __init__(self) -> None:
        self._should_since: float | None = None
        self._anchor: FramedPose | None = None
        self._stood: FramedPose | None = None
        self._moved_at = 0.0
        self.motion: UnexpectedMotion | None = None

    def receive(self, snapshot: ExecutiveSnapshot) -> None:
        """Process a snapshot that is newer than those before."""
        why, pose, now = why_at_rest(snapshot), snapshot.robot_pose, snapshot.stamp
        if not why or (self._should_since is not None and now < self._should_since):
            self._should_since = self._anchor = self.motion = None
            return
        if pose is None:  # it may go on moving; where it is found again is where it should stand
            self._anchor = None
            return
        if self._should_since is None:
            self._should_since = now
        if self._anchor is None or self._anchor.frame != pose.frame or now - self._should_since < BRAKING_SECONDS:
            self._anchor, self._stood, self._moved_at = pose, pose, now
            return
        if self._stood is None or _differ(self._stood, pose, NOISE_METRES, NOISE_RADIANS):
            self._stood, self._moved_at = pose, now  # not from one status to the next: they may be as near as one likes
        if _differ(self._anchor, pose, MOVED_METRES, TURNED_RADIANS):
            self.motion = UnexpectedMotion(why, _metres(self._anchor, pose), _radians(self._anchor, pose))
        if self.motion is not None and now - self._moved_at >= CALM_SECONDS:
            self._anchor, self.motion = pose, None


def why_at_rest(snapshot: ExecutiveSnapshot) -> str:
    """Return why the robot should stand still; '' if it may move."""
    if snapshot.state is ExecutiveState.PAUSED:
        stands = all(state.paused and not state.not_paused for state in snapshot.active_states)
        return 'the run is paused' if stands else ''
    if snapshot.state is ExecutiveState.STOPPING:
        return 'the run is stopped'
    is_stopped = snapshot.state is ExecutiveState.IDLE and snapshot.outcome == 'preempted'
    return 'the run was stopped' if is_stopped else ''


def _metres(a: FramedPose, b: FramedPose) -> float:
    return math.dist((a.x, a.y), (b.x, b.y))


def _radians(a: FramedPose, b: FramedPose) -> float:
    return abs(math.remainder(a.yaw - b.yaw, math.tau))


def _differ(a: FramedPose, b: FramedPose, metres: float, radians: float) -> bool:
    return _metres(a, b) > metres or _radians(a, b) > radians
