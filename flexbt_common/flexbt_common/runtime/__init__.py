# SPDX-License-Identifier: BSD-3-Clause
"""A node on rclpy: its executor and thread, its clock, its parameters, and how it ends."""

from .health import HANG_SECONDS, Hang, Health, Loop, Watched
from .ignored_participant import ignore_participant
from .latest_message import LatestMessage
from .node_runtime import CALL_SECONDS, DeepNode, NodeRuntime, run_node
from .parameters import ParameterDeclarer, refuse_while_configured
from .rclpy_private import (
    ACTION_CLIENT,
    ACTION_SERVER,
    OpenActionClient,
    OpenActionServer,
    is_usable,
    let_go_of_lifecycle,
)
from .received_messages import (
    UNKNOWN_NODE,
    UNKNOWN_WRITER,
    Received,
    ReceivedMessages,
    participant_of,
    tells_writers,
    writer_name,
)
from .resources import resolve_file
from .ros_clock import RosClock
from .sender_rates import SenderRates
from .simulated_time import HeardTime, hear_of_time_senders

__all__ = [
    'ACTION_CLIENT',
    'ACTION_SERVER',
    'CALL_SECONDS',
    'HANG_SECONDS',
    'UNKNOWN_NODE',
    'UNKNOWN_WRITER',
    'DeepNode',
    'Hang',
    'Health',
    'HeardTime',
    'LatestMessage',
    'Loop',
    'NodeRuntime',
    'OpenActionClient',
    'OpenActionServer',
    'ParameterDeclarer',
    'Received',
    'ReceivedMessages',
    'RosClock',
    'SenderRates',
    'Watched',
    'hear_of_time_senders',
    'ignore_participant',
    'is_usable',
    'let_go_of_lifecycle',
    'participant_of',
    'refuse_while_configured',
    'resolve_file',
    'run_node',
    'tells_writers',
    'writer_name',
]
