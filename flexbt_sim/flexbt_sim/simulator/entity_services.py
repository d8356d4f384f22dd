# SPDX-License-Identifier: BSD-3-Clause
"""The services of simulation_interfaces that spawn, delete, move and list entities, with filters for their names.

An entity is described as in a world file: a mapping of one section with one entry, ``robots: {beta: {model: burger}}``.
Each kind of entity is also a tag.
"""

from __future__ import annotations

import functools
import itertools
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from geometry_msgs.msg import Pose as PoseMessage
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace
from simulation_interfaces.msg import (
    Bounds,
    EntityCategory,
    EntityFilters,
    EntityInfo,
    EntityState,
    NamedPose,
    Result,
    TagsFilter,
)
from simulation_interfaces.srv import (
    DeleteEntity,
    GetEntities,
    GetEntitiesStates,
    GetEntityInfo,
    GetEntityState,
    GetNamedPoses,
    SetEntityState,
    SpawnEntity,
)

from flexbt_common.errors import ResourceError
from flexbt_common.files import resolve_file
from flexbt_common.values.limits import check_limits
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr
from flexbt_sim.errors import SimulationError, WorldError
from flexbt_sim.messages import pose_message, pose_of
from flexbt_sim.world.models import RobotModel
from flexbt_sim.world.plane.geometry import Pose, compose, distance, touches_box
from flexbt_sim.world.plane.space import Body
from flexbt_sim.world.robot import Robot
from flexbt_sim.world.scenery import Entity, Zone
from flexbt_sim.world.specification import NAME
from flexbt_sim.world.world_file import WorldFile

from .core import SimulatorCore

WORLD_FRAME: Final = 'world'
"""Default frame of poses in the standard; here it is the map frame."""

LONGEST_NAMESPACE: Final = 150
"""Maximum length of a robot's namespace: names of topics have at most 247 characters."""

SUFFIXES: Final = ('.yaml', '.yml')


