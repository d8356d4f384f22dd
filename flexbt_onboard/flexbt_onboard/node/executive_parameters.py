# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the executive node: declared, described and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_topic_name import validate_topic_name

from flexbt_common import names
from flexbt_common.errors import UnfitParameterError
from flexbt_common.files import USER_DIRECTORY
from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, PEER_TIMEOUT_TEXT
from flexbt_common.monitoring import declare_monitoring
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.state_machine.engine.engine import STOP_TIMEOUT
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.places import Place, load_places
from flexbt_core.values.text import short_repr
from flexbt_onboard.errors import OnboardError
from flexbt_onboard.persistence.event_log import EVENT_LOG_FILES, EVENT_LOG_SIZE
from flexbt_onboard.runs.motion_stop import MotionParameters

P = TypeVar('P', bound=MotionParameters)


@dataclass(frozen=True)
class ExecutiveParameters(MotionParameters):
    """The values of the parameters of the executive."""

    peers: tuple[str, ...] = parameter(
        'peers',
        (names.BT_SERVER, names.NAVIGATION, names.SIMULATOR, names.STOP_GUARD),
        'nodes that missions depend on; operators see their liveliness. A node of the default list is missed only '
        'after it was seen',
    )
    plan_topic: str = parameter(
        'plan_topic', names.PLAN, 'topic of the path that the robot follows (nav_msgs/msg/Path), for operators'
    )
    battery_topic: str = parameter(
        'battery_topic',
        names.BATTERY_STATE,
        'topic of the charge of the battery (sensor_msgs/msg/BatteryState), for conditions of the mission queue',
    )
    event_log_directory: str = parameter(
        'event_log_directory',
        '',
        'directory of the event log of commands, decisions and transitions; empty for none',
        is_fixed=True,
    )
    peer_timeout: float = parameter('peer_timeout', PEER_TIMEOUT, PEER_TIMEOUT_TEXT, 0.6, 3600.0)
    places: Mapping[str, Place] = field(default_factory=dict)
    heartbeat_period: float = parameter(
        'heartbeat_period', 0.5, 'seconds of wall time between two status messages while nothing changes', 0.05, 10.0
    )
    autonomy: int = parameter('autonomy', 1, 'autonomy level before the first run: 0 Off, 1 Low, 2 High, 3 Full', 0, 3)
    authority_timeout: float = parameter(
        'authority_timeout',
        30.0,
        'seconds of wall time without a console or command of its holder after which the authority is lost',
        0.5,
        3600.0,
    )
    stop_timeout: float = parameter(
        'stop_timeout',
        STOP_TIMEOUT,
        'seconds of wall time after which a stop that is not confirmed ends the run as an error',
        3.0,
        3600.0,
    )
    journal_directory: str = parameter(
        'journal_directory',
        '',
        'directory of the journal, to continue a run after a crash; empty for none',
        is_fixed=True,
    )
    event_log_size: int = parameter(
        'event_log_size',
        EVENT_LOG_SIZE,
        'bytes of a file of the event log before the next one is begun',
        1000,
        10**12,
        is_fixed=True,
    )
    event_log_files: int = parameter(
        'event_log_files', EVENT_LOG_FILES, 'files of the event log that are kept', 1, 1000, is_fixed=True
    )
    monitoring: Monitoring = field(default_factory=Monitoring)
    machine_directory: str = ''
    capability_directories: tuple[str, ...] = parameter(
        'capability_directories',
        (),
        'directories of capability files, which operators name without ".yaml" in a synthesis',
        is_fixed=True,
    )
    synthesis_memory: int = parameter(
        'synthesis_memory',
        4_000_000_000,
        'bytes of address space that the process of a synthesis may take',
        500_000_000,
        10**13,
        is_fixed=True,
    )

    @property
    def expects_peers(self) -> bool:
        """True if the peers were set. The default peers need not exist on this robot."""
        return self.peers != ExecutiveParameters.peers


def declare_parameters(node: Node) -> ExecutiveParameters:
    """Declare the parameters on the node and read them.

    See :mod:`flexbt_common.runtime.parameters` for the times at which they can be set.

    Raises:
        OnboardError, UnfitParameterError: a value is not allowed. The text has parameter and value.
    """
    declare = ParameterDeclarer(node)
    directory = f'{USER_DIRECTORY}/domain_{node.context.get_domain_id()}'
    found = _checked(declare.fields(ExecutiveParameters(event_log_directory=directory)))
    places = declare.fixed.text(
        'places',
        '',
        'YAML file of named places, {name: {x: 1.0, y: 2.0, yaw: 0.0}} in m and rad',
    )
    machine_directory = declare.fixed.text(
        'machine_directory',
        f'{found.event_log_directory}/machines' if found.event_log_directory else '',
        'directory of synthesized behaviors; empty for none (default: "machines" in that of the event log)',
    )
    return replace(
        found, places=_places(places), monitoring=declare_monitoring(declare), machine_directory=machine_directory
    )


def declare_motion(node: Node) -> MotionParameters:
    """Declare the parameters of a node that stops the robot, and read them.

    Raises:
        UnfitParameterError: a value is not allowed. The text has parameter and value.
    """
    return _checked(ParameterDeclarer(node).fields(MotionParameters()))


def _checked(parameters: P) -> P:
    """Return the parameters without duplicates in their lists. Raise UnfitParameterError for an invalid ROS name."""
    lists: dict[str, Any] = {}
    for one in fields(parameters):
        value = getattr(parameters, one.name)
        if one.name.endswith('_topic'):
            _require_name(one.name, value)
        elif one.name in ('peers', 'motion_actions'):
            for name in value:
                _require_name(one.name, name)
            lists[one.name] = tuple(dict.fromkeys(value))
    return replace(parameters, **lists)


def _require_name(parameter: str, name: str) -> None:
    try:
        validate_topic_name(name)
    except InvalidTopicNameException:
        why = 'is not a name in ROS 2; write letters, digits and _, with / between parts that begin with a letter'
        raise UnfitParameterError(parameter, f'{short_repr(name)} {why}') from None


def _places(file: str) -> dict[str, Place]:
    try:
        return load_places(Path(file)) if file else {}
    except ValueError as error:
        raise OnboardError(f'parameter places: {error}') from None
