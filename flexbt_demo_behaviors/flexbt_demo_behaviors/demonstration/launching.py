# SPDX-License-Identifier: BSD-3-Clause
"""The parts of launch files that demonstrations share: the nodes of a process table, and arguments that are numbers.

Needs `launch` and `launch_ros`, which come with an installed ROS only.
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
"""Options of `launch_ros.actions.Node`: a node that died is started again after a second, a limited number of times."""


MANAGED: Final = (names.BT_SERVER, names.ONBOARD_EXECUTIVE)
"""Nodes with a lifecycle of their own, which alone have parameters such as `autostart`."""


def speed_argument() -> DeclareLaunchArgument:
    """Return the argument `speed`; :func:`numbers` reads it."""
    return DeclareLaunchArgument('speed', default_value='1.0', description='seconds of simulated time in one second')


def text(context: LaunchContext, argument: str) -> str:
    """Return what an argument of the launch file was set to."""
    return str(LaunchConfiguration(argument).perform(context))


def numbers(context: LaunchContext, argument: str, count: int = 1) -> list[float]:
    """Return this many numbers, separated by commas, with or without brackets.

    Raises:
        ValueError: the text does not match; the message, which `launch` prints, names the argument.
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
    """Return the nodes of a process table, those that are managed with further parameters, and all with options of
    `launch_ros.actions.Node`: without others, those of :data:`RESPAWN`.
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
    """Describe a launch whose only argument is `speed`: a process table, and programs that end by themselves.

    A program names its node itself, and is not started again: its end is that of its work.
    """
    started = [Node(package=one.package, executable=one.executable, output='screen') for one in programs]
    nodes = OpaqueFunction(function=lambda context: nodes_of(processes(*numbers(context, 'speed'))))
    return LaunchDescription([speed_argument(), nodes, *started])
