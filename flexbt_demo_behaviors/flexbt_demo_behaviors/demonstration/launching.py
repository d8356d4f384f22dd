# SPDX-License-Identifier: BSD-3-Clause
"""Parts of launch files shared by the demonstrations: the nodes of a process table, and numeric arguments.

Needs `launch` and `launch_ros`, which are only available with an installed ROS.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from flexbt_common import names
from flexbt_core.values.text import short_repr

from .demo_processes import ParameterValue, Process

RESPAWN: Final[Mapping[str, Any]] = {'respawn': True, 'respawn_delay': 1.0, 'respawn_max_retries': 5}
"""Options of `launch_ros.actions.Node`: restart a node that died after a second, a limited number of times."""


MANAGED: Final = (names.BT_SERVER, names.ONBOARD_EXECUTIVE)
"""Lifecycle nodes: only these have parameters such as `autostart`."""


def speed_argument() -> DeclareLaunchArgument:
    """Return the launch argument `speed`; :func:`numbers` reads it."""
    return DeclareLaunchArgument('speed', default_value='1.0', description='seconds of simulated time in one second')


def text(context: LaunchContext, argument: str) -> str:
    """Return the value of an argument of the launch file."""
    return str(LaunchConfiguration(argument).perform(context))


def numbers(context: LaunchContext, argument: str, count: int = 1) -> list[float]:
    """Return `count` numbers from an argument, separated by commas, with or without brackets.

    Raises:
        ValueError: the text does not match; the message, which `launch` prints, contains the argument.
    """
    given = text(context, argument)
    try:
        found = [float(number) for number in given.strip('[] ').split(',')]
    except ValueError:
        found = []
    if len(found) != count or not all(map(math.isfinite, found)):
        wanted = 'a number' if count == 1 else f'{count} numbers, separated by commas'
        raise ValueError(f'launch argument {argument}:={short_repr(given)}: has to be {wanted}')
    return found


def nodes_of(
    processes: Iterable[Process], of_managed: Mapping[str, ParameterValue] | None = None, **options: Any
) -> list[Node]:
    """Return the nodes of a process table. Managed nodes get the further parameters.

    All get the options of `launch_ros.actions.Node`, by default :data:`RESPAWN`.
    """
    return [
        Node(
            package=process.package,
            executable=process.executable,
            parameters=[{**process.parameters, **((of_managed or {}) if process.executable in MANAGED else {})}],
            output='screen',
            **{'namespace': process.namespace, **RESPAWN, **options},
        )
        for process in processes
    ]


def launch_at_speed(
    processes: Callable[[float], Iterable[Process]], programs: Iterable[Process] = ()
) -> LaunchDescription:
    """Return a launch description with the only argument `speed`: a process table, and programs that end by themselves.

    A program names its node itself. It is not restarted, because it ends when its work is done.
    """
    started = [Node(package=one.package, executable=one.executable, output='screen') for one in programs]
    nodes = OpaqueFunction(function=lambda context: nodes_of(processes(*numbers(context, 'speed'))))
    return LaunchDescription([speed_argument(), nodes, *started])
