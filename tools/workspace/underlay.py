# SPDX-License-Identifier: BSD-3-Clause
"""Which ROS 2 the workspace stands on: a sourced installation, or the wheels in a virtual environment."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from workspace.errors import WorkspaceError
from workspace.layout import Layout

WHEELS = ('jazzy', 'kilted')  # lock-NAME.txt has those of each; the first is the default
DISTRIBUTIONS = (*WHEELS, 'lyrical', 'rolling')  # those that may be sourced

# Lists of directories in which an environment names the places of a ROS installation.
_PATH_LISTS = (
    'AMENT_PREFIX_PATH',
    'CMAKE_PREFIX_PATH',
    'COLCON_PREFIX_PATH',
    'LD_LIBRARY_PATH',
    'PATH',
    'PKG_CONFIG_PATH',
    'PYTHONPATH',
)
# What would change the result of a build or of a test, and is not meant for this workspace.
_NOT_OURS = (
    'COLCON_CURRENT_PREFIX',
    'COLCON_DEFAULTS_FILE',
    'COLCON_HOME',
    'COLCON_LOG_PATH',
    'CMAKE_TOOLCHAIN_FILE',
    'MAKEFLAGS',
    'MAKELEVEL',
    'MFLAGS',
    'PIP_PREFIX',
    'PIP_TARGET',
    'PIP_USER',
    'PYTEST_ADDOPTS',
    'PYTHONHOME',
    'PYTHONSTARTUP',
    'PYTHONWARNINGS',
)
# What else the wheels (or an installation that is not wanted) leave behind.
_ROS_STATE = (
    '_ROS_WHEELS_BOOTSTRAP_COMPLETE',
    'RMW_IMPLEMENTATION',
    'ROS_DISTRO',
    'ROS_PYTHON_VERSION',
    'ROS_VERSION',
    'VIRTUAL_ENV',
)


@dataclass(frozen=True)
class Underlay:
    """The ROS that is built on. `prefix` is that of the sourced installation, or None for the wheels."""

    distribution: str
    prefix: Path | None = None

    @property
    def is_wheels(self) -> bool:
        return self.prefix is None

    def describe(self) -> str:
        return f'ROS 2 {self.distribution.capitalize()} ' + (
            'from PyPI wheels' if self.prefix is None else f'in {self.prefix}'
        )


def with_spaces(layout: Layout, environment: Mapping[str, str]) -> Layout:
    """Return `layout` with spaces of their own for the wheels that ROS_WHEELS names, unless those are the default.

    Raises WorkspaceError when there are no wheels of that name.
    """
    wheels = environment.get('ROS_WHEELS') or WHEELS[0]
    if wheels not in WHEELS:
        raise WorkspaceError(
            f'ROS_WHEELS={wheels}: there are no wheels of that ROS 2 distribution; known: {", ".join(WHEELS)}',
            'name one of these, or none and source a ROS 2 installation: ' + ', '.join(DISTRIBUTIONS),
        )
    return layout if wheels == WHEELS[0] else replace(layout, spaces=f'.{wheels}')


def detect(environment: Mapping[str, str], layout: Layout) -> Underlay:
    """Return the underlay that `environment` asks for: the wheels that ROS_WHEELS names, or what is sourced.

    A sourced installation is a directory on AMENT_PREFIX_PATH that has rclpy and is not a virtual environment:
    the wheels set ROS_DISTRO and AMENT_PREFIX_PATH too, those of this clone as well as those of another.

    Raises WorkspaceError when a distribution is sourced that is not supported.
    """
    if environment.get('ROS_WHEELS'):
        return Underlay(environment['ROS_WHEELS'])
    distribution = environment.get('ROS_DISTRO', '')
    if distribution not in ('', *DISTRIBUTIONS):
        raise WorkspaceError(
            f'ROS_DISTRO={distribution} is sourced in this shell; FlexBT is for ROS 2 {", ".join(DISTRIBUTIONS)}',
            f'use a new shell, with /opt/ros/{WHEELS[0]}/setup.bash sourced or (for the wheels) without any ROS',
        )
    for entry in environment.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        prefix = Path(entry)
        if not entry or _is_below(entry, layout.root) or (prefix / 'pyvenv.cfg').exists():
            continue
        if distribution and (prefix / 'share' / 'rclpy' / 'package.xml').exists():
            return Underlay(distribution, prefix)
    return Underlay(WHEELS[0])


def clean_environment(environment: Mapping[str, str], underlay: Underlay, layout: Layout) -> dict[str, str]:
    """`environment` without what does not belong to the workspace's own set-up.

    On an installation: without this workspace's own entries, which are to be built. On the wheels: without
    any installation, virtual environment or overlay that happens to be sourced.
    """
    result = {key: value for key, value in environment.items() if key not in _NOT_OURS}
    unwanted = [str(layout.root)]
    if underlay.is_wheels:
        for name in ('AMENT_PREFIX_PATH', 'COLCON_PREFIX_PATH'):
            unwanted += [entry for entry in environment.get(name, '').split(os.pathsep) if entry]
        if 'VIRTUAL_ENV' in environment:
            unwanted.append(environment['VIRTUAL_ENV'])
        for name in (*_ROS_STATE, 'PYTHONPATH'):
            result.pop(name, None)
    for name in _PATH_LISTS:
        if name in result:
            entries = [
                entry
                for entry in result[name].split(os.pathsep)
                if entry and not any(_is_below(entry, Path(place)) for place in unwanted)
            ]
            if entries:
                result[name] = os.pathsep.join(entries)
            else:
                del result[name]
    return result


def _is_below(entry: str, place: Path) -> bool:
    return Path(entry) == place or place in Path(entry).parents