class ServiceRefusedError(SimulationError):
    """A refused request, with the ``code`` for its result."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


def answered(answer: Callable[[Any, Any], None]) -> Callable[[Any, Any], Any]:
    """Return a service callback that calls ``answer(request, response)`` and puts the code of its error into
    ``result``."""

    def callback(request: Any, response: Any) -> Any:
        response.result.result = Result.RESULT_OK
        try:
            check_limits(request)
            answer(request, response)
        except FlexbtError as error:
            response.result.result = (
                error.code if isinstance(error, ServiceRefusedError) else Result.RESULT_OPERATION_FAILED
            )
            response.result.error_message = str(error)
        return response

    return callback


class EntityServices:
    """The services for entities. Executor thread only."""

    def __init__(self, simulator: SimulatorCore) -> None:
        self._simulator = simulator
        node = simulator.runtime.node
        for service_type, name, answer in (
            (SpawnEntity, 'spawn_entity', self._spawn),
            (DeleteEntity, 'delete_entity', self._delete),
            (GetEntities, 'get_entities', self._list),
            (GetEntityInfo, 'get_entity_info', self._inform),
            (GetEntityState, 'get_entity_state', self._tell),
            (GetEntitiesStates, 'get_entities_states', self._tell_all),
            (SetEntityState, 'set_entity_state', self._move),
            (GetNamedPoses, 'get_named_poses', self._places),
        ):
            node.create_service(service_type, f'~/{name}', answered(answer))

    # -- spawn and delete --------------------------------------------------------------------------------------------

    def _spawn(self, request: Any, response: Any) -> None:
        codes = SpawnEntity.Response
        simulator = self._simulator
        placed = request.initial_pose
        pose = None
        if placed.header.frame_id or placed.pose != PoseMessage():
            pose = self._pose(placed.pose, placed.header.frame_id, codes.INVALID_POSE)
        described, model, own_pose = self._described(request, pose)
        name = self._free_name(request.name or described, request.allow_renaming)
        namespace = request.entity_namespace.strip('/')
        if namespace or isinstance(model, RobotModel):
            self._check_namespace(namespace or name)
        try:
            simulator.spawn(name, model, pose or own_pose, namespace)
        except SimulationError as error:
            raise ServiceRefusedError(codes.INVALID_POSE, str(error)) from None
        response.entity_name = name

    def _described(self, request: Any, pose: Pose | None) -> tuple[str, Any, Pose | None]:
        """Return the name, model and pose of the entity."""
        codes = SpawnEntity.Response
        text: str | None = None
        if request.uri:
            file = self._file(request.uri)
        elif request.resource_string:
            file, text = Path('resource_string'), request.resource_string
            if text.lstrip().startswith('<'):
                raise ServiceRefusedError(
                    codes.UNSUPPORTED_FORMAT, 'XML is not known here; give the YAML of a world file'
                )
        else:
            raise ServiceRefusedError(
                codes.NO_RESOURCE, 'uri and resource_string are empty; give the YAML of a world file'
            )
        try:
            entities = WorldFile(file, text, pose or Pose(0.0, 0.0, 0.0)).entities
        except WorldError as error:
            raise ServiceRefusedError(codes.RESOURCE_PARSE_ERROR, str(error)) from None
        if len(entities) != 1:
            raise ServiceRefusedError(
                codes.RESOURCE_PARSE_ERROR,
                f'{file}: {len(entities)} entities; give one, as in robots: {{beta: {{model: burger}}}}',
            )
        _, name, model, own_pose = entities[0]
        return name, model, own_pose

    @staticmethod
    def _file(uri: str) -> Path:
        codes = SpawnEntity.Response
        if not uri.endswith(SUFFIXES):
            raise ServiceRefusedError(
                codes.UNSUPPORTED_FORMAT, f'{short_repr(uri)} is not a YAML file: {", ".join(SUFFIXES)}'
            )
        try:
            return resolve_file(uri.removeprefix('package://'))
        except ResourceError as error:
            raise ServiceRefusedError(codes.NO_RESOURCE, f'{error}; files are package://PACKAGE/PATH') from None

    def _free_name(self, name: str, may_rename: bool) -> str:
        codes = SpawnEntity.Response
        if not NAME.fullmatch(name):
            raise ServiceRefusedError(
                codes.NAME_INVALID, f'{short_repr(name)} cannot be a name: give letters, digits and _, a letter first'
            )
        entities = self._simulator.world.entities
        if name not in entities:
            return name
        if not may_rename:
            raise ServiceRefusedError(codes.NAME_NOT_UNIQUE, f'there is a {name!r} already')
        number = next(number for number in range(1, len(entities) + 2) if f'{name}_{number}' not in entities)
        return self._free_name(f'{name}_{number}', may_rename=False)

    def _check_namespace(self, namespace: str) -> None:
        try:
            validate_namespace(f'/{namespace}')
        except InvalidNamespaceException as error:
            raise ServiceRefusedError(SpawnEntity.Response.NAMESPACE_INVALID, str(error)) from None
        around = self._simulator.runtime.node.get_namespace()
        if len(around) + len(namespace) > LONGEST_NAMESPACE:
            raise ServiceRefusedError(
                SpawnEntity.Response.NAMESPACE_INVALID,
                f'{short_repr(namespace)} has {len(namespace)} characters; with the namespace of the simulator '
                f'({around}) it may have {LONGEST_NAMESPACE}',
            )
        if not self._simulator.is_free_namespace(namespace):
            raise ServiceRefusedError(
                SpawnEntity.Response.NAMESPACE_INVALID, f'there is a robot in namespace {namespace!r} already'
            )

    def _delete(self, request: Any, _response: Any) -> None:
        entity = self._entity(request.entity)
        self._simulator.remove(entity)

    # -- state -------------------------------------------------------------------------------------------------------

    def _entity(self, name: str) -> Entity:
        entity = self._simulator.world.entities.get(name)
        if entity is None:
            raise ServiceRefusedError(Result.RESULT_NOT_FOUND, f'there is no {short_repr(name)} in the world')
        return entity

    def _pose(self, message: PoseMessage, frame: str, code: int) -> Pose:
        """Return the pose in the map. The frame is that of the map, or the name of an entity."""
        turned = message.orientation
        length = math.hypot(turned.x, turned.y, turned.z, turned.w)
        pose = pose_of(message)
        if not abs(length - 1.0) < 0.01 or not pose.is_place:
            raise ServiceRefusedError(
                code, 'the pose has numbers that are none, or a quaternion that is not of length 1'
            )
        if frame in ('', WORLD_FRAME, self._simulator.parameters.map_frame):
            return pose
        if frame not in self._simulator.world.entities:
            raise ServiceRefusedError(
                code, f'frame {short_repr(frame)} is not known; give the pose in that of the map or an entity'
            )
        return compose(self._simulator.world.entities[frame].pose, pose)

    def _move(self, request: Any, _response: Any) -> None:
        entity, state = self._entity(request.entity), request.state
        speeds = (state.twist.linear, state.twist.angular, state.acceleration.linear, state.acceleration.angular)
        if any(getattr(speed, axis) != 0.0 for speed in speeds for axis in 'xyz'):
            raise SimulationError(f'{request.entity}: speeds cannot be set; a robot is driven by cmd_vel')
        code = SetEntityState.Response.INVALID_POSE
        pose = self._pose(state.pose, state.header.frame_id, code)
        try:
            self._simulator.move(entity, pose)
        except SimulationError as error:
            raise ServiceRefusedError(code, str(error)) from None

    def _tell(self, request: Any, response: Any) -> None:
        self._entity(request.entity)
        with self._simulator.lock:
            response.state = self._state(request.entity)

    def _tell_all(self, request: Any, response: Any) -> None:
        with self._simulator.lock:
            response.entities = list(self._filtered(request.filters))
            response.states = [self._state(name) for name in response.entities]

    def _state(self, name: str) -> EntityState:
        state = self._simulator.world.state(name)
        message = EntityState(pose=pose_message(state.pose))
        message.header.frame_id = self._simulator.parameters.map_frame
        message.header.stamp = self._simulator.stamp()
        forward, sideways = state.linear
        yaw = state.pose.yaw if state.kind == 'robot' else 0.0
        message.twist.linear.x = forward * math.cos(yaw) - sideways * math.sin(yaw)
        message.twist.linear.y = forward * math.sin(yaw) + sideways * math.cos(yaw)
        message.twist.angular.z = float(state.angular)
        return message

    # -- queries -----------------------------------------------------------------------------------------------------

    def _list(self, request: Any, response: Any) -> None:
        with self._simulator.lock:
            response.entities = list(self._filtered(request.filters))

    def _inform(self, request: Any, response: Any) -> None:
        entity = self._entity(request.entity)
        kind = _kind(entity)
        with self._simulator.lock:
            faults = ', '.join(self._simulator.world.active_faults(request.entity))
        description = f'{kind} {request.entity}' + (f', with faults: {faults}' if faults else '')
        response.info = EntityInfo(
            category=EntityCategory(category=_category(entity)), description=description, tags=[kind]
        )

    def _filtered(self, filters: EntityFilters) -> Iterator[str]:
        matches = NameFilter(filters.filter)
        categories = {one.category for one in filters.categories}
        is_there = _bounded(filters.bounds)
        for name, entity in self._simulator.world.entities.items():
            if (
                matches(name)
                and (not categories or _category(entity) in categories)
                and _has_tags(filters.tags, (_kind(entity),))
                and is_there(entity)
            ):
                yield name

    def _places(self, request: Any, response: Any) -> None:
        response.poses = [
            NamedPose(name=name, pose=pose_message(pose))
            for name, pose in self._simulator.world.places.items()
            if _has_tags(request.tags, ())
        ]


def _kind(entity: Entity) -> str:
    return type(entity).__name__.lower()


def _category(entity: Entity) -> int:
    if isinstance(entity, Robot):
        return int(EntityCategory.CATEGORY_ROBOT)
    if isinstance(entity, Zone):
        return int(EntityCategory.CATEGORY_OBJECT)
    moves = isinstance(entity, Body) and entity.top_speed > 0.0
    return int(EntityCategory.CATEGORY_DYNAMIC_OBJECT if moves else EntityCategory.CATEGORY_STATIC_OBJECT)


def _has_tags(wanted: TagsFilter, tags: tuple[str, ...]) -> bool:
    if not wanted.tags:
        return True
    every = all if wanted.filter_mode == TagsFilter.FILTER_MODE_ALL else any
    return every(tag in tags for tag in wanted.tags)


def _bounded(bounds: Bounds) -> Callable[[Entity], bool]:
    """Return a test whether an entity touches bounds, which may have any size, in the plane."""
    if bounds.type == Bounds.TYPE_EMPTY:
        return lambda _: True
    if bounds.type not in (Bounds.TYPE_SPHERE, Bounds.TYPE_BOX):
        raise ServiceRefusedError(Result.RESULT_FEATURE_UNSUPPORTED, 'bounds are a box or a sphere here')
    points = [(point.x, point.y) for point in bounds.points]
    if not all(math.isfinite(number) for point in points for number in point):
        raise SimulationError('bounds have numbers that are none')
    if len(points) != 2 or (bounds.type == Bounds.TYPE_SPHERE and points[1][0] < 0.0):
        raise SimulationError('bounds have two points: corners of a box, or the centre of a sphere and (radius, 0, 0)')
    one, other = points
    if bounds.type == Bounds.TYPE_SPHERE:
        return lambda entity: distance(entity.shape, entity.pose, *one) <= other[0]
    (left, right), (bottom, top) = (sorted(ends) for ends in zip(one, other, strict=True))
    return lambda entity: touches_box(entity.shape, entity.pose, (left, bottom), (right, top))


# POSIX extended regular expressions for names, matched in a time bounded by the lengths of expression and name.
#
# The expression comes from another process. For some expressions, Python's ``re`` backtracks for hours and cannot be
# stopped. Here, each part computes once, for each position in a name, where a match of it may end.

MAX_GROUPS: Final = 100

_CLASSES: Final = {
    'alpha': 'A-Za-z', 'digit': '0-9', 'alnum': 'A-Za-z0-9', 'upper': 'A-Z', 'lower': 'a-z', 'xdigit': '0-9A-Fa-f',
    'space': r'\s', 'blank': r' \t', 'punct': r'!-/:-@\[-`{-~',
}  # fmt: skip

_Part = Callable[[str, int], set[int]]
"""A part of an expression: returns the positions in a name where a match that begins at a position may end."""


class NameFilter:
    """A filter that matches whole names by ``pattern``; an empty pattern matches every name.

    Raises:
        SimulationError: the pattern is invalid or has too many groups.
    """

    def __init__(self, pattern: str) -> None:
        self._pattern = pattern
        self._at = 0
        self._known: dict[tuple[_Part, int], set[int]] = {}
        self._whole = self._alternatives()
        if self._at < len(pattern):
            raise self._error(f'{pattern[self._at]!r} has no beginning')

    def __call__(self, name: str) -> bool:
        """Return whether the name matches."""
        self._known.clear()
        return not self._pattern or len(name) in self._after(self._whole, name, {0})

    def _after(self, part: _Part, name: str, starts: set[int]) -> set[int]:
        """Return where a match of a part may end that begins at one of several positions."""
        ends: set[int] = set()
        for start in starts:
            if (part, start) not in self._known:
                self._known[part, start] = part(name, start)
            ends |= self._known[part, start]
        return ends

    # -- reading the expression --------------------------------------------------------------------------------------

    def _error(self, problem: str) -> SimulationError:
        return SimulationError(
            f'{short_repr(self._pattern)} is not an extended regular expression, at {self._at}: {problem}'
        )

    def _next(self) -> str:
        return self._pattern[self._at : self._at + 1]

    def _alternatives(self) -> _Part:
        ways = [self._sequence()]
        while self._next() == '|':
            self._at += 1
            ways.append(self._sequence())
        return lambda name, start: set().union(*(self._after(way, name, {start}) for way in ways))

    def _sequence(self) -> _Part:
        parts: list[_Part] = []
        while self._next() not in ('', '|', ')'):
            part = self._atom()
            parts.append(self._repeated(part) if self._next() in ('*', '+', '?', '{') else part)

        def ends(name: str, start: int) -> set[int]:
            return functools.reduce(lambda reached, part: self._after(part, name, reached), parts, {start})

        return ends

    def _atom(self) -> _Part:
        character = self._next()
        self._at += 1
        if character == '(':
            if self._pattern[: self._at].count('(') > MAX_GROUPS:
                raise self._error('too many groups')
            part = self._alternatives()
            if self._next() != ')':
                raise self._error("')' is missing")
            self._at += 1
            return part
        if character in ('*', '+', '?', '{'):
            raise self._error('there is nothing to repeat')
        if character in ('^', '$'):
            return lambda name, start: {start} if start == (0 if character == '^' else len(name)) else set()
        if character == '.':
            return _one(lambda _: True)
        if character == '[':
            return _one(self._bracket())
        if character == '\\':
            character = self._next()
            self._at += 1
        if not character:
            raise self._error('nothing comes after the backslash')
        return _one(character.__eq__)

    def _bracket(self) -> Callable[[str], bool]:
        end = self._pattern.find(']', self._at + (2 if self._next() == '^' else 1))
        while end >= 0 and self._pattern[self._at : end].rfind('[:') > self._pattern[self._at : end].rfind(':]'):
            end = self._pattern.find(']', end + 1)
        if end < 0:
            raise self._error("']' is missing")
        inside, self._at = self._pattern[self._at : end], end + 1
        negated = '^' if inside.startswith('^') else ''
        inside = inside.removeprefix('^').replace('\\', r'\\').replace('[', r'\[').replace(']', r'\]')
        inside = re.sub(r'\\\[:(\w+):(?:\\\])?', lambda found: _CLASSES.get(found[1], ''), inside)
        try:
            one_of = re.compile(f'[{negated}{inside}]')
        except re.error as error:
            raise self._error(str(error)) from None
        return lambda character: one_of.match(character) is not None

    def _repeated(self, part: _Part) -> _Part:
        least, most = self._bounds()

        def ends(name: str, start: int) -> set[int]:
            found: set[int] = set()
            reached = {start}
            for count in itertools.count():
                if count >= least:
                    reached -= found  # matches from positions found earlier are known already
                    found |= reached
                if not reached or count == most:
                    break
                before, reached = reached, self._after(part, name, reached)
                if before == reached:  # and so it is after any more repetitions
                    return found | reached
            return found

        return ends

    def _bounds(self) -> tuple[int, int | None]:
        character = self._next()
        self._at += 1
        if character != '{':
            return {'*': (0, None), '+': (1, None), '?': (0, 1)}[character]
        found = re.compile(r'(\d{1,3})(,?)(\d{0,3})\}').match(self._pattern, self._at)
        if found is None:
            raise self._error('give {least,most} of at most 999')
        self._at = found.end()
        least = int(found[1])
        most = int(found[3]) if found[3] else None if found[2] else least
        if most is not None and most < least:
            raise self._error(f'{most} is less than {least}')
        return least, most


def _one(test: Callable[[str], bool]) -> _Part:
    """Return a part that matches one character."""
    return lambda name, start: {start + 1} if start < len(name) and test(name[start]) else set()
