# SPDX-License-Identifier: BSD-3-Clause
"""The programs of a world, by the name of the world: of a demonstration, of a world file, or of a function."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import EntryPoints, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Final

import yaml
from ament_index_python.packages import get_package_share_directory

from flexbt_common.files import resolve_file
from flexbt_core import load_places
from flexbt_core.values.text import did_you_mean
from flexbt_sim.world import Pose
from flexbt_sim.world.plane.occupancy_map import load_map
from flexbt_sim.world.world_file import WorldFile

from . import abstract_robot

Parameters = Mapping[str, Any]

SPEED: Final = 0.3
"""Speed of an abstract robot, m/s."""

_DEMONSTRATIONS: Final = {
    'navigate': '',
    'night_watch': 'flexbt_demo_behaviors.night_watch.watch:watch_processes',
    'nav2_robot': 'flexbt_demo_behaviors.nav2_robot.main:robot_processes',
    'goals': 'flexbt_demo_behaviors.goals.main:robot_processes',
}
_SIMULATED: Final = {'use_sim_time': True}
_BODIES: Final = ('simulator', 'navigation', 'simulation')


@dataclass(frozen=True)
class Program:
    """An executable of a package, with the parameters of its node and its namespace; or a function, ``main``."""

    package: str
    executable: str
    parameters: Parameters = field(default_factory=dict)
    namespace: str = ''
    main: Callable[[], Any] | None = None

    @property
    def name(self) -> str:
        """Name in the world, with the namespace before it."""
        return named(self.namespace, self.executable)

    def arguments(self) -> list[str]:
        """Return the ROS arguments of the process."""
        words = ['--ros-args']
        if self.namespace:
            words += ['-r', f'__ns:=/{self.namespace}']
        for name, value in self.parameters.items():
            words += ['-p', f'{name}:={_yaml(value)}']
        return words

    def load(self) -> Callable[[], Any]:
        """Return the main function.

        Raises:
            LookupError: the package is not installed, or has no such executable in Python.
        """
        if self.main is not None:
            return self.main
        try:
            scripts = distribution(self.package).entry_points.select(group='console_scripts')
        except PackageNotFoundError:
            scripts = EntryPoints()
        for script in scripts:
            if script.name == self.executable:
                main: Callable[[], Any] = script.load()
                return main
        known = [script.name for script in scripts]
        remedy = did_you_mean(self.executable, known) if known else '; is it installed, and sourced?'
        raise LookupError(f'package {self.package} has no executable {self.executable!r} in Python{remedy}')


def named(namespace: str, name: str) -> str:
    """Return the name of a process, or of an operator, of one of several robots."""
    return f'{namespace}/{name}' if namespace else name


def _yaml(value: Any) -> str:
    value = list(value) if isinstance(value, tuple) else value
    return str(yaml.safe_dump(value, default_flow_style=True, width=10_000)).removesuffix('\n').removesuffix('\n...')


def robot_programs(
    places: str = '',
    simulator: Parameters | None = None,
    server: Parameters | None = None,
    executive: Parameters | None = None,
    world: str = '',
) -> list[Program]:
    """Return the programs of a simulated robot: simulator, navigation, BT server, stop guard and executive.

    ``places`` is the YAML file of named places, by default that of the built-in map. ``world`` is a world file with one
    robot. The others are further parameters.
    """
    built_in = Path(get_package_share_directory('flexbt_sim')) / 'maps' / 'rooms_places.yaml'
    rate = {'odom_rate': 20.0, **(simulator or {})}
    if world:
        body = [Program('flexbt_navigation', 'simulation', {**rate, 'world': world, 'robot_namespaces': False})]
    else:
        body = [
            Program('flexbt_sim', 'simulator', rate),
            Program('flexbt_navigation', 'navigation', _SIMULATED),
        ]
    known = places or ('' if world else str(built_in))
    return [
        *body,
        Program('flexbt_server', 'bt_server', {**_SIMULATED, **(server or {})}),
        Program('flexbt_onboard', 'stop_guard'),
        Program('flexbt_onboard', 'onboard_executive', {**_SIMULATED, 'places': known, **(executive or {})}),
    ]


def named_programs(name: str, folder: Path, scratch: Path, motion: str = 'full', **options: Any) -> list[Program]:
    """Return the programs of a world.

    ``name``: of a demonstration, of a world file (in ``folder``, or ``package/file``), or ``module:function`` for a
    function that returns programs; '' for a robot in the built-in rooms. ``motion``: ``full`` or ``abstract``.
    ``options``: those of :func:`robot_programs`. ``scratch`` is a directory for files that this makes.

    Raises:
        LookupError: there is no such world, or no such motion.
    """
    if motion not in ('full', 'abstract'):
        raise LookupError(f"there is no motion {motion!r}; choose 'full' or 'abstract'")
    for key in ('places', 'world'):
        if options.get(key):
            options[key] = str(_file(options[key], folder))
    if name.endswith(('.yaml', '.yml')):
        options['world'] = str(_file(name, folder))
        if not options.get('places'):
            options['places'] = str(_places_of(Path(options['world']), scratch))
        name = ''
    function = _DEMONSTRATIONS.get(name, name)
    if not function:
        for option in options.keys() - inspect.signature(robot_programs).parameters.keys():
            raise LookupError(f'a world has no option {option!r}; see the parameters of robot_programs')
        made = robot_programs(**options)
    else:
        module, _, attribute = function.partition(':')
        if not attribute:
            raise LookupError(
                f'there is no world {name!r}{did_you_mean(name, _DEMONSTRATIONS, ".")} Give a demonstration '
                f'({", ".join(_DEMONSTRATIONS)}), a world file (.yaml), or module:function'
            )
        make = _function(name, module, attribute)
        known = inspect.signature(make).parameters
        for option in options.keys() - known.keys():
            raise LookupError(f'the world {name!r} has no option {option!r}{did_you_mean(option, known)}')
        speed = {'speed': 1.0} if 'speed' in known else {}  # the demonstrations have it
        made = [_program(one) for one in make(**speed | options)]
    return list(_abstract(made)) if motion == 'abstract' else made


def _function(world: str, module: str, name: str) -> Callable[..., Any]:
    top = module.partition('.')[0]
    if top not in sys.modules and importlib.util.find_spec(top) is None:
        raise LookupError(f'the world {world!r}: there is no module {module!r}; is its package installed, and sourced?')
    functions = {key: one for key, one in vars(importlib.import_module(module)).items() if callable(one)}
    if name not in functions:
        raise LookupError(f'the world {world!r}: {module} has no function {name!r}{did_you_mean(name, functions)}')
    return functions[name]


def _program(one: Any) -> Program:
    if isinstance(one, Program):
        return one
    return Program(one.package, one.executable, one.parameters, one.namespace)


def _file(name: str, folder: Path) -> Path:
    beside = folder / name
    return beside if beside.exists() else Path(resolve_file(name))


def _places_of(world: Path, scratch: Path) -> Path:
    """Return the places file beside a world file, or one made of the places in it."""
    beside = world.with_name('places.yaml')
    if beside.exists():
        return beside
    file = scratch / 'places.yaml'
    places = {name: {'x': pose.x, 'y': pose.y, 'yaw': pose.yaw} for name, pose in WorldFile(world).places.items()}
    file.write_text(yaml.safe_dump(places))
    return file


def _abstract(programs: Sequence[Program]) -> Iterator[Program]:
    """Yield the programs with an abstract robot for each robot, in the place of simulator and navigation."""
    bodies = [program for program in programs if program.executable in _BODIES]
    world = next((one.parameters['world'] for one in bodies if one.parameters.get('world')), '')
    read = WorldFile(Path(world), with_map=True) if world else None
    starts = {name: pose for _, name, _, pose in read.entities} if read else {}
    share = Path(get_package_share_directory('flexbt_sim'))
    map = read.map if read and read.map else load_map(share / 'maps' / 'rooms.yaml')
    for program in programs:
        if program.executable == 'onboard_executive':
            start = starts.get(program.namespace) or next(filter(None, starts.values()), None)
            if start is None:
                first = next(iter(load_places(Path(program.parameters['places'])).values()))
                start = Pose(first.x, first.y, first.yaw)
            run = partial(abstract_robot.run, abstract_robot.AbstractRobot, map=map, pose=start, speed=SPEED)
            yield Program('', 'abstract_robot', namespace=program.namespace, main=run)
        if program not in bodies:
            rest = {name: value for name, value in program.parameters.items() if name != 'use_sim_time'}
            yield replace(program, parameters=rest)
