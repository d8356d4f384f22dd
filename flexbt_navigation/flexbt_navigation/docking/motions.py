# SPDX-License-Identifier: BSD-3-Clause
"""Docks, from the database of Nav2's docking server or the charging stations of a world file, and the motions of a
robot onto a dock and off it, with their control law. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Final

from flexbt_core.values.json_data import finite_number
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import short_repr
from flexbt_core.values.text_files import read_text
from flexbt_core.values.yaml_data import load_yaml
from flexbt_navigation.controller.motions import STOP, Motion, TurnLimits, Velocity, collides
from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_navigation.errors import DockError, NavigationError
from flexbt_sim.world.models import StationModel
from flexbt_sim.world.plane.geometry import Pose, compose, drive, inverse, wrap
from flexbt_sim.world.world_file import WorldFile

MOST_BYTES: Final = 4_000_000


@dataclass(frozen=True)
class DockType:
    """A type of dock. If it ``charges``, the robot waits there until it is charged."""

    name: str
    charges: bool


@dataclass(frozen=True)
class Dock:
    """A dock: the pose of the docked robot, in ``frame``. The ``type`` of a station is empty: it charges."""

    name: str
    pose: Pose
    frame: str = 'map'
    type: str = ''


def load_docks(file: Path) -> dict[str, Dock]:
    """Return the docks of a file, by name.

    ``docks:`` has, for each dock, ``type``, ``pose`` (x, y, yaw) and ``frame`` (default: map). A file with
    ``stations:`` is a world file.

    Raises:
        DockError: the file cannot be read, or has no docks.
        WorldError: the world file is invalid.
    """
    try:
        text = read_text(file, MOST_BYTES)
        content = load_yaml(text, aliases=True)
    except (OSError, ValueError) as error:
        raise DockError.unreadable(file, error, 'a YAML file with docks') from error
    sections = content if isinstance(content, dict) else {}
    if 'docks' in sections:
        docks = sections['docks']
        if not isinstance(docks, dict):
            raise _unfit(file, 'docks', 'docks by their names', docks)
        return {str(name): _dock(file, f'docks.{name}', str(name), entry) for name, entry in docks.items()}
    if 'stations' in sections:
        entities = WorldFile(file, text).entities
        return {name: Dock(name, model.pose) for _, name, model, _ in entities if isinstance(model, StationModel)}
    raise DockError(file, '', 'has neither docks: nor stations:')


def _dock(file: Path, where: str, name: str, entry: object) -> Dock:
    if not isinstance(entry, Mapping):
        raise _unfit(file, where, 'a mapping with pose', entry)
    pose = _pose(entry.get('pose'))
    if pose is None:
        raise _unfit(file, f'{where}.pose', 'x, y and yaw: m, m, rad', entry.get('pose'))
    frame, kind = entry.get('frame', 'map'), entry.get('type')
    if not isinstance(kind, str) or not kind:
        raise _unfit(file, f'{where}.type', 'the name of a type of docks', kind)
    if not isinstance(frame, str) or not frame:
        raise _unfit(file, f'{where}.frame', 'the name of a frame', frame)
    return Dock(name, pose, frame, kind)


def _pose(value: Any) -> Pose | None:
    if not isinstance(value, list) or len(value) != 3:
        return None
    pose = Pose(*(math.nan if (number := finite_number(one)) is None else number for one in value))
    return pose if pose.is_place else None


def _unfit(file: Path, where: str, expected: str, value: object) -> DockError:
    return DockError(file, where, f'expected {expected}, got {short_repr(value)}')


@dataclass(frozen=True)
class ControlLaw:
    """Gains and limits of the control law, with the defaults of Nav2's docking server. Speeds in m/s and rad/s, radii
    in m.

    ``slow_gain`` is k1 of the paper (k_phi), ``fast_gain`` k2 (k_delta). ``beta`` and ``exponent`` (lambda) slow the
    robot down where the path bends. The robot slows down within ``slowdown_radius`` of the pose. No bend is tighter
    than ``turning_radius``, which is 0 for a robot that turns on the spot.
    """

    slow_gain: float = 3.0
    fast_gain: float = 2.0
    beta: float = 0.4
    exponent: float = 2.0
    least_speed: float = 0.1
    speed: float = 0.25
    angular_speed: float = 0.75
    slowdown_radius: float = 0.25
    turning_radius: float = 0.0


_SMALLEST: Final = 1e-6


def velocity_to(target: Pose, pose: Pose, law: ControlLaw, *, backward: bool = False) -> Velocity:
    """Return the velocity that leads from a pose to a target, forward or backward. It is arbitrary at the target
    itself."""
    dx, dy = target.x - pose.x, target.y - pose.y
    distance = max(math.hypot(dx, dy), _SMALLEST)
    # Driving backward is driving forward with the opposite heading.
    flip = math.pi if backward else 0.0
    sight = math.atan2(dy, dx)
    heading = wrap(pose.yaw + flip - sight)
    goal = wrap(target.yaw + flip - sight)
    wanted = math.atan(-law.slow_gain * goal)
    curvature = (
        -(
            law.fast_gain * (heading - wanted)
            + (1.0 + law.slow_gain / (1.0 + (law.slow_gain * goal) ** 2)) * math.sin(heading)
        )
        / distance
    )
    sharpest = 1.0 / law.turning_radius if law.turning_radius else math.inf
    curvature = max(-sharpest, min(sharpest, curvature))
    speed = law.speed / (1.0 + law.beta * abs(curvature) ** law.exponent)
    speed = max(law.least_speed, min(speed, law.speed * distance / law.slowdown_radius))
    angular = max(-law.angular_speed, min(law.angular_speed, speed * curvature))
    if abs(curvature) > _SMALLEST:
        speed = angular / curvature
    return Velocity(-speed if backward else speed, angular)


# Motions that drive the robot onto a dock and off it.

BEYOND: Final = 0.25
"""Distance from the dock to the target of the control law behind it, m: at the target itself, the law is arbitrary."""

FARTHEST_STAGING: Final = -10.0
"""Maximum distance of a staging pose from its dock, m."""

RETRIES: Final = 6
WAIT_DURATION: Final = 5.0
"""Number of times that the path to a staging pose is planned again, and the wait before each, s: number_of_retries and
wait_duration of Nav2's default tree, which drives the robot there for Nav2's docking server."""

STEP: Final = 0.2
"""Time between two collision checks, s."""


class DockState(Enum):
    """The phase of docking, with the values of the feedback of dock_robot."""

    NONE = 0
    NAV_TO_STAGING_POSE = 1
    INITIAL_PERCEPTION = 2
    CONTROLLING = 3
    WAIT_FOR_CHARGE = 4
    RETRY = 5


@dataclass(frozen=True)
class DockingLimits:
    """Parameters of docking, with the defaults of Nav2's docking server; m, rad and s.

    ``staging_offset`` is the distance from the dock to the staging pose, along the heading of the dock.
    ``docked_within`` is the docking_threshold of Nav2's SimpleChargingDock. A robot whose ``law`` has a turning radius
    cannot turn on the spot: it needs a ``staging_yaw_offset`` of 0.
    """

    staging_offset: float = parameter(
        'staging_x_offset', -0.7, 'from a dock to its staging pose, m', FARTHEST_STAGING, 0.0
    )
    staging_yaw_offset: float = parameter('staging_yaw_offset', 0.0, 'the same for the heading, rad', -3.2, 3.2)
    docked_within: float = parameter(
        'docking_threshold', 0.05, 'how near to its dock the robot is docked, m', 0.005, 1.0
    )
    prestaging_tolerance: float = parameter(
        'dock_prestaging_tolerance',
        0.5,
        'distance from the staging pose that needs no drive to it, m and rad',
        0.0,
        10.0,
    )
    perception_seconds: float = parameter(
        'initial_perception_timeout', 5.0, 'how long a dock is looked for, s', 0.1, 100.0
    )
    approach_seconds: float = parameter('dock_approach_timeout', 30.0, 'how long an approach may take, s', 0.1, 1000.0)
    charge_seconds: float = parameter('wait_charge_timeout', 5.0, 'how long a charge is waited for, s', 0.1, 1000.0)
    retries: int = parameter('max_retries', 3, 'how often docking is tried again', 0, 100)
    linear_tolerance: float = parameter(
        'undock_linear_tolerance', 0.05, 'how near to it a staging pose is reached, m', 0.01, 1.0
    )
    angular_tolerance: float = parameter('undock_angular_tolerance', 0.05, 'the same for the heading, rad', 0.01, 3.2)
    projection_seconds: float = parameter('dock_projection_time', 5.0, 'how far ahead obstacles count, s', 0.0, 30.0)
    collision_threshold: float = parameter(
        'dock_collision_threshold', 0.3, 'so near to a dock nothing counts as an obstacle, m', 0.0, 10.0
    )
    law: ControlLaw = field(default_factory=ControlLaw)
    turn: TurnLimits = field(default_factory=TurnLimits)
    deceleration: float = math.inf

    @classmethod
    def of(
        cls, turning_radius: float, deceleration: float = math.inf, angular_acceleration: float = math.inf
    ) -> DockingLimits:
        """Return the limits for a robot that brakes with these, m/s² and rad/s². A car-like robot begins one turning
        radius before the dock, but at most 10 m: on the way it can shift sideways by a quarter of that. It has twice
        the time that this takes."""
        law = ControlLaw(turning_radius=turning_radius)
        offset = min(cls.staging_offset, max(-turning_radius, FARTHEST_STAGING))
        return cls(
            staging_offset=offset,
            approach_seconds=max(cls.approach_seconds, -2.0 * offset / law.speed),
            law=law,
            turn=TurnLimits().braking_with(angular_acceleration / 2.0),
            deceleration=deceleration,
        )

    def staging_pose(self, dock: Pose) -> Pose:
        """Return the pose from which the robot approaches a dock."""
        x, y, _ = drive(dock, self.staging_offset, 0.0, 1.0)
        return Pose(x, y, wrap(dock.yaw + self.staging_yaw_offset))


@dataclass(frozen=True)
class Senses:
    """The sensors of a docking robot: whether it is charging, and the detected pose of the dock, if any."""

    is_charging: Callable[[], bool]
    seen_dock: Callable[[], Pose | None]


class StagingMotion(Motion):
    """A drive to the staging pose by a motion that follows a path.

    If it fails, the robot waits for WAIT_DURATION, then ``plan_again()`` is called. The caller reports the result with
    :meth:`go_on` or :meth:`fail`. This happens up to RETRIES times.

    Raises, when stepped:
        NavigationError: FAILED_TO_STAGE.
    """

    def __init__(self, follow: Motion, seconds: float, plan_again: Callable[[], object]) -> None:
        self._follow: Motion | None = follow
        self._seconds = seconds
        self._plan_again = plan_again
        self._plan_at = math.inf
        self._failure = ''
        self._tries = 0
        self._began: float | None = None

    def go_on(self, follow: Motion) -> None:
        """Continue with another motion to the staging pose."""
        self._follow = follow

    def fail(self, why: str) -> None:
        """Report that no path to the staging pose was found."""
        self._failure = why

    def step(self, pose: Pose, now: float) -> Velocity | None:
        self._began = now if self._began is None else self._began
        if now - self._began > self._seconds:
            raise NavigationError('FAILED_TO_STAGE', f'the staging pose is not reached within {self._seconds:g} s')
        if now >= self._plan_at:
            self._plan_at = math.inf
            self._plan_again()
        try:
            if not self._failure:
                return STOP if self._follow is None else self._follow.step(pose, now)
        except NavigationError as error:
            self._failure = str(error)
        if self._tries == RETRIES:
            raise NavigationError('FAILED_TO_STAGE', f'the staging pose is not reached: {self._failure}')
        self._tries += 1
        self._failure, self._follow, self._plan_at = '', None, now + WAIT_DURATION
        return STOP

    def update(self, costmap: Costmap) -> None:
        if self._follow is not None:
            self._follow.update(costmap)

    def limit_speed(self, limit: float) -> None:
        """See :class:`Motion`."""
        if self._follow is not None:
            self._follow.limit_speed(limit)


class DockMotion(Motion):
    """A drive from the staging pose onto a dock, including the wait for the charge. After a failure, it goes back and
    retries.

    ``state`` and ``retries`` are for the feedback.
    """

    def __init__(
        self,
        dock: Pose,
        senses: Senses,
        limits: DockingLimits,
        costmap: Costmap,
        *,
        charges: bool,
        staging: StagingMotion | None = None,
    ) -> None:
        """``dock`` is the expected pose of the dock. ``staging``, if given, drives to the staging pose first."""
        self._dock = dock
        self._senses = senses
        self._limits = limits
        self._costmap = costmap
        self._charges = charges
        self._staging = staging
        self._phase_began: float | None = None
        self.retries = 0
        self.state = DockState.INITIAL_PERCEPTION if staging is None else DockState.NAV_TO_STAGING_POSE

    def update(self, costmap: Costmap) -> None:
        super().update(costmap)
        if self._staging is not None:
            self._staging.update(costmap)

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`Motion`.

        Raises:
            NavigationError: FAILED_TO_STAGE, FAILED_TO_DETECT_DOCK, FAILED_TO_CONTROL or FAILED_TO_CHARGE. The last
                three when all retries are used, or at once if the dock is not seen at first.
        """
        if self._phase_began is None:
            self._phase_began = now
        spent = now - self._phase_began
        if self.state is DockState.NAV_TO_STAGING_POSE:
            assert self._staging is not None
            return self._staging.step(pose, now) or self._enter(DockState.INITIAL_PERCEPTION, now)
        if self.state is DockState.INITIAL_PERCEPTION and not self.retries:
            return self._perceive(spent, now)
        try:
            if self.state is DockState.INITIAL_PERCEPTION:
                return self._perceive(spent, now)
            if self.state is DockState.CONTROLLING:
                return self._approach(pose, spent, now)
            if self.state is DockState.WAIT_FOR_CHARGE:
                return self._wait(spent)
        except NavigationError:
            if self.retries >= self._limits.retries:
                raise
            self.retries += 1
            return self._enter(DockState.RETRY, now)
        return self._go_back(pose, spent, now)

    def _enter(self, state: DockState, now: float) -> Velocity:
        self.state, self._phase_began = state, now
        return STOP

    def _perceive(self, spent: float, now: float) -> Velocity:
        seen = self._senses.seen_dock()
        if seen is not None:
            self._dock = seen
            return self._enter(DockState.CONTROLLING, now)
        if spent > self._limits.perception_seconds:
            raise NavigationError('FAILED_TO_DETECT_DOCK', f'the dock was not seen within {spent:.1f} s')
        return STOP

    def _approach(self, pose: Pose, spent: float, now: float) -> Velocity | None:
        limits = self._limits
        seen = self._senses.seen_dock()
        if seen is None:
            raise NavigationError('FAILED_TO_DETECT_DOCK', 'the dock is not seen any more')
        self._dock = seen
        is_charged = self._charges and self._senses.is_charging()
        if is_charged or pose.distance(seen) < limits.docked_within:
            return self._enter(DockState.WAIT_FOR_CHARGE, now)
        if _ahead(seen, pose) < -limits.docked_within:
            raise NavigationError(
                'FAILED_TO_CONTROL',
                f'the robot has come past the dock, {pose.distance(seen):.2f} m beside it: approach it from farther '
                'away (staging_x_offset), or give a greater docking_threshold',
            )
        if spent > limits.approach_seconds:
            raise NavigationError('FAILED_TO_CONTROL', f'the dock is not reached within {limits.approach_seconds:g} s')
        target = drive(seen, BEYOND, 0.0, 1.0)
        if _collides(self._costmap, pose, target, limits, backward=False, apart_from=target):
            raise NavigationError('FAILED_TO_CONTROL', 'an obstacle is on the way to the dock')
        return _braking(velocity_to(target, pose, limits.law), pose.distance(seen), limits)

    def _wait(self, spent: float) -> Velocity | None:
        if not self._charges or self._senses.is_charging():
            return None
        if spent > self._limits.charge_seconds:
            raise NavigationError('FAILED_TO_CHARGE', f'the robot is docked, and not charged within {spent:.1f} s')
        return STOP

    def _go_back(self, pose: Pose, spent: float, now: float) -> Velocity:
        if spent > self._limits.approach_seconds:
            raise NavigationError('FAILED_TO_CONTROL', f'the staging pose is not reached within {spent:.1f} s')
        velocity = _back(self._costmap, pose, self._dock, self._limits)
        return velocity or self._enter(DockState.INITIAL_PERCEPTION, now)


