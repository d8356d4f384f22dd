# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/world_files.md, the reference of world files, from the declarations of their keys and faults.

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

from flexbt_sim.world import FAULTS, MODELS, Circle, DoorModel, ObstacleModel, Polygon, Pose, StationModel, ZoneModel
from flexbt_sim.world.faults import NAVIGATION_SERVERS, TOPICS, FaultTiming
from flexbt_sim.world.models import RobotModel
from flexbt_sim.world.plane.geometry import MAX_CORNERS, Shape
from flexbt_sim.world.specification import FaultModel, ModelKey, ModelSpecification, keys_of, types_of, written
from flexbt_sim.world.world_file import SECTIONS, FloorPlan, WorldModel

PAGE: Final = Path(__file__).parents[1] / 'reference' / 'world_files.md'
HEAD: Final = """\
# World files

A world file describes a simulated world in YAML. Every key is checked when the file is read. All errors are reported
together, as `FILE:LINE:COLUMN: KEY: problem, and the valid choices`. `docs/tools/make_world_files.py` writes this page
from the declarations of the keys. See also [Create your own world](../how_to/own_world.md).

- Lengths are in m, angles in rad, times in s of simulated time. A pose is `[x, y, yaw]` in the map, a point `[x, y]`.
- A shape is a number, the radius of a circle; `[length, width]` of a box, along x and y; or the corners of a polygon in
  order, `[[x, y], [x, y], [x, y], ...]`. Each of its points is within 50 m of its origin, where its pose is.
- A name has letters, digits and `_`, starts with a letter, and has at most 63 characters. Names are unique among all
  entities, because robots are namespaces. Names of places are separate.
- Robots, places and stations are on the map; zones at least in part.
- Type and default of a key are in parentheses.

No body jumps over another between two steps: it moves up to the obstacle and stops there. Robots, moving obstacles and
doors stop for each other; moving obstacles and doors then wait. Sensors see all of them.
"""
ROBOTS: Final = """\
## Robots and models

An entry of `robots` has a `pose`, a `model`, and any of these keys to override. An entry of `models` is `based_on`
another one. Omitted keys are inherited from that model, at any depth.
"""
FAULT_LIST: Final = """\
## Faults

Define a fault by an entry of the list `faults`, the service `simulator/set_fault`, or `World.set_fault`. `parameters`
are those of the fault and are optional. The simulator logs when a fault starts and ends. The world executes the faults
of a robot, unless their section says otherwise.
"""
SERVERS: Final = """\
A `server` is one of {}.

The node `navigation` in the robot's namespace executes these faults. It receives them on the latched
topic `server_faults`. Without this node, `simulator/set_fault` refuses them, since Nav2's own servers cannot fail on
command. Those of a world file wait for it. Each server can have each of them; clearing a name clears it for all
servers. If one server has several, the refusal comes first, then the hang, then the failure.
"""
TOPIC_LIST: Final = """\
A `topic` is one of {}.

`cmd_vel` means the robot's command topic, whatever the parameter `cmd_vel_topic` is. Each topic can have both faults;
clearing a name clears it for all topics. The robot must have the device of the topic.
"""
ENTITIES: Final = {
    'obstacles': ObstacleModel, 'doors': DoorModel, 'stations': StationModel, 'zones': ZoneModel,
}  # fmt: skip


def page() -> str:
    """Return the whole page."""
    lines = [HEAD, '## The file', '', *items(WorldModel)]
    lines += [f'- `{name}`: {text}' for name, text in SECTIONS.items()]
    lines += ['', '## Plan', '', *section(FloorPlan)]
    lines += [ROBOTS, *section(RobotModel), *models()]
    for name, specification in ENTITIES.items():
        lines += [f'## {name.capitalize()}', '', *section(specification)]
    lines += [FAULT_LIST, *items(FaultTiming), '']
    for fault in FAULTS.values():
        lines += [f'### `{fault.name}`', '', f'{doc(fault)}{executed(fault)}', '']
        lines += [*items(fault), ''] if keys_of(fault) else []
    lines += ['### Topics', '', TOPIC_LIST.format(', '.join(f'`{name}`' for name in TOPICS))]
    lines += ['### Navigation servers', '', SERVERS.format(', '.join(f'`{name}`' for name in NAVIGATION_SERVERS))]
    return '\n'.join(lines).rstrip('\n') + '\n'


