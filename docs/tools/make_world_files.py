# SPDX-License-Identifier: BSD-3-Clause
"""Writes docs/reference/world_files.md, the reference of world files, from the declarations of their keys and faults.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from target import target

from flexbt_sim.world import (
    FAULTS,
    MODELS,
    NAVIGATION_SERVERS,
    TOPICS,
    Circle,
    DoorModel,
    ObstacleModel,
    Polygon,
    Pose,
    StationModel,
    ZoneModel,
)
from flexbt_sim.world.descriptions import (
    SECTIONS,
    FaultTiming,
    FloorPlan,
    Key,
    RobotModel,
    Specification,
    WorldModel,
    keys_of,
    types_of,
    written,
)
from flexbt_sim.world.plane import MAX_CORNERS, Shape

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'world_files.md'
HEAD: Final = """\
# World files

A world file is YAML and says what is in a simulated world. Every key is checked when it is read; all that is wrong is
told at once, as `FILE:LINE:COLUMN: KEY: what is wrong, and what there is`. The text comes from the declarations of the
keys (`docs/tools/make_world_files.py` writes this page). How to write one:
[Worlds of your own](../how_to/own_world.md).

- Lengths are in m, angles in rad, times in s of simulated time. A pose is `[x, y, yaw]` in the map, a point `[x, y]`.
- A shape is a number, the radius of a circle; `[length, width]` of a box, along x and y; or the corners of a polygon in
  their order, `[[x, y], [x, y], [x, y], ...]`.
- Names are of letters, digits and `_`, a letter first, at most 63. They are unique among all entities, for robots are
  namespaces. Places have names of their own.
- Robots, places, stations and zones are on the map, these at least in part.

Between two steps nothing is jumped over: bodies go as far as nothing is in their way, and stop there. Robots, moving
obstacles and doors stop for each other; a moving obstacle waits, and so does a door. Sensors see all of them.
"""
ROBOTS: Final = """\
## Robots and models

An entry of `robots` has a `pose`, a `model`, and any of these keys that are to be otherwise; an entry of `models` is
`based_on` another one. What is left out is as in that model, at any depth.
"""
FAULT_LIST: Final = """\
## Faults

An entry of the list `faults`; the same by the service `simulator/set_fault` and by `World.set_fault`. `parameters` are
those of the fault, and may be left out. The log of the simulator tells when a fault begins, and when it is over.
"""
SERVERS: Final = """\
A `server` is one of {}.

These faults are carried out by the node `navigation` in the namespace of the robot, which hears of them on the latched
topic `server_faults`. While there is none, `simulator/set_fault` refuses them: Nav2's own servers cannot be told to
fail. Those of a world file wait for it. Each server can have each of them; clearing a name clears it for all servers.
Of several of one server, a refusal is seen first, then the hang, then the failure.
"""
TOPIC_LIST: Final = """\
A `topic` is one of {}.

