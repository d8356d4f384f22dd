# SPDX-License-Identifier: BSD-3-Clause
"""The keys of world files: frozen dataclasses whose fields have bounds and a meaning, and how they are read.

The same declarations check files, requests at run time and objects made in Python, and the reference is written from
them.
"""

from __future__ import annotations

import dataclasses
import functools
import re
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, TypeVar

from flexbt_core.values.json_data import finite_number
from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.plane.geometry import FARTHEST, MAX_CORNERS, Circle, Polygon, Pose, Shape, box

NAME: Final = re.compile(r'[A-Za-z][A-Za-z0-9_]{0,62}')
"""Names of entities: a robot's is its ROS namespace."""

_WIDTH: Final = 300
"""Characters of a path that people are shown."""

Path = tuple[str | int, ...]
"""Path to a value: keys and indices."""

S = TypeVar('S', bound='ModelSpecification')

_type_hints: Callable[[Any], Mapping[str, Any]] = functools.cache(typing.get_type_hints)


@dataclass(frozen=True)
class ModelKey:
    """The declaration of a key: its meaning, unit, bounds (both included) and choices."""

    text: str
    unit: str = ''
    low: float = -FARTHEST
    high: float = FARTHEST
    choices: tuple[str, ...] = ()


@dataclass(frozen=True)
class WorldProblem:
    """A problem of a value, and its remedy."""

    path: Path
    message: str

    @property
    def where(self) -> str:
        """The path as text, safe to print in a terminal: ``robots.alpha.pose``."""
        return one_line('.'.join(map(str, self.path)), _WIDTH)


def key(text: str, default: Any = dataclasses.MISSING, **details: Any) -> Any:
    """Return a field of a specification; ``details`` are those of :class:`Key`."""
    return dataclasses.field(default=default, metadata={'key': ModelKey(text, **details)})


@dataclass(frozen=True)
class ModelSpecification:
    """Base of the mappings in a world file. The values are checked, however an instance is made.

    Raises:
        SimulationError: a value is out of its bounds; the message names it.
    """

    title: ClassVar[str] = ''

    def __post_init__(self) -> None:
        problems: list[WorldProblem] = []
        for name, one in keys_of(type(self)).items():
            value = getattr(self, name)
            if value is not None:
                _bounded(value, one, (name,), problems)
        problems = problems or [WorldProblem((), text) for text in self.conflicts()]
        if problems:
            raise SimulationError('; '.join(f'{p.where}: {p.message}' if p.path else p.message for p in problems))

    def conflicts(self) -> Iterable[str]:
        """Return the conflicts between values that are each valid alone."""
        return ()


def keys_of(specification: type[ModelSpecification]) -> Mapping[str, ModelKey]:
    """Return the keys that a specification may have, in their order."""
    fields = dataclasses.fields(specification)
    return {one.name: one.metadata['key'] for one in fields if 'key' in one.metadata}


def types_of(specification: type[ModelSpecification]) -> Mapping[str, Any]:
    """Return the type of each key."""
    return _type_hints(specification)


def written(name: str) -> str:
    """Return a key as in a file: ``from_`` is ``from``, which is a keyword of Python."""
    return name.rstrip('_')


def read(
    specification: type[S],
    data: Any,
    path: Path,
    problems: list[WorldProblem],
    base: S | None = None,
    beside: Collection[str] = (),
) -> S | None:
    """Return what a mapping of plain data specifies; problems are added to the list, and None is returned, if it is
    wrong.

    Keys that the mapping leaves out are as in ``base``, or have their default. Keys ``beside`` those of the
    specification are for the caller.
    """
    if not isinstance(data, Mapping):
        problems.append(WorldProblem(path, f'expected a mapping of {names(map(written, keys_of(specification)))}, '
                                      f'got {short_repr(data)}'))  # fmt: skip
        return None
    known = {written(name): name for name in keys_of(specification)}
    before = len(problems)
    values = {} if base is None else {name: getattr(base, name) for name in keys_of(specification)}
    for word, value in data.items():
        if word in known:
            name = known[word]
            values[name] = convert(types_of(specification)[name], value, (*path, word), problems, values.get(name))
        elif word not in beside:
            problems.append(WorldProblem((*path, word), f'there is no such key{did_you_mean(word, [*known, *beside])}'))
    for one in dataclasses.fields(specification):
        if one.name in keys_of(specification) and one.name not in values and one.default is dataclasses.MISSING:
            text = keys_of(specification)[one.name].text
            problems.append(WorldProblem(path, f"'{written(one.name)}' is missing: {text}"))
    if len(problems) > before:
        return None
    for name, one_key in keys_of(specification).items():
        if values.get(name) is not None:
            _bounded(values[name], one_key, (*path, written(name)), problems)
    if len(problems) > before:
        return None
    try:
        return specification(**values)
    except SimulationError as error:
        problems.append(WorldProblem(path, str(error)))
        return None


