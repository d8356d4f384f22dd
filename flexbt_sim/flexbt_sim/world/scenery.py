# SPDX-License-Identifier: BSD-3-Clause
"""Obstacles, doors, charging stations and zones."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Generic, TypeVar

from flexbt_sim.world.models import (
    DoorModel,
    ObstacleModel,
    RouteModel,
    StationModel,
    WalkModel,
    ZoneModel,
)
from flexbt_sim.world.plane.geometry import Circle, Polygon, Pose, Shape, contains
from flexbt_sim.world.plane.space import ROUNDING, Body, WorldView, generator

EDGE: Final = 0.01
"""Visible part of an open door, m."""


class Obstacle(Body):
    """A static or moving obstacle. ``velocity`` is in m/s, in the map."""

    def __init__(self, name: str, model: ObstacleModel, seed: int = 0) -> None:
        super().__init__(name, model.shape, model.pose)
        self.model = model
        self.top_speed = max((one.speed for one in (model.route, model.random_walk) if one is not None), default=0.0)
        self.is_mobile = self.top_speed > 0.0
        self._seed = seed
        self.reset()

    def reset(self) -> None:
        """Return to the state at the start, random numbers included."""
        self.place(self.start)
        self._random = generator(self._seed, self.name, 'walk')
        self._heading, self._left = 0.0, 0.0

    def place(self, pose: Pose) -> None:
        """Move it to a pose. Its route continues from there to the first point."""
        self.pose = pose
        self.velocity = (0.0, 0.0)
        self._next: int | None = 0
        self._step = 1
        self._blocked = 0.0

    def tick(self, surroundings: WorldView, duration: float) -> None:
        """Follow the route, or walk at random."""
        if self.model.route is not None:
            self._follow(self.model.route, surroundings, duration)
        elif self.model.random_walk is not None:
            self._walk(self.model.random_walk, surroundings, duration)

    def _follow(self, route: RouteModel, surroundings: WorldView, duration: float) -> None:
        self.velocity = (0.0, 0.0)
        for _ in range(len(route.waypoints) + 1):  # several may be within one tick
            if self._next is None or duration <= 0.0:
                return
            x, y = route.waypoints[self._next]
            dx, dy = x - self.pose.x, y - self.pose.y
            distance = math.hypot(dx, dy)
            if distance > 1e-9:
                time = min(duration, distance / route.speed)
                if not self._go(route.speed * dx / distance, route.speed * dy / distance, surroundings, time):
                    self._wait(self._next, route, time)
                    return
                self._blocked = 0.0
                duration -= time
            if distance <= 1e-9 or duration > 0.0:
                self._next = self._after(self._next, route)

    def _wait(self, index: int, route: RouteModel, duration: float) -> None:
        """Wait on the way to a blocked point, and finally turn back to the one before."""
        self._blocked += duration
        back = index - self._step
        if route.order == 'loop':
            back %= len(route.waypoints)
        if self._blocked >= route.patience and route.order != 'once' and 0 <= back < len(route.waypoints):
            self._next, self._step, self._blocked = back, -self._step, 0.0

    def _after(self, index: int, route: RouteModel) -> int | None:
        count = len(route.waypoints)
        if route.order == 'loop':
            return (index + self._step) % count
        if not 0 <= index + self._step < count:
            if route.order == 'once' or count == 1:
                return None
            self._step = -self._step
        return index + self._step

    def _walk(self, walk: WalkModel, surroundings: WorldView, duration: float) -> None:
        if self._left <= 0.0:
            self._heading = self._random.uniform(-math.pi, math.pi)
            self._left = self._random.exponential(walk.period)
        self._left -= duration
        vx, vy = walk.speed * math.cos(self._heading), walk.speed * math.sin(self._heading)
        if not self._go(vx, vy, surroundings, duration):
            self._left = 0.0

    def _go(self, vx: float, vy: float, surroundings: WorldView, duration: float) -> bool:
        x, y, yaw = self.pose
        reach = math.hypot(vx, vy)
        moved = surroundings.advance(self, lambda time: Pose(x + vx * time, y + vy * time, yaw), reach, duration)
        self.velocity = (vx, vy) if moved == duration else (0.0, 0.0)
        return moved == duration


class Door(Body):
    """A sliding door. ``opening`` is 0 when it is closed and 1 when it is open.

    ``wants_open`` is the last command, or, for an automatic door, what it has detected as needed.
    ``jammed`` is None, or where it stays while it is jammed: ``anywhere``, or ``closed`` or ``open``, to where it goes
    first.
    """

    def __init__(self, name: str, model: DoorModel) -> None:
        self.model = model
        (x, y), (to_x, to_y) = model.from_, model.to
        super().__init__(name, self._leaf(float(model.open)), Pose(x, y, math.atan2(to_y - y, to_x - x)))
        self.radius = math.hypot(model.length + EDGE, model.thickness / 2.0)
        self.top_speed = model.length / model.opening_time
        self.jammed: str | None = None
        self._start_model = model
        self.reset()

    def reset(self) -> None:
        """Return to the state at the start."""
        self.pose, self.model = self.start, self._start_model
        self.wants_open = self.model.open
        self._nobody_since = -math.inf
        self._is_commanded = False
        self._set(float(self.model.open))

    def place(self, pose: Pose) -> None:
        """Move it to a pose, as :meth:`DoorModel.at`. Its opening stays."""
        self.pose, self.model = pose, self.model.at(pose)

    def command(self, open_it: bool) -> None:
        """Command it to open or to close. An automatic door closes again by itself; a jammed one ignores it."""
        if self.jammed is None:
            self.wants_open, self._is_commanded = open_it, True

    def tick(self, surroundings: WorldView, duration: float) -> None:
        """Open or close a little."""
        model = self.model
        if model.automatic:
            middle = ((model.from_[0] + model.to[0]) / 2.0, (model.from_[1] + model.to[1]) / 2.0)
            is_someone_near = surroundings.is_someone_near(*middle, model.range)
            if is_someone_near or self._is_commanded:
                self._nobody_since, self._is_commanded = surroundings.time, False
            if is_someone_near:
                self.wants_open = True
            elif surroundings.time - self._nobody_since >= model.hold:
                self.wants_open = False
        if self.jammed is not None:
            self.wants_open = {'closed': False, 'open': True}.get(self.jammed, self.wants_open)
        before = self.opening
        step = duration / model.opening_time
        after = min(1.0, before + step) if self.wants_open else max(0.0, before - step)
        if after == before or self.jammed == 'anywhere':
            return
        self._set(after)
        if after < before and surroundings.gap_to_bodies(self, self.pose) < -ROUNDING:
            self._set(before)  # something is in its way, not only beside it, as the other leaf of a double door is

    def _set(self, opening: float) -> None:
        self.opening = opening
        self.shape = self._leaf(opening)

    def _leaf(self, opening: float) -> Polygon:
        # An open door keeps its edge, so that a body that was looked for is always there: beside the passage.
        side, start = self.model.thickness / 2.0, opening * self.model.length
        end = max(self.model.length, start + EDGE)
        return Polygon(((end, side), (start, side), (start, -side), (end, -side)))


M = TypeVar('M', StationModel, ZoneModel)


@dataclass
class Marking(Generic[M]):
    """A marking on the ground, which does not block anything."""

    name: str
    model: M

    def __post_init__(self) -> None:
        self._start: M = self.model

    def reset(self) -> None:
        """Return to the state at the start."""
        self.model = self._start

    def place(self, pose: Pose) -> None:
        """Move it to a pose."""
        self.model = replace(self.model, pose=pose)

    @property
    def pose(self) -> Pose:
        """Pose of its origin."""
        return self.model.pose


class Station(Marking[StationModel]):
    """A charging station: it charges a robot at its pose."""

    @property
    def shape(self) -> Shape:
        """The area around its pose in which a robot is charged."""
        return Circle(self.model.reach)


class Zone(Marking[ZoneModel]):
    """An area with a rule."""

    @property
    def shape(self) -> Shape:
        """Shape of its area, around its origin."""
        return self.model.area

    def contains(self, x: float, y: float) -> bool:
        """Return whether a point is in it."""
        return contains(self.model.area, self.model.pose, x, y)


Entity = Body | Station | Zone
"""Anything with a name in the world."""