`cmd_vel` is what the robot is driven by, whatever the parameter `cmd_vel_topic` says. Each topic can have both faults;
clearing a name clears it for all topics. The robot has to have what a topic comes from.
"""
ENTITIES: Final = {
    'obstacles': ObstacleModel, 'doors': DoorModel, 'stations': StationModel, 'zones': ZoneModel,
}  # fmt: skip


def page() -> str:
    """The whole page."""
    lines = [HEAD, '## The file', '', *table(WorldModel)]
    lines += [f'| `{name}` | | | {text} |' for name, text in SECTIONS.items()]
    lines += ['', '## Plan', '', *section(FloorPlan)]
    lines += [ROBOTS, *section(RobotModel), *models()]
    for name, specification in ENTITIES.items():
        lines += [f'## {name.capitalize()}', '', *section(specification)]
    lines += [FAULT_LIST, *table(FaultTiming), '']
    for fault in FAULTS.values():
        whose = ' or a '.join(fault.entities)
        lines += [f'### `{fault.name}`', '', f'{doc(fault)} A fault of a {whose}, carried out by the {fault.by}.', '']
        lines += [*table(fault), ''] if keys_of(fault) else []
    lines += ['### Topics', '', TOPIC_LIST.format(', '.join(f'`{name}`' for name in TOPICS))]
    lines += ['### Navigation servers', '', SERVERS.format(', '.join(f'`{name}`' for name in NAVIGATION_SERVERS))]
    return '\n'.join(lines).rstrip('\n') + '\n'


def doc(specification: type) -> str:
    """Its docstring, on one line."""
    return ' '.join((specification.__doc__ or '').split()).replace('``', '`')


def section(specification: type[Specification]) -> Iterator[str]:
    """What a specification is, its keys, and those of the mappings in it."""
    yield from [doc(specification), '', *table(specification), '']
    for name, kind in types_of(specification).items():
        for part in parts(kind):
            if name in keys_of(specification):
                yield f'### {specification.title}: `{written(name)}`'
                yield ''
                yield from [doc(part), '', *table(part), '']


def parts(kind: Any) -> Iterator[type[Specification]]:
    """The specifications in a type."""
    if isinstance(kind, type) and not typing.get_args(kind):
        if issubclass(kind, Specification):
            yield kind
        return
    for one in typing.get_args(kind):
        yield from parts(one)


def table(specification: type[Specification]) -> Iterator[str]:
    """The keys of a specification."""
    yield '| key | type | default | meaning |'
    yield '|---|---|---|---|'
    defaults = {one.name: one.default for one in dataclasses.fields(specification)}
    for name, key in keys_of(specification).items():
        kind = described(types_of(specification)[name], key)
        yield f'| `{written(name)}` | {kind} | {shown(defaults[name])} | {key.text} |'


def described(kind: Any, key: Key) -> str:
    """The type of a key, with its unit, bounds and choices."""
    if kind == Shape:
        return f'shape, at most {MAX_CORNERS} corners'
    if key.choices:
        return ', '.join(f'`{one}`' for one in key.choices) if len(key.choices) < 5 else 'name, see below'
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return described(next(one for one in arguments if one is not type(None)), key) + ' or `null`'
    if origin is tuple and arguments[-1] is ...:
        return 'list of: ' + described(arguments[0], key)
    if origin is tuple:
        return 'point'
    if kind is Pose:
        return 'pose'
    if issubclass(kind, Specification):
        return 'mapping, see below'
    words = {bool: 'true or false', int: 'whole number', float: 'number', str: 'text'}
    bounds = ''
    if kind in (int, float):
        low, high = (number(one) for one in (key.low, key.high))
        bounds = f' {low} to {high}' if key.high < 1e7 else (f' from {low}' if key.low > -1e7 else '')
    return f'{words[kind]}{bounds}{" " + key.unit if key.unit else ""}'


def shown(value: Any) -> str:
    """A default."""
    if value is dataclasses.MISSING:
        return 'needed'
    if isinstance(value, Specification):
        return ''
    if value is None or isinstance(value, bool):
        return f'`{str(value).lower().replace("none", "null")}`'
    if isinstance(value, float | int):
        return f'`{number(value)}`'
    if isinstance(value, Circle):
        return f'`{number(value.radius)}`'
    if isinstance(value, Polygon):
        return f'`[{", ".join(f"[{number(x)}, {number(y)}]" for x, y in value.corners)}]`'
    if isinstance(value, Pose):
        return f'`[{", ".join(map(number, value))}]`'
    return '' if value == () else f'`{value}`'


def number(value: float) -> str:
    """A number as a person writes it."""
    return {math.tau: '2 pi', math.pi: 'pi', -math.pi: '-pi', float(2**53): '2^53'}.get(value, f'{value:g}')


def models() -> Iterator[str]:
    """The models that come along."""
    yield from ['### Models that come along', '', '| | ' + ' | '.join(f'`{name}`' for name in MODELS) + ' |']
    yield '|---|' + '---|' * len(MODELS)
    rows: dict[str, list[str]] = {}
    for model in MODELS.values():
        for path, value in values(model):
            rows.setdefault(path, []).append(value)
    for path, cells in rows.items():
        yield f'| `{path}` | {" | ".join(cells)} |'
    yield ''


def values(specification: Specification, prefix: str = '') -> Iterator[tuple[str, str]]:
    """All values of a model, by the paths of their keys."""
    for name in keys_of(type(specification)):
        value = getattr(specification, name)
        path = f'{prefix}{written(name)}'
        if isinstance(value, Specification):
            yield from values(value, f'{path}.')
        else:
            yield path, shown(value)


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