def convert(kind: Any, value: Any, path: Path, problems: list[WorldProblem], base: Any = None) -> Any:
    """Return a plain value as a type of the specifications; None, with a problem added, when it is none."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        if arguments == typing.get_args(Shape):
            return _shape(value, path, problems)
        if value is None:
            return None
        return convert(next(one for one in arguments if one is not type(None)), value, path, problems, base)
    if origin is tuple and arguments[-1:] == (...,):
        if not isinstance(value, list):
            problems.append(WorldProblem(path, f'expected a list, got {short_repr(value)}'))
            return None
        return tuple(convert(arguments[0], one, (*path, i), problems) for i, one in enumerate(value))
    if origin is tuple:
        return _numbers(value, len(arguments), path, problems)
    if kind is Pose:
        numbers = _numbers(value, 3, path, problems, ' (x, y in m, yaw in rad)')
        return Pose(*numbers) if numbers else None
    if isinstance(kind, type) and issubclass(kind, ModelSpecification):
        return read(kind, value, path, problems, base)
    return _scalar(kind, value, path, problems)


_SCALARS: Final = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'a text'}


def _scalar(kind: Any, value: Any, path: Path, problems: list[WorldProblem]) -> Any:
    if kind is float and (number := finite_number(value)) is not None:
        return number
    if kind is not float and type(value) is kind:
        return value
    problems.append(WorldProblem(path, f'expected {_SCALARS[kind]}, got {short_repr(value)}'))
    return None


def _numbers(value: Any, count: int, path: Path, problems: list[WorldProblem], what: str = '') -> Any:
    numbers = [finite_number(one) for one in value] if isinstance(value, list) else []
    if len(numbers) == count and None not in numbers:
        return tuple(numbers)
    problems.append(WorldProblem(path, f'expected a list of {count} numbers{what}, got {short_repr(value)}'))
    return None


def _shape(value: Any, path: Path, problems: list[WorldProblem]) -> Shape | None:
    """Return a shape: a circle for a radius, a box for length and width, a polygon for a list of points."""
    radius = finite_number(value)
    try:
        if radius is not None:
            return Circle(radius)
        if isinstance(value, list) and len(value) == 2 and not any(isinstance(one, list) for one in value):
            sides = _numbers(value, 2, path, problems)
            return box(*sides) if sides else None
        if isinstance(value, list) and 3 <= len(value) <= MAX_CORNERS:
            corners = [_numbers(one, 2, (*path, i), problems) for i, one in enumerate(value)]
            return None if None in corners else Polygon(tuple(corners))
    except SimulationError as error:
        problems.append(WorldProblem(path, str(error)))
        return None
    text = (
        'expected a radius, [length, width] of a box, or the corners of a polygon [[x, y], [x, y], [x, y], ...] '
        f'(at most {MAX_CORNERS})'
    )
    problems.append(WorldProblem(path, f'{text}, got {short_repr(value)}'))
    return None


def _bounded(value: Any, one: ModelKey, path: Path, problems: list[WorldProblem]) -> None:
    if isinstance(value, str):
        if one.choices and value not in one.choices:
            problems.append(WorldProblem(path, f'{short_repr(value)} is none of {names(one.choices)}'))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        if not one.low <= value <= one.high:
            unit = f' {one.unit}' if one.unit else ''
            shown = f'{value:g}' if isinstance(value, float) else short_repr(value)  # a long int has no float
            problems.append(WorldProblem(path, f'{shown}{unit} is not within {one.low:g} to {one.high:g}{unit}'))
    elif isinstance(value, tuple):
        for i, part in enumerate(value):
            _bounded(part, one, (*path, i), problems)


def names(words: Iterable[Any]) -> str:
    """Return words as a line, separated by commas."""
    return ', '.join(map(str, words))


@dataclass(frozen=True)
class FaultModel(ModelSpecification):
    """Base of the parameters of a fault: ``name``, the kinds of entities that can have it, and the node that carries it
    out."""

    name: ClassVar[str]
    entities: ClassVar[tuple[str, ...]] = ('robot',)
    by: ClassVar[str] = 'world'
    needs: ClassVar[str] = ''

    @property
    def part(self) -> str:
        """Key of the device that the entity must have for it; '' for none."""
        return self.needs

    @property
    def slot(self) -> str:
        """Key of which an entity has one fault at a time: a new one replaces the old."""
        return self.name

    def __str__(self) -> str:
        """Return the fault on one line, for people: ``stuck_wheel (side: 'left')``."""
        values = names(f'{name}: {short_repr(getattr(self, name))}' for name in keys_of(type(self)))
        return f'{self.name} ({values})' if values else self.name
