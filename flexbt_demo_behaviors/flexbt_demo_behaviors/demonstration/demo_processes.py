# SPDX-License-Identifier: BSD-3-Clause
"""The processes of a demonstration: the process table that `demo` and the launch file share."""

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
"""Rate of poses in simulated time, Hz. Each pose wakes every process."""

ParameterValue = bool | int | float | str | tuple[float, ...] | tuple[str, ...]

SIMULATED: Final[Mapping[str, ParameterValue]] = {'use_sim_time': True}
"""Parameters of a node on the simulator's clock."""


@dataclass(frozen=True)
class DemoSettings:
    """Settings of the processes.

    `map` is a ROS map YAML file, empty for the built-in map. `start` is the robot's initial pose (m, m, rad), None for
    that of the built-in map. `places` is the YAML file of named places. `speed` is the number of simulated seconds per
    second.
    """

    map: str = ''
    start: tuple[float, float, float] | None = None
    places: str = ''
    speed: float = 1.0


@dataclass(frozen=True)
class Process:
    """An executable of a package, its node parameters, and the namespace of its robot, if any."""

    package: str
    executable: str
    parameters: Mapping[str, ParameterValue] = field(default_factory=dict)
    namespace: str = ''

    @property
    def name(self) -> str:
        """Name of the executable, and of its node if it has only one."""
        return self.executable

    def command(self) -> list[str]:
        """Return the command line that starts the process, like `ros2 run`.

        Raises ament_index_python's PackageNotFoundError if the package is not installed, and FileNotFoundError if it
        lacks the executable.
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
    """Return the pose of the first place in a places file. Raises the console's UsageError if the file has none."""
    known = list(load_places(Path(places)).values())
    if not known:
        raise UsageError(f'places file {places}: it has no place at which the robot could start')
    return known[0].x, known[0].y, known[0].yaw


def console_command(leaving: str = 'the demonstration ends', namespace: str = '', page: str = '') -> list[str]:
    """Return the command line of the operator's console in the terminal: full-screen if its toolkit is installed.

    ``leaving`` is the help text about leaving, ``namespace`` that of its robot, ``page`` the address of the web page.
    """
    executable, *parameters = Process('flexbt_console', 'console', namespace=namespace).command()
    mode = 'screen' if importlib.util.find_spec('textual') is not None else 'prompt'
    return [executable, mode, '--leaving', leaving, *(['--page', page] if page else []), *parameters]


def page_command(port: int) -> list[str]:
    """Return the command line that serves the operator's page for a browser; empty if its library is missing.

    With the package flexbt_studio, the studio has the files of the demonstrations.
    """
    if importlib.util.find_spec('aiohttp') is None:
        return []
    executable, *parameters = Process('flexbt_console', 'console').command()
    folder = Path(__file__).resolve().parents[1]  # the sources, where the build only links to them
    studio = ['--studio', str(folder)] if importlib.util.find_spec('flexbt_studio') else []
    return [executable, 'web', '--port', str(port), *studio, *parameters]


def demo_processes(settings: DemoSettings) -> tuple[Process, ...]:
    """Return the processes besides the operator's console, in their start order."""
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
    """Return the processes that run missions on a robot: BT server with further parameters, stop guard, executive."""
    return (
        Process('flexbt_server', 'bt_server', {**SIMULATED, **(server or {})}, namespace),
        Process('flexbt_onboard', 'stop_guard', namespace=namespace),
        Process('flexbt_onboard', 'onboard_executive', {**SIMULATED, 'places': places}, namespace),
    )


def only_robot(speed: float, world: str, **navigation: ParameterValue) -> Process:
    """Return the process of a world file with one robot: the simulation and its navigation.

    ``speed`` is in simulated seconds per second.
    """
    parameters: Mapping[str, ParameterValue] = {
        'speed_factor': speed,
        'odom_rate': ODOM_RATE,
        'world': world,
        'robot_namespaces': False,
    }
    return Process('flexbt_navigation', 'simulation', {**parameters, **navigation})


def demo_file(path: str) -> str:
    """Return the path of a file of this package."""
    return str(resolve_file(f'flexbt_demo_behaviors/{path}'))


def _parameter_text(value: ParameterValue) -> str:
    """Return a value as YAML for a parameter override. Text is quoted so that it stays text."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, tuple):
        return f'[{", ".join(_parameter_text(item if isinstance(item, str) else float(item)) for item in value)}]'
    return "'" + value.replace("'", "''") + "'" if isinstance(value, str) else repr(value)
