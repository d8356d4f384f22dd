# SPDX-License-Identifier: BSD-3-Clause
"""The world: robots and their surroundings, on one clock."""

from __future__ import annotations

import dataclasses
import math
from bisect import insort
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy

from flexbt_core.values.text import did_you_mean
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.device import Sensor
from flexbt_sim.world.devices import Gripper
from flexbt_sim.world.faults import DoorJammed, Fault, check_fault_name, fault_parameters
from flexbt_sim.world.models import (
    STEP,
    DoorModel,
    ObstacleModel,
    RobotModel,
    StationModel,
    ZoneModel,
)
from flexbt_sim.world.plane.geometry import Circle, Pose, Shape, box, compose
from flexbt_sim.world.plane.occupancy_map import OccupancyMap
from flexbt_sim.world.plane.ray_casting import Floats, RayCaster, outlines
from flexbt_sim.world.plane.space import Body, BodyGrid, Space, check_pose
from flexbt_sim.world.specification import NAME, FaultModel
from flexbt_sim.world.world_file import WorldFile

from .robot import Robot
from .scenery import Door, Entity, Obstacle, Station, Zone

MAX_ENTITIES: Final = 10_000

EntityModel = RobotModel | ObstacleModel | DoorModel | StationModel | ZoneModel


@dataclass(frozen=True)
class EntityState:
    """Pose and speeds over ground of an entity, m/s and rad/s; those of a robot are in its own frame."""

    name: str
    kind: str
    pose: Pose
    linear: tuple[float, float] = (0.0, 0.0)
    angular: float = 0.0
    faults: tuple[str, ...] = ()
    odometry: Pose | None = None
    estimate: Pose | None = None
    in_contact: bool = False
    devices: Mapping[str, Any] = field(default_factory=dict)
    """State of each device that has one, by name: for example the level of a battery."""
    opening: float | None = None


@dataclass(frozen=True)
class WorldSnapshot:
    """The state of a world at a simulated time, s, for storing, comparing and drawing."""

    time: float
    entities: tuple[EntityState, ...]


