# SPDX-License-Identifier: BSD-3-Clause
"""Path following by regulated pure pursuit, with a goal checker and a progress checker, along a path as a line: its
points by their distance from the beginning.

The rules are those of Nav2's regulated pure pursuit controller, with speeds that fit a TurtleBot3.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import accumulate, chain, pairwise
from typing import Final, NamedTuple

import numpy

from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.models import DriveModel
from flexbt_sim.world.plane.geometry import Pose, compose, drive, wrap

from .motions import (
    LATENCY,
    PERSONAL_SPACE,
    STOP,
    CommandedDrive,
    Inertia,
    KeepingApart,
    Motion,
    Steering,
    TurnLimits,
    Velocity,
    collides,
)

Point = tuple[float, float]
"""x and y, m."""


SAME_PLACE: Final = 1e-3
SAME_HEADING: Final = 0.02
"""Differences, m and rad, that poses of a path may have from how it is driven: others may have rounded them."""


class Track:
    """A polyline through the positions of poses, at any spacing. ``length`` in m."""

    def __init__(self, poses: Sequence[Pose]) -> None:
        """``poses`` has at least one."""
        self._corners: list[Point] = [(float(pose.x), float(pose.y)) for pose in poses]
        self._at = list(accumulate((math.dist(a, b) for a, b in pairwise(self._corners)), initial=0.0))
        self.length = self._at[-1]

    def moved(self, by: Pose) -> Track:
        """Return the track moved with its frame, which was the map frame and is now at ``by``."""
        moved = copy(self)
        cos, sin = math.cos(by.yaw), math.sin(by.yaw)  # once: it moves at each step of the robot
        moved._corners = [(by.x + x * cos - y * sin, by.y + x * sin + y * cos) for x, y in self._corners]
        return moved

    def point(self, at: float) -> Point:
        """Position at a distance from the beginning, m."""
        after = bisect_left(self._at, at)
        if after == 0:
            return self._corners[0]
        if after == len(self._at):
            return self._corners[-1]
        (x, y), (to_x, to_y) = self._corners[after - 1], self._corners[after]
        share = (at - self._at[after - 1]) / (self._at[after] - self._at[after - 1])
        return x + share * (to_x - x), y + share * (to_y - y)

    def index(self, at: float) -> int:
        """Index of the last pose that is not beyond a distance from the beginning, m."""
        return max(0, bisect_right(self._at, at) - 1)

    def heading(self, at: float) -> float:
        """Return the direction at a distance from the beginning, rad; 0 for a track without length."""
        index = min(max(bisect_right(self._at, at), 1), len(self._at) - 1)
        while index > 1 and self._at[index] == self._at[index - 1]:
            index -= 1
        (x, y), (to_x, to_y) = self._corners[index - 1], self._corners[index]
        return math.atan2(to_y - y, to_x - x)

    def nearest(self, pose: Pose, begin: float, end: float) -> float:
        """Return the distance from the beginning, between two bounds, at which the track is nearest to a position."""
        best, least = begin, math.dist(self.point(begin), pose[:2])
        for (at, (x, y)), (next_at, (to_x, to_y)) in pairwise(self._part(begin, end)):
            dx, dy = to_x - x, to_y - y
            square = dx * dx + dy * dy
            if square > 0.0:
                share = min(1.0, max(0.0, ((pose.x - x) * dx + (pose.y - y) * dy) / square))
                gap = math.hypot(x + share * dx - pose.x, y + share * dy - pose.y)
                if gap < least:
                    best, least = at + share * (next_at - at), gap
        return best

    def ahead(self, pose: Pose, begin: float, reach: float) -> Point:
        """Return the first point after a distance from the beginning that is ``reach`` away from a position, or the
        end."""
        x, y = self.point(begin)
        gap = math.hypot(x - pose.x, y - pose.y)
        for _, (to_x, to_y) in self._part(begin, self.length):
            next_gap = math.hypot(to_x - pose.x, to_y - pose.y)
            if next_gap >= reach:
                dx, dy = to_x - x, to_y - y
                square = dx * dx + dy * dy
                if square == 0.0:
                    return to_x, to_y
                # The intersection of a circle around the position with the line that leaves it.
                half = (dx * (x - pose.x) + dy * (y - pose.y)) / square
                share = -half + math.sqrt(max(0.0, half * half + (reach * reach - gap * gap) / square))
                return x + share * dx, y + share * dy
            x, y, gap = to_x, to_y, next_gap
        return self._corners[-1]

    def _part(self, begin: float, end: float) -> Iterator[tuple[float, Point]]:
        """Yield the track between two distances from its beginning: distances and positions of its ends and corners."""
        yield begin, self.point(begin)
        last = min(end, self.length)
        for index in range(bisect_right(self._at, begin), len(self._at)):
            if self._at[index] >= last:
                break
            yield self._at[index], self._corners[index]
        yield last, self.point(last)


@dataclass(frozen=True)
class Leg:
    """A part of a path to drive in one direction."""

    track: Track
    backward: bool = False


def drivable_legs(path: Sequence[Pose], turning_radius: float) -> list[Leg]:
    """Return the parts of a path between changes of direction; none where a robot cannot drive it as its poses say:
    where it would have to turn on the spot, or bend more than the radius, m, allows.
    """
    corners: list[list[Pose]] = []
    backward: list[bool] = []
    for a, b in pairwise(path):
        length, turned = a.distance(b), abs(wrap(b.yaw - a.yaw))
        if length < SAME_PLACE and turned < SAME_HEADING:
            continue
        ahead = a.bearing(b.x, b.y) - wrap(b.yaw - a.yaw) / 2.0
        aside = min(abs(wrap(ahead)), abs(wrap(ahead + math.pi)))
        if turned > length / turning_radius + SAME_HEADING or aside > SAME_HEADING + SAME_PLACE / max(length, 1e-9):
            return []
        is_back = abs(wrap(ahead)) > math.pi / 2.0
        if not backward or is_back != backward[-1]:
            backward.append(is_back)
            corners.append([a])
        corners[-1].append(b)
    return [Leg(Track(part), back) for part, back in zip(corners, backward, strict=True)]


MOST_ROBOT_SPEED: Final = 10.0
"""m/s."""

SEARCH_DISTANCE: Final = 1.5
"""Maximum distance along the path from one step to the next, m; the path may cross itself."""

JOIN_DISTANCE: Final = 0.25
"""Distance, m, by which a later part of a new path has to be nearer for the robot to join it there."""

YIELD_TIME: Final = 60.0
"""Time for which the robot gives way to others before it is nearer to the goal, s."""

TURNED: Final = 0.1
"""Turn at the goal, rad, that is progress."""

HELD_UP: Final = 0.5
"""Time, s, from one check to the next that counts as driven at most, unless poses come more rarely: ten periods of a
controller."""

END_OF_LEG: Final = 0.02
"""Distance, m, from where a car changes direction, or from the end, at which it is there; and from the goal, at which
another robot is, unless its tolerance is less, when its last turn would collide farther off."""

ASIDE: Final = tuple(math.tau * part / 8.0 for part in range(8))
"""Directions in the map, rad, in which a robot may give way. They do not turn with it, or it would turn to and fro."""

STILL: Final = Pose(0.0, 0.0, 0.0)

NEAREST_LOOKAHEAD: Final = 0.05
"""Distance, m, of the nearest point that the robot is directed to."""


CAR_SPEED: Final = 0.3
BRAKING_TIME: Final = 1.5
"""Speed of a car, in its turning radii for each second; and for how long it slows down before it stops, s."""

CLOSE: Final = 0.3
CLOSE_TIME: Final = 0.5
"""Distance at which a car is directed ahead on a path that it can drive, in its turning radii, and s of driving at
least."""


@dataclass(frozen=True)
class FollowerLimits:
    """Parameters of the controller, in m, s and rad.

    The look-ahead distance is ``lookahead_time`` of driving, within its bounds. Within ``approach_distance`` of the end
    the robot slows down to ``approach_speed``; where the path bends more than ``curvature_radius`` it slows down to no
    less than ``curve_speed``, and so it does where an obstacle is nearer than ``proximity_distance`` to its centre.
    A turn of more than ``rotate_angle`` is made in place. Where the last one, to the heading of the goal, would
    collide within ``xy_tolerance`` of the goal, the robot drives on, and after ``patience`` turns at the goal only.
    No progress means less than ``progress_distance`` within ``progress_time``; ``patience`` is how long an obstacle
    ahead is waited for, too. Collisions are looked for ``collision_time`` ahead, and as far as the robot needs to stop,
    with its accelerations.

    With a ``turning_radius`` the robot steers as a car does: no bend is narrower, and nothing is turned on the spot. A
    path that it can drive, as that of the planner for such a robot, is followed closely, backward where its poses head
    away from where it leads; on another path the point that it is directed to is at least the radius away. A goal whose
    heading it does not have there is not reached. Only if it ``reverses``, it is ever driven backward.
    """

    speed: float = parameter(
        'desired_linear_vel', 0.26, 'speed on a free and straight way, m/s', 0.01, MOST_ROBOT_SPEED
    )
    lookahead_min: float = 0.25
    lookahead_max: float = 0.6
    lookahead_time: float = 1.5
    approach_distance: float = 0.4
    approach_speed: float = 0.05
    curvature_radius: float = 0.6
    curve_speed: float = 0.1
    proximity_distance: float = parameter(
        'cost_scaling_dist',
        0.4,
        'nearer to an obstacle than this the robot drives slower, in proportion, m',
        0.01,
        10.0,
    )
    rotate_angle: float = 0.785
    angular_speed: float = 1.5
    xy_tolerance: float = parameter('xy_goal_tolerance', 0.1, 'm', 0.01, 2.0)
    yaw_tolerance: float = parameter('yaw_goal_tolerance', 0.1, 'rad', 0.01, 3.2)
    progress_distance: float = parameter('required_movement_radius', 0.5, 'm', 0.01, 10.0)
    progress_time: float = parameter('movement_time_allowance', 10.0, 's', 0.1, 1000.0)
    patience: float = parameter('failure_tolerance', 0.3, 'how long an obstacle is waited for, s', 0.0, 60.0)
    collision_time: float = 1.0
    linear_acceleration: float = 2.5
    angular_acceleration: float = 3.2
    turning_radius: float = parameter(
        'minimum_turning_radius',
        0.0,
        'minimum turning radius of a car-like robot, m; 0 for one that turns on the spot',
        0.0,
        100.0,
    )
    reverses: bool = parameter(
        'allow_reversing',
        True,
        'whether a car-like robot is driven backward, where its path leads there or to give way',
    )

    @property
    def steering(self) -> Steering:
        """Steering of the robot, for the planner."""
        return Steering(self.turning_radius, self.reverses)

    @classmethod
    def of(cls, drive: DriveModel) -> FollowerLimits:
        """Return the limits for a robot of the simulated world. A car is faster, and brakes earlier."""
        limits = cls(
            speed=min(cls.speed, drive.linear_speed),
            linear_acceleration=drive.linear_acceleration,
            angular_acceleration=drive.angular_acceleration,
            angular_speed=min(cls.angular_speed, drive.angular_speed),
            turning_radius=drive.turning_radius,
        )
        if not limits.turning_radius:
            return limits
        speed = min(drive.linear_speed, max(cls.speed, CAR_SPEED * limits.turning_radius))
        return replace(limits, speed=speed, approach_distance=max(cls.approach_distance, BRAKING_TIME * speed))


class ProgressChecker:
    """A checker that notices when the robot makes no progress. It outlives a change of the path.

    Only the time in which the robot was driven counts: if time runs away from a busy machine, a long delay of the
    controller between two checks is no evidence about the robot. It was held up when it took more than twice as long as
    the shortest time between two checks before, and more than ``HELD_UP``.
    """

    def __init__(self, limits: FollowerLimits) -> None:
        self._limits = limits
        self._mark: Pose | None = None
        self._turns = False
        self._checked = -math.inf
        self._shortest = math.inf
        self._driven = self._yielded = 0.0
        self._least = math.inf

    def head_elsewhere(self) -> None:
        """Measure how near the robot comes to another goal from now on."""
        self._least, self._yielded = math.inf, 0.0

    def check(self, pose: Pose, now: float, turning: bool, left: float, yielding: bool) -> None:
        """``left``: m to the goal; ``yielding``: gives way to others since the last check.

        Raises NavigationError FAILED_TO_MAKE_PROGRESS. A turn at the goal is progress, too: its begin, and each
        ``TURNED``.
        """
        passed, self._checked = now - self._checked, now
        driven = min(passed, HELD_UP if self._shortest == math.inf else max(HELD_UP, 2.0 * self._shortest))
        if left < self._least - self._limits.progress_distance:
            self._least, self._yielded = left, 0.0
        self._yielded += driven if yielding else 0.0
        if self._yielded > YIELD_TIME:
            raise NavigationError(
                'FAILED_TO_MAKE_PROGRESS', f'gave way to others for {YIELD_TIME:g} s and is no nearer to the goal'
            )
        begins, self._turns, mark = turning and not self._turns, turning, self._mark
        if (
            mark is None
            or begins
            or (turning and abs(wrap(pose.yaw - mark.yaw)) >= TURNED)
            or mark.distance(pose) >= self._limits.progress_distance
        ):
            self._mark, self._driven = pose, 0.0
        else:
            self._driven += driven
        if passed > 0.0:
            self._shortest = min(self._shortest, passed)
        if self._driven > self._limits.progress_time:
            raise NavigationError(
                'FAILED_TO_MAKE_PROGRESS',
                f'moved less than {self._limits.progress_distance:g} m in {self._limits.progress_time:g} s',
            )


class CircleChecker:
    """A checker that notices when a robot that cannot turn on the spot drives in circles around a goal."""

    def __init__(self, progress_distance: float) -> None:
        self._distance = progress_distance
        self._least = math.inf
        self._heading: float | None = None
        self._turned = 0.0

    def check(self, heading: float, left: float) -> None:
        """``left``: m to the goal. Raises NavigationError FAILED_TO_MAKE_PROGRESS after a circle that led no nearer."""
        self._turned += 0.0 if self._heading is None else wrap(heading - self._heading)
        self._heading = heading
        if left < self._least - self._distance:
            self._least, self._turned = left, 0.0
        elif abs(self._turned) > math.tau:
            raise NavigationError(
                'FAILED_TO_MAKE_PROGRESS',
                'the robot has driven in a circle and is no nearer to the goal: it lies within its turning radius',
            )


class PlaceOnPath(NamedTuple):
    """The place of a robot relative to a path: its distance to the left of it, m, its heading from that of the path,
    rad, the index of the pose that it passed last, and its distance from the goal, m."""

    left: float
    turned: float
    passed: int
    to_goal: float


class PathFollower(Motion):
    """A follower of one path to its end, which turns to the heading of its last pose."""

    def __init__(
        self,
        path: Sequence[Pose],
        costmap: Costmap,
        limits: FollowerLimits,
        before: PathFollower | None = None,
        drift: Callable[[], Pose] = lambda: STILL,
    ) -> None:
        """``before`` followed the path that this one replaces. The robot does not stop for the change, and progress
        checker and patience continue, as in Nav2. ``drift()``, called at each step, returns the motion in the map of
        the path's frame since the path was sent. It may raise NavigationError.

        Raises:
            NavigationError: INVALID_PATH for one without poses, or with one that is not finite.
        """
        if not path or not all(map(math.isfinite, chain.from_iterable(path))):
            raise NavigationError('INVALID_PATH', 'the path has no poses' if not path else 'a pose is not finite')
        legs = drivable_legs(path, limits.turning_radius) if limits.turning_radius else []
        self._is_close = bool(legs) and (limits.reverses or not any(leg.backward for leg in legs))
        self._given = path[-1], legs if self._is_close else [Leg(Track(path))]
        self._goal, self._legs = path[-1], list(self._given[1])
        self._drift, self._drifted = drift, STILL
        self._costmap = costmap
        self._limits = limits
        self.progress: ProgressChecker = ProgressChecker(limits) if before is None else before.progress
        self._circles = CircleChecker(limits.progress_distance)
        self._no_room_since = math.inf
        if before is not None and before._given[0] == self._given[0]:
            self._circles, self._no_room_since = before._circles, before._no_room_since
        else:
            self.progress.head_elsewhere()
        self._turn = TurnLimits(maximum=limits.angular_speed).braking_with(limits.angular_acceleration / 2.0)
        self._at = 0.0
        self._has_begun = self._yields = False
        self._at_goal = False
        self._blocked_since: float | None = None if before is None else before._blocked_since
        self._apart: KeepingApart = KeepingApart(limits.speed) if before is None else before._apart
        inertia = Inertia(STOP, limits.linear_acceleration, limits.angular_acceleration)
        self._drive: CommandedDrive = CommandedDrive(inertia) if before is None else before._drive
        self.speed_limit = math.inf
        """m/s, of the topic of that name."""
        self.distance_to_goal = self._left = sum(leg.track.length for leg in self._legs)

    def limit_speed(self, limit: float) -> None:
        """See :class:`Motion`."""
        self.speed_limit = limit

    @property
    def speed(self) -> float:
        """Commanded speed, m/s."""
        return self._drive.command.linear

    @property
    def _track(self) -> Track:
        """The part of the path that the robot is driving."""
        return self._legs[0].track

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`Motion`.

        Raises:
            NavigationError: that of the drift; FAILED_TO_MAKE_PROGRESS; PATIENCE_EXCEEDED if an obstacle stays in
                the way, or NO_VALID_CONTROL at once without patience.
        """
        limits = self._limits
        self._drive.advance(now)
        self._move(self._drift())
        self._apart.look(self._costmap, pose, now)
        self._at = self._nearest(pose)
        if self._is_close and len(self._legs) > 1 and self._track.length - self._at <= END_OF_LEG:
            del self._legs[0]
            self._at = 0.0
        left = self._track.length - self._at
        self._left = math.dist(pose[:2], self._track.point(self._at)) + left
        self.distance_to_goal = self._left + sum(leg.track.length for leg in self._legs[1:])
        near_end = left <= 2.0 * limits.xy_tolerance and len(self._legs) == 1
        least = min(END_OF_LEG, limits.xy_tolerance)
        tolerance = least if now - self._no_room_since > limits.patience else limits.xy_tolerance
        self._at_goal = self._at_goal or (near_end and pose.distance(self._goal) <= tolerance)
        if self._is_close and left > END_OF_LEG and abs(wrap(self._goal.yaw - pose.yaw)) > limits.yaw_tolerance:
            self._at_goal = False  # its heading is that of the goal at the end only
        self.progress.check(pose, now, self._at_goal, self.distance_to_goal, self._yields)
        if limits.turning_radius:
            self._circles.check(pose.yaw, self.distance_to_goal)
        if self._at_goal:
            angle = wrap(self._goal.yaw - pose.yaw)
            if abs(angle) <= limits.yaw_tolerance:
                self._drive.command = STOP
                return None
            if limits.turning_radius:
                raise NavigationError(
                    'NO_VALID_CONTROL',
                    f'the robot is at the goal, {math.degrees(abs(angle)):.0f} degrees off its heading, and cannot '
                    'turn on the spot: give a goal with another heading, or a greater yaw_goal_tolerance',
                )
            is_beside = pose.distance(self._goal) > least
            # After a turn without room, require room for the whole turn, so that the robot does not oscillate.
            velocity = self._last_turn(angle, pose, now, is_beside and self._no_room_since < math.inf)
            if velocity is None and is_beside:
                # Drive on: the goal itself may have room. After the patience the robot turns only there.
                self._no_room_since = min(self._no_room_since, now)
                self._at_goal = False
                velocity = self._pursue(pose, now)
        elif self._is_close and len(self._legs) == 1 and left <= END_OF_LEG:
            raise NavigationError(
                'NO_VALID_CONTROL',
                f'the robot is at the end of its path, {pose.distance(self._goal):.2f} m beside the goal, and cannot '
                'move aside: plan a path from here, or give a greater xy_goal_tolerance',
            )
        else:
            velocity = self._pursue(pose, now)
        self._yields = velocity is None and self._apart.has_company(now)
        if self._yields:
            velocity = self._give_way(pose)
        if velocity is None:
            velocity = self._wait_for_way(now)
        else:
            self._blocked_since = None
        self._drive.command = velocity
        return velocity

    def _last_turn(self, angle: float, pose: Pose, now: float, is_whole: bool) -> Velocity | None:
        """Return the turn to the heading of the goal; None if it collides soon or, if ``is_whole``, at any time."""
        turn = self._turn_by(angle)
        seconds = abs(angle / turn.angular)
        if self._collides(pose, turn, seconds if is_whole else min(self._turning_ahead(turn), seconds)):
            return None
        return self._apart.limited(self._costmap, pose, turn)

    def _move(self, drifted: Pose) -> None:
        if drifted != self._drifted:
            goal, legs = self._given
            left = [replace(leg, track=leg.track.moved(drifted)) for leg in legs[-len(self._legs) :]]
            self._goal, self._legs, self._drifted = compose(drifted, goal), left, drifted

    def _nearest(self, pose: Pose) -> float:
        """Return the robot's distance along the path: not much farther than before, except at its first step on the
        path."""
        track = self._track
        near = track.nearest(pose, self._at, self._at + SEARCH_DISTANCE)
        if not self._has_begun:
            # The plan starts at an earlier position: the robot may have driven far since then.
            self._has_begun = True
            anywhere = track.nearest(pose, 0.0, track.length)
            gaps = [math.dist(track.point(at), pose[:2]) for at in (near, anywhere)]
            if gaps[1] < gaps[0] - JOIN_DISTANCE:
                return anywhere
        return near

    def place(self, pose: Pose) -> PlaceOnPath:
        """Return how the robot, at ``pose``, is on the path, after its last step."""
        leg, before = self._legs[0], self._given[1][: -len(self._legs)]
        x, y = leg.track.point(self._at)
        heading = leg.track.heading(self._at)
        return PlaceOnPath(
            left=math.cos(heading) * (pose.y - y) - math.sin(heading) * (pose.x - x),
            turned=wrap(pose.yaw - heading - (math.pi if leg.backward else 0.0)),
            passed=sum(one.track.index(math.inf) for one in before) + leg.track.index(self._at),
            to_goal=pose.distance(self._goal),
        )

    def _pursue(self, pose: Pose, now: float) -> Velocity | None:
        """Steer to a point ahead on the path, or to a nearer one where only the short cut is blocked."""
        limits = self._limits
        if self._is_close:
            return self._pursue_closely(pose, now)
        reach = min(limits.lookahead_max, max(limits.lookahead_min, self.speed * limits.lookahead_time))
        reach = max(reach, limits.turning_radius)
        end = self._at + reach
        while reach >= NEAREST_LOOKAHEAD:
            carrot = Pose(*self._track.ahead(pose, self._at, reach), 0.0)
            velocity = self._towards(pose, carrot)
            if not self._is_blocked(pose, carrot, velocity):
                return self._apart.limited(self._costmap, pose, self._stoppable(pose, velocity))
            if not self._is_free_until(end):
                return None
            reach /= 2.0
        return None

    def _pursue_closely(self, pose: Pose, now: float) -> Velocity | None:
        """Follow a drivable path closely, and straight beyond its end. Slow down for obstacles ahead."""
        limits, track, backward = self._limits, self._track, self._legs[0].backward
        heading = track.heading(self._at) + (math.pi if backward else 0.0)
        beside = math.dist(pose[:2], track.point(self._at)) + limits.turning_radius * abs(wrap(heading - pose.yaw))
        # A robot off the path, for example after planning from another heading, joins it in a wide bend.
        reach = max(CLOSE * limits.turning_radius, CLOSE_TIME * abs(self.speed), min(limits.turning_radius, beside))
        beyond = max(0.0, self._at + reach - track.length)
        heading = track.heading(track.length)
        x, y = track.ahead(pose, self._at, reach) if not beyond else track.point(track.length)
        carrot = Pose(x + beyond * math.cos(heading), y + beyond * math.sin(heading), 0.0)
        wanted = self._led(pose, carrot, backward)
        velocity = self._stoppable(pose, wanted, limits.collision_time)
        if velocity != wanted and not self._is_free_until(self._at + reach):
            return None
        if self._collides(pose, velocity, limits.collision_time):
            return None
        return self._apart.limited(self._costmap, pose, velocity)

    def _is_free_until(self, end: float) -> bool:
        """Return whether the path itself is free for this distance from its beginning, m."""
        track, turn = self._track, math.pi if self._legs[0].backward else 0.0
        places = numpy.arange(self._at, min(end, track.length), self._costmap.world.resolution)
        poses = (Pose(*track.point(at), track.heading(at) + turn) for at in places)
        return not any(map(self._costmap.in_collision, poses))

    def _led(self, pose: Pose, carrot: Pose, backward: bool) -> Velocity:
        """Steer to a point, forward or backward."""
        if not backward:
            return self._towards(pose, carrot)
        velocity = self._towards(pose._replace(yaw=wrap(pose.yaw + math.pi)), carrot)
        return Velocity(-velocity.linear, velocity.angular)

    def _towards(self, pose: Pose, carrot: Pose) -> Velocity:
        limits = self._limits
        bearing = pose.bearing(carrot.x, carrot.y)
        at_rest = abs(self.speed) < 0.01
        if not limits.turning_radius and abs(bearing) > limits.rotate_angle / (3.0 if at_rest else 1.0):
            return self._turn_by(bearing)
        curvature = 2.0 * math.sin(bearing) / max(pose.distance(carrot), 0.05)
        if limits.turning_radius:
            sharpest = 1.0 / limits.turning_radius
            is_behind = abs(bearing) > math.pi / 2.0
            curvature = math.copysign(sharpest, bearing) if is_behind else max(-sharpest, min(sharpest, curvature))
        top = min(limits.speed, self.speed_limit)
        bend = abs(curvature) * limits.curvature_radius
        near = self._costmap.known_distance(pose.x, pose.y) / limits.proximity_distance
        speed = min(top, max(limits.curve_speed, top * min(1.0, 1.0 / bend if bend else 1.0, near)))
        braking = math.sqrt(limits.linear_acceleration * self._left)  # with half of the deceleration
        speed = min(speed, max(limits.approach_speed, min(speed * self._left / limits.approach_distance, braking)))
        if limits.turning_radius and abs(speed * curvature) > limits.angular_speed:
            speed = limits.angular_speed / abs(curvature)  # the bend stays as wide as it is
        angular = max(-limits.angular_speed, min(limits.angular_speed, speed * curvature))
        return Velocity(speed, angular)

    def _turn_by(self, angle: float) -> Velocity:
        return Velocity(0.0, math.copysign(self._turn.speed(angle), angle))

    def _is_blocked(self, pose: Pose, carrot: Pose, velocity: Velocity) -> bool:
        """Return whether an obstacle blocks the arc before the carrot, as in Nav2. A turn includes the way after it."""
        limits = self._limits
        if velocity.linear:
            return self._collides(pose, velocity, min(limits.collision_time, pose.distance(carrot) / velocity.linear))
        bearing = pose.bearing(carrot.x, carrot.y)
        if self._collides(pose, velocity, min(self._turning_ahead(velocity), abs(bearing / velocity.angular))):
            return True
        seconds = min(limits.collision_time, pose.distance(carrot) / limits.speed)
        return collides(self._costmap, pose._replace(yaw=pose.yaw + bearing), Velocity(limits.speed, 0.0), seconds)

    def _turning_ahead(self, turn: Velocity) -> float:
        """Return the time, s, for which a turn on the spot looks ahead: at least as long as the robot brakes."""
        return max(self._limits.collision_time, abs(turn.angular) / self._limits.angular_acceleration)

    def _collides(self, pose: Pose, velocity: Velocity, seconds: float) -> bool:
        """Return whether the robot collides with this velocity, from its pose when the command takes effect."""
        coming, inertia = self._drive.foreseen(pose)
        return collides(self._costmap, coming, velocity, seconds, inertia)

    def _stoppable(self, pose: Pose, velocity: Velocity, seconds: float = 0.0) -> Velocity:
        """Return the velocity, slower on the same arc as far as it collides before the robot could stop, or within this
        time, s, if that is longer; or where the robot would collide if it braked after this command."""
        limits = self._limits
        _, inertia = self._drive.foreseen(pose)
        while True:
            rolls_on = self._collides_braking(pose, velocity)
            if abs(velocity.linear) <= limits.approach_speed:
                return STOP if rolls_on else velocity
            fastest = max(abs(velocity.linear), abs(inertia.velocity.linear))
            if not (rolls_on or self._collides(pose, velocity, max(seconds, fastest / limits.linear_acceleration))):
                return velocity
            share = max(0.5, limits.approach_speed / abs(velocity.linear))
            velocity = Velocity(velocity.linear * share, velocity.angular * share)

    def _collides_braking(self, pose: Pose, velocity: Velocity) -> bool:
        """Return whether the robot collides if it brakes after this command: it leaves the arc then. One that is no
        circle may collide before, too, and while it turns on after it has come to rest."""
        coming, inertia = self._drive.foreseen(pose)
        (there,) = inertia.poses(coming, velocity, LATENCY, 1)
        inertia = inertia.after(velocity, LATENCY)
        linear, angular = map(abs, inertia.velocity)
        braking = linear / inertia.linear
        if self._costmap.inflation.corners:
            if self._collides(pose, velocity, LATENCY):
                return True
            braking = max(braking, angular / inertia.angular)
        return collides(self._costmap, there, STOP, braking, inertia)

    def _give_way(self, pose: Pose) -> Velocity:
        """Drive to where the gap to a body in the way grows most, if that leads away from it, or wait."""
        costmap, limits = self._costmap, self._limits
        may_reverse = limits.reverses or not limits.turning_radius
        ways = (pose.yaw, pose.yaw + math.pi, *ASIDE)
        places = [drive(pose._replace(yaw=way), PERSONAL_SPACE, 0.0, 1.0)._replace(yaw=pose.yaw) for way in ways]
        free = [place for place in places if not costmap.in_collision(place)]
        for place in sorted(free, key=lambda place: costmap.gap_seen(place, 2.0 * PERSONAL_SPACE), reverse=True):
            velocity = self._led(pose, place, abs(pose.bearing(place.x, place.y)) > math.pi / 2.0)
            is_free = not self._collides(pose, velocity, limits.collision_time)
            if (velocity.linear >= 0.0 or may_reverse) and is_free and self._apart.leaves(costmap, pose, velocity):
                self._at_goal = False
                return velocity
        return STOP

    def _wait_for_way(self, now: float) -> Velocity:
        patience = self._limits.patience
        if self._blocked_since is None or not self._drive.is_at_rest:
            self._blocked_since = now  # it may be its own turn that is in the way, until it has braked
        if patience <= 0.0:
            raise NavigationError('NO_VALID_CONTROL', 'an obstacle is ahead on the path')
        if now - self._blocked_since > patience:
            raise NavigationError('PATIENCE_EXCEEDED', f'an obstacle has been ahead on the path for {patience:g} s')
        return STOP