def doc(specification: type) -> str:
    """Return the docstring on one line."""
    return ' '.join((specification.__doc__ or '').split()).replace('``', '`')


def executed(fault: type[FaultModel]) -> str:
    """Return whose fault it is and what executes it, unless that is usual."""
    whose = '' if fault.entities == ('robot',) else f' A fault of a {" or a ".join(fault.entities)}.'
    return whose if fault.by == 'world' else f'{whose} Executed by the {fault.by}.'


def section(specification: type[ModelSpecification]) -> Iterator[str]:
    """Return the section of a specification: its keys, and those of the mappings in it."""
    yield from [doc(specification), '', *items(specification), '']
    for name, kind in types_of(specification).items():
        for part in parts(kind):
            if name in keys_of(specification):
                yield f'### {specification.title}: `{written(name)}`'
                yield ''
                yield from [doc(part), '', *items(part), '']


def parts(kind: Any) -> Iterator[type[ModelSpecification]]:
    """Return the specifications in a type."""
    if isinstance(kind, type) and not typing.get_args(kind):
        if issubclass(kind, ModelSpecification):
            yield kind
        return
    for one in typing.get_args(kind):
        yield from parts(one)


def items(specification: type[ModelSpecification]) -> Iterator[str]:
    """Return the list of the keys of a specification."""
    defaults = {one.name: one.default for one in dataclasses.fields(specification)}
    for name, key in keys_of(specification).items():
        default = shown(defaults[name])
        kind = described(types_of(specification)[name], key)
        yield f'- `{written(name)}` ({kind}{f", {default}" if default else ""}): {key.text}'


def described(kind: Any, key: ModelKey) -> str:
    """Return the type of a key, with its unit, bounds and choices."""
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
    if issubclass(kind, ModelSpecification):
        return 'mapping'
    words = {bool: 'true or false', int: 'whole number', float: 'number', str: 'text'}
    bounds = ''
    if kind in (int, float):
        low, high = (number(one) for one in (key.low, key.high))
        bounds = f' {low} to {high}' if key.high < 1e7 else (f' from {low}' if key.low > -1e7 else '')
    return f'{words[kind]}{bounds}{" " + key.unit if key.unit else ""}'


def shown(value: Any) -> str:
    """Return a default as text."""
    if value is dataclasses.MISSING:
        return 'required'
    if isinstance(value, ModelSpecification):
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
    """Return a number as a person writes it."""
    return {math.tau: '2 pi', math.pi: 'pi', -math.pi: '-pi', float(2**53): '2^53'}.get(value, f'{value:g}')


def models() -> Iterator[str]:
    """Return the table of the included models."""
    yield from ['### Included models', '', 'Other keys have their default.', '']
    yield '| | ' + ' | '.join(f'`{name}`' for name in MODELS) + ' |'
    yield '|---|' + '---|' * len(MODELS)
    rows: dict[str, list[str]] = {}
    for model in MODELS.values():
        for path, value in values(model):
            rows.setdefault(path, []).append(value)
    usual = dict(values(RobotModel()))
    for path, cells in rows.items():
        if set(cells) != {usual.get(path)}:
            yield f'| `{path}` | {" | ".join(cells)} |'
    yield ''


def values(specification: ModelSpecification, prefix: str = '') -> Iterator[tuple[str, str]]:
    """Return all values of a model, by the paths of their keys."""
    for name in keys_of(type(specification)):
        value = getattr(specification, name)
        path = f'{prefix}{written(name)}'
        if isinstance(value, ModelSpecification):
            yield from values(value, f'{path}.')
        else:
            yield path, shown(value)


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
