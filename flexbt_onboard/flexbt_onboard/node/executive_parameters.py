# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the executive node: declared, described and checked."""

from __future__ import annotations

from dataclasses import dataclass

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_topic_name import validate_topic_name

from flexbt_common.cli.user_files import USER_DIRECTORY
from flexbt_common.lifecycle.parameters import declare
from flexbt_common.runtime import names
from flexbt_onboard.errors import OnboardError
from flexbt_onboard.record.event_log import RECORD_FILES, RECORD_SIZE


@dataclass(frozen=True)
class ExecutiveParameters:
    """Values of the parameters; see :func:`declare_parameters` for what each means."""

    peers: tuple[str, ...] = (names.BT_SERVER, names.NAVIGATION, names.SIMULATOR)
    pose_topic: str = names.POSE
    heartbeat_period: float = 0.5
    autonomy: int = 1
    authority_timeout: float = 30.0
    journal_directory: str = ''
    record_directory: str = ''
    record_size: int = RECORD_SIZE
    record_files: int = RECORD_FILES


def declare_parameters(node: Node) -> ExecutiveParameters:
    """Declare the parameters on the node and read them;
    see :mod:`flexbt_common.lifecycle.parameters` for when they can be set.

    Raises:
        OnboardError, UnfitParameterError: a value is not acceptable; names parameter and value.
    """
    defaults = ExecutiveParameters()
    peers = declare(
        node,
        'peers',
        list(defaults.peers),
        ParameterDescriptor(
            description='names of the nodes that missions depend on; an operator sees whether they are alive and ready'
        ),
    )
    pose_topic = declare(
        node,
        'pose_topic',
        defaults.pose_topic,
        ParameterDescriptor(description='topic of the robot pose (geometry_msgs/msg/PoseStamped) for the status'),
    )
    heartbeat_period = declare(
        node,
        'heartbeat_period',
        defaults.heartbeat_period,
        ParameterDescriptor(
            description='seconds of wall time between two status messages while nothing changes',
            floating_point_range=[FloatingPointRange(from_value=0.05, to_value=10.0)],
        ),
    )
    autonomy = declare(
        node,
        'autonomy',
        defaults.autonomy,
        ParameterDescriptor(
            description='autonomy level before the first run: 0 Off, 1 Low, 2 High, 3 Full',
            integer_range=[IntegerRange(from_value=0, to_value=3, step=1)],
        ),
    )
    authority_timeout = declare(
        node,
        'authority_timeout',
        defaults.authority_timeout,
        ParameterDescriptor(
            description='seconds of wall time without a console or a command of the operator who has the authority, '
            'after which it is lost',
            floating_point_range=[FloatingPointRange(from_value=0.5, to_value=3600.0)],
        ),
    )
    journal_directory = declare(
        node,
        'journal_directory',
        defaults.journal_directory,
        ParameterDescriptor(
            description='directory of the journal, by which a run can go on after a crash of the executive; '
            'empty for none'
        ),
    )
    record_directory = declare(
        node,
        'record_directory',
        USER_DIRECTORY,
        ParameterDescriptor(
            description='directory of the record of commands, decisions and transitions; empty for no record'
        ),
    )
    record_size = declare(
        node,
        'record_size',
        defaults.record_size,
        ParameterDescriptor(
            description='bytes of a file of the record before the next one is begun',
            integer_range=[IntegerRange(from_value=1000, to_value=10**12)],
        ),
    )
    record_files = declare(
        node,
        'record_files',
        defaults.record_files,
        ParameterDescriptor(
            description='files of the record that are kept',
            integer_range=[IntegerRange(from_value=1, to_value=1000)],
        ),
    )
    try:
        validate_topic_name(pose_topic)
    except InvalidTopicNameException as error:
        raise OnboardError(f'parameter pose_topic: {pose_topic!r} is not a topic: {error}') from None
    wanted = tuple(dict.fromkeys(name for name in peers if name))
    for name in wanted:
        try:
            validate_topic_name(name)
        except InvalidTopicNameException as error:
            raise OnboardError(f'parameter peers: {name!r} is not the name of a node: {error}') from None
    return ExecutiveParameters(
        peers=wanted,
        pose_topic=str(pose_topic),
        heartbeat_period=float(heartbeat_period),
        autonomy=int(autonomy),
        authority_timeout=float(authority_timeout),
        journal_directory=str(journal_directory),
        record_directory=str(record_directory),
        record_size=int(record_size),
        record_files=int(record_files),
    )
