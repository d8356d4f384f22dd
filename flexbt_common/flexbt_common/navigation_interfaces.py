# SPDX-License-Identifier: BSD-3-Clause
"""Nav2's action and service types: from ``nav2_msgs`` where it is installed, otherwise ours of the same shape.

The leaves and the navigation servers choose by the same parameter, ``navigation_interfaces``: the package is
part of a type's name, so both sides have to make the same choice.
"""

from __future__ import annotations

import importlib
from typing import Any, Final

from ament_index_python.packages import get_packages_with_prefixes

from .errors import InterfacesError

CHOICES: Final = ('auto', 'nav2_msgs', 'flexbt_msgs')
"""Values of the parameter ``navigation_interfaces``. ``auto``: nav2_msgs where installed."""

ACTIONS: Final = (
    'AssistedTeleop',
    'BackUp',
    'ComputePathThroughPoses',
    'ComputePathToPose',
    'DriveOnHeading',
    'FollowPath',
    'NavigateThroughPoses',
    'NavigateToPose',
    'SmoothPath',
    'Spin',
    'Wait',
)
SERVICES: Final = (
    'ClearCostmapAroundPose',
    'ClearCostmapAroundRobot',
    'ClearCostmapExceptRegion',
    'ClearEntireCostmap',
    'IsPathValid',
)


class NavigationInterfaces:
    """The types of one package, as attributes: ``interfaces.FollowPath``. ``package`` is its name."""

    def __init__(self, package: str) -> None:
        self.package = package
        actions = importlib.import_module(f'{package}.action')
        services = importlib.import_module(f'{package}.srv')
        self._types = {name: getattr(actions, name) for name in ACTIONS}
        self._types |= {name: getattr(services, name) for name in SERVICES if hasattr(services, name)}

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__['_types'][name]
        except KeyError:
            raise AttributeError(f'{self.__dict__.get("package")} has no interface {name!r}') from None


def load(choice: str = 'auto') -> NavigationInterfaces:
    """The interfaces that the parameter ``navigation_interfaces`` asks for.

    Raises:
        InterfacesError: unknown choice, or a package that is not installed.
    """
    if choice not in CHOICES:
        raise InterfacesError(f"parameter 'navigation_interfaces': {choice!r} is not one of {', '.join(CHOICES)}")
    installed = get_packages_with_prefixes()
    if choice == 'auto':
        choice = 'nav2_msgs' if 'nav2_msgs' in installed else 'flexbt_msgs'
    if choice not in installed:
        raise InterfacesError(
            f"parameter 'navigation_interfaces': package {choice!r} is not installed; "
            f'install ros-jazzy-{choice.replace("_", "-")}, or choose auto'
        )
    return NavigationInterfaces(choice)
