# SPDX-License-Identifier: BSD-3-Clause
"""Motions, which drive the robot step by step, and the prediction of collisions, with slowing down before them. Pure:
the caller asks a motion for a velocity at each new pose.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_sim.world.plane.geometry import Pose, drive

LOOK_AHEAD: Final = 2.0
"""Time for which collisions are looked for ahead, s."""

LOOK_AHEAD_STEP: Final = 0.1
"""Time, s, from one collision check to the next, where that is less than a cell of driving, half a cell for a box."""


LATENCY: Final = 0.05
"""Time until a command takes effect, s: a period of a controller. Until then the previous command does."""

SIDE_GAP: Final = 0.03
SIDE_TIME: Final = 0.4
"""Minimum distance from a movable obstacle, m, and time for which it may come nearer unseen, s."""

SLOWEST: Final = 0.01
"""Speed, m/s, below which nothing that rests is approached: the robot would creep without end, and never arrive."""

PASSING: Final = 0.05
"""Speed, m/s, at which the robot passes what rests, however near the path leads to it."""

AWAY: Final = 0.25
"""Distance, m, by which a robot that is not a circle and turns moves away from everything near it, for each metre that
its corners swing."""

ESCAPE: Final = 0.5
"""Distance, m, by which the robot moves away from an obstacle that touches it, for each metre driven; it makes no other
motion. Cells are coarse: an obstacle that seems to be passed may be pushed."""

SAME_GAP: Final = 1e-6
"""Gaps, m, that differ by no more are the same: headings and distances are rounded."""

JUMP: Final = 0.1
"""Distance, m, beyond that driven which the robot moves from one step to the next if it has been relocalized: earlier
observations are then void."""

FASTEST: Final = 1.0
"""Maximum speed of an approaching obstacle, m/s: a faster one is not a moving body."""

COMPANY_TIME: Final = 3.0
"""Time since its last motion for which something counts as a moving person or robot, s."""

PERSONAL_SPACE: Final = 0.3
"""Distance that a robot keeps from a person or robot in its way, m, if it can move away."""


class Velocity(NamedTuple):
    """m/s and rad/s."""

    linear: float
    angular: float


STOP: Final = Velocity(0.0, 0.0)


class Motion(ABC):
    """Base of motions, which drive the robot on a costmap."""

    _costmap: Costmap

    @abstractmethod
    def step(self, pose: Pose, now: float) -> Velocity | None:
        """Return the velocity to drive with, or None when the motion is complete.

        Raises:
            NavigationError: it cannot go on.
        """

    def update(self, costmap: Costmap) -> None:
        """Continue on another costmap, after a change of the map."""
        self._costmap = costmap

    def limit_speed(self, limit: float) -> None:  # noqa: B027 - most motions have a speed of their own
        """Obey a limit of the speed, m/s, if the motion follows a path."""


@dataclass(frozen=True)
class Steering:
    """Minimum turning radius, m, 0 for a robot that turns in place; and whether the robot drives backward."""

    turning_radius: float = 0.0
    reverses: bool = True


@dataclass(frozen=True)
class TurnLimits:
    """Angular speeds of turns on the spot, rad/s, and their acceleration, rad/s²."""

    minimum: float = 0.1
    maximum: float = 1.0
    acceleration: float = 1.6

    def braking_with(self, acceleration: float) -> TurnLimits:
        """Return the limits for a robot that brakes no harder than this, rad/s²."""
        return replace(self, acceleration=min(self.acceleration, acceleration))

    def speed(self, remaining: float) -> float:
        """Return the turning speed, rad/s, from which the robot can still brake within this angle."""
        return min(self.maximum, max(self.minimum, math.sqrt(2.0 * self.acceleration * abs(remaining))))


@dataclass(frozen=True)
class Inertia:
    """Speeds of the robot, and its maximum accelerations, m/s² and rad/s²."""

    velocity: Velocity = STOP
    linear: float = math.inf
    angular: float = math.inf

    def after(self, command: Velocity, seconds: float) -> Inertia:
        """Return the inertia after the robot has followed this command for some time, s."""
        pairs = zip(self.velocity, command, (self.linear, self.angular), strict=True)
        changes = (max(-limit * seconds, min(limit * seconds, wanted - now)) for now, wanted, limit in pairs)
        linear, angular = map(sum, zip(self.velocity, changes, strict=True))
        return replace(self, velocity=Velocity(linear, angular))

    def poses(self, pose: Pose, command: Velocity, seconds: float, steps: int) -> Iterator[Pose]:
        """Yield the predicted poses under this command, in equal time steps."""
        inertia = self
        for _ in range(steps):
            then = inertia.after(command, seconds / steps)
            linear, angular = ((one + other) / 2.0 for one, other in zip(inertia.velocity, then.velocity, strict=True))
            inertia, pose = then, drive(pose, linear, angular, seconds / steps)
            yield pose


class CommandedDrive:
    """A model of a robot that executes its commands: each takes effect after LATENCY, with limited accelerations."""

    def __init__(self, inertia: Inertia) -> None:
        self._inertia = inertia
        self._before, self._now = STOP, -math.inf
        self.command: Velocity = STOP
        """The newest one; given after :meth:`advance`."""

    def advance(self, now: float) -> None:
        """Advance to a time, s."""
        passed = now - self._now
        self._inertia = self._inertia.after(self._before, min(passed, LATENCY))
        self._inertia = self._inertia.after(self.command, max(0.0, passed - LATENCY))
        self._before, self._now = self.command, now

    @property
    def is_at_rest(self) -> bool:
        """True if the robot is at rest."""
        return self._inertia.velocity == STOP

    def foreseen(self, pose: Pose) -> tuple[Pose, Inertia]:
        """Return the pose and inertia of the robot when the next command takes effect."""
        (coming,) = self._inertia.poses(pose, self._before, LATENCY, 1)
        return coming, self._inertia.after(self._before, LATENCY)


def collides(costmap: Costmap, pose: Pose, command: Velocity, seconds: float, inertia: Inertia | None = None) -> bool:
    """Return whether this command, held for some time, leads into an obstacle or off the map. Without ``inertia`` the
    command takes effect at once.

    If the robot already overlaps an obstacle, only a deeper overlap counts. A circular robot may always turn in place.
    """
    inflation = costmap.inflation
    inertia = inertia or Inertia(command)
    if command.linear == inertia.velocity.linear == 0.0 and not inflation.corners:
        return False
    world = costmap.world
    linear, angular = (max(map(abs, pair)) for pair in zip(command, inertia.velocity, strict=True))
    way = (linear + angular * (inflation.outer_radius if inflation.corners else 0.0)) * seconds
    if costmap.has_room(pose, inflation.outer_radius + way):
        return False
    looks = 2.0 if inflation.corners else 1.0  # in a cell: a corner would pass that of a cell between two looks
    steps = max(1, math.ceil(seconds / LOOK_AHEAD_STEP), math.ceil(looks * way / world.resolution))
    overlap: float | None = None
    for ahead in inertia.poses(pose, command, seconds, steps):
        if not world.contains(*world.cell(ahead.x, ahead.y)):
            return True
        before, overlap = overlap, costmap.overlap(ahead)
        if overlap > 0.0 and overlap > (costmap.overlap(pose) if before is None else before) + SAME_GAP:
            return True
    return False


class Sight(NamedTuple):
    """Gap, m, to the nearest obstacle seen, at a pose and a time, s."""

    time: float
    pose: Pose
    gap: float


class KeepingApart:
    """A limiter that keeps a moving robot apart from movable obstacles; ``top_speed`` is the robot's own, m/s.

    Look-ahead finds obstacles on the arc. This finds obstacles that approach from the side, between two scans.
    """

    def __init__(self, top_speed: float) -> None:
        self._top_speed = top_speed
        self._reach = SIDE_GAP + SIDE_TIME * (top_speed + FASTEST)
        self._sights: deque[Sight] = deque()
        self._here = math.inf
        self._pace = self._closing = 0.0
        self._seen_moving = -math.inf

    def look(self, costmap: Costmap, pose: Pose, now: float) -> None:
        """Record the gap at a pose and a time, s. Call it at each step, before the other methods."""
        sights, reach = self._sights, self._reach
        while sights and now - sights[0].time > SIDE_TIME + 1e-6:
            sights.popleft()
        if sights and pose.distance(sights[-1].pose) > JUMP + self._top_speed * (now - sights[-1].time):
            sights.clear()
        self._here = costmap.gap_seen(pose, reach)
        sights.append(Sight(now, pose, self._here))
        # Measure the gap from the previous pose: a change of it is not due to the robot's own motion.
        then = sights[0]
        there = costmap.gap_seen(then.pose, reach) if self._here < math.inf else then.gap
        nearer = min(reach, then.gap) - min(reach, there)
        change = min(FASTEST, max(0.0, abs(nearer) - costmap.world.resolution) / SIDE_TIME)
        if now - self._seen_moving > COMPANY_TIME:
            self._pace = 0.0
        if change > 0.0 and max(then.gap, there) < math.inf:  # a sudden change may be noise
            self._pace, self._seen_moving = max(change, self._pace), now
        self._closing = max(self._pace, change if nearer > 0.0 else 0.0)

    def has_company(self, now: float) -> bool:
        """Return whether something near has moved lately or touches the robot, which never goes that near by itself."""
        return self._here < 0.0 or now - self._seen_moving <= COMPANY_TIME

    def leaves(self, costmap: Costmap, pose: Pose, velocity: Velocity) -> bool:
        """Return whether a person or robot is in ``PERSONAL_SPACE``, and this command brings the robot no nearer."""
        swing = abs(velocity.angular) * costmap.inflation.outer_radius if costmap.inflation.corners else 0.0
        if self._here >= PERSONAL_SPACE:
            return False
        if swing > SLOWEST and self._here < SIDE_GAP + SIDE_TIME * (swing + self._closing):
            return False  # a corner would touch them before the next scan
        # Between two of them a circle would get away from one only to touch the other; a box may slide along one.
        escape = 0.0 if costmap.inflation.corners or self._here >= 0.0 else ESCAPE * abs(velocity.linear)
        return self._grows(costmap, pose, velocity, escape, (SIDE_TIME / 2.0, SIDE_TIME))

    def _grows(self, costmap: Costmap, pose: Pose, velocity: Velocity, speed: float, times: tuple[float, ...]) -> bool:
        """Return whether the gap grows by this much per second, at these times."""
        gaps = (costmap.gap_seen(drive(pose, *velocity, time), self._reach) for time in times)
        return all(gap >= self._here + speed * time - SAME_GAP for gap, time in zip(gaps, times, strict=True))

    def limited(self, costmap: Costmap, pose: Pose, velocity: Velocity) -> Velocity | None:
        """Return the command, slowed down on the same arc if it leads nearer to a movable obstacle. Return None if the
        robot would go slower than ``SLOWEST``.

        For an obstacle that has moved lately the robot stops earlier, by the distance that it may move while the robot
        brakes, and waits. The robot passes static obstacles slowly, as near as the path leads.
        """
        inflation = costmap.inflation
        here, closing = self._here, self._closing
        swing = abs(velocity.angular) * inflation.outer_radius if inflation.corners else 0.0
        speed = abs(velocity.linear) + swing
        if speed == 0.0 or here >= SIDE_GAP + SIDE_TIME * (speed + closing):
            return velocity
        if here < 0.0 and swing > SLOWEST:
            return None  # a body that touches it may follow, and be hit by another corner
        escape = max(closing, ESCAPE * speed if here < 0.0 else AWAY * swing)
        # Moving away must last longer: after one corner has swung away, the next one approaches.
        times = (SIDE_TIME / 2.0, SIDE_TIME) if closing or here < 0.0 else (SIDE_TIME / 2.0,)
        if self._grows(costmap, pose, velocity, escape, times):
            return velocity
        allowed = (here - SIDE_GAP) / SIDE_TIME - closing
        is_at_rest = not closing and here >= 0.0
        if is_at_rest and self._grows(costmap, pose, velocity, escape - AWAY * abs(velocity.linear), times):
            allowed = max(PASSING, here / SIDE_TIME)  # the path may pass a static obstacle as near as it fits
        if allowed >= min(SLOWEST, speed):
            share = min(1.0, allowed / speed)
            return Velocity(velocity.linear * share, velocity.angular * share)
        return STOP if closing > 0.0 else None


# Slows a robot down before it collides, whatever commands it: the approach model of Nav2's collision monitor.


def slowed(costmap: Costmap, pose: Pose, command: Velocity, seconds: float) -> Velocity:
    """Return a command, scaled by the ratio of the time until a collision to the look-ahead time, s.

    It becomes zero if the robot collides within the first tenth of a second.
    """
    steps = max(2, round(seconds / LOOK_AHEAD_STEP))
    # A collision within some time is a collision within any longer one.
    free = bisect_left(range(1, steps), True, key=lambda step: collides(costmap, pose, command, step * LOOK_AHEAD_STEP))
    scale = (free + 1) / steps if free else 0.0
    return Velocity(command.linear * scale, command.angular * scale)
