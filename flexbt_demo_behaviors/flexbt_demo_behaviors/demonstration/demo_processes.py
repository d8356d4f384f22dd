# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a demonstration: the one table that `demo` and the launch file start them from."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from ament_index_python.packages import get_package_prefix, get_package_share_directory

from flexbt_common.files import resolve_file
from flexbt_console.commands.operator_values import load_places
from flexbt_console.errors import UsageError

ODOM_RATE: Final = 20.0
"""Poses in a second of the simulated world: each wakes every process."""

ParameterValue = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

SIMULATED: Final[Mapping[str, ParameterValue]] = {'use_sim_time': True}
"""Parameters of a node that follows the clock of the simulator."""


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the processes.

    `map` is a ROS map YAML file, empty for the built-in one; `start` the pose (m, m, rad) at which the robot
    begins on it, None for that of the built-in map; `places` the YAML file of the places that the robot knows
    by name; `speed` how many seconds of the simulated world pass in one second.
    """

    map: str = ''
    start: tuple[float, float, float] | None = None
    places: str = ''
    speed: float = 1.0


@dataclass(frozen=True)
class Process:
    """One executable of a package, the parameters of its node, and the namespace of its robot, if it has one."""

    package: str
    executable: str
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    namespace: str = ''

    @property
    def name(self) -> str:
        """Name of the executable, and of its node, if it has only one."""
        return self.executable

    def command(self) -> list[str]:
        """Return the command line that starts it, as `ros2 run` makes it.

        Raises ament_index_python's PackageNotFoundError when the package is not installed, and
        FileNotFoundError when it lacks the executable.
        """
        file = Path(get_package_prefix(self.package)) / 'lib' / self.package / self.executable
        if not file.exists():
            raise FileNotFoundError(f'package {self.package} has no executable {self.executable}: build the workspace')
        words = [str(file), '--ros-args']
        if self.namespace:
            words += ['-r', f'__ns:=/{self.namespace}']
        for key, value in self.parameters.items():
            words += ['-p', f'{key}:={_parameter_text(value)}']
        return words


def built_in_places() -> str:
    """Return the places file of the built-in map."""
    return str(Path(get_package_share_directory('flexbt_sim')) / 'maps' / 'rooms_places.yaml')


def first_place(places: str) -> tuple[float, float, float]:
    """Pose of the first place of a places file; raises the console's UsageError when there is none."""
    known = list(load_places(Path(places)).values())
    if not known:
        raise UsageError(f'places file {places}: it has no place at which the robot could start')
    return known[0].x, known[0].y, known[0].yaw


def console_command(leaving: str = 'the demonstration ends', namespace: str = '', page: str = '') -> list[str]:
    """Return the command line of the operator's console, which runs in the terminal: the screen, where its toolkit is.

    ``leaving`` is its help text on leaving, ``namespace`` that of its robot, ``page`` the address of the page.
    """
    executable, *parameters = Process('flexbt_console', 'console', namespace=namespace).command()
    mode = 'screen' if importlib.util.find_spec('textual') is not None else 'prompt'
    return [executable, mode, '--leaving', leaving, *(['--page', page] if page else []), *parameters]


def page_command(port: int) -> list[str]:
    """Return the command line that serves the operator's page for a browser; empty where its library is missing."""
    if importlib.util.find_spec('aiohttp') is None:
        return []
    executable, *parameters = Process('flexbt_console', 'console').command()
    return [executable, 'web', '--port', str(port), *parameters]


def demo_processes(settings: DemoSettings) -> tuple[Process, ...]:
    """Return the processes behind the operator's console, in the order in which they are started."""
    world: dict[str, ParameterValue] = {'speed_factor': settings.speed, 'odom_rate': ODOM_RATE}
    if settings.map:
        world['map'] = settings.map
    if settings.start is not None:
        world['initial_pose'] = settings.start
    return (
        Process('flexbt_sim', 'simulator', world),
        Process('flexbt_navigation', 'navigation', SIMULATED),
        *mission_processes(settings.places),
    )


def mission_processes(
    places: str, server: Mapping[str, ParameterValue] | None = None, namespace: str = ''
) -> tuple[Process, ...]:
    """Return the processes that run missions on a robot: BT server, with further parameters, stop guard, executive."""
    return (
        Process('flexbt_server', 'bt_server', {**SIMULATED, **(server or {})}, namespace),
        Process('flexbt_onboard', 'stop_guard', namespace=namespace),
        Process('flexbt_onboard', 'onboard_executive', {**SIMULATED, 'places': places}, namespace),
    )


def only_robot(speed: float, world: str, **navigation: ParameterValue) -> Process:
    """Return the simulation of a world file with one robot, and its navigation in it; ``speed`` in seconds per
    second."""
    parameters: Mapping[str, ParameterValue] = {
        'speed_factor': speed,
        'odom_rate': ODOM_RATE,
        'world': world,
        'robot_namespaces': False,
    }
    return Process('flexbt_navigation', 'simulation', {**parameters, **navigation})


def demo_file(path: str) -> str:
    """Return a file of this package by its path."""
    return str(resolve_file(f'flexbt_demo_behaviors/{path}'))


def _parameter_text(value: ParameterValue) -> str:
    """Return a value as the YAML of a parameter override; text is quoted, so that it stays text."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, tuple):
        return f'[{", ".join(_parameter_text(item if isinstance(item, str) else float(item)) for item in value)}]'
    return "'" + value.replace("'", "''") + "'" if isinstance(value, str) else repr(value)
