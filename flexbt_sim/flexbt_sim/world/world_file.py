# SPDX-License-Identifier: BSD-3-Clause
"""World files: reading, checking with the place of each problem, and conversion to models; and floor plans."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy
import yaml
from numpy.typing import NDArray

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.text_files import TextFileError, read_text
from flexbt_core.values.yaml_data import YamlError, compose_yaml, construct_yaml
from flexbt_sim.errors import MapError, SimulationError, WorldError
from flexbt_sim.world.plane.geometry import Point, Pose
from flexbt_sim.world.plane.occupancy_map import FREE, MAX_CELLS, OCCUPIED, OccupancyMap, load_map
from flexbt_sim.world.specification import NAME, ModelSpecification, WorldProblem, convert, key, keys_of, names, read
from flexbt_sim.world.specification import Path as Where

from .faults import FAULTS, FaultTiming
from .models import MODELS, STEP, DoorModel, ObstacleModel, RobotModel, StationModel, ZoneModel

MAX_BYTES: Final = 2_000_000


@dataclass(frozen=True)
class WorldModel(ModelSpecification):
    """The top level of a world file. Paths to maps and worlds of other packages are relative to this file."""

    title: ClassVar[str] = 'world'

    map: str | None = key('map file for map_server (YAML), relative to the world file', None)
    plan: FloorPlan | None = key('rooms and walls, in place of a map file', None)
    seed: int = key('seed for all random numbers', 0, low=0, high=2**53)
    step: float = key('maximum simulation step; speeds are constant during a step', STEP, unit='s', low=0.001, high=1.0)


_ENTITIES: Final[Mapping[str, type[ModelSpecification]]] = {
    'obstacles': ObstacleModel, 'doors': DoorModel, 'stations': StationModel, 'zones': ZoneModel,
}  # fmt: skip
SECTIONS: Final[Mapping[str, str]] = {
    'models': 'robot models by name; a model inherits omitted keys from its `based_on` model',
    'robots': 'robots by name: `pose`, `model`, and keys that override the model',
    'obstacles': 'obstacles by name',
    'doors': 'doors by name',
    'stations': 'charging stations by name',
    'zones': 'zones by name',
    'places': 'named poses: NAME: [x, y, yaw]',
    'faults': 'list of faults with their times',
}
"""The keys of a world file in addition to those of :class:`WorldModel`."""


class WorldFile:
    """The contents of a world file: the map, and entities and faults in their order, each with its place in the file.

    Raises:
        WorldError: the file is invalid. The error lists every problem, with line and remedy.
    """

    def __init__(
        self, file: Path, text: str | None = None, pose: Pose | None = None, *, with_map: bool = False
    ) -> None:  # fmt: skip
        """``text`` replaces the contents of the file. ``pose`` is the default pose of robots. ``map`` is read or drawn,
        which may take seconds, only if requested."""
        self._file = file
        self._pose = pose
        self._problems: list[WorldProblem] = []
        self._marks: dict[Where, tuple[int, int]] = {}
        self._data = self._load(text)
        self.model = self._read_model()
        self.places = self._read_places()
        self.entities = self._read_entities()
        self.faults = self._read_faults()
        self.map = self._read_map() if with_map else None
        self.finish()

    def _load(self, text: str | None) -> Any:
        try:
            node = compose_yaml(read_text(self._file, MAX_BYTES) if text is None else text, aliases=True)
            if node is None:
                return {}
            _mark(node, (), self._marks, self._problems)
            return construct_yaml(node)
        except TextFileError as error:
            raise WorldError([f'{self._file}: cannot be read: {error}; give a world file']) from error
        except YamlError as error:
            raise WorldError([f'{self._file}:{error.line}:{error.column}: {error.reason}']) from error

    def attempt(self, path: Where, action: Callable[..., object], *arguments: Any) -> None:
        """Run an action for a place of the file; an error becomes a problem of the file there."""
        try:
            action(*arguments)
        except SimulationError as error:
            self._problems.append(WorldProblem(path, str(error)))

    def finish(self) -> None:
        """Raise the problems found so far as a WorldError."""
        if self._problems:
            raise WorldError([_line(self._file, one, self._marks) for one in self._problems])

    # -- reading -----------------------------------------------------------------------------------------------------

    def _read_model(self) -> WorldModel:
        data = self._data
        if not isinstance(data, Mapping):
            self._problems.append(
                WorldProblem((), f'expected a mapping with {names(SECTIONS)}, got {short_repr(data)}')
            )
            self._data = {}
            return WorldModel()
        known = [*keys_of(WorldModel), *SECTIONS]
        for word in data:
            if word not in known:
                self._problems.append(WorldProblem((word,), f'there is no such key{did_you_mean(word, known)}'))
        top = {word: value for word, value in data.items() if word in keys_of(WorldModel)}
        return read(WorldModel, top, (), self._problems) or WorldModel()

    def _read_places(self) -> dict[str, Pose]:
        return {name: convert(Pose, value, ('places', name), self._problems) for name, value in self._section('places')}

    def _read_entities(self) -> list[tuple[Where, str, Any, Pose | None]]:
        """Return, for each entity, its place in the file, name, model and pose."""
        return [*self._robots(), *self._others()]

    def _section(self, section: str) -> list[tuple[str, Any]]:
        """Return the entries of a section that have valid names."""
        data = self._data.get(section)
        if data is None:
            return []
        if not isinstance(data, Mapping):
            self._problems.append(WorldProblem((section,), f'expected a mapping of names, got {short_repr(data)}'))
            return []
        entries = []
        for name, value in data.items():
            if isinstance(name, str) and NAME.fullmatch(name):
                entries.append((name, value))
            else:
                text = 'cannot be a name: give letters, digits and _, a letter first, at most 63'
                self._problems.append(WorldProblem((section, name), text))
        return entries

    def _read_map(self) -> OccupancyMap | None:
        model = self.model
        if model.map is not None and model.plan is not None:
            self._problems.append(WorldProblem(('map',), "there is a 'plan' too; leave one of them out"))
            return None
        if model.plan is not None:
            return model.plan.drawn()
        if model.map is None:
            return None
        try:
            return load_map(self._file.parent / model.map)
        except MapError as error:
            self._problems.append(WorldProblem(('map',), str(error)))
            return None

    def _models(self) -> dict[str, RobotModel]:
        models = dict(MODELS)
        for name, value in self._section('models'):
            made = self._model(value, ('models', name), models, 'based_on')
            models[name] = made or RobotModel()  # models based on an invalid one are not reported for that
        return models

    def _model(
        self, value: Any, path: Where, models: Mapping[str, RobotModel], base_key: str, *beside: str
    ) -> RobotModel | None:
        """Return a robot model, based on the one that ``base_key`` names; the keys ``beside`` it are for the caller."""
        if not isinstance(value, Mapping):
            self._problems.append(WorldProblem(path, f'expected a mapping, got {short_repr(value)}'))
            return None
        base = value.get(base_key, 'waffle')
        if not isinstance(base, str) or base not in models:
            self._problems.append(
                WorldProblem(
                    (*path, base_key), f'there is no model {short_repr(base)} before this{did_you_mean(base, models)}'
                )
            )
            return None
        return read(RobotModel, value, path, self._problems, models[base], (base_key, *beside))

    def _robots(self) -> list[tuple[Where, str, Any, Pose | None]]:
        models = self._models()
        robots: list[tuple[Where, str, Any, Pose | None]] = []
        for name, value in self._section('robots'):
            path: Where = ('robots', name)
            model = self._model(value, path, models, 'model', 'pose')
            if model is None:
                continue
            pose = self._pose
            if 'pose' in value:
                pose = convert(Pose, value['pose'], (*path, 'pose'), self._problems)
            elif pose is None:
                self._problems.append(WorldProblem(path, "'pose' is missing: where it is at the start, [x, y, yaw]"))
                continue
            robots.append((path, name, model, pose))
        return robots

    def _others(self) -> list[tuple[Where, str, Any, Pose | None]]:
        return [
            ((section, name), name, read(specification, value, (section, name), self._problems), None)
            for section, specification in _ENTITIES.items()
            for name, value in self._section(section)
        ]

    def _read_faults(self) -> list[tuple[Where, FaultTiming, Mapping[str, Any]]]:
        """Return, for each fault, its place in the file, timing and parameters."""
        entries = self._data.get('faults') or []
        if not isinstance(entries, list):
            self._problems.append(WorldProblem(('faults',), f'expected a list, got {short_repr(entries)}'))
            return []
        faults: list[tuple[Where, FaultTiming, Mapping[str, Any]]] = []
        for i, entry in enumerate(entries):
            path: Where = ('faults', i)
            parameters: Any = (entry.get('parameters') or {}) if isinstance(entry, Mapping) else {}
            timing = read(FaultTiming, entry, path, self._problems, beside=('parameters',))
            if timing is not None and read(FAULTS[timing.fault], parameters, (*path, 'parameters'), self._problems):
                faults.append((path, timing, parameters))
        return faults


_MERGE: Final = 'tag:yaml.org,2002:merge'


def _mark(node: yaml.Node, path: Where, marks: dict[Where, tuple[int, int]], problems: list[WorldProblem]) -> None:
    """Record the position of each value: line and column of its key or, in a list, of the value itself."""
    marks.setdefault(path, (node.start_mark.line + 1, node.start_mark.column + 1))
    if isinstance(node, yaml.MappingNode):
        seen = set[str]()
        for key_node, value in node.value:
            if key_node.tag == _MERGE:  # <<: *others, which the keys here override
                for merged in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                    _mark(merged, path, marks, problems)
                continue
            word: Any = construct_yaml(key_node) if isinstance(key_node, yaml.ScalarNode) else '?'
            marks[*path, word] = (key_node.start_mark.line + 1, key_node.start_mark.column + 1)
            if str(word) in seen:
                problems.append(WorldProblem((*path, word), 'is there twice; leave one of them out'))
            seen.add(str(word))
            _mark(value, (*path, word), marks, problems)
    elif isinstance(node, yaml.SequenceNode):
        for i, one in enumerate(node.value):
            _mark(one, (*path, i), marks, problems)


def _line(file: Path, problem: WorldProblem, marks: Mapping[Where, tuple[int, int]]) -> str:
    path = problem.path
    while path not in marks and path:
        path = path[:-1]
    line, column = marks.get(path, (1, 1))
    where = f'{problem.where}: ' if problem.path else ''
    return f'{file}:{line}:{column}: {where}{problem.message}'


# Rooms and walls of a world file, drawn as an occupancy map.

MAX_PARTS: Final = 5000
PIECE: Final = 32
"""Maximum extent, in cells, of a piece of a wall along its shorter axis."""


@dataclass(frozen=True)
class Opening(ModelSpecification):
    """A gap in the walls."""

    title: ClassVar[str] = 'opening'

    at: Point = key('center: [x, y]', unit='m')
    width: float = key('width of the opening', 1.0, unit='m', low=0.05, high=100.0)


@dataclass(frozen=True)
class Room(ModelSpecification):
    """A rectangular room. The center lines of its four walls follow the rectangle."""

    title: ClassVar[str] = 'room'

    from_: Point = key('one corner: [x, y]', unit='m')
    to: Point = key('the opposite corner: [x, y]', unit='m')

    @property
    def walls(self) -> tuple[Point, ...]:
        """Walls of the map as one line."""
        (x0, y0), (x1, y1) = self.from_, self.to
        return (x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)


@dataclass(frozen=True)
class FloorPlan(ModelSpecification):
    """Rooms, walls and openings. Openings are cut after all walls are drawn, so their order does not matter."""

    title: ClassVar[str] = 'plan'

    rooms: tuple[Room, ...] = key('rooms; neighbors share a wall where their edges coincide', ())
    walls: tuple[tuple[Point, ...], ...] = key(
        'additional walls, each a line through points: [[x, y], [x, y], ...]', (), unit='m'
    )
    openings: tuple[Opening, ...] = key('gaps in the walls, for doors and passages', ())
    thickness: float = key('thickness of the walls, at least that of a cell', 0.1, unit='m', low=0.01, high=10.0)
    resolution: float = key('cell size of the resulting map', 0.05, unit='m', low=0.005, high=10.0)
    margin: float = key('free space around the plan on the map', 0.5, unit='m', low=0.0, high=100.0)

    def conflicts(self) -> Iterable[str]:
        parts = len(self.rooms) + len(self.openings) + sum(map(len, self.walls))
        if not 0 < parts <= MAX_PARTS or not (self.rooms or self.walls):
            yield f'give rooms or walls, {MAX_PARTS} parts at most'
            return
        if any(len(wall) < 2 for wall in self.walls):
            yield 'a wall has two points or more'
        rows, columns, _ = self._grid()
        if rows * columns > MAX_CELLS:
            yield f'{rows} x {columns} cells; a map has at most {MAX_CELLS}: a coarser resolution needs fewer'

    def _lines(self) -> list[tuple[Point, ...]]:
        return [*(room.walls for room in self.rooms), *self.walls]

    def _grid(self) -> tuple[int, int, Point]:
        points = [point for line in self._lines() for point in line]
        border = self.margin + self.thickness / 2.0
        left, bottom = min(x for x, _ in points) - border, min(y for _, y in points) - border
        width, height = max(x for x, _ in points) + border - left, max(y for _, y in points) + border - bottom
        return math.ceil(height / self.resolution - 1e-6), math.ceil(width / self.resolution - 1e-6), (left, bottom)

    def drawn(self) -> OccupancyMap:
        """Return the map: cells whose centre is in a wall, and in no opening, are occupied. A wall without holes has at
        least the thickness of a cell."""
        rows, columns, (left, bottom) = self._grid()
        cells = numpy.full((rows, columns), FREE, numpy.int8)
        half = max(self.thickness, self.resolution) / 2.0 + 1e-9
        for line in self._lines():
            for start, end in pairwise(line):
                # Draw in pieces: a long oblique wall covers few of the cells in its bounding box.
                narrow = min(abs(a - b) for a, b in zip(start, end, strict=True)) / self.resolution
                ends = numpy.linspace(start, end, max(1, math.ceil(narrow / PIECE)) + 1)
                for piece in pairwise(ends.tolist()):
                    self._fill(cells, (left, bottom), (start, end), piece, half)
        for opening in self.openings:
            x, y = opening.at
            reach = opening.width / 2.0
            r0, r1 = (max(0, math.ceil((v - bottom) / self.resolution - 0.5 - 1e-6)) for v in (y - reach, y + reach))
            c0, c1 = (max(0, math.ceil((v - left) / self.resolution - 0.5 - 1e-6)) for v in (x - reach, x + reach))
            cells[r0:r1, c0:c1] = FREE
        return OccupancyMap(cells, self.resolution, Pose(left, bottom, 0.0))

    def _fill(
        self, cells: NDArray[numpy.int8], corner: Point, wall: tuple[Point, Point], piece: Sequence[Point], half: float
    ) -> None:  # fmt: skip
        """Draw a piece of a straight wall: all cells whose centre is within half the thickness of its centre line. The
        wall is longer by as much at both ends, so that corners are filled."""
        start, end = wall
        ends, reach = list(zip(*piece, corner, strict=True)), math.sqrt(2.0) * half
        left, bottom = (max(0, math.floor((min(a, b) - reach - c) / self.resolution)) for a, b, c in ends)
        right, top = (math.ceil((max(a, b) + reach - c) / self.resolution) for a, b, c in ends)
        part = cells[bottom : top + 1, left : right + 1]
        x = corner[0] + (left + numpy.arange(part.shape[1]) + 0.5) * self.resolution - start[0]
        y = corner[1] + (bottom + numpy.arange(part.shape[0])[:, None] + 0.5) * self.resolution - start[1]
        length = math.dist(start, end)
        ux, uy = ((end[0] - start[0]) / length, (end[1] - start[1]) / length) if length else (1.0, 0.0)
        beyond = numpy.abs(x * ux + y * uy - length / 2.0) - length / 2.0
        away = numpy.maximum(numpy.abs(x * uy - y * ux), beyond)
        part[away <= half] = OCCUPIED