class UndockMotion(Motion):
    """A drive back from a dock to its staging pose. It assumes that the robot's own pose is that of the dock."""

    def __init__(
        self,
        senses: Senses,
        limits: DockingLimits,
        costmap: Costmap,
        *,
        charges: bool,
        seconds: float,
    ) -> None:
        """``seconds`` is the time limit."""
        self._senses = senses
        self._limits = limits
        self._costmap = costmap
        self._charges = charges
        self._seconds = seconds
        self._began: float | None = None
        self._dock: Pose | None = None

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`Motion`.

        Raises:
            NavigationError: FAILED_TO_CONTROL.
        """
        if self._began is None or self._dock is None:
            self._began, self._dock = now, pose
        if now - self._began > self._seconds:
            raise NavigationError('FAILED_TO_CONTROL', f'the robot has not left the dock within {self._seconds:g} s')
        velocity = _back(self._costmap, pose, self._dock, self._limits)
        if velocity is None and self._charges and self._senses.is_charging():
            return STOP  # until the battery reports that charging has ended
        return velocity


def _back(costmap: Costmap, pose: Pose, dock: Pose, limits: DockingLimits) -> Velocity | None:
    """Return the velocity for driving back to the staging pose of a dock and for the turn there; None when both are
    done.

    Raises:
        NavigationError: FAILED_TO_CONTROL.
    """
    staging = limits.staging_pose(dock)
    turn = wrap(staging.yaw - pose.yaw)
    way = staging._replace(yaw=wrap(staging.yaw - limits.staging_yaw_offset))  # straight off the dock
    is_there = _is_at(way, pose, limits, backward=True)
    if is_there and (abs(turn) < limits.angular_tolerance or limits.law.turning_radius):
        return None
    if is_there:
        velocity = Velocity(0.0, math.copysign(limits.turn.speed(turn), turn))
        seconds = min(limits.projection_seconds, turn / velocity.angular)
        if seconds and collides(costmap, pose, velocity, seconds):
            raise NavigationError('FAILED_TO_CONTROL', 'an obstacle is beside the robot, which has to turn')
        return velocity
    if _collides(costmap, pose, way, limits, backward=True, apart_from=dock):
        raise NavigationError('FAILED_TO_CONTROL', 'an obstacle is on the way back from the dock')
    return _braking(velocity_to(way, pose, limits.law, backward=True), pose.distance(way), limits)


def _braking(velocity: Velocity, distance: float, limits: DockingLimits) -> Velocity:
    """Return the velocity, slower on the same arc if the robot, with half of its deceleration, could not stop within
    this distance, m."""
    share = min(1.0, math.sqrt(limits.deceleration * distance) / max(abs(velocity.linear), _SMALLEST))
    return Velocity(velocity.linear * share, velocity.angular * share)


def _ahead(target: Pose, pose: Pose) -> float:
    """Return the distance, m, of the robot before a pose, along the heading of the pose; negative beyond it."""
    return -compose(inverse(target), pose).x


def _is_at(target: Pose, pose: Pose, limits: DockingLimits, *, backward: bool) -> bool:
    """Return whether the robot is level with a pose, even if it is off to one side: from there, the control law gets no
    closer."""
    left = _ahead(target, pose)
    return (-left if backward else left) <= limits.linear_tolerance


def _collides(
    costmap: Costmap, pose: Pose, target: Pose, limits: DockingLimits, *, backward: bool, apart_from: Pose
) -> bool:
    """Return whether the control law leads into an obstacle that is farther from the dock than the threshold."""
    here = pose
    for _ in range(math.ceil(limits.projection_seconds / STEP)):
        here = drive(here, *velocity_to(target, here, limits.law, backward=backward), STEP)
        if _is_at(target, here, limits, backward=backward):
            return False
        if here.distance(apart_from) > limits.collision_threshold and costmap.in_collision(here):
            return True
    return False
