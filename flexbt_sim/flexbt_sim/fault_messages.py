# SPDX-License-Identifier: BSD-3-Clause
"""What the simulator tells navigation servers of their faults: all that there are, as YAML, each as in a world file:
``[{fault: server_fails, parameters: {server: spin, error_code: 703}}]``.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any, Final

from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.values import check_limits
from flexbt_core.values import load_yaml, shown
from flexbt_sim.errors import SimulationError
from flexbt_sim.world import FaultModel, ServerFails, ServerFault, fault_parameters

_TYPES: Final[Mapping[str, str]] = {
    names.ASSISTED_TELEOP: 'AssistedTeleop',
    names.BACKUP: 'BackUp',
    names.COMPUTE_AND_TRACK_ROUTE: 'ComputeAndTrackRoute',
    names.COMPUTE_PATH_THROUGH_POSES: 'ComputePathThroughPoses',
    names.COMPUTE_PATH_TO_POSE: 'ComputePathToPose',
    names.COMPUTE_ROUTE: 'ComputeRoute',
    names.DOCK_ROBOT: 'DockRobot',
    names.DRIVE_ON_HEADING: 'DriveOnHeading',
    names.FOLLOW_PATH: 'FollowPath',
    names.SMOOTH_PATH: 'SmoothPath',
    names.SPIN: 'Spin',
    names.UNDOCK_ROBOT: 'UndockRobot',
    names.WAIT: 'Wait',
}
"""Those of nav2_msgs, by the names of the actions."""


def action_type(server: str) -> Any:
    """That of a navigation server. All of Nav2's actions are loaded only by who asks: it takes a while."""
    return getattr(importlib.import_module('nav2_msgs.action'), _TYPES[server])


def check_fault(parameters: FaultModel) -> None:
    """Look whether a fault of a server can be carried out; others always can, as far as this goes.

    Raises:
        SimulationError: its action does not know the error code.
    """
    if not isinstance(parameters, ServerFails):
        return
    result = action_type(parameters.server).Result
    codes = {
        name: value for name in dir(result) if name.isupper() and isinstance(value := getattr(result, name), int)
    } or {'NONE': 0}
    if parameters.error_code not in codes.values():
        known = ', '.join(f'{code} ({name})' for name, code in sorted(codes.items(), key=lambda one: one[1]))
        raise SimulationError(
            f'{parameters.name}: error_code: {parameters.server} does not know {parameters.error_code}; it has {known}'
        )


def faults_message(faults: Iterable[ServerFault]) -> String:
    """What is told of the faults that there are."""
    return String(data=json.dumps([{'fault': one.name, 'parameters': asdict(one)} for one in faults]))


def faults_of(message: String) -> list[ServerFault]:
    """The faults that there are.

    Raises:
        FlexbtError, YamlError: the message tells of none, or of what cannot be.
    """
    check_limits(message)
    value = load_yaml(message.data)
    if not isinstance(value, list):
        raise SimulationError(f'expected a list of faults, got {shown(value)}')
    return [_fault(one) for one in value]


def _fault(value: Any) -> ServerFault:
    match value:
        case {'fault': str(name), 'parameters': dict(parameters)}:
            fault = fault_parameters(name, parameters)
            check_fault(fault)
            if isinstance(fault, ServerFault):
                return fault
    raise SimulationError(f'expected {{fault: NAME, parameters: {{server: ACTION}}}}, got {shown(value)}')