class World:
    """Robots, obstacles, doors, stations and zones on a map or on an unlimited plane.

    ``entities`` has all of them by name; ``robots``, ``obstacles`` and so on have those of one kind. Names are unique
    among all entities. The world depends only on the seed, the file and the calls: if these are the same, states are
    equal to the last bit. Not thread-safe.
    """

    def __init__(
        self, world: OccupancyMap | None = None, *, places: Mapping[str, Pose] | None = None, seed: int = 0,
        step: float = STEP,
    ) -> None:  # fmt: skip
        """``step`` is the longest simulated time, s, for which speeds are assumed constant.

        Raises:
            SimulationError: the step is not in the range 0.001 to 1 s.
        """
        if not 0.001 <= step <= 1.0:
            raise SimulationError(f'a step of {step:g} s; give 0.001 to 1 s')
        self.map = world
        self.seed = seed
        self.step_size = step
        self.places: Mapping[str, Pose] = MappingProxyType(dict(places or {}))
        self._nanoseconds = 0
        self._of_kind: dict[type, dict[str, Any]] = {kind: {} for kind in (Robot, Obstacle, Door, Station, Zone)}
        self._entities: dict[str, Entity] = {}
        self._held: dict[str, Obstacle] = {}
        self.entities: Mapping[str, Entity] = MappingProxyType(self._entities)
        self.robots: Mapping[str, Robot] = MappingProxyType(self._of_kind[Robot])
        self.obstacles: Mapping[str, Obstacle] = MappingProxyType(self._of_kind[Obstacle])
        self.doors: Mapping[str, Door] = MappingProxyType(self._of_kind[Door])
        self.stations: Mapping[str, Station] = MappingProxyType(self._of_kind[Station])
        self.zones: Mapping[str, Zone] = MappingProxyType(self._of_kind[Zone])
        self.held: Mapping[str, Obstacle] = MappingProxyType(self._held)
        """Obstacles in grippers, by robot name. They block no other body."""
        self._movers: list[Body] = []
        self._next_reading = 0.0
        self._space = Space(world, step)
        self._rays = RayCaster(world)
        self._faults: dict[str, dict[str, Fault]] = {}
        self._begun: set[Fault] = set()

    @classmethod
    def load(cls, file: Path | str, *, seed: int | None = None) -> World:
        """Return the world of a file; ``seed`` overrides that of the file.

        Raises:
            WorldError: the file is invalid. The error lists every problem, with line and remedy.
        """
        told = WorldFile(Path(file), with_map=True)
        model = told.model
        world = cls(told.map, places=told.places, seed=model.seed if seed is None else seed, step=model.step)
        for name, pose in told.places.items():
            told.attempt(('places', name), world._space.check_on_map, pose)
        for path, *entity in told.entities:
            told.attempt(path, world.add, *entity)
        for path, timing, parameters in told.faults:
            told.attempt(path, world.set_fault, timing.entity, timing.fault, parameters, timing.after, timing.duration)
        told.finish()
        return world

    # -- queries -----------------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return self._nanoseconds * 1e-9

    @property
    def nanoseconds(self) -> int:
        """Simulated time, ns."""
        return self._nanoseconds

    @property
    def no_go(self) -> tuple[tuple[Shape, Pose], ...]:
        """Areas of the no-go zones, and their poses."""
        return tuple((one.shape, one.pose) for one in self.zones.values() if one.model.kind == 'no_go')

    @property
    def known_map(self) -> OccupancyMap | None:
        """The map for navigation, in which no-go zones are occupied, too."""
        no_go, world = self.no_go, self.map
        return world if world is None or not no_go else world.masked(world.mask(no_go))

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Faults that are active or scheduled, ordered by entity."""
        return tuple(one for of_entity in self._faults.values() for one in of_entity.values())

    @property
    def begun_faults(self) -> frozenset[Fault]:
        """Faults that are active."""
        return frozenset(self._begun)

    def active_faults(self, entity: str) -> Mapping[str, FaultModel]:
        """Return the parameters of the active faults of an entity, by slot, whichever node carries them out."""
        return {slot: one.parameters for slot, one in self._faults.get(entity, {}).items() if one in self._begun}

    # -- changes -----------------------------------------------------------------------------------------------------

    def add(self, name: str, model: EntityModel, pose: Pose | None = None) -> Any:
        """Add an entity and return it. ``pose`` is that of a robot, or replaces that of the model; for a door as
        :meth:`DoorModel.at`.

        Raises:
            SimulationError: the name is in use or invalid, the pose is missing, there is no room, or a station or
                a zone is outside the map.
        """
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise SimulationError(f"'{name}' cannot be a name: give letters, digits and _, a letter first, at most 63")
        if name in self._entities:
            raise SimulationError(f"there is a '{name}' already; names are unique among all entities")
        if len(self._entities) >= MAX_ENTITIES:
            raise SimulationError(f'{MAX_ENTITIES} entities are the most that a world has')
        entity = self._made(name, model, pose)
        if isinstance(entity, Body):
            self._check(entity, entity.pose)
            self._bring(entity)
        else:
            self._check_marking(entity, entity.pose)
        self._entities[name] = entity
        self._of_kind[type(entity)][name] = entity
        self._next_reading = 0.0
        return entity

    def _made(self, name: str, model: EntityModel, pose: Pose | None) -> Entity:
        if isinstance(model, RobotModel):
            if pose is None:
                raise SimulationError(f"robot '{name}': its pose is missing")
            check_pose(pose)
            return Robot(name, model, pose, self.seed)
        if isinstance(model, DoorModel):
            return Door(name, model if pose is None else model.at(pose))
        if pose is not None:
            model = dataclasses.replace(model, pose=pose)
        if isinstance(model, ObstacleModel):
            return Obstacle(name, model, self.seed)
        return Station(name, model) if isinstance(model, StationModel) else Zone(name, model)

    def _bring(self, body: Body) -> None:
        """Put a body into the space. Bodies are ordered by name, so the order of adding does not matter."""
        self._space.add(body)
        insort(self._movers, body, key=lambda one: one.name)

    def _take_away(self, body: Body) -> None:
        """Remove a body from the space."""
        self._space.remove(body)
        self._movers.remove(body)

    def remove(self, name: str) -> None:
        """Remove an entity and its faults.

        Raises:
            SimulationError: no entity has this name.
        """
        entity = self._entity(name)
        if isinstance(entity, Robot) and name in self._held:
            self._let_go(name)
        if isinstance(entity, Body) and entity in self._movers:
            self._take_away(entity)
        for robot in [robot for robot, one in self._held.items() if one is entity]:
            del self._held[robot]
            self._gripper(robot).holds = ''
        del self._entities[name]
        del self._of_kind[type(entity)][name]
        self._begun.difference_update(self._faults.pop(name, {}).values())
        self._next_reading = 0.0
        if isinstance(entity, Station | Zone):  # no robot is in it any more, even if it was the last one
            self._find_zones()
            self._charge()

    def move(self, name: str, pose: Pose) -> None:
        """Put an entity at a pose and stop it; a robot that holds it releases it.

        Raises:
            SimulationError: no entity has this name, there is no room, or a station or a zone would be outside the
                map.
        """
        entity = self._entity(name)
        check_pose(pose)
        if isinstance(entity, Body):
            self._check(entity, pose)
            for robot in [robot for robot, one in self._held.items() if one is entity]:
                self._let_go(robot)
            entity.place(pose)
            self._space.changed(entity)
            self._carry()
        else:
            self._check_marking(entity, pose)
            entity.place(pose)

    def check_place(self, name: str, pose: Pose) -> None:
        """Check that a robot or an obstacle fits at a pose.

        Raises:
            SimulationError: it does not; the message says why.
        """
        entity = self._entity(name)
        if isinstance(entity, Body):
            self._check(entity, pose)

    def _check(self, body: Body, pose: Pose) -> None:
        check_pose(pose)
        is_robot = isinstance(body, Robot)
        near = self._space.touching(pose.x, pose.y, body.radius)
        others = near if is_robot else [one for one in near if isinstance(one, Robot)]
        self._space.check(body, pose, others, on_map=is_robot)

    def _check_marking(self, marking: Station | Zone, pose: Pose) -> None:
        """Check that the pose of a station, or a part of a zone there, is on the map."""
        self._space.check_on_map(pose, marking.shape if isinstance(marking, Zone) else None)

    def grip(self, robot: str) -> str:
        """Make a robot pick up the nearest obstacle that fits its gripper; return the obstacle's name.

        Raises:
            SimulationError: the robot has no gripper, holds something, or nothing is in its reach.
        """
        gripper, pose = self._gripper(robot), self.robots[robot].pose
        if robot in self._held:
            raise SimulationError(f'{robot} holds {self._held[robot].name}; open the gripper first')
        reach, opening = gripper.model.reach, gripper.model.opening
        resting = [one for one in self.obstacles.values() if not one.is_mobile and one not in self._held.values()]
        near = [one for one in resting if one.pose.distance(pose) <= reach and one.radius <= opening]
        if not near:
            raise SimulationError(f'nothing that the gripper of {robot} can take is within its reach of {reach:g} m')
        thing = min(near, key=lambda one: (one.pose.distance(pose), one.name))
        self._take_away(thing)
        self._held[robot] = thing
        self._carry()
        gripper.holds = thing.name
        return thing.name

    def release(self, robot: str) -> str:
        """Make a robot put down the obstacle that it holds, straight ahead; return the obstacle's name.

        Raises:
            SimulationError: the robot has no gripper, holds nothing, or there is no room.
        """
        gripper = self._gripper(robot)
        thing = self._held.get(robot)
        if thing is None:
            raise SimulationError(f'{robot} holds nothing')
        pose = compose(self.robots[robot].pose, Pose(gripper.model.reach, 0.0, 0.0))
        self._space.check(thing, pose, self._space.touching(pose.x, pose.y, thing.radius), on_map=True)
        self._let_go(robot)
        thing.place(pose)
        self._space.changed(thing)
        return thing.name

    def _gripper(self, robot: str) -> Gripper:
        one = self._entity(robot)
        if not isinstance(one, Robot) or (gripper := one.device(Gripper)) is None:
            raise SimulationError(f'{robot} has no gripper')
        return gripper

    def _carry(self) -> None:
        """Put each obstacle that a robot holds at the robot's position."""
        for robot, thing in self._held.items():
            thing.pose = self.robots[robot].pose

    def _let_go(self, robot: str) -> None:
        """Put the obstacle that a robot holds back into the world, at the robot's position."""
        thing = self._held.pop(robot)
        self._gripper(robot).holds = ''
        self._bring(thing)

    def reset(self) -> None:
        """Reset every entity to its state when it was added, including the random numbers.

        Time and faults continue.

        Raises:
            SimulationError: a robot would overlap something that was added since; nothing is changed.
        """
        bodies = (*self._movers, *self._held.values())
        starts = [Body(one.name, one.start_shape, one.start) for one in bodies]
        places = BodyGrid(starts, 0.0)
        for start in starts:
            if start.name in self.robots:
                others = places.touching(start.pose.x, start.pose.y, start.radius)
                try:
                    self._space.check(start, start.pose, others, on_map=False)
                except SimulationError as error:
                    raise SimulationError(f'nothing was reset: at the start {error}; remove one of the two') from None
        for robot in list(self._held):
            self._let_go(robot)
        for entity in self._entities.values():
            entity.reset()
        self._next_reading = 0.0
        self._space.changed(*self._movers)

    def _entity(self, name: str) -> Entity:
        if name not in self._entities:
            raise SimulationError(f"there is no '{name}' in the world{did_you_mean(name, self._entities)}")
        return self._entities[name]

    # -- faults ------------------------------------------------------------------------------------------------------

    def set_fault(
        self, entity: str, fault: str, parameters: Mapping[str, Any] | None = None, after: float = 0.0,
        duration: float = 0.0,
    ) -> Fault:  # fmt: skip
        """Schedule a fault after a simulated time, s, and for a duration, s; 0: until it is cleared.

        It replaces an active or scheduled fault of the entity in the same slot: one with the same name and, for a fault
        of a server or a topic, of the same server or topic.

        Raises:
            SimulationError: the entity or fault does not exist, the entity cannot have it, or a value is wrong.
        """
        values = fault_parameters(fault, parameters or {})
        one = self._entity(entity)
        kind = type(one).__name__.lower()
        if kind not in values.entities:
            raise SimulationError(f"{fault}: '{entity}' is a {kind}; a {' or a '.join(values.entities)} can have it")
        if isinstance(one, Robot) and values.part and not getattr(one.model, values.part):
            raise SimulationError(f"{fault}: '{entity}' has no {values.part}")
        if not (0.0 <= after < math.inf and 0.0 <= duration < math.inf):
            raise SimulationError(f'{fault}: after {after:g} s for {duration:g} s; give times that are not negative')
        if (before := self._faults.get(entity, {}).get(values.slot)) is not None:
            self._end(before)
        begins = self.time + after
        made = Fault(entity, values, begins, begins + duration if duration else math.inf)
        self._faults.setdefault(entity, {})[values.slot] = made
        self._run(made)
        return made

    def clear_fault(self, entity: str, fault: str = '') -> int:
        """End or unschedule a fault of an entity, or all if the name is empty; return their number.

        Raises:
            SimulationError: the entity or fault does not exist.
        """
        self._entity(entity)
        if fault:
            check_fault_name(fault)
        ended = [one for one in self._faults.get(entity, {}).values() if fault in ('', one.name)]
        for one in ended:
            self._end(one)
        return len(ended)

    def _run(self, one: Fault) -> None:
        """Begin or end a fault when it is due."""
        now = self.time + 1e-9
        entity = self._entities[one.entity]
        if one.begins <= now and one not in self._begun:
            self._begun.add(one)
            if isinstance(entity, Robot):
                entity.begin(one.parameters.slot, one.parameters)
            elif isinstance(entity, Door) and isinstance(one.parameters, DoorJammed):
                entity.jammed = one.parameters.where
        if one.ends <= now:
            self._end(one)

    def _end(self, one: Fault) -> None:
        of_entity = self._faults[one.entity]
        del of_entity[one.parameters.slot]
        if not of_entity:
            del self._faults[one.entity]
        if one in self._begun:
            self._begun.remove(one)
            entity = self._entities[one.entity]
            if isinstance(entity, Robot):
                entity.end(one.parameters.slot)
            elif isinstance(entity, Door):
                entity.jammed = None

    # -- time --------------------------------------------------------------------------------------------------------

    def step(self, duration: float | None = None) -> None:
        """Advance the simulated time, s, by default by one step. A longer time is split into steps and a remainder.

        Raises:
            SimulationError: the duration is negative or not finite.
        """
        if duration is None:
            self._tick(round(self.step_size * 1e9))
            return
        if not 0.0 <= duration < math.inf:
            raise SimulationError(f'{duration} s cannot pass')
        left, longest = round(duration * 1e9), round(self.step_size * 1e9)
        while left > 0:
            self._tick(min(left, longest))
            left -= longest

    def _tick(self, nanoseconds: int) -> None:
        for one in self.faults:
            self._run(one)
        duration = nanoseconds * 1e-9
        self._space.begin(self.time, duration)
        for body in self._movers:
            body.tick(self._space, duration)
        self._carry()
        self._nanoseconds += nanoseconds
        if self.zones:
            self._find_zones()
        if self.stations:
            self._charge()
        self._sense()

    def _find_zones(self) -> None:
        for robot in self.robots.values():
            x, y, _ = robot.pose
            inside = [zone for zone in self.zones.values() if zone.contains(x, y)]
            names = tuple(zone.name for zone in inside)
            if names != robot.zones:
                slow = min((zone.model.speed for zone in inside if zone.model.kind == 'slow'), default=math.inf)
                forbidden = sum(one.model.kind == 'no_go' and one.name not in robot.zones for one in inside)
                shadow = any(zone.model.kind == 'sensor_shadow' for zone in inside)
                robot.enter(names, slow, forbidden, in_shadow=shadow)

    def _charge(self) -> None:
        for robot in self.robots.values():
            if robot.battery is not None:
                rests = robot.linear == robot.angular == 0.0
                robot.battery.is_charging = rests and any(
                    robot.pose.distance(station.pose) <= station.model.reach for station in self.stations.values()
                )

    def _sense(self) -> None:
        """Measure with the sensors that are due; all beams are cast together."""
        now = self.time
        if now + 1e-9 < self._next_reading:
            return
        sensors = [one for robot in self.robots.values() for one in robot.sensors]
        due = [one for one in sensors if one.comes_due(now)]
        self._next_reading = min((one.due for one in sensors), default=math.inf)
        ranges: dict[Sensor, Floats] = {}
        if casting := [one for one in due if one.casts]:
            numbers = {body.name: number for number, body in enumerate(self._movers)}
            beams = [one.beams(numbers[one.robot.name]) for one in casting]
            ranges = dict(zip(casting, self._rays.cast(beams, outlines(self._movers)), strict=True))
        for one in due:
            one.take(now, ranges.get(one))

    # -- state -------------------------------------------------------------------------------------------------------

    def state(self, name: str) -> EntityState:
        """Return the state of an entity.

        Raises:
            SimulationError: no entity has this name.
        """
        entity = self._entity(name)
        kind = type(entity).__name__.lower()
        faults = tuple(self.active_faults(name))
        if isinstance(entity, Robot):
            linear, angular = entity.twist
            return EntityState(
                name, kind, entity.pose, (linear, 0.0), angular, faults, entity.odometry,
                entity.estimate, entity.in_contact,
                {key: one.state for key, one in entity.devices.items() if one.state is not None},
            )  # fmt: skip
        if isinstance(entity, Obstacle):
            return EntityState(name, kind, entity.pose, entity.velocity, faults=faults)
        opening = entity.opening if isinstance(entity, Door) else None
        return EntityState(name, kind, entity.pose, faults=faults, opening=opening)

    def snapshot(self) -> WorldSnapshot:
        """Return the state of all entities."""
        return WorldSnapshot(self.time, tuple(map(self.state, self._entities)))


def prepare_world() -> None:
    """Load the compiled loops of a world, or compile them on the first start of a computer, which takes some
    seconds."""
    cells = numpy.zeros((20, 20), numpy.int8)
    cells[0] = 100
    world = World(OccupancyMap(cells, 0.1, Pose(0.0, 0.0, 0.0)))
    for name, shape, x in (('round', Circle(0.2), 0.5), ('square', box(0.4, 0.4), 1.5)):
        world.add(name, RobotModel(footprint=shape), Pose(x, 0.301, 0.0)).command(0.1, 0.1, 0.0)  # close to the wall
    for _ in range(3):
        world.step()
