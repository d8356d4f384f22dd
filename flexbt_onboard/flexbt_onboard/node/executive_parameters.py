# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the executive node: declared, described and checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

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
from flexbt_core.state_machine.engine.run import STOP_TIMEOUT
from flexbt_core.values.places import Place, load_places
from flexbt_core.values.text import short_repr
from flexbt_onboard.errors import OnboardError
from flexbt_onboard.persistence.event_log import EVENT_LOG_FILES, EVENT_LOG_SIZE
from flexbt_onboard.runs.motion_stop import MOTION_ACTIONS


@dataclass(frozen=True)
class MotionParameters:
    """The ways to stop the robot without the nodes that drive it; see :func:`declare_motion` for what each means."""

    pose_topic: str = names.POSE
    motion_actions: tuple[str, ...] = MOTION_ACTIONS
    cmd_vel_topic: str = names.CMD_VEL
    stamped_cmd_vel: bool = False


@dataclass(frozen=True)
class ExecutiveParameters(MotionParameters):
    """Values of the parameters; see :func:`declare_parameters` for what each means."""

    peers: tuple[str, ...] = (names.BT_SERVER, names.NAVIGATION, names.SIMULATOR, names.STOP_GUARD)
    peer_timeout: float = PEER_TIMEOUT
    plan_topic: str = names.PLAN
    places: Mapping[str, Place] = field(default_factory=dict)
    heartbeat_period: float = 0.5
    autonomy: int = 1
    authority_timeout: float = 30.0
    stop_timeout: float = STOP_TIMEOUT
    journal_directory: str = ''
    event_log_directory: str = ''
    event_log_size: int = EVENT_LOG_SIZE
    event_log_files: int = EVENT_LOG_FILES
    monitoring: Monitoring = field(default_factory=Monitoring)
    machine_directory: str = ''
    capability_directories: tuple[str, ...] = ()
    synthesis_memory: int = 4_000_000_000

    @property
    def expects_peers(self) -> bool:
        """Return whether somebody has named the peers: those of the default need not be parts of this robot."""
        return self.peers != ExecutiveParameters.peers


def declare_parameters(node: Node) -> ExecutiveParameters:
    """Declare the parameters on the node and read them;
    see :mod:`flexbt_common.runtime.parameters` for when they can be set.

    Raises:
        OnboardError, UnfitParameterError: a value is not acceptable; names parameter and value.
    """
    defaults, declare = ExecutiveParameters(), ParameterDeclarer(node)
    peers = declare.texts(
        'peers',
        defaults.peers,
        'names of the nodes that missions depend on; an operator sees whether they are alive and ready. One of the '
        'default is missed only after it was seen',
    )
    for name in peers:
        _require_name('peers', name)
    plan_topic = declare.text(
        'plan_topic', defaults.plan_topic, 'topic of the path that the robot follows (nav_msgs/msg/Path), for operators'
    )
    _require_name('plan_topic', plan_topic)
    event_log_directory = declare.fixed.text(
        'event_log_directory',
        f'{USER_DIRECTORY}/domain_{node.context.get_domain_id()}',
        'directory of the event log of commands, decisions and transitions; empty for none',
    )
    return ExecutiveParameters(
        **vars(declare_motion(declare)),
        peers=tuple(dict.fromkeys(peers)),
        plan_topic=plan_topic,
        peer_timeout=declare.real('peer_timeout', defaults.peer_timeout, 0.6, 3600.0, PEER_TIMEOUT_TEXT),
        places=_places(
            declare.fixed.text(
                'places',
                '',
                'YAML file of the places that the robot knows by name, {name: {x: 1.0, y: 2.0, yaw: 0.0}} in m and rad',
            )
        ),
        heartbeat_period=declare.real(
            'heartbeat_period',
            defaults.heartbeat_period,
            0.05,
            10.0,
            'seconds of wall time between two status messages while nothing changes',
        ),
        autonomy=declare.integer(
            'autonomy',
            defaults.autonomy,
            0,
            3,
            'autonomy level before the first run: 0 Off, 1 Low, 2 High, 3 Full',
        ),
        authority_timeout=declare.real(
            'authority_timeout',
            defaults.authority_timeout,
            0.5,
            3600.0,
            'seconds of wall time without a console or a command of the operator who has the authority, '
            'after which it is lost',
        ),
        stop_timeout=declare.real(
            'stop_timeout',
            defaults.stop_timeout,
            3.0,
            3600.0,
            'seconds of wall time after a stop in which everything has to be confirmed at rest; '
            'a behavior that is not ends as an error then',
        ),
        journal_directory=declare.fixed.text(
            'journal_directory',
            defaults.journal_directory,
            'directory of the journal, by which a run can go on after a crash of the executive; empty for none',
        ),
        event_log_directory=event_log_directory,
        event_log_size=declare.fixed.integer(
            'event_log_size',
            defaults.event_log_size,
            1000,
            10**12,
            'bytes of a file of the event log before the next one is begun',
        ),
        event_log_files=declare.fixed.integer(
            'event_log_files', defaults.event_log_files, 1, 1000, 'files of the event log that are kept'
        ),
        monitoring=declare_monitoring(declare),
        machine_directory=declare.fixed.text(
            'machine_directory',
            f'{event_log_directory}/machines' if event_log_directory else '',
            'directory of the behaviors that were synthesized, for the next start; empty for none '
            '(default: "machines" in that of the event log)',
        ),
        capability_directories=declare.fixed.texts(
            'capability_directories',
            defaults.capability_directories,
            'directories of capability files, which operators name without ".yaml" in a synthesis',
        ),
        synthesis_memory=declare.fixed.integer(
            'synthesis_memory',
            defaults.synthesis_memory,
            500_000_000,
            10**13,
            'bytes of address space that the process of a synthesis may take',
        ),
    )


def declare_motion(declare: ParameterDeclarer) -> MotionParameters:
    """Declare the parameters of a node that stops the robot, and read them.

    Raises what :func:`declare_parameters` raises.
    """
    defaults = MotionParameters()
    pose_topic = declare.text(
        'pose_topic', defaults.pose_topic, 'topic of the robot pose (geometry_msgs/msg/PoseStamped)'
    )
    motion_actions = declare.texts(
        'motion_actions',
        defaults.motion_actions,
        'actions that move the robot: all of their goals are canceled when a stop is not confirmed in time',
    )
    cmd_vel_topic = declare.text(
        'cmd_vel_topic',
        defaults.cmd_vel_topic,
        'topic of the velocity commands, for zero velocity when a stop is not confirmed in time',
    )
    for parameter, values in (
        ('pose_topic', (pose_topic,)),
        ('motion_actions', motion_actions),
        ('cmd_vel_topic', (cmd_vel_topic,)),
    ):
        for name in values:
            _require_name(parameter, name)
    return MotionParameters(
        pose_topic=pose_topic,
        motion_actions=tuple(dict.fromkeys(motion_actions)),
        cmd_vel_topic=cmd_vel_topic,
        stamped_cmd_vel=declare.flag(
            'enable_stamped_cmd_vel', defaults.stamped_cmd_vel, 'velocity commands are TwistStamped instead of Twist'
        ),
    )


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
